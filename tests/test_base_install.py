"""What `pip install curiobench` does without an extra, and the examples for other trainers."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from curiobench.cli.commands import COMMANDS
from curiobench.errors import OF_TRAIN
from curiobench.tasks.goals import goal_space

ROOT = Path(__file__).parents[1]
WITHOUT_EXTRAS = f"""
import sys
class Absent:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {OF_TRAIN}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
"""


def outcome(code, folder):
    """Exit code, stdout and stderr of a program that cannot import what the extra `train` installs."""
    command = [sys.executable, "-c", WITHOUT_EXTRAS + code]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_extra_is_what_messages_take_it_for():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {re.match(r"[\w-]+", package)[0] for package in extras["train"]}
    assert {name.removeprefix("py") for name in names} == {*OF_TRAIN}


@pytest.mark.slow
def test_the_pinned_versions_fit_every_extra():
    """Needs a package index."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--constraint", "constraints.txt"]
    done = subprocess.run([*pip, f".[{','.join(extras)}]"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_environments_need_no_extra(tmp_path):
    code = """
import gymnasium
for make in (gymnasium.make, lambda name: gymnasium.make_vec(name, 2, "vector_entry_point")):
    env = make("curiobench:curiobench/SemanticStack3-v0")
    env.reset(seed=0)
    env.step(env.action_space.sample())
import curiobench
try: curiobench.train
except ImportError as error: print(error)
try: curiobench.analysis.load("v2")
except ImportError as error: print(error)
"""
    code, out, err = outcome(code, tmp_path)
    assert code == 0, err
    assert [line.split("; ")[1] for line in out.splitlines()] == [NEEDED] * 2


NEEDED = "training and results need the extra `train`: pip install 'curiobench[train]'"


def test_commands_name_the_extra_that_they_lack(tmp_path):
    arguments = {"new-method": "mine", "check": "rnd", "evaluate": "run", "probe": "run", "train": "--out run"}
    arguments |= {"grid": "--tasks stack2 --methods sac --out grid", "video": "run --goal close"}
    arguments |= {"publish": "v2 --out set", "list": ""}
    code = f"""
from curiobench.cli import main
for command in {[f"{name} {arguments.get(name, 'v2')}" for name in COMMANDS]}:
    sys.argv = ["curiobench", *command.split()]
    try: main()
    except SystemExit as ended: print(command.split()[0], ended.code)
"""
    code, out, err = outcome(code, tmp_path)
    assert code == 0, err
    codes = dict(line.split() for line in out.splitlines() if re.fullmatch(r"[\w-]+ \d", line))
    assert codes == dict.fromkeys(COMMANDS, "2") | {"list": "0"}
    assert len(err.splitlines()) == len(COMMANDS) - 1
    assert all(line.startswith("curiobench: ") and line.endswith(f"; {NEEDED}") for line in err.splitlines())
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("example", "arguments", "shown"), [("sb3_sac", [2, 1500], "success_rate"), ("cleanrl_ddpg", [2, 3], "round 3:")]
)
def test_examples_train(example, arguments, shown, tmp_path):
    if example.startswith("sb3"):
        pytest.importorskip("stable_baselines3")
    file = ROOT / "examples" / f"{example}.py"
    assert len(file.read_text().splitlines()) <= 60
    command = [sys.executable, str(file), *map(str, arguments)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert shown in done.stdout


@pytest.mark.slow
def test_the_example_that_tests_sb3_writes_a_row_a_goal(tmp_path):
    pytest.importorskip("stable_baselines3")
    command = [sys.executable, str(ROOT / "examples" / "sb3_her.py"), "stack2", "--minutes", "0.05", "--tests", "1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = [line.split(",") for line in (tmp_path / "sb3.csv").read_text().splitlines()[1:]]
    assert [row[3] for row in rows] == [*goal_space(2).names]


@pytest.mark.slow
def test_the_tuning_example_goes_on(tmp_path):
    optuna = pytest.importorskip("optuna")
    file, small = ROOT / "examples" / "tune.py", "preset=smoke cycles=1 worlds=2 updates=2 episodes-per-goal=1"
    assert len(file.read_text().splitlines()) <= 45
    for trials in (2, 1):
        command = [sys.executable, str(file), "tune", str(trials), *small.split()]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert "3 trials, the best 0." in done.stdout
    study = optuna.load_study(study_name="icm", storage=f"sqlite:///{tmp_path}/tune/study.db")
    assert [sorted(trial.intermediate_values) for trial in study.trials] == [[1, 2, 3, 4, 5, 6]] * 3
