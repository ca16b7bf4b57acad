"""One run folder: config and result are checked, and whatever is in its files, it is read or named in one line."""

import os

import numpy as np
import pytest
from lawful import edit_json

from curiobench.analysis import rows
from curiobench.analysis.frames import read_results

CONFIGS = [
    (lambda r: r.update(format="other run"), "format is 'other run'"),
    (lambda r: r.update(config_version=99), "its config has version 99; this curiobench reads version 1 only"),
    (lambda r: r.update(config=[]), "it holds no config"),
    (lambda r: r["config"].update(task="stack9"), "unknown task 'stack9'"),
    (lambda r: r["config"].update(robot=["gripper"]), "unknown robot"),
    (lambda r: r["config"].update(seed=True), "seed is True"),
    (lambda r: r["config"].update(epochs=0), "epochs is 0"),
    (lambda r: r["config"].update(method="<b>\n"), "method is '<b>\\n'"),
    (lambda r: r["config"].update(method=7), "method is 7"),
    (lambda r: r["config"].update(preset="a b"), "preset is 'a b'"),
]
RESULTS = [
    (lambda result: result.update(goals_learned=3), "result.json says goals_learned 3, evaluations.csv 0"),
    (lambda result: result.update(success=0.5), "result.json says success 0.5"),
    (lambda result: result.update(steps=1), "result.json says steps 1, evaluations.csv 4000"),
    (lambda result: result["learned_by_layer"]["2"].update(learned=2), "disagree in learned_by_layer"),
    (lambda result: result.update(epochs=3), "result.json records 3 epochs, config.json 4"),
    (lambda result: result.update(success="high"), "success is 'high'; it must be a number"),
    (lambda result: result.update(seconds=float("nan")), "seconds is nan; it must be a number"),
    (lambda result: result.pop("goals"), "goals is None; it must be a number"),
    (lambda result: result.update(updates=10**400), "it must be a number from 0 to 1e+15"),
    (lambda result: result.update(updates=7), "progress.csv: its last row has 40 updates, result.json 7"),
]


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [*(("config.json", *damage) for damage in CONFIGS), *(("result.json", *damage) for damage in RESULTS)],
)
def test_damage_is_named(make_runs, tmp_path, file, change, message):
    damaged, _ = make_runs(methods=("sac",), seeds=2, success=lambda *args: 0.2)
    edit_json(damaged / file, change)
    for progress in (True, False):
        results = read_results([tmp_path / "runs"], progress=progress)
        (fault,) = results.faults
        assert str(damaged) in fault
        assert message in fault
        assert "\n" not in fault
        assert list(results.runs["seed"]) == [1]


@pytest.mark.parametrize("name", ["config.json", "result.json", "evaluations.csv", "progress.csv"])
@pytest.mark.parametrize("kind", ["folder", "fifo", "nonsense", "missing"])
def test_unreadable_files_are_named(make_runs, tmp_path, name, kind):
    damaged, _ = make_runs(methods=("sac",), seeds=2)
    (damaged / name).unlink()
    if kind == "folder":
        (damaged / name).mkdir()
    elif kind == "fifo":
        os.mkfifo(damaged / name)
    elif kind == "nonsense":
        (damaged / name).write_bytes(b"\xff\xfe\0{[" * 50)
    for progress in (True, False):
        results = read_results([tmp_path / "runs"], progress=progress)
        (fault,) = results.faults
        assert str(damaged) in fault
        assert list(results.runs["seed"]) == [1]


def test_whatever_is_in_the_files_is_read_or_named(make_runs, tmp_path):
    """Bytes are changed at random: a run is kept or named, and nothing but that happens."""
    rng = np.random.default_rng(0)
    path, _ = make_runs(methods=("sac",), seeds=2, epochs=2)
    named = 0
    for trial in range(60):
        file = path / ("config.json", "result.json", "evaluations.csv", "progress.csv")[trial % 4]
        content = file.read_bytes()
        changed = bytearray(content)
        for place in rng.integers(0, len(content), 1 + trial % 5):
            changed[place] = rng.choice(list(b'\n,"0-9e.{}[\0\xff '))
        file.write_bytes(changed)
        results = read_results([tmp_path / "runs"], every_goal=bool(trial % 3))
        assert len(results.runs) + len(results.faults) == 2, results.faults
        named += len(results.faults)
        file.write_bytes(content)
    assert named > 30


def test_huge_files_are_not_read(make_runs, tmp_path):
    first, second = make_runs(methods=("sac",), seeds=2)
    for path in (first / "evaluations.csv", second / "config.json"):
        os.truncate(path, rows.MAX_CSV_BYTES + 1)  # takes no space on the disk
    results = read_results([tmp_path / "runs"])
    assert results.runs.empty
    assert "more than 1,073,741,824 bytes" in results.faults[0]
    assert "not a regular file, or larger than 16 MiB" in results.faults[1]


def test_recorded_texts_are_on_one_line_and_commands_joined(make_runs):
    (run,) = make_runs(methods=("sac",), seeds=1)
    edit_json(run / "config.json", lambda record: record.update(created="a\nb\x1b[31m", command=["x", "a\nb"]))
    edit_json(run / "result.json", lambda result: result.update(machine=["no text"]))
    row = read_results([run]).runs.iloc[0]
    assert (row["created"], row["command"], row["machine"]) == ("a b [31m", "x 'a b'", "")
    for lengthened, command in (([{"command": ["d"]}], "a 'b c' && d"), (["?"], "")):
        edit_json(
            run / "config.json", lambda record, own=lengthened: record.update(command=["a", "b c"], lengthened=own)
        )
        assert read_results([run]).runs.loc[0, "command"] == command
