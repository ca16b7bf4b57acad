"""Agents of published sets: they act as they did in evaluations, and nothing that is wrong with a file goes unsaid."""

import os
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lawful import edit_options, sign
from safetensors.numpy import load_file, save_file
from synthetic import write_runs
from tiny_runs import TINY

import curiobench
from curiobench.analysis import agents as choice
from curiobench.analysis import folders, load
from curiobench.analysis.folders import AGENTS, SUMS, WEIGHTS, read_sums
from curiobench.analysis.frames import read_results
from curiobench.analysis.publish import publish
from curiobench.evaluation import Evaluator
from curiobench.methods.specs import canonical
from curiobench.saved_agent import load_agent
from curiobench.training import train

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def hybrid(tmp_path_factory):
    """A finished run in which another policy explores than the one that is evaluated."""
    path = tmp_path_factory.mktemp("runs") / "hybrid"
    train(replace(TINY, method="mihm", method_config=None), path)
    return path


@pytest.fixture(scope="module")
def published(finished, hybrid, tmp_path_factory):
    """`runs` of icm, and `sets/v1` with their rows and agents of sac and mihm; not to be altered."""
    folder = tmp_path_factory.mktemp("published")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("curiobench.analysis.publish.derive", lambda folder: None)
        runs = [finished, hybrid, *write_runs(folder / "runs", methods=["icm"], seeds=2)]
        lines = publish(runs, folder / "sets" / "v1", allow_dirty=True)
    assert lines[-1] == "no agent of stack2 icm: runs without a checkpoint"
    return folder


@pytest.fixture
def out(published, tmp_path):
    """The set, in a copy of that folder."""
    shutil.copytree(published, tmp_path, dirs_exist_ok=True)
    return tmp_path / "sets" / "v1"


def test_a_published_agent_acts_as_in_evaluations(finished, hybrid, out, monkeypatch):
    rng = np.random.default_rng(0)
    seen = rng.normal(size=(32, 40)), rng.integers(0, 2, (32, 3)), rng.integers(0, 2, (32, 3))
    monkeypatch.setattr(folders, "_home", lambda: out.parent)
    for run, method in ((finished, "sac"), (hybrid, "mihm"), (hybrid, "MI+hm")):
        expected = load_agent(run)[1].act(*seen, deterministic=True)
        for place in (f"v1/stack2/{method}", out / "stack2" / method):
            config, agent = load_agent(Path(place))
            np.testing.assert_array_equal(agent.act(*seen, deterministic=True), expected)
            assert config.fingerprint() == load_agent(run)[0].fingerprint()
        observation = dict(zip(("observation", "achieved_goal", "desired_goal"), seen, strict=True))
        np.testing.assert_array_equal(curiobench.load_agent(f"v1/stack2/{method}").predict(observation)[0], expected)
    assert not np.array_equal(agent.act(*seen), expected)


def test_every_shipped_agent_loads_by_its_name():
    folders = sorted((ROOT / "results" / "v2" / AGENTS).glob("*-*"))
    assert folders
    for folder in folders:
        task, _, method = folder.name.partition("-")
        config, _ = load_agent(Path(f"v2/{task}/{method}"))
        assert (config.task, config.method) == (task, canonical(method))


def test_a_shipped_agent_reaches_the_success_that_its_set_records():
    config, agent = load_agent(Path("v2/stack2/icm+hm"))
    rows = load("v2").evaluations.query(f"run == 'stack2-icm+hm-{config.seed}'")
    rows = rows[rows["epoch"] == rows["epoch"].max()].set_index("goal")["success"]
    tested = Evaluator(config.task, config.robot, config.episodes_per_goal).evaluate(agent).rows()
    found = {row["goal"]: row["success"] for row in tested}
    assert found == pytest.approx(rows.to_dict(), abs=0.08)  # other processors round otherwise: two episodes of 25


