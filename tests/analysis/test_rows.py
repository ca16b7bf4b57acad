"""Rows of a run: layers are means over goals, an unfinished last row is left out, and damage is named."""

import pytest

from curiobench.analysis.frames import read_results


def test_layers_are_means_over_goals(make_runs):
    results = read_results(make_runs(tasks=("stack3",), methods=("sac",), seeds=1))
    rows, layers = results.evaluations, results.layers
    for epoch in (0, 4):
        for layer in (0, 1, 2, 3):
            goals = rows[(rows["epoch"] == epoch) & ((rows["layer"] == layer) | (layer == 0))]
            found = layers[(layers["epoch"] == epoch) & (layers["layer"] == layer)].iloc[0]
            assert (found["goals"], found["learned"]) == (len(goals), goals["learned"].sum())
            assert found["success"] == pytest.approx(goals["success"].mean())
            assert found["success_unsatisfied"] == pytest.approx(goals["success_unsatisfied"].mean())


def test_a_run_at_work_may_be_cut_anywhere(make_runs):
    (path,) = make_runs(methods=("mihm",), seeds=1, complete=False)
    content = (path / "evaluations.csv").read_bytes()
    rows = content.splitlines(keepends=True)
    for end in range(len(b"".join(rows[:5])), len(content), 13):
        (path / "evaluations.csv").write_bytes(content[:end])
        results = read_results([path], partial=True)
        n_rows = content[:end].count(b"\n") - 1
        assert len(results.evaluations) == n_rows // 4 * 4
        assert len(results.faults) == (0 if content[:end] == b"".join(rows[: 1 + n_rows // 4 * 4]) else 1)
    (path / "evaluations.csv").write_bytes(content)
    progress = (path / "progress.csv").read_bytes()
    (path / "progress.csv").write_bytes(progress[:-3])
    results = read_results([path], partial=True)
    assert results.faults == (f"{path / 'progress.csv'}: its last row is not all there, and left out",)
    assert len(results.progress) == 3
    (path / "progress.csv").unlink()
    (path / "evaluations.csv").write_bytes(b"".join(rows[:5]))
    assert read_results([path], partial=True).runs["epoch"].tolist() == [0]


def replaced(old, new, count=1):
    return lambda text: text.replace(old, new, count)


def at_end(old, new):
    """Replaces in the rows of the last two goals of the last evaluation."""
    return lambda text: text[:-60] + text[-60:].replace(old, new)


EVALUATIONS = [
    (lambda text: text[:-20], "its last row is cut off"),
    (lambda text: "", "the file is empty"),
    (lambda text: text.splitlines()[0] + "\n", "there is no evaluation yet"),
    (replaced(",success,", ",win,"), "it has no column success"),
    (replaced("25,0.0", "25,"), "its success is not always a number from 0 to 1"),
    (replaced("25,0.0", "25,inf"), "its success is not always a number from 0 to 1"),
    (replaced("25,1.0", "25,1.5"), "its success is not always a number from 0 to 1"),
    (replaced(",24,0.0", ",24,1.5"), "its success_unsatisfied is not always a number from 0 to 1"),
    (replaced("25,0.0", "25,high"), "could not convert string to float: 'high'"),
    (lambda text: "".join(text.splitlines(True)[:-1]), "an evaluation has 3 rows, expected 4"),
    (lambda text: text + text.splitlines(True)[-1], "an evaluation has 5 rows, expected 4"),
    (replaced(",100,1,", ",000,1,"), "its goals are not those of stack2"),
    (at_end(",101,", ",110,"), "must have the same goals and layers"),
    (replaced(",100,1,", ",100,2,"), "its goals are not those of stack2"),
    (at_end("b on a", "a on b"), "needs one unique name"),
    (replaced("\n3,", "\n1,", 4), "its epochs and steps do not rise"),
    (lambda text: text.rstrip()[:-1] + "1\n", "learned must be 1 where success > 0.8"),
    (replaced(",25,0.6,25", ",25,0.6,26"), "episodes_unsatisfied from 0 to episodes"),
    (replaced(",000,1,", ",\0\0,1,"), ""),
]
PROGRESS = [
    (lambda text: text[:-3], "its last row is cut off"),
    (lambda text: "".join(text.splitlines(True)[:-1]), "it has 3 rows for 4 epochs"),
    (replaced("\n2,", "\n3,"), "its epochs do not count from 1"),
    (replaced(",0.3,", ",high,"), "its column reward does not hold numbers"),
    (replaced("seconds", "time"), "it has no column seconds"),
    (replaced(",36.0\n", ",inf\n"), "its seconds are not all numbers that rise from 0"),
    (replaced(",36.0\n", ",-1\n"), "its seconds are not all numbers that rise from 0"),
    (replaced(",0.3,", ",inf,"), "its column reward has a number that is not finite"),
    (lambda text: text.splitlines()[0] + "\n", "it has no rows"),
]


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [*(("evaluations.csv", *damage) for damage in EVALUATIONS), *(("progress.csv", *damage) for damage in PROGRESS)],
)
def test_damage_is_named(make_runs, tmp_path, file, change, message):
    damaged, _ = make_runs(methods=("sac",), seeds=2, success=lambda *args: [0.0, 0.4, 1.0, 0.6][args[-1]])
    content = (damaged / file).read_text()
    assert change(content) != content
    (damaged / file).write_text(change(content))
    for every_goal in (True, False):
        results = read_results([tmp_path / "runs"], every_goal=every_goal)
        (fault,) = results.faults
        assert fault.startswith(f"{damaged / file}: ")
        assert message in fault
        assert fault.endswith("; left out")
        assert list(results.runs["seed"]) == [1]
