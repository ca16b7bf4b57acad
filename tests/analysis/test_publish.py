"""Published sets: what is read back is what was run; nothing is lost, invented or left half-written."""

import gzip
import hashlib
import json
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from lawful import edit_options, edit_rows, edit_versions, lengthen

import curiobench
from curiobench.analysis import folders, load
from curiobench.analysis import publish as module
from curiobench.analysis.folders import CONFIGS, PUBLISHED_FILES, SUMS, available, check_sums, read_sums
from curiobench.analysis.frames import read_results
from curiobench.analysis.publish import publish

ROOT = Path(__file__).parents[2]
SETS = sorted(path for path in (ROOT / "results").glob("v*") if path.is_dir())


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves out tables, figures and report, which take seconds."""
    monkeypatch.setattr(module, "derive", lambda folder: None)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "sets" / "v1"


def files(folder):
    """Content of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_equal(one, other):
    for name in ("runs", "evaluations", "layers", "progress"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(other, name), check_exact=True, obj=name)


def test_frames_read_back_are_those_of_the_run_folders(make_runs, out, undrawn):
    runs = make_runs(tasks=("stack2", "stack3"), methods=("sac", "mihm", "pkg.mod:Class+hm"), seeds=2)
    runs += make_runs(seeds=1, options={"sac.tau": 0.1}, suffix="-tau")
    runs += make_runs(methods=["pkg.mod:Class+hm"], seeds=2, suffix="-later")
    runs.append(ROOT / "results" / "agent" / "biased" / "stack2-sac-2")
    for run in runs[-3:-1]:
        edit_versions(run, method_sha256="ab" * 32)
    publish(runs, out)
    results = read_results(runs)
    assert_equal(load(out), results)
    publish([out], out.with_name("v2"))
    assert_equal(load(out.with_name("v2")), results)
    again = read_results([out, out, *runs])
    assert len(again.runs) == len(results.runs)
    assert len(again.faults) == len(runs)
    assert all("is a duplicate of" in fault for fault in again.faults)
    short, last = read_results([out], every_goal=False).evaluations, results.evaluations.groupby("run", observed=True)
    assert len(short) == sum(rows["epoch"].eq(rows["epoch"].max()).sum() for _, rows in last)


def test_configs_sums_and_bytes(make_runs, out, undrawn):
    runs = make_runs(seeds=1)
    publish(runs, out)
    for run in runs:
        assert (out / CONFIGS / f"{run.name}.json").read_bytes() == (run / "config.json").read_bytes()
    subprocess.run(["sha256sum", "--check", "--strict", "--quiet", SUMS], cwd=out, check=True)
    assert {*read_sums(out), SUMS} == {*files(out)}
    assert gzip.decompress((out / "evaluations.csv.gz").read_bytes()).startswith(b"run,task,method,variant,seed,epoch")
    publish(runs, out.with_name("v2"))
    assert files(out.with_name("v2")) == files(out)


def test_names_that_pandas_reads_as_missing_are_names(make_runs, out, undrawn):
    """A run folder may be called NA or nan."""
    runs = make_runs(methods=("sac",), seeds=3)
    publish([run.rename(run.with_name(name)) for run, name in zip(runs, ("NA", "nan", "null"), strict=True)], out)
    assert sorted(load(out).runs["run"]) == ["NA", "nan", "null"]


def rising(task, method, seed, epoch, goal):
    return min(1, (epoch + seed) / 10)


