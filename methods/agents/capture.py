"""Static buffers for a batch, and a CUDA graph of the update that reads them."""

from collections.abc import Callable

import torch
from torch import Tensor

from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.reward import Batch

WARM_UP = 3
"""Updates that run eagerly before the capture, so that optimiser state and workspaces exist."""


class StaticBatch:
    """A batch in float32 buffers at fixed addresses, in the layout that the encoder reads."""

    def __init__(self, layout: PairLayout, batch: Batch, device: torch.device) -> None:
        """
        Args:
            layout: sizes of observations, goals and actions.
            batch: the first batch of B transitions; sets the size.
            device: device of the buffers.
        """
        self.size = size = len(batch.reward)
        self.rows = torch.empty((2, size, layout.observation_size + 2 * layout.goal_size), device=device)
        """[observation | achieved | desired] before and after the step."""
        self.action = torch.empty((size, layout.action_size), device=device)
        self.reward = torch.empty(size, device=device)
        """r_ext; becomes r_ext + tau · n(r_int)."""
        parts = (layout.observation_size, layout.goal_size, layout.goal_size)
        self.source = batch
        """The batch that was loaded last. The curiosity method reads it; no graph is captured if there is one."""
        self.observation, self.achieved_goal, self.desired_goal = self.rows.split(parts, dim=2)

    def load(self, batch: Batch) -> None:
        """Copy in a batch of the same size and any numeric types."""
        self.observation[0].copy_(batch.observation)
        self.observation[1].copy_(batch.next_observation)
        self.achieved_goal[0].copy_(batch.achieved_goal)
        self.achieved_goal[1].copy_(batch.next_achieved_goal)
        self.desired_goal.copy_(batch.desired_goal)
        self.action.copy_(batch.action)
        self.reward.copy_(batch.reward)
        self.source = batch


class CapturedStep:
    """Calls `step`, a function of static buffers. On CUDA it replays the graph of `step` from the fourth call on.

    On CUDA the results lie in the graph's memory, so they are copied. On a CPU this is a plain call. The CUDA branch
    has never been run, because no GPU was available. A test on a CPU checks that `step` reads nothing but static
    buffers and the agent's state.
    """

    def __init__(self, step: Callable[[], dict[str, Tensor]], generator: torch.Generator) -> None:
        """
        Args:
            step: the function to call. Its Python code must not depend on values of tensors.
            generator: the source of its random numbers.
        """
        self.step, self.generator, self.calls = step, generator, 0
        self.graph: torch.cuda.CUDAGraph | None = None
        self.result: dict[str, Tensor] = {}

    def __call__(self) -> dict[str, Tensor]:
        self.calls += 1
        if self.generator.device.type != "cuda":
            return self.step()
        if self.calls <= WARM_UP:
            return self._beside_the_default_stream()
        if self.graph is None:
            self.graph = torch.cuda.CUDAGraph()
            self.graph.register_generator_state(self.generator)
            with torch.cuda.graph(self.graph):
                self.result = self.step()
        self.graph.replay()
        return {name: value.clone() for name, value in self.result.items()}

    def _beside_the_default_stream(self) -> dict[str, Tensor]:
        """Run a warm-up call on a side stream, as the documentation of torch.cuda.graph requires."""
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            result = self.step()
        torch.cuda.current_stream().wait_stream(stream)
        return result
