"""Trained agents in a published set, as two files: the run's config.json and agent.safetensors.

`agent.safetensors` holds what the agent needs to act: the statistics of the encoder's normalisers, and the weights of
the policy that is evaluated (with `+hm`, the exploiting one). Critics, optimiser, curiosity method and replay buffer
are left out. The file contains no executable code.
"""

from collections.abc import Container
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from curiobench.analysis.folders import WEIGHTS
from curiobench.build import pair_layout
from curiobench.config import RunConfig
from curiobench.files import check_size, read_content
from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.sac import SAC
from curiobench.methods.process import tune_process
from curiobench.options import flatten
from curiobench.run_folder import read_config
from curiobench.tasks.registration import task_spec

MAX_BYTES = 1 << 26  # largest size of agent.safetensors; with the laptop preset it has 130 kB


def packed(agent: LearningAgent) -> bytes:
    """The content of `agent.safetensors`. The same agent gives the same bytes."""
    learner = agent.learner
    tensors = flatten({"encoder": learner.encoder.state_dict()})
    # the first policy is the one that is evaluated
    tensors |= {f"actor.{name}": weights[:1].detach() for name, weights in learner.actor.state_dict().items()}
    return save(tensors)


def load_published(folder: Path, trusted: Container[str] = ()) -> tuple[RunConfig, LearningAgent]:
    """The config, and an agent that acts as the run's agent does in evaluations. Its critics are untrained.

    Raises ValueError with a message of one line if a file is missing or damaged, the files do not match, or the method
    is external and not `trusted`.
    """
    config, path = read_config(folder, trusted), folder / WEIGHTS
    tune_process(config.torch_threads)
    try:
        check_size(path, MAX_BYTES)
        return config, _agent(config, read_content(path))
    except (SafetensorError, KeyError, ValueError, RuntimeError) as error:
        why = error if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
        raise ValueError(f"cannot use {path}: {' '.join(str(why).split())[:200]}") from None


def _agent(config: RunConfig, content: bytes) -> LearningAgent:
    """Raises SafetensorError, KeyError, ValueError or RuntimeError if the content is damaged or another agent's."""
    tensors = load(content)
    if odd := [name for name, tensor in tensors.items() if not tensor.isfinite().all()]:
        raise ValueError(f"{odd[0]} is not finite")
    if config.sac.hidden**2 > len(content):  # a layer has hidden² weights; do not allocate them for a wrong config
        raise ValueError(f"it is too small for sac.hidden {config.sac.hidden}")
    agent = SAC(pair_layout(task_spec(config.task).goal_space), config.sac, torch.Generator().manual_seed(0))
    encoder = agent.learner.encoder
    moments = {part: {n: tensors.pop(f"encoder.{part}.{n}") for n in own} for part, own in encoder.state_dict().items()}
    encoder.load_state_dict(moments)
    agent.learner.actor.load_state_dict({name.removeprefix("actor."): tensor for name, tensor in tensors.items()})
    return agent
