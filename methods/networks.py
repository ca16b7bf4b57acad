"""Deep Sets actor and twin critics over pairs of blocks.

Every network here has one form (Zaheer et al. 2017, arXiv 1703.06114; over pairs of blocks as in DECSTR, Akakzia et al.
2021, arXiv 2006.07185):

    out = rho( sum over pairs (i, j) of  phi(context, block_i, block_j, achieved bits of (i, j), desired bits of (i, j)) )

`context` is the body (grip and fingers), and for a critic the action too. phi and rho have one hidden layer each. Where
this differs from DECSTR: phi ends in `hidden` units instead of three times its input; both layers of phi and the first of
rho may be layer-normalised, without learned gain and offset, as the next layer can express those; pairs may be symmetric.

Achieved bits could be computed from the blocks' positions, but only as a sharp threshold that a network is slow to
learn. They are observable and DECSTR feeds them too, so they are always fed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from curiobench.methods.moments import RunningMoments

LOG_STD_RANGE = (-5.0, 2.0)
LOG_2 = 0.6931471805599453

PairMode = Literal["symmetric", "oriented"]


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
    the n(n-1)/2 unordered pairs, fed as (j, i) if the goal wants j on i and as (i, j) otherwise; half the cost, but of a
    pair that the goal does not stack the first-named block always comes first. identities=True adds one-hot block
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
        flat = torch.cat([observation, achieved_goal, desired_goal], dim=1)
        flat = flat.sub_(self._shift).mul_(self._scale).clamp_(-self.body.clip, self.body.clip)
        state = flat[:, : self.layout.observation_size]
        if self.identities:
            flat = torch.cat([flat, self._constants.expand(len(flat), 2)], dim=1)
        n_pairs, width = self._columns.shape
        gathered = flat.index_select(1, self._columns.view(-1)).view(-1, n_pairs, width).transpose(0, 1)
        if self.mode == "symmetric":
            return PairInputs(state, gathered.contiguous())
        forward, reverse = gathered.chunk(2)
        turn = desired_goal.index_select(1, self._reversed_on).T.unsqueeze(-1) > 0.5
        return PairInputs(state, torch.where(turn, reverse, forward))

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


class DeepSets(nn.Module):
    """`members` networks of the form above with the same inputs and separate weights, each layer one batched product.

    Weights are uniform with Xavier's bound, biases zero, drawn from `generator`.
    """

    def __init__(
        self,
        members: int,
        context_size: int,
        pair_size: int,
        hidden: int,
        out_size: int,
        layer_norm: bool,
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.members, self.hidden, self.layer_norm = members, hidden, layer_norm

        def weight(fan_in: int, fan_out: int, rows: int | None = None) -> nn.Parameter:
            bound = (6.0 / (fan_in + fan_out)) ** 0.5
            values = torch.empty(members, rows or fan_in, fan_out, device=generator.device)
            return nn.Parameter(values.uniform_(-bound, bound, generator=generator))

        def bias(size: int) -> nn.Parameter:
            return nn.Parameter(torch.zeros(members, 1, size, device=generator.device))

        self.phi_context = weight(context_size + pair_size, hidden, rows=context_size)
        self.phi_pair = weight(context_size + pair_size, hidden, rows=pair_size)
        self.phi_2, self.rho_1, self.rho_2 = weight(hidden, hidden), weight(hidden, hidden), weight(hidden, out_size)
        self.phi_bias_1, self.phi_bias_2, self.rho_bias_1 = bias(hidden), bias(hidden), bias(hidden)
        self.rho_bias_2 = bias(out_size)

    def forward(self, context: Tensor, pairs: Tensor, frozen: bool = False) -> Tensor:
        """Context (B, C) and pairs (P, B, F) to outputs (members, B, out_size).

        With frozen=True gradients flow to the context only, and those of the weights cost nothing.
        """
        weights = [w.detach() if frozen else w for w in self.parameters()]
        return DeepSetsFunction.apply(context, pairs, self.layer_norm, *weights)


class DeepSetsFunction(torch.autograd.Function):
    """`DeepSets` with its gradient written out: the same numbers in about half of autograd's time on a CPU.

    At these sizes what costs is not the products but passes over memory between them, so passes are made in place and
    only what the gradient needs is kept. `pairs` gets no gradient: it holds data. M members, H hidden units.
    """

    @staticmethod
    def forward(ctx, context, pairs, layer_norm, *weights):  # noqa: D102
        w_context, w_pair, w_2, w_3, w_4, b_1, b_2, b_3, b_4 = weights
        members, (n_pairs, batch, _) = len(w_2), pairs.shape
        shared = torch.baddbmm(b_1, context.expand(members, -1, -1), w_context)
        hidden = torch.bmm(pairs.flatten(0, 1).expand(members, -1, -1), w_pair)
        hidden.view(members, n_pairs, batch, -1).add_(shared.unsqueeze(1))
        phi_1, *norm_1 = _activate(hidden, layer_norm)
        phi_2, *norm_2 = _activate(torch.baddbmm(b_2, phi_1, w_2), layer_norm)
        summed = phi_2.view(members, n_pairs, batch, -1).sum(1)
        rho, *norm_3 = _activate(torch.baddbmm(b_3, summed, w_3), layer_norm)
        ctx.save_for_backward(
            context, pairs, w_context, w_2, w_3, w_4, phi_1, phi_2, summed, rho, *norm_1, *norm_2, *norm_3
        )
        return torch.baddbmm(b_4, rho, w_4)

    @staticmethod
    def backward(ctx, grad):  # noqa: D102
        context, pairs, w_context, w_2, w_3, w_4, phi_1, phi_2, summed, rho, *norms = ctx.saved_tensors
        norm_1, norm_2, norm_3 = norms[:2], norms[2:4], norms[4:]
        (members, _, width), (n_pairs, batch, _) = phi_1.shape, pairs.shape
        by_pair = (members, n_pairs, batch, width)
        at_rho = _activate_backward(torch.bmm(grad, w_4.mT), rho, norm_3)
        at_sum = torch.bmm(at_rho, w_3.mT).unsqueeze(1).expand(by_pair)
        at_phi_2 = _activate_backward(at_sum, phi_2.view(by_pair), norm_2).view_as(phi_2)
        at_phi_1 = _activate_backward(torch.bmm(at_phi_2, w_2.mT), phi_1, norm_1)
        at_shared = at_phi_1.view(by_pair).sum(1)
        to_context = torch.bmm(at_shared, w_context.mT).sum(0) if ctx.needs_input_grad[0] else None
        if not ctx.needs_input_grad[3]:
            return to_context, *[None] * 11
        flat_pairs = pairs.flatten(0, 1).expand(members, -1, -1)
        return (
            to_context,
            None,
            None,
            torch.bmm(context.expand(members, -1, -1).mT, at_shared),
            torch.bmm(flat_pairs.mT, at_phi_1),
            torch.bmm(phi_1.mT, at_phi_2),
            torch.bmm(summed.mT, at_rho),
            torch.bmm(rho.mT, grad),
            *(g.sum(1, keepdim=True) for g in (at_shared, at_phi_2, at_rho, grad)),
        )


def _activate(hidden: Tensor, layer_norm: bool) -> tuple[Tensor, ...]:
    """Layer norm (if asked) and rectifier of (M, R, H), overwriting it; with what the gradient needs of the norm."""
    if not layer_norm:
        return (hidden.relu_(),)
    hidden.sub_(hidden.mean(-1, keepdim=True))
    norm = torch.linalg.vector_norm(hidden, dim=-1, keepdim=True)
    inverse_std = norm.square_().div_(hidden.shape[-1]).add_(1e-5).rsqrt_()
    return torch.mul(hidden, inverse_std).relu_(), hidden, inverse_std


def _activate_backward(grad: Tensor, activated: Tensor, norm: Sequence[Tensor]) -> Tensor:
    """Gradient of `_activate`: of its input, from that of its output, its output, and what it kept of the norm."""
    grad = torch.ops.aten.threshold_backward.grad_input(grad, activated, 0, grad_input=torch.empty_like(activated))
    if not norm:
        return grad
    centred, inverse_std = norm
    mean = torch.zeros_like(inverse_std)
    return torch.ops.aten.native_layer_norm_backward(
        grad.view_as(centred), centred, centred.shape[-1:], mean, inverse_std, None, None, (True, False, False)
    )[0]


class Actor(nn.Module):
    """Tanh-squashed diagonal Gaussian policy pi(a | s, g)."""

    def __init__(self, encoder: PairEncoder, hidden: int, layer_norm: bool, generator: torch.Generator) -> None:
        super().__init__()
        self.body_size, outputs = encoder.layout.body_size, 2 * encoder.layout.action_size
        self.net = DeepSets(1, self.body_size, encoder.pair_size, hidden, outputs, layer_norm, generator)

    def forward(self, inputs: PairInputs) -> tuple[Tensor, Tensor]:
        """Mean and log standard deviation, each (B, A), of the action before squashing."""
        mean, log_std = self.net(inputs.state[:, : self.body_size], inputs.pairs)[0].chunk(2, dim=-1)
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

    def forward(self, inputs: PairInputs, action: Tensor, frozen: bool = False) -> Tensor:
        """Actions (B, A) to values (2, B). With frozen=True gradients reach the action but not the weights."""
        context = torch.cat([inputs.state[:, : self.body_size], action], dim=1)
        return self.net(context, inputs.pairs, frozen).squeeze(-1)


def squashed_gaussian(mean: Tensor, log_std: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """a = tanh(u), u = mean + std · noise: actions (B, A) and log pi(a) (B,).

    log pi(a) = log N(u) - sum log(1 - a²) (Haarnoja et al. 2018, appendix C), with log(1 - tanh(u)²) in the form
    2 (log 2 - u - softplus(-2u)), which stays finite where tanh saturates.
    """
    pre_squash = torch.addcmul(mean, log_std.exp(), noise)
    normal = -0.5 * noise.square() - log_std - 0.9189385332046727  # log sqrt(2 pi)
    log_slope = 2.0 * (LOG_2 - pre_squash - F.softplus(-2.0 * pre_squash))
    return pre_squash.tanh(), (normal - log_slope).sum(-1)