def test_a_lengthened_run_replaces_the_shorter_one(make_runs, tmp_path, out, undrawn):
    short = make_runs(seeds=2, success=rising)
    publish(short, out)
    (tmp_path / "runs").rename(tmp_path / "before")
    longer = make_runs(methods=("sac",), seeds=1, epochs=7, success=rising)
    publish([out, *longer], out)
    runs = load(out).runs.set_index("run")
    assert runs["epoch"].to_dict() == {run.name: 7 if run.name == "stack2-sac-0" else 4 for run in short}
    publish([*longer, tmp_path / "before"], out.with_name("v2"))
    assert_equal(load(out.with_name("v2")), load(out))
    with pytest.raises(ValueError, match=r"its run stack2-sac-0 would get other numbers"):
        publish([tmp_path / "before"], out)
    other = make_runs(methods=("sac",), seeds=1, epochs=7, suffix="-other")  # its first rows have other numbers
    Path(shutil.copytree(other[0], out.parents[1] / "other" / "stack2-sac-0"))
    with pytest.raises(ValueError, match=r"needs a unique name"):
        publish([tmp_path / "before", out.parents[1] / "other"], out.with_name("v3"))


def test_what_is_derived_is_there(make_runs, out, cli):
    make_runs()
    code, printed, _ = cli("publish", out.parents[1] / "runs", "--out", out)
    assert code == 0
    first, *_, last, lacking = printed.splitlines()
    assert (first, last) == (f"{out / 'runs.csv'}: 6 rows", str(out / "report.html"))
    assert lacking == "no agent of stack2 sac, stack2 mihm: runs without a checkpoint"
    suffixes = {path.suffix for path in (out / "tables").iterdir()}
    assert suffixes == {".txt", ".md", ".tex", ".csv"}
    assert (out / "figures" / "stack2-learning-curves.pdf").stat().st_size > 1000
    assert "<html" in (out / "report.html").read_text()[:200]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda run: (run / "result.json").unlink(), "stack2-sac-0 is partial"),
        (lambda run: (run.parent / "notes").mkdir(), "notes is foreign"),
        (lambda run: shutil.copytree(run, run.with_name("again")), "again is foreign"),
        (shutil.rmtree, "stack2-sac-0 is missing"),
    ],
)
def test_refuses_incomplete_grids(make_runs, out, undrawn, spoil, message):
    run, *_ = make_runs(seeds=2, grid=True)
    spoil(run)
    with pytest.raises(ValueError, match=rf"^not published: .*{message}"):
        publish([run.parent], out)
    assert not out.parent.exists()


def test_refuses_duplicates_and_the_same_name_twice(make_runs, out, undrawn):
    runs = make_runs(seeds=1)
    copy = Path(shutil.copytree(runs[0], out.parents[1] / "other" / runs[0].name))
    with pytest.raises(ValueError, match="is a duplicate of"):
        publish([*runs, copy], out)
    edit_options(copy, seed=7)
    with pytest.raises(ValueError, match="needs a unique name"):
        publish([*runs, copy], out)
    with pytest.raises(ValueError, match="name at least one run folder"):
        publish([], out)


def test_refuses_code_that_is_no_commit_unless_allowed(make_runs, out, undrawn):
    runs = make_runs(seeds=1)
    edit_versions(runs[0], git_commit="c0ffee-dirty")
    edit_versions(runs[1], git_commit=None)
    with pytest.raises(ValueError, match=r"sac-0 .* changes \(commit c0ffee-dirty\); .*mihm-0 .* an unknown"):
        publish(runs, out)
    edit_versions(runs[0], git_commit="c0ffee")
    lengthen(runs[0], git_commit="badcafe-dirty")
    edit_versions(runs[1], git_commit="c0ffee")
    lengthen(runs[1], git_commit=None)
    with pytest.raises(ValueError, match=r"sac-0 .* changes \(commit c0ffee badcafe-dirty\); .*from an unknown"):
        publish(runs, out)
    assert not out.exists()
    publish(runs, out, allow_dirty=True)
    assert len(load(out).runs) == 2