def test_it_is_small_and_all_of_its_set_is_signed_and_installed(out, finished):
    checkpoint = max(path.stat().st_size for path in finished.rglob("agent-*.pt"))
    assert (out / AGENTS / "stack2-mihm" / WEIGHTS).stat().st_size < checkpoint / 4
    agents = {f"{AGENTS}/stack2-{method}/{file}" for method in ("sac", "mihm") for file in ("config.json", WEIGHTS)}
    written = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert {name for name in written if name.startswith(AGENTS)} == agents | {f"{AGENTS}/README.md"}
    assert written == {*read_sums(out), SUMS}
    (out / "figures").mkdir()
    (out / "figures" / "curve.png").touch()  # the wheel takes no pictures
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert setup["package-dir"]["curiobench.published"] == "results"
    globs = setup["package-data"]["curiobench.published"]
    assert {str(path.relative_to(out)) for glob in globs for path in out.parent.glob(glob)} == written


def test_publishing_again_keeps_agents_and_their_bytes(out, finished, hybrid, tmp_path):
    again = out.with_name("v2")
    publish([out], again, allow_dirty=True)
    assert (again / SUMS).read_bytes() == (out / SUMS).read_bytes()
    bare = Path(shutil.copytree(hybrid, tmp_path / "hybrid"))
    shutil.rmtree(bare / "checkpoint")
    runs = [finished, bare, *(tmp_path / "runs").iterdir()]
    with pytest.raises(ValueError, match="its agent stack2-mihm would be lost; overwrite with --replace"):
        publish(runs, out, allow_dirty=True)
    publish(runs, out, allow_dirty=True, replace=True)
    assert len(load(out).runs) == 4
    with pytest.raises(ValueError, match=r"mihm is not a published agent; available: .*v1/stack2/sac$"):
        load_agent(out / "stack2" / "mihm")


def test_the_best_run_gives_the_agent_and_of_equals_the_lowest_seed(make_runs, monkeypatch):
    monkeypatch.setattr(choice, "_weights", lambda run, file, trusted: run["run"].encode())
    made = {("sac", 0): 0.6, ("sac", 1): 0.8, ("sac", 2): 0.8, ("mihm", 0): 0.4, ("mihm", 1): 0.2, ("mihm", 2): 0.4}
    runs = make_runs(success=lambda task, method, seed, epoch, goal: made[method, seed])
    files, notes = choice.collect_agents(read_results(runs), ())
    chosen = {path: content for path, content in files.items() if path.endswith(WEIGHTS)}
    assert chosen == {
        f"agents/stack2-sac/{WEIGHTS}": b"stack2-sac-1",
        f"agents/stack2-mihm/{WEIGHTS}": b"stack2-mihm-0",
    }
    assert "| stack2 | sac | stack2-sac-1 | 0.80 | 0 of 4 | 12 |" in files["agents/README.md"].decode()
    assert notes == []


def test_a_checkpoint_that_cannot_be_used_is_told_and_the_next_run_taken(finished, tmp_path):
    spoilt = Path(shutil.copytree(finished, tmp_path / "spoilt"))
    for path in (spoilt / "checkpoint").glob("agent-*.pt"):
        path.write_bytes(b"nothing")
    files, (note,) = choice.collect_agents(read_results([spoilt]), ())
    assert files == {}
    assert note.startswith("no agent of stack2 sac: cannot use ")
    other = Path(shutil.copytree(spoilt, tmp_path / "other"))
    edit_options(other, seed=1)
    files, notes = choice.collect_agents(read_results([other, finished]), ())
    assert len(files) == 3
    assert notes == []


def edit_weights(file, change):
    tensors = load_file(file)
    change(tensors)
    save_file(tensors, file)


