"""Methods that are not built in: how a spec finds them, errors where it does not, and faults while they train."""

import hashlib
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest
import torch
from agents import random_batch
from layouts import SMALL

from curiobench.check.subject import same as same_state
from curiobench.methods import specs
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.guard import MethodError
from curiobench.methods.registry import available_specs, make_agent, parse_spec, traced
from curiobench.methods.rnd import RND

MINE = """
from dataclasses import dataclass
import torch
from curiobench.methods.reward import IntrinsicReward
from curiobench.methods.rnd import RND

class Mine(RND):
    "Alters nothing."
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes a module into the current directory, which is searched like a user's; forgets it afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    known = set(sys.modules)

    def module(text: str, name: str = "outside") -> str:
        (tmp_path / f"{name}.py").write_text(text)
        return str(tmp_path / f"{name}.py")

    yield module
    for name in set(sys.modules) - known:
        del sys.modules[name]


def test_a_class_is_found_in_the_current_directory_and_keeps_its_case(write, tmp_path):
    path = write(MINE)
    found = parse_spec(" outside:Mine+HM ")
    assert (found.text, found.hybrid, found.reward.__name__) == ("outside:Mine+hm", True, "Mine")
    assert parse_spec(found.text) == found
    assert not parse_spec("outside:Mine").hybrid
    digest = hashlib.sha256(MINE.encode()).hexdigest()
    assert traced("outside:Mine+hm") == {"method_file": path, "method_sha256": digest}
    assert sys.path[-1] == str(tmp_path)


def test_the_current_directory_is_searched_last(write, tmp_path):
    write("raise AssertionError", "difflib")
    with pytest.raises(ValueError, match=r"method 'difflib:Mine' in .*lib.*difflib\.py: there is no class 'Mine'"):
        parse_spec("difflib:Mine")


def test_built_in_methods_are_not_traced_and_search_nothing():
    before = list(sys.path)
    assert traced("sac") == traced("rnd+hm") == traced("curiobench.methods.rnd:RND") == {}
    parse_spec("rnd")
    assert sys.path[: len(before)] == before


def test_installed_methods_have_a_name(write, monkeypatch):
    write(MINE)
    point = EntryPoint("Mine", "outside:Mine", specs.GROUP)
    monkeypatch.setattr(specs, "entry_points", lambda group: [point] if group == specs.GROUP else [])
    assert {"mine", "mine+hm"} < {*available_specs()}
    assert "outside" not in sys.modules
    found = parse_spec("MINE+hm")
    assert (found.text, found.reward.__name__, found.hybrid) == ("mine+hm", "Mine", True)
    assert traced("mine").keys() == {"method_file", "method_sha256"}
    with pytest.raises(ValueError, match="the nearest is 'mine'"):
        parse_spec("minne")


def test_a_name_that_two_packages_give_is_nobodys(monkeypatch):
    points = [EntryPoint("mine", value, specs.GROUP) for value in ("one:Mine", "two:Mine")]
    monkeypatch.setattr(specs, "entry_points", lambda group: points)
    with pytest.raises(ValueError, match="'mine': several installed packages provide it: one:Mine, two:Mine"):
        parse_spec("mine")


def test_installed_methods_cannot_take_the_place_of_built_in_ones(monkeypatch):
    points = [EntryPoint(name, "one:Mine", specs.GROUP) for name in ("sac", "RND", "mihm")]
    monkeypatch.setattr(specs, "entry_points", lambda group: points)
    assert len({*available_specs()}) == len(available_specs())
    assert parse_spec("rnd").reward is RND


CONFIG = "@dataclass(frozen=True)\nclass C:\n    "


@pytest.mark.parametrize(
    ("text", "spec", "message"),
    [
        ("", "nowhere:Mine", r"'nowhere:Mine': there is no module 'nowhere', neither installed nor in "),
        ("", "outside.py:Mine", r"there is no module 'outside\.py'.*; leave out the \.py .*: outside$"),
        ("", "outside:", r"'outside:': expected package\.module:Class"),
        ("", "../outside:Mine", r"'\.\./outside:Mine': expected package\.module:Class"),
        ("import nowhere_either", "outside:Mine", r"outside\.py, line 1: .*ModuleNotFoundError: .*nowhere_either"),
        ("x = 1\n1 / 0", "outside:Mine", r"outside\.py, line 2: importing outside raised ZeroDivisionError"),
        ("def f(:", "outside:Mine", r"outside\.py, line 1: importing outside raised SyntaxError"),
        ("raise SystemExit(3)", "outside:Mine", r"outside\.py, line 1: importing outside raised SystemExit: 3"),
        (MINE, "outside:Nine", r"outside\.py: there is no class 'Nine'; its methods are RND, Mine"),
        (MINE, "outside:torch", r"outside\.py: torch is not a class derived from .*IntrinsicReward"),
        (MINE + "class Half(IntrinsicReward): pass", "outside:Half", r"Half lacks load_state_dict, reward, state_dict"),
        (
            MINE + "Mine.Config = None",
            "outside:Mine",
            r"outside\.py: Mine\.Config is None; expected a dataclass with fro",
        ),
        (
            MINE + "def __getattr__(name): raise OSError('no weights here')",
            "outside:Lazy",
            r"outside\.py: looking for Lazy raised OSError: no weights here",
        ),
        (MINE + f"{CONFIG}k: int\nMine.Config = C", "outside:Mine", r"Mine\.Config cannot be made from its defaults"),
        (MINE + f"{CONFIG}k: tuple = ()\nMine.Config = C", "outside:Mine", r"Mine\.Config\.k is a <class 'tuple'>"),
    ],
)
def test_what_is_no_method_is_refused_in_one_line_that_names_spec_and_file(write, text, spec, message):
    write(text)
    with pytest.raises(ValueError, match=message) as refused:
        parse_spec(spec)
    assert "\n" not in str(refused.value)
    assert spec.partition("+")[0] in str(refused.value)


def test_settings_may_be_anything_that_survives_json(write):
    fields = "a: int | None = None\n    b: Literal['x', 'y'] = 'x'\n    c: Optional[float] = 1.0\n    d: bool = True\n"
    write(f"{MINE}from typing import Literal, Optional\n{CONFIG}{fields}Mine.Config = C")
    assert parse_spec("outside:Mine").reward.Config().b == "x"


def test_a_method_that_cannot_be_built_is_named_with_its_file(write):
    path = write(f"{MINE}    def __init__(self, *sizes): raise KeyError('blocks')")
    with pytest.raises(
        ValueError, match=r"method 'outside:Mine' in .*: building it raised KeyError: 'blocks'"
    ) as found:
        make_agent("outside:Mine", SMALL, SACConfig(hidden=8), torch.Generator())
    assert path in str(found.value)


def test_a_class_that_sees_a_part_of_the_state_is_built_for_its_size(write):
    text = MINE.replace("rnd import RND", "icm import ICM").replace("(RND)", "(ICM)")  # which has no setting `sees`
    write(f"{text}    sees = 'positions'\n    def __init__(self, size, *_): raise KeyError(size)")
    with pytest.raises(ValueError, match=f"KeyError: {len(SMALL.columns('positions'))}$"):
        make_agent("outside:Mine", SMALL, SACConfig(hidden=8), torch.Generator())


def faulty(name: str, function) -> RND:
    """RND with one function replaced, after one proper batch."""
    cls = type("Faulty", (RND,), {name: function, "__module__": __name__})
    return cls(SMALL.observation_size, SMALL.action_size, RND.Config(hidden=8), torch.Generator().manual_seed(0))


def ones(*shape: int, **options) -> torch.Tensor:
    return torch.ones(shape, **options)


OWN = "which is the agent's own"
FAULTS = {
    "reward": [
        (lambda *_: ones(8, 1), r"returned .* shape \(8, 1\); expected a tensor of shape \(8,\)"),
        (lambda *_: None, r"returned a NoneType; expected a tensor of shape \(8,\)"),
        (lambda *_: ones(8).double(), r"returned a torch\.float64 .*; expected torch\.float32"),
        (lambda *_: ones(8, requires_grad=True), r"returned a tensor that carries gradients"),
        (lambda *_: ones(8) * np.nan, r"returned nan in 8 of 8 transitions"),
        (lambda *_: {}["a"], r"raised KeyError: 'a'"),
    ],
    "update": [
        (lambda *_: {}["a"], r"raised KeyError: 'a'"),
        (lambda *_: sys.exit("bye"), r"raised SystemExit: bye"),
        (lambda *_: None, r"returned a NoneType; expected a dict of metrics"),
        (lambda *_: {"rnd_loss": ones() * np.nan}, r"returned rnd_loss = nan; expected a finite number"),
        (lambda *_: {"rnd_loss": 1.0}, r"returned rnd_loss = a float; expected a scalar tensor"),
        (lambda *_: {"rnd_loss": ones(requires_grad=True)}, r"returned rnd_loss = .* carries gradients; "),
        (lambda *_: {0: ones()}, r"returned a metric named 0; expected a letter"),
        (lambda *_: {"a,b": ones()}, r"returned a metric named 'a,b'; expected a letter"),
        (lambda *_: {"a\nb": ones()}, r"returned a metric named 'a\\nb'; expected a letter"),
        (lambda *_: {"run": ones()}, rf"returned the metric run, {OWN}"),
        (lambda *_: {"q": ones()}, rf"returned the metric q, {OWN}; .* my_q"),
        (lambda *_: {}, r"returned no metric rnd_loss, unlike the update before"),
        (lambda *_: {"rnd_loss": ones(), "seen": ones()}, r"returned a metric seen, unlike the update before"),
    ],
    "policy_loss_term": [
        (lambda *_: ones(8, 1), r"returned .*; expected .* of shape \(8,\)"),
        (lambda *_: ones(8).double(), r"returned .*; expected .*float32"),
        (lambda *_: ones(8) * np.nan, r"returned nan in 8 of 8 transitions"),
        (lambda *_: {}["a"], r"raised KeyError: 'a'"),
    ],
}


@pytest.mark.parametrize(
    ("name", "function", "message"), [(name, *fault) for name, faults in FAULTS.items() for fault in faults]
)
def test_a_fault_in_training_names_method_file_and_update_and_spares_the_agent(name, function, message):
    agent = make_agent("rnd", SMALL, SACConfig(hidden=8), torch.Generator().manual_seed(0))
    batch = random_batch(SMALL, 8, np.random.default_rng(0))
    agent.update(batch)
    agent.learner.curiosity.method = faulty(name, function)
    before = agent.state_dict()
    where = rf"method test_plugins:Faulty in .*test_plugins\.py, update 1: {name}\(\) "
    with pytest.raises(MethodError, match=where + message):
        agent.update(batch)
    after = agent.state_dict()
    assert all(same_state(after[part], before[part]) for part in ("actor", "critics", "target_critics", "optimiser"))


def test_a_method_that_does_not_take_its_state_back_is_named():
    agent = make_agent("rnd", SMALL, SACConfig(hidden=8), torch.Generator().manual_seed(0))
    state = agent.state_dict()
    agent.learner.curiosity.method = faulty("load_state_dict", lambda self, state: state["old"])
    with pytest.raises(
        MethodError, match=r"method test_plugins:Faulty in .*: load_state_dict\(\) raised KeyError: 'old'"
    ):
        agent.load_state_dict(state)


def test_a_state_that_no_checkpoint_gives_back_is_refused_when_it_is_saved():
    agent = make_agent("rnd", SMALL, SACConfig(hidden=8), torch.Generator().manual_seed(0))
    agent.learner.curiosity.method = faulty("state_dict", lambda self: {"seen": [1, {2}]})
    with pytest.raises(MethodError, match=r"state_dict\(\) returned state\['seen'\]\[1\] = a set; expected tensors"):
        agent.state_dict()
