"""Probes: which steps are lifting and falling, scores, files, and that runs stay as they are."""

import csv
import re
import shutil
from dataclasses import replace

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest
import torch
from commands import files
from tiny_runs import TINY

from curiobench.analysis import colours
from curiobench.check.subject import same as same_state
from curiobench.cli.arguments import ProbeArguments
from curiobench.config import MachineConfig
from curiobench.methods.icm import ICMConfig
from curiobench.methods.reward import Batch
from curiobench.methods.specs import available_specs
from curiobench.probe import report
from curiobench.probe.episodes import SCRIPTED_EPISODES, play_scripts, reference_transitions, transitions
from curiobench.probe.report import probe
from curiobench.probe.scores import open_runs, others, own_transitions, read, score
from curiobench.probe.steps import Track, falling, lifting, push_moments, stack_moments
from curiobench.training import train

SPECS = ("rnd", "mi+hm", "dac", "dac+hm")
STARTS = 2


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of finished tiny runs, by spec; not to be altered."""
    folder = tmp_path_factory.mktemp("probed")
    for spec in SPECS:
        machine = MachineConfig(keep_replay=spec != "rnd")
        train(replace(TINY, method=spec, epochs=1, cycles=1, machine=machine), folder / spec)
    return {spec: folder / spec for spec in SPECS}


@pytest.fixture(scope="module")
def played():
    return play_scripts("stack2", "gripper", STARTS, seed=0)


@pytest.fixture(scope="module")
def reference():
    return reference_transitions("stack2", "gripper", seed=0)


def track(heights, offset=0.0, opening=0.03, y=0.75):
    """A track of one block at these heights (metres), with the grip this far above its centre."""
    heights = np.array(heights, float)
    block = np.stack([np.full_like(heights, 1.3), np.broadcast_to(y, heights.shape), heights], axis=1)
    grip = block + np.stack([0 * heights, 0 * heights, np.broadcast_to(offset, heights.shape)], axis=1)
    return Track(block, grip, np.broadcast_to(opening, heights.shape).astype(float))


def steps(found):
    return np.flatnonzero(found).tolist()


def test_lifting_is_a_rise_of_a_centimetre_in_the_hand():
    up = [0.425, 0.425, 0.426, 0.456, 0.486, 0.486, 0.477]
    assert steps(lifting(track(up))) == [2, 3]
    assert steps(lifting(track(up, offset=0.019))) == [2, 3]
    assert steps(lifting(track(up, offset=0.021))) == []  # tossed or pushed up, not held
    assert steps(lifting(track(up, offset=[0, 0, 0, 0, 0.03, 0, 0]))) == [2]  # lost in step 3
    assert steps(lifting(track([0.425, 0.434, 0.443]))) == []  # 9 mm a step
    assert steps(falling(track(up))) == []


def test_falling_is_a_drop_of_a_centimetre_out_of_the_hand_to_the_ground():
    down = [0.425, 0.426, 0.422, 0.402, 0.367, 0.2, 0.02, 0.025, 0.024]
    away = [0.04, 0.04, 0.045, 0.09, 0.2, 0.3, 0.4, 0.4, 0.4]
    assert steps(falling(track(down, away))) == [2, 3, 4, 5]
    assert steps(falling(track(down))) == []  # lowered in the hand
    assert steps(lifting(track(down, away))) == []


def test_key_moments_of_made_up_episodes():
    stacked = track(
        [0.425, 0.425, 0.425, 0.455, 0.486, 0.486, 0.478, 0.475, 0.475],
        offset=[0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.03],
        opening=[0.03, 0.03, 0.024, 0.024, 0.024, 0.024, 0.024, 0.024, 0.04],
    )
    assert stack_moments(stacked) == {"gripper closes": 2, "block lifts": 3, "block lowers": 6, "releases": 8}
    pushed = track(
        [0.425, 0.425, 0.425, 0.425, 0.40, 0.2, 0.02, 0.024],
        offset=[0.1, 0.04, 0.04, 0.04, 0.06, 0.3, 0.5, 0.5],
        y=[1.0, 1.0, 1.04, 1.08, 1.12, 1.15, 1.18, 1.18],
    )
    assert push_moments(pushed) == {"push starts": 2, "block at the edge": 3, "block falls": 4}
    assert stack_moments(pushed) == push_moments(track([0.425] * 5)) == {}


@pytest.mark.parametrize("robot", ["gripper", "fetch"])
def test_scripts_show_every_key_moment_and_only_what_they_are_for(robot):
    for episodes in play_scripts("stack3", robot, 3, seed=1):
        whole, stacks = episodes.track, episodes.kind.name == "stack"
        assert len(episodes.kind.moments(whole[episodes.pictured])) == (4 if stacks else 3)
        assert lifting(whole).any(axis=1).all() == stacks
        assert falling(whole).any() != stacks
        if stacks:
            assert (episodes.episodes.achieved_goal[:, -1] == episodes.episodes.desired_goal).all(axis=1).any()


def test_both_kinds_begin_at_the_same_starts_and_the_reference_elsewhere(played, reference):
    first, second = (episodes.episodes.observation[:, 0] for episodes in played)
    np.testing.assert_array_equal(first, second)
    assert len(reference.reward) >= 511
    blocks = reference.observation.numpy()[:, None, 10:13]
    assert (np.abs(blocks - first[None, :, 10:13]).max(axis=-1) > 1e-4).all()


@pytest.mark.parametrize("spec", SPECS)
def test_numbers_are_those_of_direct_calls_and_nothing_changes(runs, played, reference, spec):
    (run,), _ = open_runs([runs[spec]])
    before = run.agent.state_dict()
    reading = read(run, played[1], reference)
    assert same_state(before, run.agent.state_dict())

    probed = transitions(played[1].episodes)
    start, step = 1, 7
    row = start * 50 + step
    arrays = {n: np.concatenate([a[row : row + 1], getattr(reference, n)[:15]]) for n, a in probed.items()}
    n_particles = run.agent.learner.curiosity.method.n_particles
    arrays["particles"] = reference.next_observation[-n_particles:].numpy() if n_particles else None
    batch = run.agent.transitions(Batch.from_numpy(arrays), epoch=1)
    raw = run.agent.learner.curiosity.method.reward(batch)[0]
    assert reading.raw[start, step] == pytest.approx(float(raw), rel=1e-4, abs=1e-5)
    moments = run.agent.learner.curiosity.moments
    z_score = np.clip((float(raw) - float(moments.mean)) / float(moments.std), -5, 5)
    assert reading.normalised[start, step] == pytest.approx(z_score, rel=1e-3, abs=1e-3)
    if spec.endswith("+hm"):
        q_int = run.agent.q_int(probed["observation"], probed["action"])
        assert set(reading.q_int) == {"popart", "zscore"}
        for name, values in reading.q_int.items():
            np.testing.assert_array_equal(values.ravel(), q_int[name])
    else:
        assert reading.q_int == {}


def test_own_transitions_are_drawn_as_in_training(runs):
    """From every episode that the run collected, relabelled: goals are not those that were pursued."""
    (run,), _ = open_runs([runs["mi+hm"]])
    own, replay = own_transitions(run, seed=0), run.load_replay()
    assert len(own.reward) == others(run) == TINY.batch_size - 1
    stored = {
        row.tobytes() for row in replay.arrays["observation"][: len(replay)].reshape(-1, own.observation.shape[1])
    }
    assert {row.tobytes() for row in own.observation.numpy()} <= stored
    assert own.reward.any()  # an untrained agent reaches nothing: these are hindsight's
    assert {row.tobytes() for row in own.particles.numpy()} <= stored
    assert torch.equal(own.observation, own_transitions(run, seed=0).observation)
    assert not torch.equal(own.observation, own_transitions(run, seed=1).observation)


def test_steps_are_scored_among_the_runs_own_transitions(runs, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "draw", lambda *_: [])
    found = {}
    for among in ("random", "replay"):
        probe(ProbeArguments((runs["mi+hm"], runs["dac"]), tmp_path / among, STARTS, among=among))
        with open(tmp_path / among / "scores.csv", newline="") as file:
            found[among] = {row["method"]: row for row in csv.DictReader(file)}
        assert {row["among"] for row in found[among].values()} == {among}
    assert found["random"]["mihm"]["lifting"] != found["replay"]["mihm"]["lifting"]
    for name in ("lifting", "falling"):  # DAC looks at one transition at a time
        of_dac = [float(rows["dac"][name]) for rows in found.values()]
        assert of_dac[0] == pytest.approx(of_dac[1], abs=1e-5)


def test_a_method_gets_the_epoch_that_is_asked_for(runs, played, reference):
    (run,), _ = open_runs([runs["mi+hm"]])
    run.agent.learner.curiosity.method.reward = lambda seen: torch.full((len(seen.state),), float(seen.epoch))
    assert np.unique(read(run, played[0], reference).raw) == [run.epoch]
    assert np.unique(read(replace(run, as_of_epoch=500), played[0], reference).raw) == [500]


def test_a_method_that_gives_nan_is_named(runs, played, reference):
    (run,), _ = open_runs([runs["rnd"]])
    run.agent.learner.curiosity.method.reward = lambda seen: torch.full((len(seen.state),), torch.nan)
    with pytest.raises(ValueError, match=r"rnd: .*RND.*nan"):
        read(run, played[0], reference)


def test_states_are_normalised_as_in_training(runs, played):
    """The method sees what `update` shows it: caught there, and compared."""
    (run,), _ = open_runs([runs["dac+hm"]])
    batch = Batch.from_numpy({n: a[:16] for n, a in transitions(played[0].episodes).items()})
    probed = run.agent.transitions(batch, epoch=1)
    caught = []
    run.agent.learner.curiosity.method.reward = lambda seen: caught.append(seen) or torch.zeros(16)
    run.agent.update(batch, epoch=1)
    for name in ("state", "action", "next_state", "epoch"):
        assert torch.equal(torch.as_tensor(getattr(probed, name)), torch.as_tensor(getattr(caught[0], name))), name
    for name in ("desired_goal", "stored_log_prob"):
        torch.testing.assert_close(getattr(probed.policy, name), getattr(caught[0].policy, name))


def test_score_of_made_up_rewards():
    normalised = np.array([[1.0, 3.0, 0.0, -1.0], [2.0, 9.0, 9.0, 1.0], [5.0, 5.0, 5.0, 5.0]])
    lifts = np.array([[1, 1, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0]], bool)
    falls = np.array([[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]], bool)
    found = score(normalised, lifts, falls, seed=0)
    assert found.starts == 2  # the third never falls
    assert found.controllability == pytest.approx(((2 - -1) + (2 - 1)) / 2)
    assert (found.lifting, found.falling) == (pytest.approx(2), pytest.approx(0))
    assert (found.low, found.high) == (pytest.approx(1), pytest.approx(3))  # two starts: resamples reach both ends
    assert score(normalised, lifts, falls, seed=0) == found
    with pytest.raises(ValueError, match="take more starts"):
        score(normalised, lifts, np.zeros_like(falls), seed=0)


def shows(path, colour) -> bool:
    """Whether a picture has pixels of a colour."""
    pixels = mpl.image.imread(path)[..., :3]
    return bool((np.abs(pixels - mpl.colors.to_rgb(colour)).max(axis=-1) < 0.01).any())


def test_probe_writes_figures_and_numbers_and_repeats_itself(runs, tmp_path, monkeypatch):
    paths = (runs["rnd"], runs["mi+hm"])
    before = [files(path) for path in paths]
    table, notes, made = probe(ProbeArguments(paths, tmp_path / "one", STARTS, seed=3))
    assert notes == []
    assert table.startswith("method ")
    assert [files(path) for path in paths] == before
    assert {file.name for file in made} == {
        "scores.csv",
        "numbers.csv",
        *(f"{name}.{kind}" for name in ("rewards_stack", "rewards_push", "q_int") for kind in ("png", "pdf")),
    }
    for file in made:
        if file.suffix != ".csv":
            assert file.stat().st_size > 10_000, file
        if file.suffix == ".png":
            assert shows(file, colours.COLOURS["mi"]), file
            assert shows(file, colours.COLOURS["rnd"]) == file.name.startswith("rewards"), file
    with open(tmp_path / "one" / "numbers.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(SCRIPTED_EPISODES) * STARTS * 50
    assert {row["moment"] for row in rows} >= {"block lifts", "block falls"}
    assert all(bool(row["q_int_popart"]) == (row["method"] == "mihm") for row in rows)

    monkeypatch.setattr(report, "draw", lambda *_: [])  # seconds that say nothing about numbers
    again, *_ = probe(ProbeArguments(paths, tmp_path / "two", STARTS, seed=3))
    assert again == table
    for name in ("scores.csv", "numbers.csv"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()


def test_command_names_runs_without_curiosity_and_leaves_them_out(cli, runs, finished, tmp_path):
    code, out, err = cli("probe", finished, runs["rnd"], "--out", tmp_path, "--starts", 1)
    assert (code, err) == (0, "")
    assert out.startswith(f"left out {finished}: sac has no intrinsic reward\n")
    assert str(tmp_path / "rewards_push.png") in out
    assert not (tmp_path / "q_int.png").exists()


def test_bad_input_takes_one_line(cli, runs, finished, tmp_path, capsys):
    unstarted, other = tmp_path / "unstarted", tmp_path / "other"
    shutil.copytree(runs["rnd"], unstarted)
    shutil.rmtree(unstarted / "checkpoint")
    train(
        replace(TINY, task="stack3", method="icm", method_config=ICMConfig(), epochs=1, cycles=1, episodes_per_goal=1),
        other,
    )
    capsys.readouterr()
    for arguments, message in (
        ([], "name at least one run folder"),
        ([tmp_path / "none"], "none does not exist"),
        ([finished], f"left out {finished}: sac has no intrinsic reward"),
        ([unstarted], "has no checkpoint yet"),
        ([runs["rnd"], other], "runs need the same task and robot"),
        ([runs["rnd"], runs["rnd"]], "named twice"),
        ([runs["rnd"], "--starts", 0], "starts is 0"),
        ([runs["rnd"], "--among", "replay"], f"{runs['rnd']} has no replay any more"),
        ([runs["rnd"], "--among", "expert"], "expert"),
        ([runs["rnd"], "--as-of-epoch", -1], "as_of_epoch is -1"),
        ([runs["rnd"], "--starts", 1, "--out", "/dev/null/x"], "cannot write to /dev/null/x"),
    ):
        code, out, err = cli("probe", *arguments)
        assert (code, out) == (2, ""), arguments
        assert re.fullmatch(r"curiobench: [^\n]+\n", err), arguments
        assert message in err


def test_every_method_has_its_own_line_style():
    looks = colours.line_styles(available_specs())
    mihm = looks.pop("mihm")
    assert len({(look["color"], look["linestyle"]) for look in looks.values()}) == len(looks)
    assert looks["mi+hm"] == mihm
    assert looks["mi"]["color"] == looks["mi+hm"]["color"]
