"""Goal-conditioned actor and twin critics over pairs of blocks, as Deep Sets.

Every network here is

    rho( sum over pairs (i, j) of  phi(context, block i, block j, achieved bits of (i, j), desired bits of (i, j)) )

where the context is the body (grip and fingers), and for a critic the action too (after DECSTR, Akakzia et al. 2021,
arXiv 2006.07185). Differences from DECSTR: phi ends in `hidden` units, not in three times the size of its input; layers
may be normalised; pairs may be symmetric; and statistics of the inputs are shared by blocks.

Achieved bits could be computed from the blocks' positions, but only as a sharp threshold that a network is slow to
learn. They are observable and DECSTR feeds them too, so they are always fed.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from curiobench.methods.deepsets import DeepSets
from curiobench.methods.moments import RunningMoments
from curiobench.methods.settings import PairMode

LOG_STD_RANGE = (-5.0, 2.0)
LOG_2 = math.log(2.0)
LOG_SQRT_2_PI = 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class PairLayout:
    """Where body, blocks and predicate bits stand in flat observations and goals: plain data, made by the harness.

    An observation is `[body | block 0 | block 1 | …]`. Bits are found by name through `pairs`, never by position, so
    that networks and environment cannot disagree on their order.

    Raises ValueError where `pairs` does not name every pair i < j once and every goal bit once.
    """

    n_blocks: int
    """Number of blocks, at least 2."""
    pairs: tuple[tuple[int, int, int, int, int], ...]
    """For each i < j: (i, j, index of close(i, j), index of on(i, j), index of on(j, i)) in the goal."""
    body_size: int = 10
    """Numbers that describe the hand, at the front of the observation."""
    block_size: int = 15
    """Numbers that describe each block."""
    action_size: int = 4
    """Numbers in an action, each in [-1, 1]."""

    def __post_init__(self) -> None:
        if self.n_blocks < 2:
            raise ValueError(f"n_blocks is {self.n_blocks}; pairs need at least 2 blocks")
        named = sorted((i, j) for i, j, *_ in self.pairs)
        if named != list(combinations(range(self.n_blocks), 2)):
            raise ValueError(f"pairs name {named}; every pair i < j of {self.n_blocks} blocks must appear once")
        bits = sorted(bit for _, _, *pair_bits in self.pairs for bit in pair_bits)
        if bits != list(range(self.goal_size)):
            raise ValueError(f"pairs use the goal bits {bits}; each of 0…{self.goal_size - 1} must appear once")

    @property
    def observation_size(self) -> int:
        """Length of a flat observation."""
        return self.body_size + self.n_blocks * self.block_size

    @property
    def goal_size(self) -> int:
        """Length of a flat goal: three predicates a pair."""
        return 3 * len(self.pairs)


class PairInputs(NamedTuple):
    """What the networks read, computed once a batch and shared by all of them."""

    state: Tensor
    """(B, D) normalised observation; its first `body_size` columns are the body."""
    pairs: Tensor
    """(P, B, F) features of each pair. Pairs come first, so that a sum over them adds contiguous blocks of memory."""


class PairEncoder:
    """Normalises observations and goals, and gathers the features of each pair of blocks. Holds no weights.

    Statistics are shared by all blocks, and by all pairs of the same predicate: were each block normalised by its own
    numbers, renaming blocks would change what the networks see.

    pairs="symmetric" takes all n(n-1) ordered pairs: the sum is exactly invariant when blocks are renamed. This is the
    default, for every goal then helps to learn those that differ from it by renaming. pairs="oriented" is DECSTR's way:
    the n(n-1)/2 unordered pairs, fed as (j, i) if the goal wants j on i and as (i, j) otherwise; half the cost, but
    where the goal stacks neither on the other, the order of names decides. identities=True adds one-hot block
    identities (then nothing is shared by renaming).
    """

    def __init__(
        self, layout: PairLayout, pairs: PairMode = "symmetric", identities: bool = False, device: str = "cpu"
    ) -> None:
        if pairs not in ("symmetric", "oriented"):
            raise ValueError(f"pairs is {pairs!r}; legal are 'symmetric' and 'oriented'")
        self.layout, self.mode, self.identities, self.device = layout, pairs, identities, torch.device(device)
        self.body = RunningMoments((layout.body_size,), device=device)
        self.block = RunningMoments((layout.block_size,), device=device)
        self.predicates = RunningMoments((2,), device=device)  # close, on
        forward = [_pair_columns(layout, p, identities) for p in layout.pairs]
        reverse = [_pair_columns(layout, (j, i, c, ji, ij), identities) for i, j, c, ij, ji in layout.pairs]
        self._columns = torch.tensor(forward + reverse, device=device)  # (2 · unordered pairs, F)
        self._reversed_on = torch.tensor([ji for *_, ji in layout.pairs], device=device)
        self._close = torch.tensor([close for _, _, close, _, _ in layout.pairs], device=device)
        self._on = torch.tensor([bit for *_, ij, ji in layout.pairs for bit in (ij, ji)], device=device)
        self._shift = torch.zeros(layout.observation_size + 2 * layout.goal_size, device=device)
        self._scale = torch.ones_like(self._shift)
        self._constants = torch.tensor([0.0, 1.0], device=device)

    @property
    def pair_size(self) -> int:
        """F, the number of features of a pair."""
        return self._columns.shape[1]

    def observe(self, observation: Tensor, achieved_goal: Tensor, desired_goal: Tensor) -> None:
        """Add observations (N, D) and goals (N, bits) to the running statistics. Training only."""
        body, blocks = observation.split([self.layout.body_size, self.layout.n_blocks * self.layout.block_size], dim=-1)
        self.body.update(body)
        self.block.update(blocks.reshape(-1, self.layout.block_size))
        goals = torch.cat([achieved_goal, desired_goal])
        on = goals[:, self._on].reshape(-1)
        close = goals[:, self._close].repeat_interleave(2, dim=1).reshape(-1)  # symmetric: as often as on
        self.predicates.update(torch.stack([close, on], dim=1))
        self._refresh()

    def encode(self, observation: Tensor, achieved_goal: Tensor, desired_goal: Tensor) -> PairInputs:
        """Raw observations (B, D) and goals (B, bits), float32, to normalised `PairInputs`."""
        return self.encode_rows(torch.cat([observation, achieved_goal, desired_goal], dim=1).unsqueeze(0))[0]

    def encode_rows(self, rows: Tensor) -> list[PairInputs]:
        """Raw rows [observation | achieved | desired], S sets of them (S, B, D + 2 bits), to S `PairInputs`."""
        normalised = (rows - self._shift).mul_(self._scale).clamp_(-self.body.clip, self.body.clip)
        source = normalised
        if self.identities:
            source = torch.cat([normalised, self._constants.expand(*rows.shape[:2], 2)], dim=2)
        n_pairs, width = self._columns.shape
        gathered = source.flatten(0, 1).index_select(1, self._columns.view(-1))
        pairs = gathered.view(*rows.shape[:2], n_pairs, width).transpose(1, 2)
        if self.mode == "oriented":
            forward, reverse = pairs.chunk(2, dim=1)
            desired = rows[..., self.layout.observation_size + self.layout.goal_size :]
            turn = desired[..., self._reversed_on].mT.unsqueeze(-1) > 0.5
            pairs = torch.where(turn, reverse, forward)
        states = normalised[..., : self.layout.observation_size]
        return [PairInputs(*set_) for set_ in zip(states, pairs.contiguous(), strict=True)]

    def state_dict(self) -> dict[str, dict[str, Tensor]]:
        """The running statistics, tensors only."""
        return {name: getattr(self, name).state_dict() for name in ("body", "block", "predicates")}

    def load_state_dict(self, state: dict[str, dict[str, Tensor]]) -> None:
        """Restore what `state_dict` gave."""
        for name in ("body", "block", "predicates"):
            getattr(self, name).load_state_dict(state[name])
        self._refresh()

    def _refresh(self) -> None:
        """Lay the statistics out as one shift and one scale a column of [observation | achieved | desired]."""
        n, layout = self.layout.n_blocks, self.layout
        for source, target in (("mean", self._shift), ("inverse_std", self._scale)):
            of = [getattr(moments, source).float() for moments in (self.body, self.block, self.predicates)]
            bits = torch.empty(layout.goal_size, device=self.device)
            bits[self._close], bits[self._on] = of[2][0], of[2][1]
            torch.cat([of[0], of[1].repeat(n), bits, bits], out=target)


def _pair_columns(layout: PairLayout, pair: tuple[int, int, int, int, int], identities: bool) -> list[int]:
    """Columns of [observation | achieved | desired | 0 | 1] that describe the ordered pair (first, second)."""
    first, second, *bits = pair
    blocks = [layout.body_size + layout.block_size * b + k for b in (first, second) for k in range(layout.block_size)]
    achieved = [layout.observation_size + bit for bit in bits]
    desired = [layout.observation_size + layout.goal_size + bit for bit in bits]
    zero = layout.observation_size + 2 * layout.goal_size
    one_hot = [zero + (b == k) for b in (first, second) for k in range(layout.n_blocks)] if identities else []
    return blocks + achieved + desired + one_hot


class Actor(nn.Module):
    """Tanh-squashed diagonal Gaussian policy pi(a | s, g)."""

    def __init__(self, encoder: PairEncoder, hidden: int, layer_norm: bool, generator: torch.Generator) -> None:
        super().__init__()
        self.body_size, outputs = encoder.layout.body_size, 2 * encoder.layout.action_size
        self.net = DeepSets(1, self.body_size, encoder.pair_size, hidden, outputs, layer_norm, generator)

    def forward(self, inputs: PairInputs) -> tuple[Tensor, Tensor]:
        """Mean and log standard deviation, each (B, A), of the action before squashing."""
        mean, log_std = self.net(inputs.state[None, :, : self.body_size], inputs.pairs)[0, 0].chunk(2, dim=-1)
        return mean, log_std.clamp(*LOG_STD_RANGE)

    def sample(self, inputs: PairInputs, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Actions (B, A) in (-1, 1) and their log-densities (B,), from standard normal noise (B, A)."""
        return squashed_gaussian(*self(inputs), noise)


