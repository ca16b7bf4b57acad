"""Deep Sets over pairs of blocks. Several networks are evaluated as one batch.

    out = rho( sum over pairs p of  phi(context, p) )

(Zaheer et al. 2017, arXiv 1703.06114.) phi has two layers of `hidden` units. rho has one, and a linear output layer.
Hidden layers end in ReLU. With `layer_norm`, the first layers of phi and of rho have a layer norm before the ReLU (Ba
et al. 2016). It has no learned gain and offset, because the next layer can express them.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import torch
from torch import Tensor, nn


class DeepSets(nn.Module):
    """`members` networks with the same inputs and separate weights. Each layer is one batched matrix product.

    Weights are Xavier-uniform, drawn from `generator`; biases are zero. All layers with `hidden` outputs are stored as
    rows of one matrix, so that optimiser steps and target updates are few and large operations:

        [phi's first layer, context | the same, pair | bias | rho's first layer | bias | phi's second layer | bias]
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
        self.layer_norm = layer_norm
        first = context_size + pair_size
        self.rows = (context_size, pair_size, 1, hidden, 1, hidden, 1)
        device = generator.device
        self.hidden_weights = nn.Parameter(torch.zeros(members, sum(self.rows), hidden, device=device))
        self.out_weights = nn.Parameter(torch.zeros(members, out_size, hidden, device=device))
        self.out_bias = nn.Parameter(torch.zeros(members, out_size, 1, device=device))
        with torch.no_grad():
            w_context, w_pair, _, w_3, _, w_2, _ = self.hidden_weights.split(self.rows, dim=1)
            for weight, inputs in ((w_context, first), (w_pair, first), (w_2, hidden), (w_3, hidden)):
                bound = (6.0 / (inputs + hidden)) ** 0.5
                weight.uniform_(-bound, bound, generator=generator)
            bound = (6.0 / (hidden + out_size)) ** 0.5
            self.out_weights.uniform_(-bound, bound, generator=generator)

    def forward(self, contexts: Tensor, pairs: Tensor, trained: int | None = None) -> Tensor:
        """Outputs (members, K, B, out_size) of K contexts (K, B, C), each with the same pairs (P, B, F).

        Gradients of the first `trained` contexts' outputs reach the weights; those of the others reach the contexts.
        By default all reach the weights.
        """
        trained = len(contexts) if trained is None else trained
        weights = (self.hidden_weights, self.out_weights, self.out_bias)
        return DeepSetsFunction.apply(contexts, pairs, self.rows, self.layer_norm, trained, *weights)


class DeepSetsFunction(torch.autograd.Function):
    """`DeepSets` with a hand-written backward pass, for speed on a CPU. A test compares it with the plain formulation.

    At these sizes the products cost less than the passes over memory between them and the number of calls. So only
    what the gradient needs is saved. Products of the pairs are shared by all contexts. The norm's centring is applied
    once to the weights instead of to every row of activations. (Sharing each block's product over its pairs was 1.4 to
    1.9 times as slow, because the additions cost more than the products they save.)

    Shapes: M members, K contexts, P pairs, B transitions, H hidden units.
    """

    @staticmethod
    def forward(
        ctx: Any,
        contexts: Tensor,
        pairs: Tensor,
        rows: Sequence[int],
        layer_norm: bool,
        trained: int,
        hidden_weights: Tensor,
        out_weights: Tensor,
        out_bias: Tensor,
    ) -> Tensor:
        members, n_contexts, (n_pairs, batch, _) = len(hidden_weights), len(contexts), pairs.shape
        normalised, plain = hidden_weights.split((sum(rows[:5]), sum(rows[5:])), dim=1)
        if layer_norm:
            normalised = normalised - normalised.mean(-1, keepdim=True)
        (w_context, w_pair, b_1, w_3, b_3), (w_2, b_2) = normalised.split(rows[:5], 1), plain.split(rows[5:], 1)
        shared = torch.baddbmm(b_1, contexts.flatten(0, 1).expand(members, -1, -1), w_context)
        hidden = torch.bmm(pairs.flatten(0, 1).expand(members, -1, -1), w_pair)
        hidden = hidden.view(members, 1, n_pairs, batch, -1) + shared.view(members, n_contexts, 1, batch, -1)
        phi_1, *norm_1 = _activate(hidden.flatten(1, 3), layer_norm)
        phi_2 = torch.baddbmm(b_2, phi_1, w_2).relu_()
        summed = _sum_over_pairs(phi_2.view_as(hidden))
        rho, *norm_3 = _activate(torch.baddbmm(b_3, summed, w_3), layer_norm)
        ctx.rows, ctx.trained, ctx.by_pair = rows, trained, hidden.shape
        ctx.save_for_backward(
            contexts, pairs, w_context, w_2, w_3, out_weights, phi_1, phi_2, summed, rho, *norm_1, *norm_3
        )
        # with few outputs, the transposed product is up to four times as fast
        return torch.baddbmm(out_bias, out_weights, rho.mT).mT.unflatten(1, (n_contexts, batch))

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        contexts, pairs, w_context, w_2, w_3, w_out, phi_1, phi_2, summed, rho, *norms = ctx.saved_tensors
        members, n_contexts, _, batch, _ = ctx.by_pair
        grad = grad.flatten(1, 2)
        outer = torch.mul if w_out.shape[1] == 1 else torch.bmm  # same result, several times as fast
        at_rho = _activate_backward(outer(grad, w_out), rho, norms[2:])
        at_sum = torch.bmm(at_rho, w_3.mT).view(members, n_contexts, 1, batch, -1).expand(ctx.by_pair)
        at_phi_2 = _activate_backward(at_sum, phi_2.view(ctx.by_pair), ()).view_as(phi_2)
        at_phi_1 = _activate_backward(torch.bmm(at_phi_2, w_2.mT), phi_1, norms[:2])
        at_shared = _sum_over_pairs(at_phi_1.view(ctx.by_pair))
        to_contexts, few = None, ctx.trained * batch  # rows of the contexts that train the weights come first
        if ctx.needs_input_grad[0]:
            to_contexts = torch.zeros_like(contexts)
            to_others = torch.bmm(at_shared[:, few:], w_context.mT).sum(0)
            to_contexts[ctx.trained :] = to_others.view_as(to_contexts[ctx.trained :])
        if not few:
            return to_contexts, *[None] * 7
        outputs = [at[:, : at.shape[1] // n_contexts * ctx.trained] for at in (at_shared, at_phi_1, at_rho, at_phi_2)]
        to_hidden = _weight_gradients(ctx.rows, contexts[: ctx.trained], pairs, summed, phi_1, outputs)
        to_out = torch.bmm(grad[:, :few].mT, rho[:, :few])
        return to_contexts, None, None, None, None, to_hidden, to_out, grad[:, :few].sum(1).unsqueeze(-1)


def _weight_gradients(
    rows: Sequence[int], contexts: Tensor, pairs: Tensor, summed: Tensor, phi_1: Tensor, outputs: Sequence[Tensor]
) -> Tensor:
    """Gradient of `hidden_weights`, from the layers' inputs and the gradients at their outputs, trained rows only.

    The gradient of centring needs no step here, because the gradient through the norm has zero mean over units.
    """
    at_shared, at_phi_1, at_rho, at_phi_2 = outputs
    members, _, width = at_shared.shape
    gradient = at_shared.new_empty(members, sum(rows), width)
    w_context, w_pair, b_1, w_3, b_3, w_2, b_2 = gradient.split(rows, dim=1)
    over_contexts = reduce(torch.add, at_phi_1.unflatten(1, (len(contexts), -1)).unbind(1))
    torch.bmm(contexts.flatten(0, 1).expand(members, -1, -1).mT, at_shared, out=w_context)
    torch.bmm(pairs.flatten(0, 1).expand(members, -1, -1).mT, over_contexts, out=w_pair)
    torch.bmm(summed[:, : at_rho.shape[1]].mT, at_rho, out=w_3)
    torch.bmm(phi_1[:, : at_phi_2.shape[1]].mT, at_phi_2, out=w_2)
    for bias, at in ((b_1, at_shared), (b_3, at_rho), (b_2, at_phi_2)):
        torch.sum(at, 1, keepdim=True, out=bias)
    return gradient


def _sum_over_pairs(values: Tensor) -> Tensor:
    """(M, K, P, B, H) to (M, K · B, H). On a CPU, additions are three times as fast as `sum` over a middle axis."""
    return reduce(torch.add, values.unbind(2)).flatten(1, 2)


def _activate(centred: Tensor, layer_norm: bool) -> tuple[Tensor, ...]:
    """Layer norm (if `layer_norm`; the input is centred already) and ReLU of (M, R, H).

    Returns the output and, with the norm, what its gradient needs: the input and 1 / its standard deviation (M, R, 1).
    """
    if not layer_norm:
        return (centred.relu_(),)
    norm = torch.linalg.vector_norm(centred, dim=-1, keepdim=True)
    epsilon = centred.new_full((), 1e-5)
    inverse_std = torch.addcmul(epsilon, norm, norm, value=1 / centred.shape[-1]).rsqrt_()
    return torch.mul(centred, inverse_std).relu_(), centred, inverse_std


def _activate_backward(grad: Tensor, activated: Tensor, norm: Sequence[Tensor]) -> Tensor:
    """Gradient at the input of `_activate`, from the gradient at its output, its output, and the saved norm."""
    grad = torch.ops.aten.threshold_backward.grad_input(grad, activated, 0, grad_input=torch.empty_like(activated))
    if not norm:
        return grad
    centred, inverse_std = norm
    mean, shape = torch.zeros_like(inverse_std), centred.shape[-1:]
    mask = (True, False, False)
    return torch.ops.aten.native_layer_norm_backward(grad, centred, shape, mean, inverse_std, None, None, mask)[0]
