"""Measures the numbers of docs/fidelity.md, writes the tables into it, and draws its pictures: `make fidelity`."""

import sys

import imageio.v3 as iio
import numpy as np
from sections import DOCS, markdown, write_section

TESTS = DOCS.parent / "tests"
sys.path[:0] = [str(TESTS / "tasks"), str(TESTS / "benchmarks")]

import fidelity  # noqa: E402
import test_stepping as stepping  # noqa: E402

from curiobench.tasks import ROBOTS, BatchedStacking, scripts  # noqa: E402
from curiobench.tasks.rendering import WorldRenderer  # noqa: E402

PICTURE_STEPS = (7, 15, 30, 47)
"""Steps of a scripted stack of three that the pictures show."""


def robots_table() -> str:
    """The measured facts of both robots as markdown."""
    rows = []
    measured = {robot: _robot_facts(robot) for robot in ROBOTS}
    for fact, paper in measured["fetch"].items():
        rows.append([fact, paper[0], measured["fetch"][fact][1], measured["gripper"][fact][1]])
    return markdown(["", "expected", "`fetch`", "`gripper`"], rows)


def _robot_facts(robot: str) -> dict[str, tuple[str, str]]:
    """What was measured: `{fact: (expected, value)}`."""
    start = BatchedStacking("stack3", 1, robot).observe().observation[0, :3]
    steps = 1e3 * fidelity.reach(robot)
    closing, opening = fidelity.finger_times(robot)
    held, still = fidelity.held_after_closing(robot)
    plain, biased = (fidelity.random_play(robot, biased=b, episodes=400) for b in (False, True))
    facts = {
        "grip at start (m)": ("1.3419, 0.7491, 0.5347", ", ".join(f"{x:.4f}" for x in start)),
        "reach in steps 1, 2, 3 at full action (mm)": ("29, 32, 32", ", ".join(f"{x:.1f}" for x in steps[:3])),
        "sag of an idle hand in 50 steps (mm)": ("about 8", f"{1e3 * fidelity.sag(robot):.1f}"),
        "steps to close from 0.03, to open to 0.04": ("about 3, 1-2", f"{closing}, {opening}"),
        "held blocks still held after 5 closing steps": ("≥ 98 %", f"{still:.1%} of {held}"),
        "random episodes that end with a predicate changed, plain": ("1-3 %", f"{plain['changed at the end']:.1%}"),
        "the same, biased starts": ("20-30 %", f"{biased['changed at the end']:.1%}"),
        "random steps outside the valid goals, plain": ("-", f"{plain['steps outside the valid goals']:.2%}"),
        "the same, biased starts ": ("-", f"{biased['steps outside the valid goals']:.2%}"),
    }
    for name in ("stack_two", "stack_three", "pyramid", "push_together", "push_off_table"):
        expected = "≥ 95 %" if name in fidelity.GOALS else "-"
        facts[f"script `{name}`: built and stays, 100 plain starts"] = (
            expected,
            f"{fidelity.script_success(name, robot):.0%}",
        )
    return facts


def open_loop_table() -> str:
    """The same open-loop actions on both robots, as markdown."""
    rows = []
    for steps in (10, 25, 50):
        distance, same, path = fidelity.open_loop(fidelity.random_actions(400, steps))
        free = fidelity.in_free_space(path)
        rows.append([f"uniform, {steps} steps, hand in free space", *_agreement(distance[-1, free], same[-1, free])])
        rows.append([f"uniform, {steps} steps, all", *_agreement(distance[-1], same[-1])])
    for name in fidelity.GOALS:
        distance, same, _ = fidelity.open_loop(fidelity.scripted_actions(name, 100))
        rows.append([f"`{name}` as played on the arm, 50 steps", *_agreement(distance[-1], same[-1])])
    return markdown(["actions", "cases", "median gap (mm)", "hands within 1 cm", "same predicates"], rows)


def _agreement(distance: np.ndarray, same: np.ndarray) -> list[str]:
    within = (distance < 0.01).mean()
    return [str(len(distance)), f"{1e3 * np.median(distance):.1f}", f"{within:.0%}", f"{same.mean():.0%}"]


def speed_table() -> str:
    """The stepping benchmark's ratios as markdown."""
    rows = [[name, f"{value:,.2f}" if value < 100 else f"{value:,.0f}"] for name, value in stepping.measure().items()]
    return markdown(["", "measured"], rows)


def draw(robot: str) -> None:
    """Four moments of a scripted stack of three, side by side."""
    worlds = BatchedStacking("stack3", 1, robot, seed=12)
    seen = worlds.reset()
    script, renderer, pictures = scripts.stack_three(), WorldRenderer(worlds.model, 420, 420), []
    for step in range(max(PICTURE_STEPS) + 1):
        seen, _ = worlds.step(script.act(seen.observation))
        if step in PICTURE_STEPS:
            pictures.append(renderer.render(worlds.qpos[0]).copy())
    renderer.close()
    iio.imwrite(DOCS / "images" / f"{robot}_stacks_three.png", np.hstack(pictures))


if __name__ == "__main__":
    page = DOCS / "fidelity.md"
    for name, table in (("robots", robots_table), ("open loop", open_loop_table), ("speed", speed_table)):
        write_section(page, name, table(), "make fidelity")
        print(f"measured: {name}", flush=True)
    for robot in ROBOTS:
        draw(robot)
