"""Stepping many worlds against a bare loop of `mj_step`; run with `make benchmark`, on an idle machine."""

import pytest
from stepping import bare_step, batched_step, composer_step, measure, worlds_of


@pytest.mark.benchmark(group="one control step of 64 worlds, gripper")
@pytest.mark.parametrize("way", ["bare mj_step", "batched", "batched, two threads", "reset"])
def test_sixty_four_worlds(benchmark, way):
    worlds = worlds_of(n_threads=2 if "two" in way else 1)
    run = {"bare mj_step": bare_step, "reset": lambda w: lambda: w.reset()}.get(way, batched_step)(worlds)
    benchmark(run)


@pytest.mark.benchmark(group="one control step of one world")
@pytest.mark.parametrize("way", ["gripper, composer", "gripper, batched", "fetch, composer", "fetch, batched"])
def test_one_world(benchmark, way):
    robot, stepping = way.split(", ")
    benchmark(composer_step(robot) if stepping == "composer" else batched_step(worlds_of(robot, n_worlds=1)))


def test_targets(benchmark, capsys):
    """The issue's targets, each a ratio measured side by side. Two threads are judged only where two cores are idle."""
    measured = benchmark.pedantic(measure, rounds=1)
    with capsys.disabled():
        print("\n" + "\n".join(f"  {name}: {value:.2f}" for name, value in measured.items()))
    assert measured["batched / bare mj_step, gripper"] <= 1.2
    assert measured["reset of 64 worlds / control step of 64 worlds"] < 1
    assert measured["fetch / gripper, per world"] >= 5
