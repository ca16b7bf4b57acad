"""Published sets: what is read back is what was run; nothing is lost, invented or left half-written."""

import gzip
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest
from commands import files
from lawful import edit_options, edit_rows, edit_versions, lengthen
from synthetic import known

from curiobench.analysis import load
from curiobench.analysis import publish as module
from curiobench.analysis.folders import CONFIGS, SUMS
from curiobench.analysis.frames import read_results
from curiobench.analysis.publish import publish

ROOT = Path(__file__).parents[2]


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
    assert gzip.decompress((out / "evaluations.csv.gz").read_bytes()).startswith(b"run,task,method,variant,seed,epoch")
    publish(runs, out.with_name("v2"))
    assert files(out.with_name("v2")) == files(out)


def test_a_lengthened_run_replaces_the_shorter_one(make_runs, tmp_path, out, undrawn):
    short = make_runs(seeds=2)
    publish(short, out)
    (tmp_path / "runs").rename(tmp_path / "before")
    longer = make_runs(methods=("sac",), seeds=1, epochs=7)
    publish([out, *longer], out)
    runs = load(out).runs.set_index("run")
    assert runs["epoch"].to_dict() == {run.name: 7 if run.name == "stack2-sac-0" else 4 for run in short}
    publish([*longer, tmp_path / "before"], out.with_name("v2"))
    assert_equal(load(out.with_name("v2")), load(out))
    with pytest.raises(ValueError, match=r"its run stack2-sac-0 would get other numbers"):
        publish([tmp_path / "before"], out)
    (other,) = make_runs(methods=("sac",), seeds=1, epochs=7, success=known, suffix="-other")  # with other first rows
    shutil.copytree(other, out.parents[1] / "other" / "stack2-sac-0")
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


def test_refuses_every_fault_and_the_same_name_twice(make_runs, out, undrawn):
    runs = make_runs(seeds=1)
    (out.parents[1] / "runs" / "notes").mkdir()
    with pytest.raises(ValueError, match=r"^not published: .*notes is not a run folder"):
        publish([out.parents[1] / "runs"], out)
    copy = Path(shutil.copytree(runs[0], out.parents[1] / "other" / runs[0].name))
    with pytest.raises(ValueError, match="is a duplicate of"):
        publish([*runs, copy], out)
    edit_options(copy, seed=7)
    with pytest.raises(ValueError, match="needs a unique name"):
        publish([*runs, copy], out)
    with pytest.raises(ValueError, match="name at least one run folder"):
        publish([], out)
    assert not out.parent.exists()


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
