"""A registered task sets its scene, starts, goals, horizon and robots wherever it is used."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_runs import TINY

from curiobench.analysis.frames import read_results
from curiobench.analysis.report import pictures
from curiobench.tasks import TASKS, BatchedStacking, TaskSpec, load, registration, task_spec
from curiobench.tasks.gym_vector import SemanticStackVectorEnv
from curiobench.tasks.observation import observation_size
from curiobench.tasks.scene import TableArena
from curiobench.tasks.starts import sample_starts
from curiobench.training import train

PAGE = Path(__file__).parents[2] / "docs" / "tasks.md"


def flat(goals, layers):
    return layers == 1


def wide_table():
    arena = TableArena()
    arena.mjcf_model.find("geom", "table").size = (0.4, 0.6, 0.2)
    return arena


def wide_starts(rng, biased, n_blocks, probabilities):
    return sample_starts(rng, biased, n_blocks, probabilities, spread=0.3)


ODD = TaskSpec(
    name="odd-table",
    n_blocks=2,
    gym_id="curiobench/Odd-v0",
    robots=("gripper",),
    horizon=7,
    keeps=flat,
    arena=wide_table,
    starts=wide_starts,
)


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    monkeypatch.setitem(registration._BY_NAME, ODD.name, ODD)


def test_names_and_ids_are_unique():
    assert len({task_spec(task).gym_id for task in TASKS}) == len(registration._SPECS) == len(TASKS)


@pytest.mark.parametrize("task", [task for task in TASKS if not task_spec(task).is_slow_to_enumerate])
def test_the_page_of_the_tasks_has_the_numbers_of_each(task):
    spec = task_spec(task)
    heights = ", ".join(str(count) for count in np.bincount(spec.goal_space.layers)[1:])
    row = f"{len(spec.goal_space)} ({heights}) | {observation_size(spec.n_blocks)} | {spec.goal_space.n_bits} |"
    assert re.search(rf"^\| `{task}` \| [a-e ]+ \| {re.escape(row)}$", PAGE.read_text(), re.MULTILINE)


def test_worlds_have_the_scene_starts_and_goals():
    worlds = pickle.loads(pickle.dumps(BatchedStacking("odd-table", 64, seed=0)))
    np.testing.assert_allclose(worlds.model.geom("table").size, (0.4, 0.6, 0.2))
    offset = worlds.block_positions[..., :2] - worlds.observe().observation[:, None, :2]
    assert 0.25 < np.abs(offset).max() <= 0.301
    assert worlds.goal_space is ODD.goal_space
    assert worlds.goal_space.names == ("all apart", "all close")
    assert set(worlds.goal_space.indices(worlds.desired_goal)) == {0, 1}
    with pytest.raises(ValueError, match=r"110 is not one of the task's 2 goals"):
        worlds.goal_space.parse("110")


def test_episodes_end_at_the_horizon():
    environment = load("odd-table", random_state=0)
    environment.reset()
    steps = [environment.step(np.zeros(4)) for _ in range(7)]
    assert [step.last() for step in steps] == [False] * 6 + [True]
    assert steps[-1].discount == 1
    vector = SemanticStackVectorEnv(2, "odd-table")
    vector.reset(seed=0)
    assert [vector.step(np.zeros((2, 4), np.float32))[3].all() for _ in range(7)] == [False] * 6 + [True]


@pytest.mark.parametrize("make", [load, lambda task, robot: replace(TINY, task=task, robot=robot)])
def test_other_robots_are_refused(make):
    with pytest.raises(ValueError, match=r"odd-table does not take the robot 'fetch': its robots are gripper"):
        make("odd-table", "fetch")


def test_a_run_collects_and_evaluates_by_it(tmp_path):
    train(replace(TINY, task="odd-table"), tmp_path / "run")
    results = read_results([tmp_path / "run"])
    assert results.faults == ()
    assert results.runs.loc[0, "steps"] == TINY.epochs * TINY.cycles * TINY.worlds * 7
    assert set(results.evaluations["goal"]) == {"all apart", "all close"}
    assert all(picture["caption"].startswith("odd-table: ") for picture in pictures(results))
