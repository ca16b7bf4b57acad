"""Run-time checks of what a curiosity method returns, so that a fault stops the run where it occurs.

A violation raises MethodError, which names the method, its file and the update. Checks of shapes and types cost almost
nothing. Checks of values take microseconds on a CPU. On CUDA they synchronise with the device, so they are made only
every CUDA_CHECK_EVERY updates. `Curiosity` calls these functions.
"""

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import Tensor

from curiobench.methods.plugins import Method, error_line, file_of

CUDA_CHECK_EVERY = 100
"""Updates between checks for non-finite values on CUDA, where a check synchronises. A CPU checks every update."""
TAKEN = frozenset(
    (
        "epoch", "steps", "updates", "episodes", "diverged", "training_success", "training_success_unsatisfied",
        "goals_reached", "goals_learned", "success", "seconds", "seconds_collecting", "seconds_sampling",
        "seconds_updating", "seconds_evaluating", "seconds_checkpointing",
        "reward", "critic_loss", "q", "target_q", "policy_loss", "entropy", "temperature", "temperature_loss",
        "intrinsic_raw", "intrinsic_normalised", "bonus_spread",
        "explorer_policy_loss", "explorer_entropy", "explorer_temperature", "explorer_temperature_loss",
        "q_int_loss", "q_int_popart", "q_int_zscore", "popart_mean", "popart_scale", "share_exploitation",
        "q_ext_action_spread", "q_int_action_spread", "tau",
        "run", "task", "method", "variant", "seed",
    )
)  # fmt: skip
"""Columns of progress.csv, or of the data frame made from it, that belong to the run or the agent. A method's metrics
must have other names."""
_METRIC = re.compile(r"[A-Za-z_][\w./-]{0,99}", re.ASCII)
"""Names of metrics, which are columns of a csv file."""


class NonFiniteError(FloatingPointError):
    """A loss became NaN or infinite; names the update and the term. Weights are those before that update."""


class MethodError(RuntimeError):
    """A method raised an exception or returned an invalid value. The message is one line with the class, the file and,
    for a curiosity method, the update."""


@contextmanager
def blamed(method: Method, call: str, update: int | None = None) -> Iterator[None]:
    """Turn any exception of a method's function `call` into a MethodError."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise fault(method, update, f"{call}() raised {error_line(error)}") from error


def flaw_of_reward(reward: object, size: int) -> str | None:
    """What is wrong with the form of a batch of `size` rewards, and what was expected; None if nothing is."""
    if not isinstance(reward, Tensor) or reward.shape != (size,):
        return f"{outline(reward)}; expected a tensor of shape {(size,)}, one reward per transition"
    if reward.dtype != torch.float32:
        return f"{outline(reward)}; expected torch.float32"
    if reward.requires_grad:
        return "a tensor that carries gradients; expected none: put @torch.no_grad() above reward()"
    return None


def flaw_of_values(numbers: Tensor) -> str | None:
    """How many numbers (B,) are NaN or infinite; None if all are finite. Waits for the device."""
    finite = numbers.isfinite()
    if finite.all():
        return None
    wrong = numbers[~finite]
    return f"{wrong[0].item()} in {len(wrong)} of {len(numbers)} transitions; expected finite numbers"


def flaw_of_term(term: object, size: int) -> str | None:
    """What is wrong with the form of a term in the policy's loss of `size` transitions; None if nothing is."""
    if not isinstance(term, Tensor) or term.shape != (size,) or term.dtype != torch.float32:
        return f"{outline(term)}; expected a torch.float32 tensor of shape {(size,)}"
    return None


def flaw_of_metrics(metrics: object, before: Collection[str] | None = None) -> str | None:
    """What is wrong with the form of the metrics of an update, and what was expected; None if nothing is.

    `before` has the names of the previous update's metrics.
    """
    if not isinstance(metrics, dict):
        return f"{outline(metrics)}; expected a dict of metrics"
    if found := flaw_of_names(metrics):
        return found
    if before is not None and metrics.keys() != set(before):
        odd = min(metrics.keys() ^ set(before))
        return f"{'a' if odd in metrics else 'no'} metric {odd}, unlike the update before; expected the same each time"
    for name, value in metrics.items():
        if not isinstance(value, Tensor) or value.shape != () or value.requires_grad:
            return f"{name} = {outline(value)}; expected a scalar tensor without gradients"
    return None


def flaw_of_names(metrics: dict[Any, Any]) -> str | None:
    """What is wrong with the names of metrics, which are columns of progress.csv; None if nothing is."""
    if odd := [name for name in metrics if not isinstance(name, str) or not _METRIC.fullmatch(name)]:
        return f"a metric named {odd[0]!r:.80}; expected a letter, then letters, digits and _ . / -"
    if taken := sorted(metrics.keys() & TAKEN):
        return f"the metric {taken[0]}, which is the agent's own; expected another name, such as my_{taken[0]}"
    return None


def flaw_of_state(state: object, name: str = "state") -> str | None:
    """The first part of a state that is not a dict, list, tuple, tensor or plain value; None if there is none."""
    if isinstance(state, dict):
        parts = {f"{name}[{key!r}]": value for key, value in state.items()}
    elif isinstance(state, list | tuple):
        parts = {f"{name}[{k}]": value for k, value in enumerate(state)}
    elif state is None or isinstance(state, Tensor) or type(state) in (bool, int, float, str):
        return None
    else:
        return f"{name} = a {type(state).__name__}; expected tensors and plain values only"
    return next(filter(None, (flaw_of_state(value, part) for part, value in parts.items())), None)


def outline(value: object) -> str:
    """Type and shape of a value, for messages."""
    if isinstance(value, np.ndarray):
        return f"a {value.dtype} array of shape {value.shape}"
    if not isinstance(value, Tensor):
        return f"a {type(value).__name__}"
    gradients = " that carries gradients" if value.requires_grad else ""
    return f"a {value.dtype} tensor of shape {tuple(value.shape)}{gradients}"


def checks_values(tensor: Tensor, update: int) -> bool:
    """Whether values are checked at this update. Reading them from a GPU synchronises with it."""
    return not tensor.is_cuda or update % CUDA_CHECK_EVERY == 0


def fault(method: Method, update: int | None, what: str) -> MethodError:
    """The error that names a method, its file and, if there is one, the update."""
    cls = type(method)
    at = "" if update is None else f", update {update}"
    return MethodError(f"method {cls.__module__}:{cls.__qualname__} in {file_of(cls)}{at}: {what}")