def test_keeps_other_files_and_all_published_runs(make_runs, out, undrawn):
    runs = make_runs(seeds=2)
    out.mkdir(parents=True)
    (out / "README.md").write_text("by hand")
    publish(runs[:3], out)
    (out / "notes").mkdir()
    (out / "notes" / "a.txt").write_text("kept")
    publish(runs, out)
    assert len(load(out).runs) == 4
    assert (out / "README.md").read_text() + (out / "notes" / "a.txt").read_text() == "by handkept"
    before = files(out)
    with pytest.raises(ValueError, match="stack2-mihm-1 would be lost; overwrite with --replace"):
        publish(runs[:3], out)
    edit_rows(runs[0] / "evaluations.csv", lambda rows: rows.assign(steps=rows["steps"] + (rows["epoch"] == 1)))
    with pytest.raises(ValueError, match="its run stack2-sac-0 would get other numbers; overwrite with --replace"):
        publish(runs, out)
    assert files(out) == before
    publish(runs[:3], out, replace=True)
    assert len(load(out).runs) == 3


def test_replaces_nothing_but_a_published_set(make_runs, out, undrawn, tmp_path):
    runs = make_runs(seeds=1)
    for place in (tmp_path / "runs", runs[0] / "config.json"):
        before = files(tmp_path)
        with pytest.raises(ValueError, match="is not a published set"):
            publish(runs, place)
        assert files(tmp_path) == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("precious")
    with pytest.raises(ValueError, match="other exists and is not a published set"):
        publish(runs, tmp_path / "other")
    with pytest.raises(ValueError, match="/ cannot itself become a set"):
        publish(runs, Path("/"))
    with pytest.raises(ValueError, match=r"^cannot write to /dev/null/v1: "):
        publish(runs, Path("/dev/null/v1"))


@pytest.mark.parametrize("stage", ["derive", "_keep_others", "sync_folder"])
def test_a_failure_at_any_stage_leaves_what_was_there(make_runs, out, undrawn, monkeypatch, stage):
    runs = make_runs(seeds=2)
    publish(runs[:3], out)
    before = files(out.parent)

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, stage, fail)
    with pytest.raises(KeyboardInterrupt):
        publish(runs, out)
    if stage == "sync_folder":  # the new one has taken its place, only its way to the disk is not awaited
        assert len(load(out).runs) == 4
        assert [path.name for path in out.parent.iterdir()] == ["v1"]
    else:
        assert files(out.parent) == before


@pytest.mark.parametrize("renames", [0, 1, 2])
def test_the_next_publish_cleans_up_after_a_kill_at_any_rename(make_runs, out, undrawn, renames):
    runs = make_runs(seeds=2)
    publish(runs[:3], out)
    new = Path(shutil.copytree(out, out.with_name(".v1.curiobench-new")))
    if renames > 0:
        out.rename(out.with_name(".v1.curiobench-old"))
    if renames > 1:
        new.rename(out)
    publish(runs, out)
    assert len(load(out).runs) == 4
    assert [path.name for path in out.parent.iterdir()] == ["v1"]


def test_published_sets_are_found_by_name(make_runs, out, undrawn, monkeypatch, tmp_path):
    runs = make_runs(seeds=1)
    for name in ("v1", "v10", "v2", "laptop"):
        publish(runs, out.with_name(name))
    (out.parent / "v3").mkdir()
    monkeypatch.setattr(folders, "_home", lambda: out.parent)
    assert available() == ["v1", "v2", "v10"]
    assert_equal(curiobench.analysis.load("v2"), load(out))
    for name in ("v3", "v4", "../v1", "laptop"):
        with pytest.raises(ValueError, match=f"no published results {name!r}: available are v1, v2, v10"):
            load(name)
    monkeypatch.chdir(tmp_path)
    assert_equal(read_results([Path("v1")]), load(out))
    Path("v1").mkdir()  # a folder of that name comes first
    assert "v1 has no config.json" in read_results([Path("v1")]).faults[0]


def test_an_installed_package_has_its_sets_inside(make_runs, tmp_path, undrawn, monkeypatch):
    site = tmp_path / "site" / "curiobench"
    monkeypatch.setattr(folders, "__file__", str(site / "analysis" / "folders.py"))
    assert available() == []
    publish(make_runs(seeds=1), site / "published" / "v1")
    assert available() == ["v1"]
    assert len(load("v1").runs) == 2


