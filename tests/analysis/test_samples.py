"""Samples: the numbers of a method's runs as arrays, worked out by hand."""

from dataclasses import replace

import pytest
from synthetic import uneven

from curiobench.analysis.frames import read_results
from curiobench.analysis.samples import task_samples


def test_samples_hold_means_of_layers_and_last_success_of_goals(samples):
    task = samples(methods=("mihm", "sac"), seeds=2, success=uneven)
    assert [sample.method for sample in task.samples] == ["sac", "mihm"]
    assert task.sizes == {0: 4, 1: 2, 2: 2}
    mihm = task.samples[1]
    assert mihm.epochs.tolist() == [0, 1, 2, 3, 4]
    assert mihm.success[0, :, 0].tolist() == [0.25, 0.5, 0.75, 1, 1]
    assert mihm.success[1, :, 2].tolist() == [0, 0, 0, 0.5, 1]
    assert mihm.learned[0, :, 1].tolist() == [1, 2, 2, 2, 2]
    assert task.samples[0].goal_success.tolist() == [[1, 1, 1, 1], [1, 1, 1, 0]]
    assert mihm.area[0] == pytest.approx((0.125 + 0.5 + 0.75 + 1 + 0.5) / 4)
    assert task.steps_per_epoch == 1000


def test_goals_that_differ_within_a_task_are_an_error(make_runs):
    results = read_results(make_runs(seeds=2), every_goal=False)
    rows = results.evaluations
    lacking = rows[(rows["run"] != "stack2-mihm-1") | (rows["goal"] != "a on b")]
    with pytest.raises(ValueError, match="stack2-mihm-1 were not all evaluated on the goals of stack2-"):
        task_samples(replace(results, evaluations=lacking))
