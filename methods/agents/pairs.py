"""Inputs of the networks: features of the hand and of each pair of blocks.

The inputs always include the achieved bits, as in DECSTR. The bits are a function of the blocks' positions, but a
threshold function, which a network learns slowly.
"""

from dataclasses import dataclass
from typing import NamedTuple, get_args

import torch
from torch import Tensor

from curiobench.methods.agents import fused_encoding, near_field
from curiobench.methods.agents.settings import PairMode, SACConfig
from curiobench.methods.checks import Sees
from curiobench.methods.moments import RunningMoments


@dataclass(frozen=True)
class PairLayout:
    """Columns of body, blocks and predicate bits in flat observations and goals.

    An observation is `[body | block 0 | block 1 | …]`. `pairs` gives the index of each bit, so networks and environment
    agree on their order.
    """

    n_blocks: int
    """Number of blocks, at least 2."""
    pairs: tuple[tuple[int, int, int, int, int], ...]
    """For each i < j: (i, j, index of close(i, j), index of on(i, j), index of on(j, i)) in the goal."""
    body_size: int = 10
    """Numbers that describe the hand, at the front of the observation; first its position (3, metres)."""
    block_size: int = 15
    """Numbers that describe each block: its position (3, metres), its position minus the hand's (3), and the rest."""
    action_size: int = 4
    """Numbers in an action, each in [-1, 1]."""
    body_details: tuple[int, ...] = (0, 1, 5, 6, 7, 8, 9)
    """Columns of the body that `SACConfig.detail_scale` scales: x, y and velocities."""
    block_details: tuple[int, ...] = (0, 1, 6, 7, 8, 9, 10, 11, 12, 13, 14)
    """Columns of a block that it scales: x, y, angles and velocities."""

    @property
    def observation_size(self) -> int:
        """Length of a flat observation."""
        return self.body_size + self.n_blocks * self.block_size

    def columns(self, sees: Sees) -> list[int]:
        """Columns of an observation that a curiosity method gets; positions (3 each) are absolute."""
        if sees == "full":
            return list(range(self.observation_size))
        starts = [self.body_size + k * self.block_size for k in range(self.n_blocks)]
        return [start + axis for start in ([0] if sees == "positions" else []) + starts for axis in range(3)]

    @property
    def goal_size(self) -> int:
        """Length of a flat goal: three predicates per pair."""
        return 3 * len(self.pairs)


class PairInputs(NamedTuple):
    """Inputs of all networks, computed once per batch."""

    state: Tensor
    """(B, D) normalised observation, the input of curiosity methods and Q_int."""
    context: Tensor
    """(B, C) the body and, with near-field features, the number of wrong bits of the goal."""
    pairs: Tensor
    """(P, B, F) features of each pair. Pairs come first, so that a sum over them adds contiguous blocks of memory."""


