"""The flags of `curiobench train`: the preset's defaults, a method's settings, and errors of one line."""

import json
from dataclasses import replace

import pytest

from curiobench.cli.train_arguments import parse_train
from curiobench.config import RunConfig, differences
from curiobench.presets import PRESETS, preset


def test_flags_override_the_preset():
    arguments = "--out x --preset smoke --epochs 7 --sac.gamma 0.9 --replay.satisfied-cap None --sac.tune-temperature"
    parsed = parse_train(arguments.split())
    smoke = PRESETS["smoke"]
    expected = replace(
        smoke,
        epochs=7,
        sac=replace(smoke.sac, gamma=0.9, tune_temperature=True),
        replay=replace(smoke.replay, satisfied_cap=None),
    )
    assert parsed.config == expected
    assert not parsed.resume


def test_the_laptop_preset_is_shorter_for_two_blocks():
    laptop, parsed = PRESETS["laptop"], parse_train(["--out", "x", "--task", "stack2"]).config
    assert parsed == preset("laptop", "stack2")
    assert parsed.epochs < laptop.epochs


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "--out"),
        ("--out x --sac.gama 1", r"--sac\.gama.*perhaps you meant --sac\.gamma"),
        ("--out x --epochs five", "--epochs.*five"),
        ("--out x --sac.pairs both", "both.*symmetric"),
        ("--out x --resume False", "False"),
        ("--out x --sac.layer-norm False", "False"),
        ("--out x --method dac --method.adapt-alpha False", "False"),
        ("--out x --sac.tau inf", "tau is inf; it must be at least 0 and finite"),
        ("--out x --method icm --method.learning-rate inf", "learning_rate is inf; it must be positive and finite"),
        ("--out x --method dac --method.control nan", "control is nan; it must be finite"),
        ("--out x --seed 4294967296", "seed is 4294967296; it must be at most 2147483647"),
        ("--out x --epochs 4294967296", "epochs is 4294967296; it must be at most 2147483647"),
    ],
)
def test_arguments_that_are_not_understood_take_one_line(arguments, message):
    with pytest.raises(ValueError, match=message) as refused:
        parse_train(arguments.split())
    assert "\n" not in str(refused.value)


def test_resuming_takes_the_folders_own_config(finished):
    config = parse_train(["--out", str(finished), "--resume"]).config
    assert config.epochs == 3
    assert parse_train([f"--out={finished}", "--resume", "--epochs", "9"]).config == replace(config, epochs=9)


def test_settings_of_a_method_come_from_the_command_line_and_survive_json():
    parsed = parse_train(["--out", "x", "--method", "RE3+hm", "--method.k", "5"]).config
    assert parsed.method == "re3+hm"
    assert parsed.method_config.k == 5
    assert RunConfig.from_json(json.loads(json.dumps(parsed.to_json()))) == parsed
    default = parse_train(["--out", "x", "--method", "re3+hm"]).config
    assert differences(default, parsed) == ["method_config.k is 3 there, 5 was requested"]
    assert default.fingerprint() != parsed.fingerprint()
