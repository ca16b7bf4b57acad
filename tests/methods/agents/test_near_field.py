"""Near-field features of scenes that can be read off."""

import math

import torch
from layouts import layout_of

from curiobench.methods.agents.near_field import block_features, goal_differences, pair_features
from curiobench.methods.agents.pairs import PairEncoder
from curiobench.methods.agents.settings import SACConfig


def test_features_of_a_block_below_the_hand():
    """3 cm below: tanh of -0.03 / 0.04 and of -0.03 / 0.015, exp of -0.03 / 0.03 and of -0.03 / 0.1."""
    seen = block_features(torch.tensor([0.0, 0.0, -0.03]))
    by_hand = [0, 0, math.tanh(-0.75), 0, 0, math.tanh(-2.0), math.exp(-1.0), math.exp(-0.3)]
    torch.testing.assert_close(seen, torch.tensor(by_hand))


def test_features_of_a_block_on_another():
    """5 cm above and 1.5 cm beside: the distance that counts is the horizontal one."""
    seen = pair_features(torch.tensor([0.015, 0.0, 0.05]))
    tanhs = [math.tanh(0.375), 0, math.tanh(1.25), math.tanh(1.0), 0, math.tanh(0.05 / 0.015)]
    by_hand = [0.15, 0, 0.5, *tanhs, math.exp(-0.5), math.exp(-0.15)]
    torch.testing.assert_close(seen, torch.tensor(by_hand))


def test_missing_and_unwanted_bits():
    missing, unwanted = goal_differences(torch.tensor([0.0, 1.0, 1.0, 0.0]), torch.tensor([1.0, 0.0, 1.0, 0.0]))
    assert missing.tolist() == [1, 0, 0, 0]
    assert unwanted.tolist() == [0, 1, 0, 0]


def scene(achieved: tuple[float, ...], desired: tuple[float, ...], hand_x: float) -> torch.Tensor:
    """What an untrained encoder feeds of two blocks at x = 0 and 0.1, seen from a hand at `hand_x`: (F,)."""
    layout = layout_of(2)
    observation = torch.zeros(1, layout.observation_size)
    for block, x in enumerate((0.0, 0.1)):
        start = layout.body_size + layout.block_size * block
        observation[0, start], observation[0, start + 3] = x, x - hand_x
    encoder = PairEncoder(layout, SACConfig(pairs="roles", features="near_field", detail_scale=0.1))
    return encoder.encode(observation, torch.tensor([achieved]), torch.tensor([desired])).pairs[0, 0]


def test_roles_follow_goal_then_state_then_distance():
    """Bits: close, on(0, 1), on(1, 0). Column 0 is the first block's x, scaled: 0 for block 0, 0.01 for block 1."""
    flat, on_01, on_10 = (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 1.0)
    for achieved, desired, hand_x, first in (
        (flat, flat, 0.0, 0),
        (flat, flat, 0.1, 1),
        (on_10, flat, 0.0, 1),
        (on_01, flat, 0.1, 0),
        (on_10, on_01, 0.1, 0),
        (on_01, on_10, 0.0, 1),
    ):
        assert math.isclose(scene(achieved, desired, hand_x)[0].item(), 0.01 * first, abs_tol=1e-7)


def test_bits_turn_with_their_pair():
    """The last 23 columns: achieved, desired, missing, unwanted (3 each), then the pair's 11 features."""
    for achieved, desired in (((1.0, 0.0, 0.0), (1.0, 0.0, 1.0)), ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0))):
        bits = scene(achieved, desired, hand_x=0.0)[-23:-11].view(4, 3)
        assert bits.tolist() == [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]