class PairEncoder:
    """Normalises observations and goals, and gathers the features of each pair of blocks. Holds no weights.

    All blocks share statistics, and so do all bits of the same predicate. With separate statistics, renaming blocks
    would change the inputs.

    `SACConfig.pairs` selects the ordered pairs (first, second):

    symmetric   all n(n-1): the sum over them is exactly invariant when blocks are renamed, so learning a goal also
                improves goals that differ from it by renaming.
    oriented    DECSTR's: the n(n-1)/2 unordered pairs, as (j, i) if the goal wants j on i and as (i, j) otherwise.
                If the goal stacks neither on the other, the order of names decides.
    roles       the same number. If the goal stacks neither, the block that lies on the other comes first, then the
                block nearer to the hand. Invariant at half the cost of symmetric.

    identities=True adds one-hot block identities. The inputs are then not invariant in any mode.
    """

    def __init__(self, layout: PairLayout, config: SACConfig, device: str | torch.device = "cpu") -> None:
        self.layout, self.mode, self.identities = layout, config.pairs, config.identities
        self.near_field, self.device = config.features == "near_field", torch.device(device)
        self.body = RunningMoments((layout.body_size,), device=device)
        self.block = RunningMoments((layout.block_size,), device=device)
        self.predicates = RunningMoments((2,), device=device)  # close, on
        pairs = torch.tensor(layout.pairs, device=device)
        self._close, self._on_pairs = pairs[:, 2], pairs[:, 3:]
        self._on = self._on_pairs.flatten()
        if self.mode == "symmetric":
            pairs = torch.cat([pairs, pairs[:, [1, 0, 2, 4, 3]]])
        self._pairs, self._first, self._second, self._bits = pairs, pairs[:, 0], pairs[:, 1], pairs[:, 2:]
        self._turned_bits = pairs[:, [2, 4, 3]]  # made once, because indexing by a list synchronises with a GPU
        self._shift = torch.zeros(layout.observation_size + 2 * layout.goal_size, device=device)
        self._scale = torch.ones_like(self._shift)
        self._one_hot = torch.eye(layout.n_blocks, device=device)
        self._one_hot_bits = torch.eye(layout.goal_size, device=device)
        self._detail_scale = self._detail_scales(config.detail_scale)
        self.context_size, self.pair_size = self._sizes()

    def _detail_scales(self, scale: float) -> Tensor:
        """Factors (D) of the columns of an observation."""
        body, block = (torch.ones(size, device=self.device) for size in (self.layout.body_size, self.layout.block_size))
        body[list(self.layout.body_details)] = scale
        block[list(self.layout.block_details)] = scale
        return torch.cat([body, block.repeat(self.layout.n_blocks)])

    def _sizes(self) -> tuple[int, int]:
        """C and F, the numbers of columns of context and pairs."""
        row = torch.zeros((1, 1, len(self._shift)), device=self.device)
        _, context, pairs = self.encode_plainly(row)
        return context.shape[-1], pairs.shape[-1]

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

    def normalise(self, observation: Tensor) -> Tensor:
        """Normalise raw observations (..., D), float32, as in `PairInputs.state`."""
        size = self.layout.observation_size
        return ((observation - self._shift[:size]) * self._scale[:size]).clamp_(-self.body.clip, self.body.clip)

    def encode(self, observation: Tensor, achieved_goal: Tensor, desired_goal: Tensor) -> PairInputs:
        """`PairInputs` of raw observations (B, D) and goals (B, bits), float32."""
        return self.encode_rows(torch.cat([observation, achieved_goal, desired_goal], dim=1).unsqueeze(0))[0]

    def encode_rows(self, rows: Tensor) -> list[PairInputs]:
        """S `PairInputs` of S sets of raw rows [observation | achieved | desired], (S, B, D + 2 bits)."""
        encoded = self.encode_plainly(rows) if rows.is_cuda or self.identities else self._encode_fused(rows)
        return [PairInputs(*set_) for set_ in zip(*encoded, strict=True)]

    def _encode_fused(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """`encode_plainly` on a CPU; a test compares the two."""
        layout, mode = self.layout, get_args(PairMode).index(self.mode)
        state = rows.new_empty(*rows.shape[:2], layout.observation_size)
        context = rows.new_empty(*rows.shape[:2], self.context_size)
        pairs = rows.new_empty(len(rows), len(self._pairs), rows.shape[1], self.pair_size)
        fused_encoding.encode(
            rows.numpy(),
            (self._shift.numpy(), self._scale.numpy(), self.body.clip, self._detail_scale.numpy()),
            (layout.body_size, layout.block_size, layout.goal_size),
            self._pairs.numpy(),
            # constants are arguments because Numba's cache does not notice a change of globals
            (mode, near_field.ROLE_WEIGHTS),
            self.near_field,
            near_field.SCALES,
            (state.numpy(), context.numpy(), pairs.numpy()),
        )
        return state, context, pairs

    def encode_plainly(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """States (S, B, D), contexts (S, B, C) and pairs (S, P, B, F); see `encode_rows`."""
        layout = self.layout
        sizes = (layout.observation_size, layout.goal_size, layout.goal_size)
        normalised = (rows - self._shift).mul_(self._scale).clamp_(-self.body.clip, self.body.clip)
        state, *normal_bits = normalised.split(sizes, dim=2)
        observation, achieved, desired = rows.split(sizes, dim=2)
        body, blocks = self._parts(state * self._detail_scale)
        _, raw_blocks = self._parts(observation)
        turn = self._turned(raw_blocks[..., 3:6], achieved, desired)

        context, of_blocks, of_bits, of_pairs = [body], [blocks], normal_bits, []
        if self.near_field:
            missing, unwanted = near_field.goal_differences(achieved, desired)
            context += [bits.sum(-1, keepdim=True) for bits in (missing + unwanted, missing, unwanted)]
            of_blocks.append(near_field.block_features(raw_blocks[..., 3:6]))
            of_bits = [*normal_bits, missing, unwanted]
            of_pairs.append(self._offset_features(raw_blocks[..., :3], turn))
        if self.identities:
            of_blocks.append(self._one_hot.expand(*rows.shape[:2], -1, -1))
        both = self._of_both_blocks(torch.cat(of_blocks, dim=-1), turn)
        pairs = torch.cat([*both, self._of_their_bits(of_bits, turn), *of_pairs], dim=-1)
        return state, torch.cat(context, dim=-1), pairs

    def _parts(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Body (S, B, body_size) and blocks (S, B, n, block_size) of observations (S, B, D)."""
        layout = self.layout
        body, blocks = observation.split([layout.body_size, layout.n_blocks * layout.block_size], dim=2)
        return body, blocks.unflatten(2, (layout.n_blocks, layout.block_size))

    def _turned(self, offsets: Tensor, achieved: Tensor, desired: Tensor) -> Tensor | None:
        """(S, P, B) bool, whether pair (i, j) is encoded as (j, i); None if no pair ever is.

        `offsets` are the blocks' positions minus the hand's (S, B, n, 3); goals are (S, B, bits).
        """
        if self.mode == "symmetric":
            return None
        wanted = desired[..., self._on_pairs].movedim(2, 1)  # (S, P, B, 2)
        if self.mode == "oriented":
            return wanted[..., 1] > 0.5
        distance = torch.linalg.vector_norm(offsets, dim=-1).mT  # (S, n, B)
        nearer = distance[:, self._second] - distance[:, self._first]
        return near_field.turned_by_role(wanted, achieved[..., self._on_pairs].movedim(2, 1), nearer)

    def _of_both_blocks(self, blocks: Tensor, turn: Tensor | None) -> tuple[Tensor, Tensor]:
        """Rows (S, P, B, F) of each pair's first and of its second block, from blocks (S, B, n, F)."""
        sets, batch, n, width = blocks.shape
        first, second = self._first.view(-1, 1), self._second.view(-1, 1)
        ends = (first, second) if turn is None else (torch.where(turn, second, first), torch.where(turn, first, second))
        start = torch.arange(0, sets * batch * n, n, device=blocks.device).view(sets, 1, batch)
        rows = blocks.reshape(-1, width)
        of_first, of_second = (
            rows.index_select(0, (start + end).flatten()).view(sets, -1, batch, width) for end in ends
        )
        return of_first, of_second

    def _of_their_bits(self, values: list[Tensor], turn: Tensor | None) -> Tensor:
        """Bits close, on(first, second), on(second, first) of each pair (S, P, B, 3 k), from k values (S, B, bits)."""
        every = torch.stack(values, dim=-2)  # (S, B, k, bits)
        bits = self._picked(every, self._bits)
        if turn is None:
            return bits
        return torch.where(turn.unsqueeze(-1), self._picked(every, self._turned_bits), bits)

    def _picked(self, values: Tensor, columns: Tensor) -> Tensor:
        """Entries of values (S, B, k, bits) at columns (P, 3), as (S, P, B, 3 k)."""
        # a product with ones and zeros: exact, and several times as fast as indexing
        one_hot = self._one_hot_bits[columns.flatten()].T
        picked = (values @ one_hot).unflatten(3, columns.shape)
        return picked.permute(0, 3, 1, 2, 4).flatten(3)

    def _offset_features(self, positions: Tensor, turn: Tensor | None) -> Tensor:
        """`pair_features` (S, P, B, 11) of positions (S, B, n, 3)."""
        positions = positions.movedim(2, 1)
        offset = positions[:, self._first] - positions[:, self._second]
        return near_field.pair_features(offset if turn is None else torch.where(turn.unsqueeze(-1), -offset, offset))

    def state_dict(self) -> dict[str, dict[str, Tensor]]:
        """The running statistics, tensors only."""
        return {name: getattr(self, name).state_dict() for name in ("body", "block", "predicates")}

    def load_state_dict(self, state: dict[str, dict[str, Tensor]]) -> None:
        """Restore a `state_dict`."""
        for name in ("body", "block", "predicates"):
            getattr(self, name).load_state_dict(state[name])
        self._refresh()

    def _refresh(self) -> None:
        """Update shift and scale of each column of [observation | achieved | desired] from the statistics."""
        n, layout = self.layout.n_blocks, self.layout
        for source, target in (("mean", self._shift), ("inverse_std", self._scale)):
            of = [getattr(moments, source).float() for moments in (self.body, self.block, self.predicates)]
            bits = torch.empty(layout.goal_size, device=self.device)
            bits[self._close], bits[self._on] = of[2][0], of[2][1]
            torch.cat([of[0], of[1].repeat(n), bits, bits], out=target)
