"""Frames: what the runs hold, and every folder that is missing, partial, duplicate, foreign or damaged is named."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from lawful import edit_json
from synthetic import EPISODES, STEPS_AN_EPOCH

from curiobench.analysis import frames, rows
from curiobench.analysis.folders import GRID_FORMAT
from curiobench.analysis.frames import EVALUATION_COLUMNS, METHOD_ORDER, RUN_COLUMNS, place_of, read_results
from curiobench.analysis.runs import decisive
from curiobench.config import RunConfig
from curiobench.tasks.goals import goal_space


def one_fault(results):
    assert len(results.faults) == 1
    return results.faults[0]


def test_frames_hold_the_runs(make_runs, tmp_path):
    make_runs(tasks=("stack3", "stack2"), methods=("mihm", "sac", "pkg.mod:Mine+hm"), seeds=2, epochs=3)
    results = read_results([tmp_path / "runs"])
    assert results.faults == results.absent == ()
    runs = results.runs
    assert tuple(runs.columns) == RUN_COLUMNS
    assert [tuple(row) for row in runs[["task", "method", "seed"]].values] == [
        (task, method, seed)
        for task in ("stack2", "stack3")
        for method in ("sac", "mihm", "pkg.mod:Mine+hm")
        for seed in (0, 1)
    ]
    first = runs.iloc[0]
    assert (first["run"], first["variant"], first["complete"], first["epoch"]) == ("stack2-sac-0", "", True, 3)
    assert (first["steps"], first["updates"], first["hours"]) == (3_000, 30, 3 * 36 / 3600)
    assert first["command"].startswith("curiobench train --task stack2 --method sac")
    assert json.loads(first["config"])["sac"]["gamma"] == 0.95

    rows = results.evaluations
    assert tuple(rows.columns) == EVALUATION_COLUMNS
    assert len(rows) == 6 * 4 * (4 + 35)
    of_run = rows[(rows["run"] == "stack3-mihm-1") & (rows["epoch"] == 2)]
    assert list(of_run["goal"]) == list(goal_space(3).names)
    assert set(of_run["steps"]) == {2 * STEPS_AN_EPOCH}
    assert set(of_run["episodes"]) == {EPISODES}
    assert list(of_run["bits"])[1] == "100000000"
    assert (of_run["learned"] == (of_run["success"] > 0.8)).all()

    progress = results.progress
    assert len(progress) == 6 * 2 * 3
    assert progress[progress["method"] == "sac"]["share_exploitation"].isna().all()
    assert progress[progress["method"] == "mihm"]["share_exploitation"].notna().all()


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


def test_reading_less_reads_the_same(make_runs):
    paths = make_runs(tasks=("stack2", "stack3"))
    full, short = read_results(paths), read_results(paths, every_goal=False, progress=["share_exploitation"])
    assert short.layers.equals(full.layers)
    last = full.evaluations[full.evaluations["epoch"] == 4].reset_index(drop=True)
    assert short.evaluations.equals(last)
    columns = ["epoch", "steps", "updates", "share_exploitation", "seconds"]
    assert list(short.progress.columns)[5:] == columns
    assert set(short.progress["method"]) == {"mihm"}  # no other has the column
    known = full.progress[full.progress["method"] == "mihm"].reset_index(drop=True)
    pd.testing.assert_frame_equal(short.progress[columns], known[columns])
    assert read_results(paths, progress=False).progress.empty


def test_missing_and_foreign_folders_of_a_grid_are_named(make_runs, tmp_path):
    missing, other, _ = make_runs(methods=("sac", "rnd", "mihm"), seeds=1, grid=True)
    make_runs(methods=("icm",), seeds=1)
    (tmp_path / "runs" / "notes").mkdir()
    (tmp_path / "runs" / ".hidden").mkdir()
    (missing / "config.json").unlink()
    edit_json(other / "config.json", lambda record: record["config"].update(seed=5))
    results = read_results([tmp_path / "runs"])
    assert results.faults == (
        f"{missing} is missing: the grid's stack2 sac seed 0",
        f"{tmp_path / 'runs' / 'notes'} is foreign: it is not a run folder; left out",
        f"{tmp_path / 'runs' / 'stack2-icm-0'} is foreign: it is a run, but not one of the grid's; left out",
        f"{other} is foreign: it holds stack2 rnd seed 5, but grid.json expects stack2 rnd seed 0; left out",
    )
    assert results.absent == ()
    assert list(results.runs["method"]) == ["mihm"]


def grid_of(*cells):
    return json.dumps({"format": GRID_FORMAT, "cells": cells})


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ("[]", "it does not hold a JSON object"),
        ("[" * 100_000, "cannot read"),
        ("nonsense", "cannot read"),
        ("{}", "was not written by `curiobench grid`: format is None"),
        ('{"format": "curiobench grid"}', "has no list of cells"),
        (grid_of({"folder": 3}), "has a damaged cell"),
        *(
            (grid_of({"folder": folder, "task": "stack2", "method": "sac", "seed": 0}), "is a folder below the grid's")
            for folder in ("/etc", "../x", "a/../../x", "", "a\nb")
        ),
    ],
)
def test_a_damaged_grid_is_named(make_runs, tmp_path, grid, message):
    make_runs(seeds=1)
    (tmp_path / "runs" / "grid.json").write_text(grid)
    results = read_results([tmp_path / "runs"])
    assert results.runs.empty
    assert str(tmp_path / "runs" / "grid.json") in one_fault(results)
    assert message in one_fault(results)
    assert results.absent == results.faults


def test_partial_runs_are_left_out_unless_asked_for(make_runs, tmp_path):
    make_runs(methods=("sac",), seeds=2)
    (partial,) = make_runs(methods=("mihm",), seeds=1, complete=False)
    results = read_results([tmp_path / "runs"])
    assert one_fault(results) == f"{partial} is partial: it has no result.json; left out"
    assert "mihm" not in set(results.runs["method"])
    results = read_results([tmp_path / "runs"], partial=True)
    assert results.faults == ()
    row = results.runs.iloc[-1]
    assert (row["method"], row["complete"], row["epoch"], row["epochs"]) == ("mihm", False, 4, 8)
    assert (row["updates"], row["hours"]) == (40, 4 * 36 / 3600)


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
    assert one_fault(results) == f"{path / 'progress.csv'}: its last row is not all there, and left out"
    assert len(results.progress) == 3
    (path / "progress.csv").unlink()
    (path / "evaluations.csv").write_bytes(b"".join(rows[:5]))
    assert read_results([path], partial=True).runs["epoch"].tolist() == [0]


def test_duplicates_are_named_and_the_first_is_kept(make_runs, tmp_path):
    first, second = make_runs(methods=("sac",), seeds=1) + make_runs(methods=("sac",), seeds=1, suffix="-again")
    edit_json(second / "config.json", lambda record: record["config"]["machine"].update(threads=8))
    edit_json(second / "config.json", lambda record: record["config"]["hybrid"].update(popart_rate=0.5))  # sac has none
    results = read_results([tmp_path / "runs"])
    assert f"{second} is a duplicate of {first}: all options that affect" in one_fault(results)
    assert list(results.runs["run"]) == ["stack2-sac-0"]
    # a complete run is no duplicate of one that is damaged, nor of one that is partial
    (first / "result.json").unlink()
    assert list(read_results([tmp_path / "runs"]).runs["run"]) == ["stack2-sac-0-again"]
    assert list(read_results([tmp_path / "runs"], partial=True).runs["run"]) == ["stack2-sac-0-again"]


def test_the_same_folder_by_two_paths_is_no_duplicate(make_runs, tmp_path):
    first, *_ = make_runs()
    results = read_results([first, tmp_path / "runs", tmp_path / "runs" / ".." / "runs"])
    assert results.faults == ()
    assert len(results.runs) == 6


def test_runs_of_one_name_get_different_names(make_runs, tmp_path):
    make_runs(methods=("sac",), seeds=1)
    (tmp_path / "runs").rename(tmp_path / "old")
    make_runs(methods=("sac",), seeds=1, options={"sac.tau": 0.1})
    results = read_results([tmp_path / "runs", tmp_path / "old"])
    assert sorted(results.runs["run"]) == ["old/stack2-sac-0", "runs/stack2-sac-0"]
    assert results.evaluations["run"].nunique() == 2


def test_variants_name_the_options_that_differ(make_runs, tmp_path):
    make_runs(seeds=2)
    make_runs(methods=("mihm",), seeds=2, options={"sac.tau": 0.1, "method_config.hidden": 8}, suffix="-tau")
    runs = read_results([tmp_path / "runs"]).runs
    assert list(dict.fromkeys(zip(runs["method"], runs["variant"], strict=True))) == [
        ("sac", ""),
        ("mihm", "sac.tau=0.1, method.hidden=8"),
        ("mihm", "sac.tau=0.2, method.hidden=128"),
    ]


def test_a_preset_stands_for_its_options(make_runs, tmp_path):
    make_runs(methods=("sac",), seeds=1)
    smoke = {"preset": "smoke", "batch_size": 256, "worlds": 32}
    make_runs(methods=("sac",), seeds=1, options=smoke, suffix="-smoke")
    make_runs(methods=("sac",), seeds=1, options=smoke | {"robot": "fetch"}, suffix="-fetch")
    assert list(read_results([tmp_path / "runs"]).runs["variant"]) == [
        "preset=short",
        "preset=smoke, robot=fetch",
        "preset=smoke, robot=gripper",
    ]


def test_methods_from_outside_of_other_files_are_other_methods(make_runs, tmp_path):
    first, second = make_runs(methods=("pkg.mod:Mine",), seeds=2)
    edit_json(first / "config.json", lambda record: record["versions"].update(method_sha256="a" * 64))
    edit_json(second / "config.json", lambda record: record["versions"].update(method_sha256="b" * 64))
    variants = list(read_results([tmp_path / "runs"]).runs["variant"])
    assert variants == ["method_sha256=aaaaaaaa", "method_sha256=bbbbbbbb"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
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
    ],
)
def test_foreign_configs_are_named(make_runs, tmp_path, change, message):
    first, *_ = make_runs(seeds=1)
    edit_json(first / "config.json", change)
    results = read_results([tmp_path / "runs"])
    assert one_fault(results).startswith(str(first)) or str(first) in one_fault(results)
    assert message in one_fault(results)
    assert "\n" not in one_fault(results)
    assert list(results.runs["method"]) == ["mihm"]


def replaced(old, new, count=1):
    return lambda text: text.replace(old, new, count)


DAMAGE = {
    "half a last row": (lambda text: text[:-20], "its last row is cut off"),
    "empty": (lambda text: "", "the file is empty"),
    "only a header": (lambda text: text.splitlines()[0] + "\n", "there is no evaluation yet"),
    "no column success": (replaced(",success,", ",win,"), "it has no column success"),
    "success is missing": (replaced("25,0.0", "25,"), "its success is not always a number from 0 to 1"),
    "success is nan": (replaced("25,0.0", "25,nan"), "its success is not always a number from 0 to 1"),
    "success is infinite": (replaced("25,0.0", "25,inf"), "its success is not always a number from 0 to 1"),
    "success is above 1": (replaced("25,1.0", "25,1.5"), "its success is not always a number from 0 to 1"),
    "success is text": (replaced("25,0.0", "25,high"), "could not convert string to float: 'high'"),
    "a row is missing": (lambda text: "".join(text.splitlines(True)[:-1]), "an evaluation has 3 rows, expected 4"),
    "a row is there twice": (lambda text: text + text.splitlines(True)[-1], "an evaluation has 5 rows, expected 4"),
    "a goal is there twice": (replaced(",100,1,", ",000,1,"), "its goals are not those of stack2"),
    "a later goal is another": (
        lambda text: text[:-60] + text[-60:].replace(",101,", ",110,"),
        "must have the same goals and layers",
    ),
    "layer is another": (replaced(",100,1,", ",100,2,"), "its goals are not those of stack2"),
    "name is another": (lambda text: text[:-60] + text[-60:].replace("b on a", "a on b"), "needs one unique name"),
    "epochs fall": (replaced("\n3,", "\n1,", 4), "its epochs and steps do not rise"),
    "learned is wrong": (lambda text: text.rstrip()[:-1] + "1\n", "learned must be 1 where success > 0.8"),
    "too many episodes unsatisfied": (replaced(",25,0.6,25", ",25,0.6,26"), "episodes_unsatisfied from 0 to episodes"),
    "NUL bytes": (replaced(",000,1,", ",\0\0,1,"), ""),
}


@pytest.mark.parametrize("every_goal", [True, False])
@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_evaluations_are_named(make_runs, tmp_path, name, every_goal):
    damaged, _ = make_runs(methods=("sac",), seeds=2, success=lambda *args: [0.0, 0.4, 1.0, 0.6][args[-1]])
    change, message = DAMAGE[name]
    content = (damaged / "evaluations.csv").read_text()
    assert change(content) != content
    (damaged / "evaluations.csv").write_text(change(content))
    results = read_results([tmp_path / "runs"], every_goal=every_goal)
    assert one_fault(results).startswith(f"{damaged / 'evaluations.csv'}: ")
    assert message in one_fault(results)
    assert one_fault(results).endswith("; left out")
    assert list(results.runs["seed"]) == [1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-3], "its last row is cut off"),
        (lambda text: "".join(text.splitlines(True)[:-1]), "it has 3 rows for 4 epochs"),
        (replaced("\n2,", "\n3,"), "its epochs do not count from 1"),
        (replaced(",0.3,", ",high,"), "its column reward does not hold numbers"),
        (replaced("seconds", "time"), "it has no column seconds"),
        (replaced(",36.0\n", ",inf\n"), "its seconds are not all numbers that rise from 0"),
        (replaced(",36.0\n", ",-1\n"), "its seconds are not all numbers that rise from 0"),
        (replaced(",0.3,", ",inf,"), "its column reward has a number that is not finite"),
        (lambda text: text.splitlines()[0] + "\n", "it has no rows"),
    ],
)
def test_damaged_progress_is_named(make_runs, tmp_path, change, message):
    damaged, _ = make_runs(methods=("sac",), seeds=2)
    (damaged / "progress.csv").write_text(change((damaged / "progress.csv").read_text()))
    results = read_results([tmp_path / "runs"])
    assert one_fault(results) == f"{damaged / 'progress.csv'}: {message}; left out"
    assert list(results.runs["seed"]) == [1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
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
    ],
)
def test_a_result_that_disagrees_is_named(make_runs, tmp_path, change, message):
    damaged, _ = make_runs(methods=("sac",), seeds=2, success=lambda *args: 0.2)
    edit_json(damaged / "result.json", change)
    for progress in (True, False):
        results = read_results([tmp_path / "runs"], progress=progress)
        assert message in one_fault(results)
        assert str(damaged) in one_fault(results)
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
        assert str(damaged) in one_fault(results)
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


def test_paths_that_give_nothing_are_named(make_runs, tmp_path):
    (partial,) = make_runs(methods=("sac",), seeds=1, complete=False)
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    results = read_results([tmp_path / "none", tmp_path / "empty", tmp_path / "file", partial])
    assert results.runs.empty
    assert results.evaluations.empty
    assert results.absent == results.faults
    assert results.absent == (
        f"{tmp_path / 'none'} does not exist",
        f"{tmp_path / 'empty'} has no config.json, and neither has any folder in it",
        f"{tmp_path / 'file'} is a file, not a folder",
        f"{partial} is partial: it has no result.json; left out",
    )


@pytest.mark.parametrize("partial", [False, True])
def test_several_processes_read_what_one_reads(make_runs, tmp_path, monkeypatch, partial):
    """With every kind of folder among them: foreign, duplicate, damaged (also as a duplicate), and partial ones."""
    paths = make_runs(tasks=("stack2", "stack3"), methods=("sac", "icm+hm"), seeds=3, complete=False)
    for path in make_runs(methods=("rnd", "mihm"), seeds=3):
        shutil.copytree(path, path.with_name(f"x-{path.name}"))
    (tmp_path / "runs" / "notes").mkdir()
    for broken in (paths[0], paths[-1], tmp_path / "runs" / "stack2-rnd-1", tmp_path / "runs" / "x-stack2-mihm-2"):
        (broken / "evaluations.csv").write_text("epoch\n")
    (tmp_path / "runs" / "stack2-rnd-2" / "config.json").write_text("{")
    every = [tmp_path / "runs", paths[1], tmp_path / "none"]
    plain = read_results(every, partial)
    monkeypatch.setattr(frames, "FEWEST", 1)
    spread = read_results(every, partial, processes=3)
    assert (len(plain.runs), len(plain.faults)) == ((16, 10) if partial else (6, 20))
    assert (spread.faults, spread.absent, spread.config_files) == (plain.faults, plain.absent, plain.config_files)
    for name in ("runs", "evaluations", "layers", "progress"):
        pd.testing.assert_frame_equal(getattr(spread, name), getattr(plain, name), check_exact=True)


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


def test_order_of_methods():
    assert sorted(["zeta", "mi", "alpha", "mihm", "sac", "icm+hm"], key=place_of) == [
        *("sac", "mihm", "icm+hm", "mi", "alpha", "zeta")
    ]
    assert sorted(METHOD_ORDER[::-1], key=place_of) == list(METHOD_ORDER)


READ = """from pathlib import Path; from curiobench.analysis.frames import read_results
print(read_results([Path("runs")]).runs["method"][0])"""
REPORT = "sys.argv[1:] = ['report', 'runs']; from curiobench.cli import main\ntry: main()\nexcept SystemExit: pass"
HEAVY = ("torch", "mujoco", "dm_control")


@pytest.mark.parametrize(
    ("program", "absent", "printed"),
    [
        ("import curiobench; print(curiobench.analysis.available() != [])", (*HEAVY, "matplotlib", "pandas"), "True"),
        (READ, (*HEAVY, "matplotlib", "scipy.stats"), "os:getcwd+hm"),
        ("import curiobench.analysis.publish, curiobench.analysis.rules; print()", (*HEAVY, "matplotlib"), ""),
        (REPORT, HEAVY, "report.html"),
    ],
    ids=["available", "read_results", "publish", "report"],
)
def test_slow_imports_and_methods_are_left_alone(make_runs, tmp_path, program, absent, printed):
    make_runs(methods=("os:getcwd+hm",), seeds=1)
    program = f"import sys\n{program}\nprint(sorted(set({absent}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [printed, "[]"]


def test_a_run_has_its_folders_name_from_within(make_runs, monkeypatch):
    first, *_ = make_runs(seeds=1)
    monkeypatch.chdir(first)
    assert list(read_results([Path()]).runs["run"]) == [first.name]


def test_the_name_of_a_preset_alone_sets_no_run_apart(make_runs, tmp_path):
    for seed, preset in enumerate(("short", "laptop")):
        make_runs(methods=("icm",), seeds=[seed], options={"preset": preset}, suffix=f"-{preset}")
    assert list(read_results([tmp_path / "runs"]).runs["variant"]) == ["", ""]
    make_runs(methods=("icm",), seeds=[1], options={"preset": "short"}, suffix="-again")
    assert "is a duplicate of" in one_fault(read_results([tmp_path / "runs"]))


@pytest.mark.parametrize(("method", "same"), [("sac", True), ("mihm", False)])
def test_curiosity_s_schedule_makes_no_other_run_of_plain_sac(method, same):
    configs = [replace(RunConfig(method=method), schedule_epochs=epochs).to_json() for epochs in (56, 500)]
    assert (decisive(configs[0]) == decisive(configs[1])) is same
