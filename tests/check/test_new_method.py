"""A user's own method from the command line: written, checked, trained, resumed, and stopped where it fails."""

import re
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint

import pytest
from commands import TRAIN
from tiny_runs import TINY

from curiobench import checkpoint
from curiobench.config import RunConfig
from curiobench.files import read_json
from curiobench.methods import specs
from curiobench.run_folder import RunFolder, read_config, read_rows
from curiobench.saved_agent import load_agent

FLAGS = (*TRAIN[1:], "--epochs", "2", "--cycles", "1")
"""Trains in a second; `--method` and `--out` are missing."""


@pytest.fixture
def cli(cli, tmp_path, monkeypatch):
    """Runs a command in an empty folder, whose modules are forgotten afterwards; gives exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    known = set(sys.modules)
    yield cli
    for name in set(sys.modules) - known:
        if getattr(sys.modules[name], "__file__", None) and sys.modules[name].__file__.startswith(str(tmp_path)):
            del sys.modules[name]


def test_a_new_method_passes_its_check_and_trains(cli, tmp_path):
    code, out, err = cli("new-method", "my_idea")
    assert (code, err) == (0, "")
    assert "curiobench check my_idea:MyIdea\n" in out
    code, out, err = cli("check", "my_idea:MyIdea")
    assert (code, err) == (0, "")
    assert out.startswith(f"MyIdea in {tmp_path / 'my_idea.py'}\npass  is built, rewards and learns\n")
    assert "FAIL" not in out
    code, _, err = cli("train", *FLAGS, "--method", "my_idea:MyIdea+hm", "--method.hidden", "9", "--out", "run")
    assert (code, err) == (0, "")
    record = read_json(tmp_path / "run" / "config.json")
    assert record["config"]["method"] == "my_idea:MyIdea+hm"
    assert record["config"]["method_config"]["hidden"] == 9
    assert record["versions"]["method_file"] == str(tmp_path / "my_idea.py")
    assert len(record["versions"]["method_sha256"]) == 64
    assert float(read_rows(tmp_path / "run" / "progress.csv")[-1]["my_idea_loss"]) > 0
    config, agent = load_agent(tmp_path / "run", "my_idea:MyIdea+hm")
    assert RunConfig.from_json(config.to_json()) == config
    assert agent.learner.curiosity.method.model[0].out_features == 9


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("my_idea", r"my_idea\.py already exists and was not changed"),
        ("../escape", r"'\.\./escape' cannot name a method: expected letters, digits and _"),
        ("2fast", r"'2fast' cannot name a method"),
        ("class", r"'class' cannot name a method"),
        ("policy", r"'policy' cannot name a method: policy_loss is a metric of the agent's own"),
        ("__", r"'__' cannot name a method"),
        ("", "an argument is empty"),
        ("difflib", r"another module that is called 'difflib'"),
    ],
)
def test_names_that_will_not_do_are_refused(cli, tmp_path, name, message):
    (tmp_path / "my_idea.py").write_text("mine")
    code, out, err = cli("new-method", name)
    assert (code, out) == (2, "")
    assert re.fullmatch(rf"curiobench: .*{message}[^\n]*\n", err)
    assert (tmp_path / "my_idea.py").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["my_idea.py"]


def test_the_folder_is_made_and_the_files_name_is_the_modules(cli, tmp_path):
    assert cli("new-method", "Mine", "--out", "a/b")[0] == 0
    text = (tmp_path / "a" / "b" / "Mine.py").read_text()
    assert "class Mine(LearnedReward):" in text
    assert "NewMethod" not in text
    assert "new_method" not in text
    assert cli("new-method", "Mine", "--out", "/dev/null/x")[0] == 2


def test_a_check_that_fails_has_exit_code_1(cli, tmp_path):
    (tmp_path / "wide.py").write_text(
        "from curiobench.methods.rnd import RND\n"
        "class Wide(RND):\n    def reward(self, transitions): return super().reward(transitions)[:, None]\n"
    )
    code, out, err = cli("check", "wide:Wide")
    assert (code, err) == (1, "curiobench: wide:Wide fails 1 of 18 properties\n")
    assert "FAIL  reward has shape (B,)\n      expected (64,), found (64, 1)\n" in out
    message = "curiobench: sac is the agent without a curiosity method, so there is nothing to check\n"
    assert cli("check", "sac")[::2] == (2, message)
    assert cli("check", "rmd")[0] == 2


FAILING = """
from curiobench.methods.rnd import RND

class Failing(RND):
    def update(self, transitions):
        if transitions.epoch > 0:
            {fault}
        return super().update(transitions)
