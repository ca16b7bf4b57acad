"""`curiobench check`: whether a curiosity method keeps the rules of `IntrinsicReward`, one line per property.

Each property is a function of a `Subject` that raises `Broken` with what was expected and found, or `Skipped` with the
reason; else it passes. `PROPERTIES` gives each its name. They are independent: a method that breaks one rule
fails one line.
"""

import copy
import io
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from curiobench.build import pair_layout
from curiobench.check import Finding, Skipped
from curiobench.check.subject import BATCH, Subject, global_generators, same, seeded_globals, snapshot
from curiobench.methods.guard import flaw_of_metrics, flaw_of_state, flaw_of_term, flaw_of_values
from curiobench.methods.plugins import error_line
from curiobench.methods.reward import IntrinsicReward, Transitions
from curiobench.tasks.goals import goal_space

MAX_COST = 2.0
"""Cost of an update, as a multiple of one of `sac`, above which there is a warning."""
ROUNDS = 15
"""Timed rounds, of which the median counts: other processes may be at work."""
TIMED_BATCH = 512
"""Transitions in a timed batch."""


class Broken(Exception):
    """A rule is broken; says what was expected and what was found."""


def examine(method: type[IntrinsicReward]) -> list[Finding]:
    """Try every property of a method, in the sizes of the task with two blocks; global random state is left as it is.

    One that cannot be built, or whose reward or update raises, is not examined further.
    """
    subject = Subject(method, pair_layout(goal_space(2)))
    with seeded_globals():
        first = finding("is built, rewards and learns", Subject.trained, subject)
        if first.verdict == "FAIL":
            return [first, *(Finding(name, "skip", "it does not run") for name in [*PROPERTIES, COST])]
        return [first, *(finding(name, tried, subject) for name, tried in PROPERTIES.items()), cost(subject)]


def finding(name: str, tried: Callable[[Subject], object], subject: Subject) -> Finding:
    """The finding for one property."""
    try:
        tried(subject)
    except Skipped as reason:
        return Finding(name, "skip", str(reason))
    except Broken as fault:
        return Finding(name, "FAIL", str(fault))
    except (Exception, SystemExit) as error:
        return Finding(name, "FAIL", f"expected no error, found {error_line(error)}")
    return Finding(name, "pass")


def expect(holds: bool, expected: str, found: object) -> None:
    """Raises Broken unless a property holds."""
    if not holds:
        raise Broken(f"expected {expected}, found {found}")


def expect_untouched(now: Mapping[str, Any], then: Mapping[str, Any], expected: str) -> None:
    """Raises Broken with the names of values that differ."""
    altered = [name for name, value in now.items() if not same(value, then[name])]
    expect(not altered, expected, f"altered in place: {', '.join(altered)}")


def no_global_randomness(before: tuple) -> None:
    """Raises Broken where a global generator is not as before."""
    states = zip(("torch", "numpy", "random"), before, global_generators(), strict=True)
    used = ", ".join(name for name, then, now in states if not same(then, now))
    expect(not used, "all randomness from the given generator", f"the global one of {used} was used")


def _reward(subject: Subject) -> Tensor:
    reward = subject.trained().reward(subject.transitions(5))
    expect(isinstance(reward, Tensor), "a tensor", f"a {type(reward).__name__}")
    return reward


def shape(subject: Subject) -> None:
    reward, wanted = _reward(subject), (len(subject.transitions(5).state),)
    expect(reward.shape == wanted, f"{wanted}", f"{tuple(reward.shape)}")


def dtype(subject: Subject) -> None:
    found = _reward(subject).dtype
    expect(found == torch.float32, "torch.float32", found)


def finite(subject: Subject) -> None:
    for about, transitions in _hard_batches(subject).items():
        reward = subject.trained().reward(transitions).detach()
        wrong = reward[~reward.isfinite()]
        expect(not len(wrong), "finite numbers", f"{wrong.flatten()[:1].tolist()} among {reward.numel()}, {about}")


