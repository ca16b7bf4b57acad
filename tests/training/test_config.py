"""Configs: legal values, JSON and presets."""

import json
from dataclasses import replace

import pytest

from curiobench.config import (
    PRESET_NAMES,
    MachineConfig,
    RunConfig,
    differences,
)
from curiobench.methods.agents.settings import HybridConfig
from curiobench.presets import PRESET_LINES, PRESETS, preset


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_survives_json(name):
    config = PRESETS[name]
    assert config.preset == name
    assert RunConfig.from_json(json.loads(json.dumps(config.to_json()))) == config
    assert PRESET_LINES[name]


def test_paper_preset_has_the_papers_scale():
    paper = PRESETS["paper"]
    assert paper.epochs * paper.cycles * paper.worlds * paper.rollouts * 50 == 40_000_000
    assert (paper.curriculum, paper.replay.relabelling, paper.biased_from_epoch) == ("reached", "future", 80)
    assert (paper.sac.network, paper.sac.features, paper.sac.actor_every) == ("deep_sets", "state", 1)


def altered(path, value):
    values = PRESETS["smoke"].to_json()
    *outer, last = path.split(".")
    inner = values
    for name in outer:
        inner = inner[name]
    inner[last] = value
    return values


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (altered("sac.gama", 1), r"unknown config field sac\.gama"),
        (altered("epochs", "5"), "config field epochs is '5'; expected int"),
        (altered("epochs", True), "config field epochs is True; expected int"),
        (altered("epochs", 0), "epochs is 0; it must be at least 1"),
        (altered("sac.pairs", "both"), r"sac\.pairs is 'both'; expected 'symmetric' or 'oriented'"),
        (altered("replay", 3), "config replay is 3; expected an object"),
        (altered("task", "stack9"), "unknown task 'stack9'"),
        (altered("seed", -1), "seed is -1"),
        (altered("device", "tpu"), "device is 'tpu'"),
        (altered("robot", "arm"), "unknown robot 'arm'"),
        ({name: value for name, value in PRESETS["smoke"].to_json().items() if name != "seed"}, "missing .* seed"),
        ([], "expected an object"),
    ],
)
def test_refuses_what_is_not_a_config(values, message):
    with pytest.raises(ValueError, match=message):
        RunConfig.from_json(values)


def test_integers_may_stand_for_floats():
    assert RunConfig.from_json(altered("sac.tau", 1)).sac.tau == 1


def test_machine_settings_decide_nothing():
    smoke = PRESETS["smoke"]
    other = replace(smoke, machine=MachineConfig(threads=4, checkpoint_every=3))
    assert differences(smoke, other) == []
    assert smoke.fingerprint() == other.fingerprint()
    changed = replace(smoke, epochs=9, sac=replace(smoke.sac, gamma=0.5))
    found = ["epochs is 5 there, 9 was requested", "sac.gamma is 0.95 there, 0.5 was requested"]
    assert differences(smoke, changed) == found
    assert smoke.fingerprint() != changed.fingerprint()
    assert smoke.fingerprint() == replace(smoke, epochs=9).fingerprint()  # a checkpoint serves a longer run, too


def test_a_new_field_leaves_checkpoints_of_before_readable():
    """The digest may change only where a default does, since then the numbers of a run do."""
    assert RunConfig().fingerprint() == "e564d266bee435c50db0acc81985ffbb2558dff7869d54d70eea862a7363df7e"
    assert RunConfig(starts="plain").fingerprint() != RunConfig().fingerprint()
    hybrid = replace(RunConfig(), hybrid=HybridConfig(popart_rate=0.5))
    assert hybrid.fingerprint() != RunConfig().fingerprint()


def test_configs_of_before_a_machine_option_are_read():
    values = PRESETS["smoke"].to_json()
    del values["machine"]["keep_replay"]
    assert RunConfig.from_json(values) == PRESETS["smoke"]


@pytest.mark.parametrize(("old", "new"), [("icm", "sac"), ("sac", "icm"), ("icm", "rnd"), ("icm", "icm+hm")])
def test_differences_of_two_methods_leave_out_their_settings(old: str, new: str):
    ours, other = (replace(PRESETS["smoke"], method=method) for method in (old, new))
    found = [f"method is {old!r} there, {new!r} was requested", "epochs is 5 there, 9 was requested"]
    assert differences(ours, replace(other, epochs=9)) == found


@pytest.mark.parametrize("task", ["stack2", "stack3"])
@pytest.mark.parametrize("name", ["paper", "laptop"])
def test_statistics_that_forget_do_so_in_a_small_part_of_a_run(name, task):
    config = preset(name, task)
    updates = config.epochs * config.cycles * config.updates
    assert 10 / config.hybrid.popart_rate < updates
    assert 10 * (config.sac.reward_window or 0) < updates


@pytest.mark.parametrize(("name", "task"), [("laptop", "stack2"), *((name, "stack3") for name in PRESET_NAMES)])
def test_schedules_are_passed_through_at_the_papers_pace(name, task):
    """MI's lambda reaches its cap in the paper's epoch 120 of 500: at 24 % of any of these runs."""
    config = preset(name, task)
    cycles = [divmod(k, config.cycles) for k in range(config.epochs * config.cycles)]
    shares = [k / len(cycles) for k, place in enumerate(cycles) if config.paper_epoch(*place) >= 120]
    assert shares[0] == pytest.approx(0.24, abs=1.5 / len(cycles))
    assert config.paper_epoch(config.epochs) == 500


def test_settings_of_another_method_are_refused():
    icm, rnd = (replace(PRESETS["smoke"], method=method) for method in ("icm", "rnd"))
    with pytest.raises(ValueError, match="rnd takes a RNDConfig"):
        replace(icm, method="rnd")
    values = icm.to_json() | {"method": "rnd"}
    with pytest.raises(ValueError, match=r"config field method_config\."):
        RunConfig.from_json(values)
    with pytest.raises(ValueError, match="sac has no settings"):
        RunConfig.from_json(rnd.to_json() | {"method": "sac"})
