"""Initial states."""

import numpy as np
import pytest

from curiobench.tasks.goals import predicates
from curiobench.tasks.robots import GRIP_START
from curiobench.tasks.starts import HAND_CLEARANCE, MIN_DISTANCE, NONE_HELD, SPREAD, BiasedStarts, sample_starts

N = 20_000


def draw(biased: bool, n_blocks: int = 3, **probabilities: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return sample_starts(rng, np.full(N, biased), n_blocks, BiasedStarts(**probabilities))


def heights(positions: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Height in blocks of the stack in each world, the held block left out."""
    z = np.where(np.arange(positions.shape[1]) == held[:, None], 0, positions[..., 2])
    return np.rint((z.max(axis=1) - 0.425) / 0.05).astype(int) + 1


def test_plain_starts_are_flat_near_the_hand_and_apart():
    positions, held = draw(biased=False)
    assert (held == NONE_HELD).all()
    np.testing.assert_allclose(positions[..., 2], 0.425)
    assert np.abs(positions[..., :2] - GRIP_START[:2]).max() <= SPREAD
    first, second = np.triu_indices(3, k=1)
    assert np.linalg.norm(positions[:, first] - positions[:, second], axis=-1).min() >= MIN_DISTANCE


def test_three_quarters_of_plain_starts_already_satisfy_nothing_close():
    positions, _ = draw(biased=False)
    assert (predicates(positions).sum(axis=1) == 0).mean() == pytest.approx(0.75, abs=0.04)


def test_probabilities_of_biased_starts():
    positions, held = draw(biased=True, held=0.0)
    shares = np.bincount(heights(positions, held), minlength=4)[1:] / N
    np.testing.assert_allclose(shares, [0.70, 0.21, 0.09], atol=0.012)
    _, held = draw(biased=True)
    assert (held != NONE_HELD).mean() == pytest.approx(0.5, abs=0.012)


def test_with_two_blocks_a_stack_of_three_is_a_stack_of_two():
    positions, held = draw(biased=True, n_blocks=2, held=0.0)
    np.testing.assert_allclose(np.bincount(heights(positions, held))[1:] / N, [0.70, 0.30], atol=0.012)


@pytest.mark.parametrize("n_blocks", [2, 3, 5])
def test_a_held_block_is_at_the_grip_and_carries_nothing(n_blocks):
    positions, held = draw(biased=True, n_blocks=n_blocks, held=1.0)
    rows = np.arange(N)
    np.testing.assert_array_equal(positions[rows, held], np.tile(GRIP_START, (N, 1)))
    # every other block still stands on the table or on a block
    z = np.where(np.arange(n_blocks) == held[:, None], np.nan, positions[..., 2])
    for level in (0.475, 0.525):
        up = np.isclose(z, level)
        below = np.isclose(z, level - 0.05)
        assert (up.sum(axis=1) <= below.sum(axis=1))[up.any(axis=1)].all()


def test_every_block_is_held_and_stacked_equally_often():
    positions, held = draw(biased=True)
    np.testing.assert_allclose(np.bincount(held[held >= 0]) / (held >= 0).sum(), 1 / 3, atol=0.02)
    lifted = (positions[..., 2] > 0.43) & (np.arange(3) != held[:, None])
    np.testing.assert_allclose(lifted.sum(axis=0) / lifted.sum(), 1 / 3, atol=0.02)


def test_a_stack_of_three_stands_clear_of_the_waiting_hand():
    positions, held = draw(biased=True, held=0.0, stack_of_three=1.0, stack_of_two=0.0)
    assert (heights(positions, held) == 3).all()
    assert np.linalg.norm(positions[:, 0, :2] - GRIP_START[:2], axis=1).min() >= HAND_CLEARANCE


def test_only_the_given_worlds_are_biased():
    biased = np.arange(1000) % 2 == 0
    positions, held = sample_starts(np.random.default_rng(0), biased, 3, BiasedStarts(0, 1, 0))
    np.testing.assert_array_equal(heights(positions, held) == 3, biased)


@pytest.mark.parametrize("probabilities", [(0.6, 0.6, 0.5), (-0.1, 0.1, 0.5), (0.2, 0.1, 1.5), (np.nan, 0.1, 0.5)])
def test_bad_probabilities(probabilities):
    with pytest.raises(ValueError, match="probabilities"):
        BiasedStarts(*probabilities)
