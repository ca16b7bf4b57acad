"""Stepping many worlds beside a bare loop of `mj_step`; run with `make benchmark`, on an idle machine."""

import itertools
from collections.abc import Callable

import mujoco
import numpy as np
from side_by_side import ratio, side_by_side

from curiobench.tasks import BatchedStacking, load
from curiobench.tasks.spec import EPISODE_STEPS

N_WORLDS = 64
EVERY = 7
"""Steps of random play between the moments that are timed, which are spread over a whole episode."""


def worlds_of(robot: str = "gripper", n_worlds: int = N_WORLDS, n_threads: int = 1) -> BatchedStacking:
    """Worlds of three blocks, half of which start biased."""
    return BatchedStacking("stack3", n_worlds, robot, n_threads=n_threads, seed=0)


def moments(worlds: BatchedStacking) -> list[tuple[np.ndarray, np.ndarray]]:
    """States `(N, nstate)` and actions `(N, 4)` at moments of random play."""
    worlds.reset(biased=np.arange(worlds.n_worlds) % 2 == 0)
    rng = np.random.default_rng(0)
    recorded = []
    for step in range(EPISODE_STEPS):
        actions = rng.uniform(-1, 1, (worlds.n_worlds, 4))
        if step % EVERY == 0:
            recorded.append((worlds._state.copy(), actions))
        worlds.step(actions)
    return recorded


def batched_step(worlds: BatchedStacking) -> Callable[[], object]:
    """One control step of all worlds, observed."""
    played = itertools.cycle(moments(worlds))

    def run() -> object:
        worlds._state[:], actions = next(played)
        return worlds.step(actions)

    return run


def bare_step(worlds: BatchedStacking) -> Callable[[], object]:
    """The floor: `mj_step` in a bare loop over the same states with the same commands, nothing observed."""
    model, data, bound = worlds.model, mujoco.MjData(worlds.model), worlds._bound
    nq = model.nq
    commands = [(s, bound.command(s[:, 1 : 1 + nq], s[:, 1 + nq :], a)) for s, a in moments(worlds)]
    played = itertools.cycle(commands)
    state_spec, control_spec = mujoco.mjtState.mjSTATE_FULLPHYSICS, bound.hand.control_spec

    def run() -> None:
        state, command = next(played)
        for world in range(worlds.n_worlds):
            mujoco.mj_setState(model, data, state[world], state_spec)
            mujoco.mj_setState(model, data, command[world], control_spec)
            data.qacc_warmstart[:] = 0
            mujoco.mj_step(model, data, bound.n_substeps)

    return run


def composer_step(robot: str = "gripper") -> Callable[[], object]:
    """One control step of the composer environment, in random play: one world."""
    environment = load("stack3", robot, biased=True, random_state=0)
    rng = np.random.default_rng(0)
    return lambda: environment.step(rng.uniform(-1, 1, 4))


def measure(rounds: int = 32) -> dict[str, float]:
    """Ratios of times, per world where the numbers of worlds differ, and control steps a second."""
    worlds, arms = worlds_of(), worlds_of("fetch", n_worlds=16)
    resettable = worlds_of()
    seconds = side_by_side(
        {
            "floor": bare_step(worlds),
            "batched": batched_step(worlds),
            "reset": resettable.reset,
            "composer": composer_step(),
            "fetch": batched_step(arms),
            "fetch floor": bare_step(arms),
        },
        rounds,
    )
    # apart from the rest, so that both find their worlds in the cache, as in training
    threads = side_by_side({"one": batched_step(worlds_of()), "two": batched_step(worlds_of(n_threads=2))}, rounds)
    return {
        "batched / bare mj_step, gripper": ratio(seconds, "batched", "floor"),
        "batched / bare mj_step, fetch": ratio(seconds, "fetch", "fetch floor"),
        "one thread / two threads": ratio(threads, "one", "two"),
        "reset of 64 worlds / control step of 64 worlds": ratio(seconds, "reset", "batched"),
        "composer / batched, per world": ratio(seconds, "composer", "batched") * N_WORLDS,
        "fetch / gripper, per world": ratio(seconds, "fetch", "batched") * N_WORLDS / arms.n_worlds,
        "gripper, control steps a second on one core": N_WORLDS / float(np.median(seconds["batched"])),
        "fetch, control steps a second on one core": arms.n_worlds / float(np.median(seconds["fetch"])),
    }


def test_targets(benchmark, capsys):
    """Each is a ratio measured side by side."""
    measured = benchmark.pedantic(measure, rounds=1)
    with capsys.disabled():
        print("\n" + "\n".join(f"  {name}: {value:.2f}" for name, value in measured.items()))
    assert measured["batched / bare mj_step, gripper"] <= 1.2
    assert measured["reset of 64 worlds / control step of 64 worlds"] < 1
    assert measured["fetch / gripper, per world"] >= 5