class TwinCritics(nn.Module):
    """Two action values Q(s, a, g), evaluated together."""

    def __init__(self, encoder: PairEncoder, hidden: int, layer_norm: bool, generator: torch.Generator) -> None:
        super().__init__()
        self.body_size = encoder.layout.body_size
        context = self.body_size + encoder.layout.action_size
        self.net = DeepSets(2, context, encoder.pair_size, hidden, 1, layer_norm, generator)

    def forward(self, inputs: PairInputs, actions: Tensor, trained: int | None = None) -> Tensor:
        """K actions in each state (K, B, A) to values (2, K, B).

        Gradients of the first `trained` reach the weights; those of the others reach the actions. By default all reach
        the weights.
        """
        body = inputs.state[:, : self.body_size].expand(len(actions), -1, -1)
        return self.net(torch.cat([body, actions], dim=2), inputs.pairs, trained).squeeze(-1)


def squashed_gaussian(mean: Tensor, log_std: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """a = tanh(u), u = mean + std · noise: actions (B, A) and log pi(a) (B,), from three arrays (B, A).

    log pi(a) = sum of log N(u) - log(1 - tanh(u)²) (Haarnoja et al. 2018, appendix C). The last term is taken as
    2 (log 2 - u - softplus(-2u)), which stays finite where tanh saturates.
    """
    pre_squash = torch.addcmul(mean, log_std.exp(), noise)
    # what depends on the weights, and what does not
    varying = (F.softplus(-2.0 * pre_squash) + pre_squash).mul(2.0) - log_std
    constant = -0.5 * noise.square() - (LOG_SQRT_2_PI + 2.0 * LOG_2)
    return pre_squash.tanh(), (varying + constant).sum(-1)