def _hard_batches(subject: Subject) -> dict[str, Transitions]:
    """Batches that training has now and then, by what is odd about them."""
    plain = subject.transitions(5)
    rows = {"of which every other is repeated": torch.arange(BATCH) // 2 * 2, "all alike": torch.zeros(BATCH).long()}
    found = {f"transitions {about}": plain.rows(order) for about, order in rows.items()}
    ends = [torch.full_like(plain.state, 5.0), torch.full_like(plain.state, -5.0)]
    found["states at both ends of their range"] = replace(plain, state=ends[0], next_state=ends[1])
    epochs = {f"in epoch {epoch}": replace(plain, epoch=epoch) for epoch in (0, 500)}
    return {"noise": plain} | found | epochs


def no_gradients(subject: Subject) -> None:
    expect(not _reward(subject).requires_grad, "none (put @torch.no_grad() above reward)", "a reward with them")


def reward_changes_nothing(subject: Subject) -> None:
    method = subject.trained()
    before, first = snapshot(method), method.reward(subject.transitions(5))
    method.reward(subject.transitions(6))
    again = method.reward(subject.transitions(5))
    expect(same(again, first), "the same reward when asked again", "another one")
    expect(same(snapshot(method), before), "the same state after rewarding", "another one")


def metrics(subject: Subject) -> None:
    found = subject.trained().update(subject.transitions(5))
    if flaw := flaw_of_metrics(found):
        raise Broken(f"found {flaw}")
    infinite = [name for name, value in found.items() if not value.isfinite()]
    expect(not infinite, "finite metrics", f"NaN or infinity in {', '.join(infinite)}")


def batch_untouched(subject: Subject) -> None:
    given, kept = subject.transitions(5), subject.transitions(5)
    goal, action = subject.view(5).desired_goal, subject.view(5).action
    method = subject.trained()
    method.reward(given)
    method.update(given)
    method.policy_loss_term(given, goal, action)
    name, view = "arguments of policy_loss_term", subject.view(5)
    now, then = vars(given) | {name: [goal, action]}, vars(kept) | {name: [view.desired_goal, view.action]}
    expect_untouched(now, then, "the batch as it was given")


def agent_untouched(subject: Subject) -> None:
    agent, method, transitions = subject.agent(), subject.trained(), subject.transitions(5)
    batch = subject.batch()
    inputs = agent.learner.encoder.encode(batch.observation, batch.achieved_goal, batch.desired_goal)
    (action,), _ = agent.learner.actor.sample(inputs, torch.zeros_like(batch.action))
    method.reward(transitions)
    method.update(transitions)
    method.policy_loss_term(transitions, batch.desired_goal, action)
    reached = [weight for weight in agent.learner.trained if weight.grad is not None]
    expect(not reached, "no gradient in the agent's weights", f"one in {len(reached)} of its tensors")


def term_in_policy_loss(subject: Subject) -> None:
    method, view = subject.trained(), subject.view(5)
    action = view.action.clone().requires_grad_()
    term = method.policy_loss_term(subject.transitions(5), view.desired_goal, action)
    if term is None:
        raise Skipped("it adds none")
    if flaw := flaw_of_term(term, len(action)) or flaw_of_values(term.detach()):
        raise Broken(f"found {flaw}")


def plain_state(subject: Subject) -> None:
    state = subject.trained().state_dict()
    if flaw := flaw_of_state(state):
        raise Broken(f"found {flaw}")
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    torch.load(file, weights_only=True)


def round_trip(subject: Subject) -> None:
    generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
    first, second = subject.trained(generators[0]), subject.fresh(generators[1])
    second.load_state_dict(snapshot(first))
    generators[1].set_state(generators[0].get_state())  # which the agent restores
    histories = [_continued(subject, method) for method in (first, second)]
    expect(same(*histories), "training to continue to the bit in a new one that loads the state", "other numbers")


def _continued(subject: Subject, method: IntrinsicReward) -> list:
    """Rewards and metrics of three more batches, and the state after them."""
    with seeded_globals():
        history = [call(subject.transitions(seed)) for seed in range(10, 13) for call in (method.reward, method.update)]
    return [*history, snapshot(method)]


def deterministic(subject: Subject) -> None:
    histories = []
    for _ in range(2):
        with seeded_globals():
            method = subject.trained(torch.Generator().manual_seed(0))
            histories.append([snapshot(method), method.reward(subject.transitions(5)).detach()])
    expect(same(*histories), "equal numbers from generators with equal seeds", "different ones")


def global_random_state(subject: Subject) -> None:
    before = global_generators()
    subject.trained().reward(subject.transitions(5))
    no_global_randomness(before)


def blind_to_goals(subject: Subject) -> None:
    if subject.method.uses_policy:
        raise Skipped("with uses_policy the reward may depend on the goal")
    method, seen, view = subject.trained(), subject.transitions(5), subject.view(5)
    state, rewards = snapshot(method), []
    for policy in (None, view, replace(view, desired_goal=1 - view.desired_goal)):
        method.load_state_dict(copy.deepcopy(state))  # another rule is about rewards that change the method
        rewards.append(method.reward(replace(seen, policy=policy)))
    expect(same(rewards[0], rewards[1]) and same(*rewards[1:]), "one reward for any goal", "it changes with the goal")


def idle_in_evaluation(subject: Subject) -> None:
    method, batch = subject.trained(), subject.batch()
    agent, before = subject.agent(method), snapshot(method)
    seen = [tensor.numpy() for tensor in (batch.observation, batch.achieved_goal, batch.desired_goal)]
    for _ in range(10):
        agent.act(*seen, deterministic=True)
    expect(same(snapshot(method), before), "the same state after the agent has only acted", "another one")


def other_sizes(subject: Subject) -> None:
    three = Subject(subject.method, pair_layout(goal_space(3)))
    for tried, size in ((subject, 33), (three, 33), (three, 50)):
        method, transitions = tried.fresh(), tried.transitions(5, size)
        reward = method.reward(transitions)
        method.update(transitions)
        expect(len(reward) == size, f"{size} rewards for as many transitions", len(reward))


PROPERTIES: dict[str, Callable[[Subject], None]] = {
    "reward has shape (B,)": shape,
    "reward is float32": dtype,
    "reward is finite": finite,
    "reward carries no gradients": no_gradients,
    "reward changes nothing in the method": reward_changes_nothing,
    "update returns finite scalars": metrics,
    "batch is left as it is": batch_untouched,
    "no gradient leaks into the agent": agent_untouched,
    "term in the policy's loss is finite and (B,)": term_in_policy_loss,
    "state holds tensors and plain values": plain_state,
    "state round-trips to the bit": round_trip,
    "deterministic under its generator": deterministic,
    "global random state is left alone": global_random_state,
    "unchanged when the goal is relabelled": blind_to_goals,
    "does not train while evaluating": idle_in_evaluation,
    "takes 2 and 3 blocks, and other batches": other_sizes,
}
"""Checks by the name of the property."""

COST = "cost of an update"
"""Name of the finding that is a measurement."""


def cost(subject: Subject) -> Finding:
    """What the method adds to an update of `sac`; both are timed in turns, so that a busy machine slows both."""
    agent, method = subject.agent(), subject.fresh()
    batch, transitions = subject.batch(TIMED_BATCH), subject.transitions(0, TIMED_BATCH)
    ratios = []
    for _ in range(ROUNDS):
        started = time.perf_counter()
        agent.update(batch)
        between = time.perf_counter()
        method.reward(transitions)
        method.update(transitions)
        ratios.append((time.perf_counter() - started) / (between - started))
    found = float(np.median(ratios))
    detail = f"{found:.2f} times that of sac alone; expected at most {MAX_COST:g}"
    return Finding(COST, "warn" if found > MAX_COST else "pass", detail)