def test_the_wheel_takes_what_load_reads_and_no_pictures(make_runs, out, undrawn):
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert setup["package-dir"]["curiobench.published"] == "results"
    publish(make_runs(seeds=1), out)
    written = {f"v1/{name}" for name in files(out)}
    (out / "figures").mkdir()
    (out / "figures" / "curve.png").touch()
    taken = {
        str(path.relative_to(out.parent))
        for pattern in setup["package-data"]["curiobench.published"]
        for path in out.parent.glob(pattern)
    }
    assert taken == written


@pytest.mark.parametrize("file", PUBLISHED_FILES)
def test_an_altered_file_is_named(make_runs, out, undrawn, file):
    publish(make_runs(seeds=1), out)
    content = bytearray((out / file).read_bytes())
    content[len(content) // 2] ^= 1
    (out / file).write_bytes(content)
    with pytest.raises(ValueError, match=f"{file} was changed after publishing"):
        load(out)
    if file.endswith(".gz"):
        for damaged in (content, b"plain text"):
            (out / file).write_bytes(damaged)
            write_sums(out)
            with pytest.raises(ValueError, match=f"^{out}: "):
                load(out)
    (out / SUMS).unlink()
    with pytest.raises(ValueError, match="cannot read"):
        load(out)


def write_sums(folder):
    """Digests of the set as it is."""
    sums = [f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in PUBLISHED_FILES]
    (folder / SUMS).write_text("".join(sums))


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("runs.csv", lambda f: f.drop(columns="hours"), "has no column hours"),
        ("runs.csv", lambda f: f.assign(run="same"), "a run is in runs.csv twice"),
        ("runs.csv", lambda f: f.assign(config="{"), "Expecting property name"),
        ("runs.csv", lambda f: f.iloc[1:], "has rows, but is not in runs.csv"),
        ("runs.csv", lambda f: f.assign(hours=np.inf), "hours of run stack2-sac-0 is inf; it must be at least 0"),
        ("runs.csv", lambda f: f.assign(updates=-1), "updates of run stack2-sac-0 is -1.0; it must be at least 0"),
        ("runs.csv", lambda f: f.replace({"run": {"stack2-sac-0": "../x"}}), "is not the name of a run"),
        ("evaluations.csv.gz", lambda f: f[f["epoch"] < 4], "has 3 of 4 epochs and is said to be complete"),
        ("evaluations.csv.gz", lambda f: f.iloc[:-1], "an evaluation has 34 rows, expected 35"),
        ("evaluations.csv.gz", lambda f: f[f["task"] == "stack3"], "has no evaluation"),
        ("progress.csv.gz", lambda f: f.drop(columns="epoch"), "has no column epoch"),
    ],
)
def test_a_damaged_set_is_named(make_runs, out, undrawn, file, change, message):
    publish(make_runs(tasks=("stack2", "stack3"), seeds=1), out)
    change(pd.read_csv(out / file, dtype={"bits": str})).to_csv(out / file, index=False)
    write_sums(out)
    results = read_results([out])
    (fault,) = results.faults
    assert fault.startswith(f"{out}: ")
    assert message in fault
    assert results.runs.empty


@pytest.mark.parametrize("folder", SETS, ids=lambda folder: folder.name)
def test_published_set_is_consistent(folder):
    assert folder.name in available()
    results = curiobench.analysis.load(folder.name)
    assert set(results.runs["run"]) == {path.stem for path in (folder / CONFIGS).iterdir()}
    check_sums(folder, tuple(read_sums(folder)))
    for run, config in zip(results.runs["run"], results.runs["config"], strict=True):
        record = json.loads((folder / CONFIGS / f"{run}.json").read_text())
        assert record["config"] == json.loads(config)
    assert results.runs["complete"].all()
    planned = results.evaluations["run"].astype(str).map(results.runs.set_index("run")["epochs"])
    last = results.evaluations[results.evaluations["epoch"] == planned]
    assert set(last["run"]) == set(results.runs["run"])
