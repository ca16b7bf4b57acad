"""Reading published sets: found by name, and an altered or damaged file is named."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from lawful import sign

from curiobench.analysis import folders, load
from curiobench.analysis.folders import CONFIGS, PUBLISHED_FILES, SUMS, available, check_sums, read_sums
from curiobench.analysis.frames import read_results
from curiobench.analysis.publish import publish

SETS = sorted(path for path in (Path(__file__).parents[2] / "results").glob("v*") if path.is_dir())
pytestmark = pytest.mark.usefixtures("undrawn")


def test_names_that_pandas_reads_as_missing_are_names(make_runs, out):
    """A run folder may be called NA or nan."""
    runs = make_runs(methods=("sac",), seeds=3)
    publish([run.rename(run.with_name(name)) for run, name in zip(runs, ("NA", "nan", "null"), strict=True)], out)
    assert sorted(load(out).runs["run"]) == ["NA", "nan", "null"]


def test_published_sets_are_found_by_name(make_runs, out, monkeypatch, tmp_path):
    runs = make_runs(seeds=1)
    for name in ("v1", "v10", "v2", "laptop"):
        publish(runs, out.with_name(name))
    (out.parent / "v3").mkdir()
    monkeypatch.setattr(folders, "_home", lambda: out.parent)
    assert available() == ["v1", "v2", "v10"]
    assert load("v2").runs.equals(load(out).runs)
    for name in ("v3", "v4", "../v1", "laptop"):
        with pytest.raises(ValueError, match=f"no published results {name!r}: available are v1, v2, v10"):
            load(name)
    monkeypatch.chdir(tmp_path)
    assert read_results([Path("v1")]).runs.equals(load(out).runs)
    Path("v1").mkdir()  # a folder of that name comes first
    assert "v1 has no config.json" in read_results([Path("v1")]).faults[0]


def test_an_installed_package_has_its_sets_inside(make_runs, tmp_path, monkeypatch):
    site = tmp_path / "site" / "curiobench"
    monkeypatch.setattr(folders, "__file__", str(site / "analysis" / "folders.py"))
    assert available() == []
    publish(make_runs(seeds=1), site / "published" / "v1")
    assert available() == ["v1"]
    assert len(load("v1").runs) == 2


@pytest.mark.parametrize("file", PUBLISHED_FILES)
def test_an_altered_file_is_named(make_runs, out, file):
    publish(make_runs(seeds=1), out)
    content = bytearray((out / file).read_bytes())
    content[len(content) // 2] ^= 1
    (out / file).write_bytes(content)
    with pytest.raises(ValueError, match=f"{file} was changed after publishing"):
        load(out)
    if file.endswith(".gz"):
        for damaged in (content, b"plain text"):
            (out / file).write_bytes(damaged)
            sign(out)
            with pytest.raises(ValueError, match=f"^{out}: "):
                load(out)
    (out / SUMS).unlink()
    with pytest.raises(ValueError, match="cannot read"):
        load(out)


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("runs.csv", lambda f: f.drop(columns="hours"), "has no column hours"),
        ("runs.csv", lambda f: f.assign(run="same"), "a run is in runs.csv twice"),
        ("runs.csv", lambda f: f.assign(config="{"), "Expecting property name"),
        ("runs.csv", lambda f: f.iloc[1:], "has rows, but is not in runs.csv"),
        ("runs.csv", lambda f: f.assign(hours=np.inf), "hours of run stack2-sac-0 is inf; it must be at least 0"),
        ("runs.csv", lambda f: f.replace({"run": {"stack2-sac-0": "../x"}}), "is not the name of a run"),
        ("evaluations.csv.gz", lambda f: f[f["epoch"] < 4], "has 3 of 4 epochs and is said to be complete"),
        ("evaluations.csv.gz", lambda f: f.iloc[:-1], "an evaluation has 34 rows, expected 35"),
        ("evaluations.csv.gz", lambda f: f[f["task"] == "stack3"], "has no evaluation"),
        ("progress.csv.gz", lambda f: f.drop(columns="epoch"), "has no column epoch"),
    ],
)
def test_a_damaged_set_is_named(make_runs, out, file, change, message):
    publish(make_runs(tasks=("stack2", "stack3"), seeds=1), out)
    change(pd.read_csv(out / file, dtype={"bits": str})).to_csv(out / file, index=False)
    sign(out)
    results = read_results([out])
    (fault,) = results.faults
    assert fault.startswith(f"{out}: ")
    assert message in fault
    assert results.runs.empty


@pytest.mark.parametrize("folder", SETS, ids=lambda folder: folder.name)
def test_published_set_is_consistent(folder):
    assert folder.name in available()
    results = load(folder.name)
    assert set(results.runs["run"]) == {path.stem for path in (folder / CONFIGS).iterdir()}
    check_sums(folder, tuple(read_sums(folder)))
    for run, config in zip(results.runs["run"], results.runs["config"], strict=True):
        record = json.loads((folder / CONFIGS / f"{run}.json").read_text())
        assert record["config"] == json.loads(config)
    assert results.runs["complete"].all()
    planned = results.evaluations["run"].astype(str).map(results.runs.set_index("run")["epochs"])
    last = results.evaluations[results.evaluations["epoch"] == planned]
    assert set(last["run"]) == set(results.runs["run"])
