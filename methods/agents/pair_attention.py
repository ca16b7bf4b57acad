"""Attention pooling over pairs of blocks. Several networks are evaluated as one batch. Each of them computes

    h_p = relu(norm(W_1 [context, p]))                                   H units
    z_p = relu(norm(W_2 h_p))                                            2 H
    s   = sum over pairs p of softmax_p(v · h_p) z_p                     2 H
    out = W_4 relu(norm(W_3 [s, context]))                               2 H

A sum over pairs, as in Deep Sets, gives all pairs the same weight: those that are already as desired and the one that
is to be stacked. With attention pooling (Ilse et al. 2018, arXiv 1802.04712; Lee et al. 2019, arXiv 1810.00825) the
network learns the weights. Norms are layer norms (Ba et al. 2016) without gain and offset.
"""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from curiobench.methods.agents import fused


class PairAttention(nn.Module):
    """`members` networks with the same inputs and separate weights. Each layer is one batched matrix product.

    Weights are Xavier-uniform, drawn from `generator`. Biases and v are zero, so all pairs have the same weight at
    first. The rows of a layer's matrix belong to its inputs and its bias:

        first  [context | pair | bias] to H      second  [h | bias] to 2 H      third  [s | context | bias] to 2 H
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
        self.layer_norm, self.context_size = layer_norm, context_size
        wide = 2 * hidden
        sizes = ((context_size + pair_size, hidden), (hidden, wide), (wide + context_size, wide))
        device = generator.device
        self.first, self.second, self.third = (
            nn.Parameter(torch.zeros(members, inputs + 1, units, device=device)) for inputs, units in sizes
        )
        self.attention = nn.Parameter(torch.zeros(members, hidden, 1, device=device))
        self.out_weights = nn.Parameter(torch.zeros(members, out_size, wide, device=device))
        self.out_bias = nn.Parameter(torch.zeros(members, out_size, 1, device=device))
        with torch.no_grad():
            for weights in (self.first[:, :-1], self.second[:, :-1], self.third[:, :-1], self.out_weights.mT):
                bound = (6.0 / (weights.shape[1] + weights.shape[2])) ** 0.5
                weights.uniform_(-bound, bound, generator=generator)

    def forward(self, contexts: Tensor, pairs: Tensor, trained: int | None = None) -> Tensor:
        """Outputs (members, K, B, out_size) of K contexts (K, B, C), each with the same pairs (P, B, F).

        Gradients of the first `trained` contexts' outputs reach the weights; those of the others reach the contexts.
        By default all reach the weights.
        """
        trained = len(contexts) if trained is None else trained
        weights = (self.first, self.second, self.third, self.attention, self.out_weights, self.out_bias)
        if contexts.is_cuda:
            frozen = [weight.detach() for weight in weights]
            parts = [(contexts[:trained].detach(), weights), (contexts[trained:], frozen)]
            return torch.cat([pair_attention(c, pairs, self.layer_norm, *w) for c, w in parts if len(c)], dim=1)
        return PairAttentionFunction.apply(contexts, pairs, self.layer_norm, trained, *weights)


def pair_attention(
    contexts: Tensor,
    pairs: Tensor,
    layer_norm: bool,
    first: Tensor,
    second: Tensor,
    third: Tensor,
    attention: Tensor,
    out_weights: Tensor,
    out_bias: Tensor,
) -> Tensor:
    """`PairAttention` in plain PyTorch, used on CUDA; shapes as in its `forward`."""
    n_contexts, (n_pairs, batch, _) = len(contexts), pairs.shape

    def normed_relu(x: Tensor) -> Tensor:
        return F.relu(F.layer_norm(x, x.shape[-1:]) if layer_norm else x)

    def affine(x: Tensor, weights: Tensor) -> Tensor:
        return torch.baddbmm(weights[:, -1:], x.expand(len(weights), -1, -1), weights[:, :-1])

    every = [contexts[:, None].expand(-1, n_pairs, -1, -1), pairs.expand(n_contexts, -1, -1, -1)]
    h = normed_relu(affine(torch.cat(every, dim=-1).flatten(0, 2), first))
    weights = (h @ attention).view(-1, n_contexts, n_pairs, batch, 1).softmax(2)
    z = normed_relu(affine(h, second)).unflatten(1, (n_contexts, n_pairs, batch))
    again = contexts.flatten(0, 1).expand(len(first), -1, -1)
    rho = normed_relu(affine(torch.cat([(weights * z).sum(2).flatten(1, 2), again], dim=-1), third))
    return (rho @ out_weights.mT + out_bias.mT).unflatten(1, (n_contexts, batch))


class PairAttentionFunction(torch.autograd.Function):
    """`pair_attention` on a CPU, with a hand-written backward pass. A test compares the two.

    All operations between two products are one pass over memory (`fused.py`). Products of the pairs are shared by all
    contexts. Norms are centred once on the weights instead of on every row of activations. The second norm does not
    divide activations: relu(z / std) = relu(z) / std, so the pair's weight is multiplied by 1 / std instead.
    """

    @staticmethod
    def forward(
        ctx: Any,
        contexts: Tensor,
        pairs: Tensor,
        layer_norm: bool,
        trained: int,
        first: Tensor,
        second: Tensor,
        third: Tensor,
        attention: Tensor,
        out_weights: Tensor,
        out_bias: Tensor,
    ) -> Tensor:
        (n_contexts, batch, size), n_pairs, members = contexts.shape, len(pairs), len(first)
        shape, attention = (n_contexts, n_pairs, batch), attention.detach()
        first, second, third = (_centred(weights, layer_norm) for weights in (first, second, third))
        of_context = torch.baddbmm(first[:, -1:], _every_member(contexts, members), first[:, :size])
        of_pair = torch.bmm(_every_member(pairs, members), first[:, size:-1])
        rows, units = n_contexts * n_pairs * batch, first.shape[2]
        x, h = (first.new_empty(members, rows, units) for _ in range(2))
        scales_1, scores, weights, scales_2 = first.new_empty(4, members, rows).unbind()
        inputs = (of_pair.numpy(), of_context.numpy(), attention.numpy())
        fused.first_layer(*inputs, shape, layer_norm, x.numpy(), h.numpy(), scales_1.numpy(), scores.numpy())
        z = torch.baddbmm(second[:, -1:], h, second[:, :-1])
        pooled = z.new_empty(members, n_contexts * batch, z.shape[2])
        outputs = (weights.numpy(), scales_2.numpy(), pooled.numpy())
        fused.pool(z.numpy(), scores.numpy(), shape, layer_norm, *outputs)
        of_pooled, of_again, bias = third.split([z.shape[2], size, 1], dim=1)
        y = torch.baddbmm(bias, _every_member(contexts, members), of_again).baddbmm_(pooled, of_pooled)
        rho, scales_3 = torch.empty_like(y), y.new_empty(y.shape[:2])
        fused.norm_relu(y.numpy(), layer_norm, rho.numpy(), scales_3.numpy())
        ctx.shape, ctx.layer_norm, ctx.trained = shape, layer_norm, trained
        ctx.save_for_backward(
            contexts, pairs, first, second, third, attention, out_weights, x, h, scales_1, weights, z, scales_2, pooled,
            y, rho, scales_3,
        )  # fmt: skip
        # with few outputs, the transposed product is up to four times as fast
        return torch.baddbmm(out_bias, out_weights, rho.mT).mT.unflatten(1, (n_contexts, batch))

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        (
            contexts, pairs, first, second, third, attention, out_weights, x, h, scales_1, weights, z, scales_2, pooled,
            y, rho, scales_3,
        ) = ctx.saved_tensors  # fmt: skip
        members, norm, size = len(first), ctx.layer_norm, contexts.shape[2]
        grad = grad.flatten(1, 2)
        outer = torch.mul if out_weights.shape[1] == 1 else torch.bmm  # same result, several times as fast
        at_y = outer(grad, out_weights.detach())
        fused.norm_relu_backward(at_y.numpy(), y.numpy(), scales_3.numpy(), norm)
        of_pooled, of_again, _ = third.split([z.shape[2], size, 1], dim=1)
        at_pooled = torch.bmm(at_y, of_pooled.mT)
        at_z, at_scores = torch.empty_like(z), torch.empty_like(weights)
        of_pool = (at_pooled.numpy(), z.numpy(), weights.numpy(), scales_2.numpy())
        fused.pool_backward(*of_pool, ctx.shape, norm, at_z.numpy(), at_scores.numpy())
        at_x = torch.bmm(at_z, second[:, :-1].mT)
        at_context = at_x.new_empty(members, len(contexts) * contexts.shape[1], at_x.shape[2])
        of_first = (at_x.numpy(), at_scores.numpy(), attention.numpy(), x.numpy(), scales_1.numpy())
        fused.first_layer_backward(*of_first, ctx.shape, norm, at_context.numpy())
        few, to_contexts = ctx.trained * contexts.shape[1], None  # contexts that train the weights come first
        if ctx.needs_input_grad[0]:
            to_contexts = torch.zeros_like(contexts)
            to_others = torch.bmm(at_context[:, few:], first[:, :size].mT).baddbmm_(at_y[:, few:], of_again.mT).sum(0)
            to_contexts[ctx.trained :] = to_others.view_as(to_contexts[ctx.trained :])
        if not few:
            return to_contexts, *[None] * 9
        rows = few * len(pairs)
        over_contexts = at_x[:, :rows].unflatten(1, (ctx.trained, -1)).sum(1) if ctx.trained > 1 else at_x[:, :rows]
        both = [_every_member(inputs, members) for inputs in (contexts[: ctx.trained], pairs)]
        to_first = _gradient(first, both, [at_context[:, :few], over_contexts])
        to_second = _gradient(second, [h[:, :rows]], [at_z[:, :rows]])
        to_third = _gradient(third, [pooled[:, :few], both[0]], [at_y[:, :few]] * 2)
        if norm:  # the gradient of centring
            for gradient in (to_first, to_second, to_third):
                fused.centre(gradient.numpy(), gradient.numpy())
        to_attention = torch.bmm(h[:, :rows].mT, at_scores[:, :rows].unsqueeze(-1))
        to_out = torch.bmm(grad[:, :few].mT, rho[:, :few])
        to_out_bias = grad[:, :few].sum(1).unsqueeze(-1)
        return to_contexts, None, None, None, to_first, to_second, to_third, to_attention, to_out, to_out_bias


def _centred(weights: Tensor, layer_norm: bool) -> Tensor:
    """Weights (M, R, H) minus the mean of each row, so that outputs are centred. Unchanged without a norm."""
    weights = weights.detach()
    if not layer_norm:
        return weights
    centred = torch.empty_like(weights)
    fused.centre(weights.numpy(), centred.numpy())
    return centred


def _every_member(inputs: Tensor, members: int) -> Tensor:
    """Inputs (…, B, F), expanded to the same rows (members, R, F) for each member."""
    return inputs.flatten(0, -2).expand(members, -1, -1)


def _gradient(weights: Tensor, inputs: list[Tensor], at_outputs: list[Tensor]) -> Tensor:
    """Gradient of a layer's weights (M, inputs + 1, units), the last row its bias.

    Args:
        weights: (M, inputs + 1, units).
        inputs: (M, R, F) each, in the order of the matrix's rows.
        at_outputs: gradient (M, R, units) at the product of each input. The bias uses the first.
    """
    gradient = torch.empty_like(weights)
    parts = gradient[:, :-1].split([rows.shape[-1] for rows in inputs], dim=1)
    for rows, at, part in zip(inputs, at_outputs, parts, strict=True):
        torch.bmm(rows.mT, at, out=part)
    torch.sum(at_outputs[0], 1, keepdim=True, out=gradient[:, -1:])
    return gradient
