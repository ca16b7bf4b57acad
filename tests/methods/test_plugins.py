"""Methods from outside: how a spec finds them, what is said when it does not, and faults while they train."""

import hashlib
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest
import torch
from layouts import SMALL
from test_sac import random_batch, same_state

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
def test_what_is_no_method_takes_one_line_that_names_spec_and_file(write, text, spec, message):
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


def faulty(name: str, function) -> RND:
    """RND with one function replaced, after one proper batch."""
    cls = type("Faulty", (RND,), {name: function, "__module__": __name__})
    return cls(SMALL.observation_size, SMALL.action_size, RND.Config(hidden=8), torch.Generator().manual_seed(0))


def ones(*shape: int, **options) -> torch.Tensor:
    return torch.ones(shape, **options)


@pytest.mark.parametrize("spec", ["rnd", "rnd+hm"])
@pytest.mark.parametrize(
    ("name", "function", "message"),
    [
        ("reward", lambda *_: ones(8, 1), r"reward\(\) returned .* shape \(8, 1\); expected a tensor of shape \(8,\)"),
        ("reward", lambda *_: None, r"reward\(\) returned a NoneType; expected a tensor of shape \(8,\)"),
        ("reward", lambda *_: ones(8).double(), r"reward\(\) returned a torch\.float64 .*; expected torch\.float32"),
        ("reward", lambda *_: ones(8, requires_grad=True), r"reward\(\) returned a tensor that carries gradients"),
        ("reward", lambda *_: ones(8) * np.nan, r"reward\(\) returned nan in 8 of 8 transitions"),
        ("reward", lambda *_: 1 / (1 - ones(8)), r"reward\(\) returned inf in 8 of 8 transitions"),
        ("reward", lambda *_: {}["a"], r"reward\(\) raised KeyError: 'a'"),
        ("update", lambda *_: {}["a"], r"update\(\) raised KeyError: 'a'"),
        (
            "update",
            lambda *_: {"rnd_loss": ones() * np.nan},
            r"update\(\) returned rnd_loss = nan; expected a finite number",
        ),
        ("update", lambda *_: {"rnd_loss": 1.0}, r"update\(\) returned rnd_loss = a float; expected a scalar tensor"),
        (
            "update",
            lambda *_: {"rnd_loss": ones(requires_grad=True)},
            r"update\(\) returned rnd_loss = .* carries gradients; ",
        ),
        ("update", lambda *_: None, r"update\(\) returned a NoneType; expected a dict of metrics"),
        ("update", lambda *_: {0: ones()}, r"update\(\) returned a metric named 0; expected a letter"),
        ("update", lambda *_: {"run": ones()}, r"update\(\) returned the metric run, which is the agent's own"),
        (
            "update",
            lambda *_: {"a,b": ones()},
            r"update\(\) returned a metric named 'a,b'; expected a letter",
        ),
        ("update", lambda *_: {"": ones()}, r"update\(\) returned a metric named ''; expected a letter"),
        ("update", lambda *_: {"a\nb": ones()}, r"update\(\) returned a metric named 'a\\nb'; expected a letter"),
        ("update", lambda *_: {"q": ones()}, r"update\(\) returned the metric q, which is the agent's own; .* my_q"),
        ("update", lambda *_: {}, r"update\(\) returned no metric rnd_loss, unlike the update before"),
        (
            "update",
            lambda *_: {"rnd_loss": ones(), "seen": ones()},
            r"update\(\) returned a metric seen, unlike the update before; expected the same each time",
        ),
        ("update", lambda *_: sys.exit("bye"), r"update\(\) raised SystemExit: bye"),
        ("policy_loss_term", lambda *_: ones(8, 1), r"policy_loss_term\(\) returned .*; expected .* of shape \(8,\)"),
        (
            "policy_loss_term",
            lambda *_: ones(8).double(),
            r"policy_loss_term\(\) returned .*; expected .*float32",
        ),
        ("policy_loss_term", lambda *_: ones(8) * np.nan, r"policy_loss_term\(\) returned nan in 8 of 8 transitions"),
        ("policy_loss_term", lambda *_: {}["a"], r"policy_loss_term\(\) raised KeyError: 'a'"),
    ],
)
def test_a_fault_in_training_names_method_file_and_update_and_spares_the_agent(spec, name, function, message):
    agent = make_agent(spec, SMALL, SACConfig(hidden=8), torch.Generator().manual_seed(0))
    batch = random_batch(SMALL, 8, np.random.default_rng(0))
    agent.update(batch)
    agent.learner.curiosity.method = faulty(name, function)
    before = agent.state_dict()
    with pytest.raises(MethodError, match=rf"method test_plugins:Faulty in .*test_plugins\.py, update 1: {message}"):
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
