"""Frames: what the runs hold, and every folder that is missing, partial, duplicate, foreign or damaged is named."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from lawful import edit_options
from synthetic import EPISODES, STEPS_AN_EPOCH

from curiobench.analysis import frames
from curiobench.analysis.folders import GRID_FORMAT
from curiobench.analysis.frames import EVALUATION_COLUMNS, RUN_COLUMNS, read_results
from curiobench.tasks.goals import goal_space


def test_frames_hold_the_runs(make_runs, tmp_path):
    make_runs(tasks=("stack3", "stack2"), methods=("pkg.mod:Mine+hm", "mihm", "a.b:C", "sac"), seeds=2, epochs=3)
    results = read_results([tmp_path / "runs"])
    assert results.faults == results.absent == ()
    runs = results.runs
    assert tuple(runs.columns) == RUN_COLUMNS
    assert [tuple(row) for row in runs[["task", "method", "seed"]].values] == [
        (task, method, seed)
        for task in ("stack2", "stack3")
        for method in ("sac", "mihm", "a.b:C", "pkg.mod:Mine+hm")
        for seed in (0, 1)
    ]
    first = runs.iloc[0]
    assert (first["run"], first["variant"], first["complete"], first["epoch"]) == ("stack2-sac-0", "", True, 3)
    assert (first["steps"], first["updates"], first["hours"]) == (3_000, 30, 3 * 36 / 3600)
    assert first["command"].startswith("curiobench train --task stack2 --method sac")
    assert json.loads(first["config"])["sac"]["gamma"] == 0.95

    rows = results.evaluations
    assert tuple(rows.columns) == EVALUATION_COLUMNS
    assert len(rows) == 8 * 4 * (4 + 35)
    of_run = rows[(rows["run"] == "stack3-mihm-1") & (rows["epoch"] == 2)]
    assert list(of_run["goal"]) == list(goal_space(3).names)
    assert set(of_run["steps"]) == {2 * STEPS_AN_EPOCH}
    assert set(of_run["episodes"]) == {EPISODES}
    assert list(of_run["bits"])[1] == "100000000"
    assert (of_run["learned"] == (of_run["success"] > 0.8)).all()

    progress = results.progress
    assert len(progress) == 8 * 2 * 3
    assert progress[progress["method"] == "sac"]["share_exploitation"].isna().all()
    assert progress[progress["method"] == "mihm"]["share_exploitation"].notna().all()


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
    edit_options(other, seed=5)
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
    (fault,) = results.absent
    assert str(tmp_path / "runs" / "grid.json") in fault
    assert message in fault
    assert results.faults == (fault,)


def test_partial_runs_are_left_out_unless_asked_for(make_runs, tmp_path):
    make_runs(methods=("sac",), seeds=2)
    (partial,) = make_runs(methods=("mihm",), seeds=1, complete=False)
    results = read_results([tmp_path / "runs"])
    assert results.faults == (f"{partial} is partial: it has no result.json; left out",)
    assert "mihm" not in set(results.runs["method"])
    results = read_results([tmp_path / "runs"], partial=True)
    assert results.faults == ()
    row = results.runs.iloc[-1]
    assert (row["method"], row["complete"], row["epoch"], row["epochs"]) == ("mihm", False, 4, 8)
    assert (row["updates"], row["hours"]) == (40, 4 * 36 / 3600)


def test_duplicates_are_named_and_the_first_is_kept(make_runs, tmp_path):
    first, second = make_runs(methods=("sac",), seeds=1) + make_runs(methods=("sac",), seeds=1, suffix="-again")
    edit_options(second, "machine", threads=8)
    edit_options(second, "hybrid", popart_rate=0.5)  # sac has none
    edit_options(second, schedule_epochs=7, preset="laptop")  # nor a schedule, and a preset is only a name
    # the same folder by several paths is no duplicate
    results = read_results([first, tmp_path / "runs", tmp_path / "runs" / ".." / "runs"])
    assert results.faults == (
        f"{second} is a duplicate of {first}: all options that affect results are equal; left out",
    )
    assert list(results.runs["run"]) == ["stack2-sac-0"]
    # a complete run is no duplicate of one that is damaged, nor of one that is partial
    (first / "result.json").unlink()
    assert list(read_results([tmp_path / "runs"]).runs["run"]) == ["stack2-sac-0-again"]
    assert list(read_results([tmp_path / "runs"], partial=True).runs["run"]) == ["stack2-sac-0-again"]


def test_runs_have_the_names_of_their_folders_and_more_where_these_are_equal(make_runs, tmp_path, monkeypatch):
    make_runs(methods=("sac",), seeds=1)
    (tmp_path / "runs").rename(tmp_path / "old")
    make_runs(methods=("sac",), seeds=1, options={"sac.tau": 0.1})
    results = read_results([tmp_path / "runs", tmp_path / "old"])
    assert sorted(results.runs["run"]) == ["old/stack2-sac-0", "runs/stack2-sac-0"]
    assert results.evaluations["run"].nunique() == 2
    monkeypatch.chdir(tmp_path / "old" / "stack2-sac-0")
    assert list(read_results([Path()]).runs["run"]) == ["stack2-sac-0"]


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


READ = """from pathlib import Path; from curiobench.analysis.frames import read_results
print(read_results([Path("runs")]).runs["method"][0])"""
HEAVY = ("torch", "mujoco", "dm_control")


@pytest.mark.parametrize(
    ("program", "absent", "printed"),
    [
        ("import curiobench; print(curiobench.analysis.available() != [])", (*HEAVY, "matplotlib", "pandas"), "True"),
        (READ, (*HEAVY, "matplotlib", "scipy.stats"), "os:getcwd+hm"),
        ("import curiobench.analysis.publish, curiobench.analysis.rules; print()", (*HEAVY, "matplotlib"), ""),
    ],
    ids=["available", "read_results", "publish"],
)
def test_slow_imports_and_methods_are_left_alone(make_runs, tmp_path, program, absent, printed):
    make_runs(methods=("os:getcwd+hm",), seeds=1)
    program = f"import sys\n{program}\nprint(sorted(set({absent}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [printed, "[]"]
