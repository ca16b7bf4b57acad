"""Networks over pairs: equal to the plain formulation, indexed by name, unchanged by renaming blocks."""

from dataclasses import replace
from itertools import permutations

import pytest
import torch
from layouts import layout_of
from torch.nn import functional as F

from curiobench.methods.agents.deepsets import DeepSets
from curiobench.methods.agents.networks import Actor, TwinCritics, squashed_gaussian
from curiobench.methods.agents.pair_attention import PairAttention, pair_attention
from curiobench.methods.agents.pairs import PairEncoder, PairLayout
from curiobench.methods.agents.settings import SACConfig

BATCH, HIDDEN = 5, 16


def some_inputs(layout: PairLayout, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Random observations (B, D), achieved and desired goals (B, bits)."""
    generator = torch.Generator().manual_seed(seed)
    observation = torch.randn(BATCH, layout.observation_size, generator=generator)
    goals = torch.randint(0, 2, (2, BATCH, layout.goal_size), generator=generator).float()
    return observation, *goals


def rename(layout: PairLayout, order: tuple[int, ...], observation: torch.Tensor, *goals: torch.Tensor):
    """The same scene with block `order[k]` now called k."""
    body, blocks = observation.split([layout.body_size, layout.n_blocks * layout.block_size], dim=1)
    blocks = blocks.view(-1, layout.n_blocks, layout.block_size)[:, list(order)].flatten(1)
    bit = {}
    for i, j, close, on_ij, on_ji in layout.pairs:
        bit |= {("close", i, j): close, ("close", j, i): close, ("on", i, j): on_ij, ("on", j, i): on_ji}
    source = [0] * layout.goal_size
    for (name, i, j), k in bit.items():
        source[k] = bit[name, order[i], order[j]]
    return torch.cat([body, blocks], dim=1), *(goal[:, source] for goal in goals)


def plain_attention(net: PairAttention, contexts: torch.Tensor, pairs: torch.Tensor) -> torch.Tensor:
    """`PairAttention` by its definition, as it runs on a GPU."""
    weights = (net.first, net.second, net.third, net.attention, net.out_weights, net.out_bias)
    return pair_attention(contexts, pairs, net.layer_norm, *weights)


def plain_deep_sets(net: DeepSets, contexts: torch.Tensor, pairs: torch.Tensor) -> torch.Tensor:
    """`DeepSets` by its definition: one member, one context and one pair at a time, by autograd."""
    outputs = []
    for member in range(len(net.hidden_weights)):
        w_context, w_pair, b_1, w_3, b_3, w_2, b_2 = net.hidden_weights[member].split(net.rows)
        w_1 = torch.cat([w_context, w_pair])

        def normed(x: torch.Tensor) -> torch.Tensor:
            return F.relu(F.layer_norm(x, x.shape[-1:]) if net.layer_norm else x)

        for context in contexts:
            total = 0
            for pair in pairs:
                total = total + F.relu(normed(torch.cat([context, pair], dim=1) @ w_1 + b_1) @ w_2 + b_2)
            outputs.append(normed(total @ w_3 + b_3) @ net.out_weights[member].T + net.out_bias[member].T)
    return torch.stack(outputs).view(len(net.hidden_weights), len(contexts), len(pairs[0]), -1)


@pytest.mark.parametrize("layer_norm", [True, False])
@pytest.mark.parametrize(("kind", "plain"), [(DeepSets, plain_deep_sets), (PairAttention, plain_attention)])
@pytest.mark.parametrize(("members", "n_contexts", "n_pairs"), [(1, 1, 1), (2, 1, 2), (2, 2, 6), (2, 3, 2)])
def test_fast_path_equals_the_plain_formulation(members, n_contexts, n_pairs, kind, plain, layer_norm):
    generator = torch.Generator().manual_seed(1)
    net = kind(members, 4, 7, HIDDEN, 3, layer_norm, generator).double()
    with torch.no_grad():  # biases and attention start at zero; make them matter
        for weights in net.parameters():
            weights += 0.1 * torch.randn(weights.shape, generator=generator).double()
    contexts = torch.randn(n_contexts, BATCH, 4, generator=generator).double().requires_grad_()
    pairs = torch.randn(n_pairs, BATCH, 7, generator=generator).double()
    weight = torch.randn(members, n_contexts, BATCH, 3, generator=generator).double()
    torch.testing.assert_close(net(contexts, pairs), plain(net, contexts, pairs))
    for trained in range(n_contexts + 1):
        fast = (net(contexts, pairs, trained) * weight).sum()
        slow = plain(net, contexts, pairs) * weight
        parameters = list(net.parameters())
        if trained:
            expected = torch.autograd.grad(slow[:, :trained].sum(), parameters, retain_graph=True)
            for got, want in zip(torch.autograd.grad(fast, parameters, retain_graph=True), expected, strict=True):
                torch.testing.assert_close(got, want)
        if trained < n_contexts:
            (got,) = torch.autograd.grad(fast, contexts)
            (want,) = torch.autograd.grad(slow[:, trained:].sum(), contexts)
            torch.testing.assert_close(got[trained:], want[trained:])
            assert (got[:trained] == 0).all()


def critic_and_actor(layout: PairLayout, **options):
    """Outputs of fresh networks as a function of raw inputs: values (2, 1, B), mean and log std (B, A) each."""
    config = SACConfig(hidden=HIDDEN, **options)
    encoder = PairEncoder(layout, config)
    observation, achieved, desired = some_inputs(layout, seed=7)
    encoder.observe(3 * observation + 1, achieved, desired)
    generator = torch.Generator().manual_seed(2)
    actor, critics = Actor(encoder, config, generator), TwinCritics(encoder, config, generator)
    actions = torch.randn(1, BATCH, layout.action_size, generator=generator).tanh()

    def outputs(*raw: torch.Tensor) -> list[torch.Tensor]:
        inputs = encoder.encode(*raw)
        return [critics(inputs, actions), *actor(inputs)]

    return outputs


def same(first: list[torch.Tensor], second: list[torch.Tensor]) -> bool:
    return all(torch.allclose(a, b, atol=1e-5) for a, b in zip(first, second, strict=True))


LAPTOP = {"pairs": "roles", "features": "near_field", "network": "pair_attention", "detail_scale": 0.1}


@pytest.mark.parametrize("options", [{}, LAPTOP], ids=["paper", "laptop"])
@pytest.mark.parametrize("n_blocks", [2, 3, 4, 5])
def test_renaming_blocks_changes_nothing(n_blocks, options):
    layout = layout_of(n_blocks)
    outputs, raw = critic_and_actor(layout, **options), some_inputs(layout)
    for order in permutations(range(n_blocks)):
        assert same(outputs(*raw), outputs(*rename(layout, order, *raw)))


@pytest.mark.parametrize("options", [{"identities": True}, {"pairs": "oriented"}])
def test_renaming_blocks_matters_with_identities_or_oriented_pairs(options):
    layout = layout_of(3)
    outputs, raw = critic_and_actor(layout, **options), some_inputs(layout)
    assert not same(outputs(*raw), outputs(*rename(layout, (2, 0, 1), *raw)))


def test_oriented_pairs_are_turned_by_the_goal():
    """Where the goal stacks the first block on the second or the second on the first, renaming changes nothing."""
    layout = layout_of(2)
    outputs = critic_and_actor(layout, pairs="oriented")
    observation, achieved, _ = some_inputs(layout)
    stacked = torch.tensor([[1.0, 0.0, 1.0]]).expand(BATCH, 3)  # close, on(0, 1), on(1, 0)
    flat = torch.tensor([[1.0, 0.0, 0.0]]).expand(BATCH, 3)
    for goal, unchanged in ((stacked, True), (flat, False)):
        raw = observation, achieved, goal
        assert same(outputs(*raw), outputs(*rename(layout, (1, 0), *raw))) is unchanged


@pytest.mark.parametrize(
    ("pairs", "features"), [("symmetric", "state"), ("oriented", "state"), ("roles", "near_field")]
)
def test_bits_are_found_by_name(pairs, features):
    """The public DECSTR code reads on-bits in another order than its environment writes them; here order is data."""
    layout = layout_of(3)
    moved = [2, 0, 1, 8, 3, 7, 4, 6, 5]  # the bit at k now stands at moved[k]
    other = replace(layout, pairs=tuple((i, j, *(moved[bit] for bit in bits)) for i, j, *bits in layout.pairs))
    observation, *goals = some_inputs(layout)
    reordered = [torch.empty_like(goal) for goal in goals]
    for goal, into in zip(goals, reordered, strict=True):
        into[:, moved] = goal
    config = SACConfig(pairs=pairs, features=features)
    reference = PairEncoder(layout, config).encode(observation, *goals)
    assert torch.equal(reference.pairs, PairEncoder(other, config).encode(observation, *reordered).pairs)
    assert not torch.equal(reference.pairs, PairEncoder(layout, config).encode(observation, *reordered).pairs)


@pytest.mark.parametrize("features", ["state", "near_field"])
@pytest.mark.parametrize("pairs", ["symmetric", "oriented", "roles"])
@pytest.mark.parametrize("n_blocks", [2, 4])
def test_fast_encoding_equals_the_plain_one(n_blocks, pairs, features):
    layout = layout_of(n_blocks)
    encoder = PairEncoder(layout, SACConfig(pairs=pairs, features=features, detail_scale=0.1))
    observation, achieved, desired = some_inputs(layout)
    encoder.observe(3 * observation + 1, achieved, desired)
    rows = torch.cat([observation, achieved, desired], dim=1).expand(2, -1, -1).contiguous()
    rows[1] *= 0.1  # some small enough not to saturate
    fast = encoder.encode_rows(rows)
    for k, plain in enumerate(zip(*encoder.encode_plainly(rows), strict=True)):
        for got, want in zip(fast[k], plain, strict=True):
            torch.testing.assert_close(got, want)


def test_encoder_statistics_are_shared_and_explicit():
    layout = layout_of(3)
    encoder, raw = PairEncoder(layout, SACConfig()), some_inputs(layout)
    before = encoder.encode(*raw)
    assert torch.equal(before.state, raw[0].clamp(-5, 5))
    assert torch.equal(encoder.encode(*raw).state, before.state)
    encoder.observe(*raw)
    blocks = raw[0][:, 10:].reshape(-1, 15)
    expected = ((blocks - blocks.mean(0)) / blocks.std(0, correction=0)).view(BATCH, 45).clamp(-5, 5)
    torch.testing.assert_close(encoder.encode(*raw).state[:, 10:], expected)


def test_log_density_of_squashed_gaussian():
    generator = torch.Generator().manual_seed(3)
    mean, log_std, noise = torch.randn(3, BATCH, 4, generator=generator).double()
    action, log_prob = squashed_gaussian(mean, log_std, noise)
    normal = torch.distributions.Normal(mean, log_std.exp())
    expected = normal.log_prob(action.atanh()) - (1 - action.square()).log()
    torch.testing.assert_close(log_prob, expected.sum(-1))
    _, saturated = squashed_gaussian(mean + 50.0, log_std, noise)
    assert saturated.isfinite().all()