NAN = {"actor.net.out_bias": np.full((1, 8, 1), np.nan, np.float32)}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / WEIGHTS).write_bytes((f / WEIGHTS).read_bytes()[:-9]), "cannot use .*safetensors: Safetensor"),
        (lambda f: (f / WEIGHTS).write_bytes(b"\x80\x04."), "cannot use .*safetensors: Safetensor"),
        (lambda f: edit_weights(f / WEIGHTS, lambda t: t.update(NAN)), "out_bias is not finite"),
        (lambda f: edit_weights(f / WEIGHTS, lambda t: t.pop("encoder.body.mean")), "encoder.body.mean"),
        (lambda f: edit_weights(f / WEIGHTS, lambda t: t.pop("actor.net.first")), "actor|first"),
        (lambda f: edit_options(f, "sac", hidden=9), "cannot use .*size mismatch"),
        (lambda f: edit_options(f, "sac", hidden=10**9), "too small for sac.hidden"),
        (lambda f: edit_options(f, task="stack9"), "unknown task 'stack9'"),
        (lambda f: edit_options(f, method="os:system"), "is not built in"),
        (lambda f: (f / "config.json").write_text("{"), "cannot read .*config.json"),
    ],
)
def test_what_is_wrong_with_an_agent_is_one_line(out, spoil, message):
    spoil(out / AGENTS / "stack2-sac")
    with pytest.raises(ValueError, match="was changed after publishing"):
        load_agent(out / "stack2" / "sac")
    sign(out)
    with pytest.raises(ValueError, match=message) as caught:
        load_agent(out / "stack2" / "sac")
    assert "\n" not in str(caught.value)


def test_relative_paths_of_a_run_mean_the_run(out, finished, monkeypatch):
    shutil.copytree(finished, out.with_name("run"))
    with pytest.raises(ValueError, match=r"v1/\.\./runs does not exist$"):
        load_agent(out / ".." / "runs")
    monkeypatch.chdir(out)
    assert load_agent(Path("../run"))[0].method == "sac"
    monkeypatch.chdir("../run")
    publish([Path()], Path("../v3"), allow_dirty=True)
    assert load_agent(Path("../v3/stack2/sac"))[0].method == "sac"


def test_what_there_is_not_is_named(out, finished, cli, monkeypatch, tmp_path):
    names = f"{out}/stack2/mihm, {out}/stack2/sac"
    for path in ("stack2/icm", "stack3/sac", "stack2/..", "stack9/sac", "stack2", "."):
        with pytest.raises(ValueError, match=f"is not a published agent; available: {names}$"):
            load_agent(Path(f"{out}/{path}"))
    with pytest.raises(ValueError, match="has an agent of mihm, not of icm"):
        load_agent(out / "stack2" / "mihm", "icm")
    weights = out / AGENTS / "stack2-sac" / WEIGHTS
    weights.unlink()
    os.mkfifo(weights)
    with pytest.raises(ValueError, match=f"available: {out}/stack2/mihm$"):
        load_agent(out / "stack2" / "sac")
    with pytest.raises(ValueError, match="no published results 'v99': available are "):
        load_agent(Path("v99/stack2/sac"))
    for arguments, message in (
        ((out,), f"--method must name an agent of {out}; available: {out}/stack2/mihm"),
        ((out, "--method", "icm"), f"--method must name an agent of {out}; available: {out}/stack2/mihm"),
        ((out, "--method", "mihm", "--task", "stack3"), "mihm is not a published agent; "),
        ((finished, "--task", "stack2"), f"--task is only for published sets, and {finished} is not one"),
    ):
        code, _, err = cli("video", *arguments, "--goal", "close")
        assert (code, err.count("\n")) == (2, 1)
        assert message in err
    shutil.rmtree(out / AGENTS)
    with pytest.raises(ValueError, match=f"{out} has only rows and configs of its runs, no agents"):
        load_agent(out / "stack2" / "mihm")


def test_a_set_gives_a_video_and_is_left_as_it_is(out, cli, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = sorted(out.rglob("*"))
    code, printed, err = cli("video", out, "--method", "mihm", "--goal", "a on b", "--episodes", "1")
    assert code == 0, err
    assert printed.startswith("a_on_b.mp4: ")
    assert (tmp_path / "a_on_b.mp4").stat().st_size > 1000
    assert sorted(out.rglob("*")) == before