"""


def test_a_fault_stops_the_run_with_one_line_and_a_repaired_method_resumes(cli, tmp_path):
    path = tmp_path / "failing.py"
    path.write_text(FAILING.format(fault="raise KeyError('blocks')"))
    code, _, err = cli("train", *FLAGS, "--method", "failing:Failing", "--out", "run")
    assert code == 1
    where = rf"method failing:Failing in {re.escape(str(path))}, update 2: update\(\) raised KeyError: 'blocks'"
    assert re.fullmatch(
        rf"curiobench: run: epoch 2, cycle 1: MethodError: {where}; the last checkpoint is kept; details in [^\n]+\n",
        err,
    )
    assert "in update\n    raise KeyError('blocks')" in (tmp_path / "run" / "error.log").read_text()
    fingerprint = read_config(tmp_path / "run", {"failing:Failing"}).fingerprint()
    assert checkpoint.load(tmp_path / "run" / "checkpoint", fingerprint)[1]["counters"]["epoch"] == 1
    del sys.modules["failing"]  # as if the process were a new one
    path.write_text(FAILING.format(fault="pass"))
    code, out, err = cli("train", "--out", "run", "--resume", "--method", "failing:Failing")
    assert (code, err) == (0, "")
    assert re.search(r"numbers may differ: .*method_sha256 [0-9a-f]{64}, was [0-9a-f]{64}", out)


def test_a_run_whose_method_is_gone_names_both(cli, tmp_path):
    (tmp_path / "lost.py").write_text("from curiobench.methods.rnd import RND as Lost\n")
    RunFolder(tmp_path / "run", replace(TINY, method="lost:Lost"), resume=False).close()
    (tmp_path / "lost.py").unlink()
    del sys.modules["lost"]
    code, _, err = cli("evaluate", "run", "--method", "lost:Lost")
    assert code == 2
    assert "run/config.json: method 'lost:Lost': there is no module 'lost', neither installed nor in" in err


def test_an_installed_method_is_listed_without_importing_it(cli, monkeypatch):
    point = EntryPoint("mine", "nowhere:Mine", specs.GROUP)
    monkeypatch.setattr(specs, "entry_points", lambda group: [point])
    code, out, _ = cli("list")
    assert code == 0
    assert re.search(r"\n  mine +not built in: nowhere:Mine\n", out)


def test_a_run_folder_does_not_decide_which_code_runs(cli, tmp_path):
    """A config that names a module of the current directory gets it imported only where the user names it, too."""
    cli("new-method", "my_idea")
    spec = "my_idea:MyIdea"
    assert cli("train", *FLAGS, "--method", spec, "--out", "run")[0] == 0
    del sys.modules["my_idea"]
    (tmp_path / "my_idea.py").write_text("raise SystemExit('this must not run')")
    for command in (("evaluate", "run"), ("video", "run", "--goal", "a on b"), ("probe", "run")):
        code, _, err = cli(*command)
        assert code == 2
        assert err.startswith(f"curiobench: run: the method {spec} is not built in; add --method {spec} to allow")
    code, out, _ = cli("table", "run")
    assert code == 0
    assert spec in out
    assert "my_idea" not in sys.modules
    code, _, err = cli("evaluate", "run", "--method", spec)
    assert code == 2
    assert "this must not run" in err


GOALS = """
import numpy as np
from curiobench.methods.curriculum import Curriculum
from curiobench.methods.relabelling import Relabelling

class First(Curriculum):
    def __init__(self, goals, config):
        super().__init__(goals, config)
        self.episodes = 0

    def draw(self, situation, generator):
        return np.zeros(len(situation.start), int), np.ones(len(situation.start), bool)

    def observe(self, goals, reached, tested):
        assert tested.all() and not goals.any()
        self.episodes += len(goals)

    def replay_weights(self):
        return np.eye(len(self.goals.bits))[0]

    def metrics(self):
        return {"first_episodes": self.episodes}

    def state_dict(self):
        return {"episodes": self.episodes}

    def load_state_dict(self, state):
        self.episodes = state["episodes"]

class Last(Relabelling):
    "Hindsight with the goal that an episode ended in."

    def draw(self, replay, size, generator):
        slot = replay.draw_episodes(generator.random((2, size)))
        return slot, generator.integers(replay.steps, size=size), replay.arrays["achieved_goal"][slot, -1]

class Beyond(Last):
    def draw(self, replay, size, generator):
        slot, step, desired = super().draw(replay, size, generator)
        return slot, step + replay.steps, desired
"""


def test_a_package_brings_its_own_curriculum_and_its_own_relabelling(cli, tmp_path):
    (tmp_path / "my_goals.py").write_text(GOALS)
    for name in ("First", "Last"):
        spec = f"my_goals:{name}"
        code, _, err = cli("train", *FLAGS, "--method", spec, "--out", name)
        assert (code, err) == (0, "")
        record = read_json(tmp_path / name / "config.json")
        assert (record["config"]["method"], record["config"]["method_config"]) == (spec, {})
        assert record["versions"]["method_file"] == str(tmp_path / "my_goals.py")
    assert read_rows(tmp_path / "First" / "progress.csv")[-1]["first_episodes"] == "8"
    with pytest.raises(ValueError, match="First is not built in"):
        load_agent(tmp_path / "First")
    code, _, err = cli("train", *FLAGS, "--method", "my_goals:First+hm", "--out", "hm")
    assert (code, "+hm needs a method with an intrinsic reward" in err) == (2, True)
    code, _, err = cli("train", *FLAGS, "--method", "my_goals:Beyond", "--out", "beyond")
    assert code == 1
    assert re.search(r"Beyond in .*my_goals\.py: draw\(\) returned steps that are .*; expected 0 to 49", err)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (
            "def replay_weights(self): return np.ones(3)",
            r"replay_weights\(\) returned .* \(3,\); expected floats .* \(4,\)",
        ),
        (
            "def metrics(self): return {'success': 1.0}",
            r"metrics\(\) returned the metric success, which is the agent's own",
        ),
        (
            "def metrics(self): return {'mine': float('nan')}",
            r"metrics\(\) returned mine = nan; expected a finite number",
        ),
        ("def state_dict(self): return {'n': np.int64(3)}", r"state_dict\(\) raised TypeError: .*int64"),
        ("def __init__(self, goals, config): {}['a']", r"building it raised KeyError: 'a'"),
    ],
)
def test_a_fault_of_a_curriculum_names_it_and_its_file(cli, tmp_path, fault, message):
    (tmp_path / "my_goals.py").write_text(f"{GOALS}\nclass Faulty(First):\n    {fault}\n")
    code, _, err = cli("train", *FLAGS, "--method", "my_goals:Faulty", "--out", "run")
    assert code == (2 if "building" in message or "replay_weights" in message else 1)  # 2: nothing was begun
    assert re.search(rf"my_goals:Faulty'? in .*my_goals\.py: {message}", err), err
