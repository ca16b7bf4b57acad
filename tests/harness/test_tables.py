"""Tables: every folder is in them or named."""

from tiny_runs import TINY

from curiobench.run_folder import RunFolder
from curiobench.tables import format_goals, format_layers, format_runs, summarise_runs


def evaluation(epoch, *learned):
    return [{"epoch": epoch, "layer": 1 + g // 2, "learned": bit, "goal": f"g{g}"} for g, bit in enumerate(learned)]


def test_finished_partial_empty_missing_and_foreign_runs(finished, tmp_path):
    partial, empty, foreign = tmp_path / "partial", tmp_path / "empty", tmp_path / "foreign"
    with RunFolder(partial, TINY, resume=False) as folder:
        folder.append("evaluations.csv", evaluation(0, 0, 0, 0, 0) + evaluation(2, 1, 1, 0, 1))
    RunFolder(empty, TINY, resume=False).close()
    foreign.mkdir()
    summaries, faults = summarise_runs([finished, partial, empty, tmp_path / "missing", foreign])
    assert [summary.path for summary in summaries] == [finished, partial]
    assert faults == [
        f"{empty}: there is no evaluation yet",
        f"{tmp_path / 'missing'} is no run folder: it does not exist",
        f"{foreign} is no run folder: it has no config.json",
    ]
    header, _, line = format_runs(summaries).splitlines()
    assert header.split() == ["run", "task", "method", "seed", "epoch", "layer", "1", "layer", "2", "total"]
    assert line.split() == [str(partial), "stack2", "sac", "0", "2", "of", "3", "2/2", "1/2", "3/4"]


def test_damaged_rows_are_named(finished, tmp_path):
    with RunFolder(tmp_path / "run", TINY, resume=False) as folder:
        folder.append("evaluations.csv", [{"epoch": 1, "success": 0.5}])
    assert summarise_runs([tmp_path / "run"]) == ([], [f"{tmp_path / 'run'}: 'layer'"])


def test_layers_and_goals_as_text():
    assert format_layers({1: (2, 8), 2: (10, 21)}) == (
        "layer  learned  goals\n1            2      8\n2           10     21\ntotal       12     29"
    )
    row = {"goal": "a on b", "bits": "110", "layer": 2, "success": 0.5, "success_unsatisfied": None, "learned": 0}
    assert format_goals([row]).splitlines()[1].split() == ["a", "on", "b", "110", "2", "0.50", "no"]
