"""What the stepping benchmarks run: one control step of some worlds, done in different ways.

`python tests/benchmarks/stepping.py` prints the ratios as a markdown table.
"""

from collections.abc import Callable

import mujoco
import numpy as np
from side_by_side import ratio, side_by_side

from curiobench.tasks import BatchedStacking, load

N_WORLDS = 64
WARM_UP_STEPS = 10
"""Steps of random play before anything is timed, so that some hands touch something."""


def played_worlds(robot: str = "gripper", n_worlds: int = N_WORLDS, n_threads: int = 1) -> BatchedStacking:
    """Worlds in the middle of random play."""
    worlds = BatchedStacking("stack3", n_worlds, robot, n_threads=n_threads, seed=0)
    worlds.reset(biased=True)
    rng = np.random.default_rng(0)
    for _ in range(WARM_UP_STEPS):
        worlds.step(rng.uniform(-1, 1, (n_worlds, 4)))
    return worlds


def batched_step(worlds: BatchedStacking) -> Callable[[], object]:
    """One control step of all worlds, always from the same states with the same actions."""
    state = worlds._state.copy()
    actions = np.random.default_rng(1).uniform(-1, 1, (worlds.n_worlds, 4))

    def run() -> object:
        worlds._state[:] = state
        return worlds.step(actions)

    return run


def bare_step(worlds: BatchedStacking) -> Callable[[], object]:
    """The floor: `mj_step` in a bare loop over the same states with the same commands, nothing observed."""
    model, data = worlds.model, mujoco.MjData(worlds.model)
    bound, state = worlds._bound, worlds._state.copy()
    actions = np.random.default_rng(1).uniform(-1, 1, (worlds.n_worlds, 4))
    command = bound.command(worlds.qpos, worlds._qvel, actions)
    state_spec, control_spec = mujoco.mjtState.mjSTATE_FULLPHYSICS, bound.hand.control_spec

    def run() -> None:
        for world in range(worlds.n_worlds):
            mujoco.mj_setState(model, data, state[world], state_spec)
            mujoco.mj_setState(model, data, command[world], control_spec)
            data.qacc_warmstart[:] = 0
            mujoco.mj_step(model, data, bound.n_substeps)

    return run


def composer_step(robot: str = "gripper") -> Callable[[], object]:
    """One control step of the composer environment: one world."""
    environment = load("stack3", robot, biased=True, random_state=0)
    environment.reset()
    rng = np.random.default_rng(0)
    for _ in range(WARM_UP_STEPS):
        environment.step(rng.uniform(-1, 1, 4))
    action = rng.uniform(-1, 1, 4)
    return lambda: environment.step(action)


def measure(rounds: int = 25) -> dict[str, float]:
    """All ratios of the issue's targets, and control steps a second; per world where the numbers of worlds differ."""
    worlds, arms = played_worlds(), played_worlds("fetch", n_worlds=8)
    resettable = played_worlds()
    seconds = side_by_side(
        {
            "floor": bare_step(worlds),
            "batched": batched_step(worlds),
            "two threads": batched_step(played_worlds(n_threads=2)),
            "reset": lambda: resettable.reset(),
            "composer": composer_step(),
            "fetch": batched_step(arms),
            "fetch floor": bare_step(arms),
        },
        rounds,
    )
    return {
        "batched / bare mj_step, gripper": ratio(seconds, "batched", "floor"),
        "batched / bare mj_step, fetch": ratio(seconds, "fetch", "fetch floor"),
        "one thread / two threads": ratio(seconds, "batched", "two threads"),
        "reset of 64 worlds / control step of 64 worlds": ratio(seconds, "reset", "batched"),
        "composer / batched, per world": ratio(seconds, "composer", "batched") * N_WORLDS,
        "fetch / gripper, per world": ratio(seconds, "fetch", "batched") * N_WORLDS / arms.n_worlds,
        "gripper, control steps a second on one core": N_WORLDS / float(np.median(seconds["batched"])),
        "fetch, control steps a second on one core": arms.n_worlds / float(np.median(seconds["fetch"])),
    }


if __name__ == "__main__":
    print("| what | measured |\n|---|---|")
    for name, value in measure().items():
        print(f"| {name} | {value:,.2f} |" if value < 100 else f"| {name} | {value:,.0f} |")
