"""Predicates, valid goals and their names."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curiobench.tasks.goals import GoalSpace, goal_space, predicates
from curiobench.tasks.placements import BLOCK_SIZE
from curiobench.tasks.starts import MIN_DISTANCE


def renamed_bits(space: GoalSpace, bits: np.ndarray, new_name: tuple[int, ...]) -> np.ndarray:
    """The bits after block i is called `new_name[i]`, worked out from the bits' names alone."""
    letters = {letter: "abcde"[new_name["abcde".index(letter)]] for letter in "abcde"[: space.n_blocks]}
    values = {}
    for name, bit in zip(space.bit_names, bits, strict=True):
        pair = letters[name[2]] + letters[name[3]]
        values[name[0] + "(" + ("".join(sorted(pair)) if name[0] == "c" else pair) + ")"] = bit
    return np.array([values[name] for name in space.bit_names])


def test_bit_order_is_the_papers():
    assert " ".join(goal_space(3).bit_names) == "c(ab) c(ac) c(bc) o(ab) o(ba) o(ac) o(ca) o(bc) o(cb)"


@pytest.mark.parametrize(
    ("bit_string", "name"),
    [
        ("110011000", "a on c, b on a"),
        ("110011000", "b on a on c"),
        ("111000101", "c on a and b"),
        ("100100000", "a on b"),
    ],
)
def test_configurations_in_the_paper(bit_string, name):
    """Figure 2's stack of three and pyramid, and a stack of two with the third block far."""
    space = goal_space(3)
    assert space.bit_string(space.parse(name)) == bit_string


def test_thirty_five_goals_for_three_blocks():
    space = goal_space(3)
    assert len(space) == 35
    assert np.bincount(space.layers).tolist() == [0, 8, 21, 6]


def test_goals_of_two_and_four_blocks():
    assert goal_space(2).names == ("all apart", "all close", "a on b", "b on a")
    # every graph of close blocks on the table is a goal of its own: 2 ** 6
    assert np.bincount(goal_space(4).layers).tolist() == [0, 64, 340, 84, 24]


def test_goals_of_five_blocks_have_unique_names():
    space = goal_space(5)
    assert len(space) == len(set(space.names)) == 13_758
    assert np.bincount(space.layers)[5] == 120
    for index in range(0, len(space), 97):
        np.testing.assert_array_equal(space.parse(space.names[index]), space.goals[index])


@pytest.mark.parametrize("n_blocks", [2, 3, 4])
def test_names_and_bit_strings_lead_back_to_the_goal(n_blocks):
    space = goal_space(n_blocks)
    for index, bits in enumerate(space.goals):
        for goal in (space.names[index], space.bit_string(bits), index, bits, bits.tolist()):
            np.testing.assert_array_equal(space.parse(goal), bits)
        assert space.index(bits) == index
    np.testing.assert_array_equal(space.indices(space.goals), np.arange(len(space)))


@pytest.mark.parametrize("n_blocks", [2, 3, 4])
def test_renaming_the_blocks_renames_the_goals(n_blocks):
    space = goal_space(n_blocks)
    for new_name in itertools.permutations(range(n_blocks)):
        renamed = np.array([renamed_bits(space, bits, new_name) for bits in space.goals])
        indices = space.indices(renamed)
        assert sorted(indices) == list(range(len(space)))
        np.testing.assert_array_equal(space.layers[indices], space.layers)


@given(st.permutations(range(3)), st.integers(0, 2**32 - 1))
def test_predicates_follow_the_names(new_name, seed):
    positions = np.random.default_rng(seed).uniform(-0.06, 0.06, (3, 3))
    renamed = np.empty_like(positions)
    renamed[list(new_name)] = positions
    expected = renamed_bits(goal_space(3), predicates(positions), tuple(new_name))
    np.testing.assert_array_equal(predicates(renamed), expected)


def test_predicate_thresholds():
    def bits(dx: float, dz: float) -> list[float]:
        return predicates(np.array([[dx, 0.0, 0.425 + dz], [0.0, 0.0, 0.425]])).tolist()

    assert bits(0.0899, 0) == [1, 0, 0]
    assert bits(0.0901, 0) == [0, 0, 0]
    assert bits(0.0499, 0.05) == [1, 1, 0]
    assert bits(0.0501, 0.05) == [1, 0, 0]
    assert bits(0, 0.029) == bits(0, 0.061) == [1, 0, 0]
    assert bits(0, 0.031) == bits(0, 0.059) == [1, 1, 0]
    assert bits(0, -0.05) == [1, 0, 1]


def test_predicates_of_lost_blocks_are_all_false():
    assert not predicates(np.full((2, 3, 3), np.nan)).any()


def _aligned(rng: np.random.Generator, n_blocks: int) -> np.ndarray | None:
    """One random aligned placement: flat, stacked or pyramid, written without regard to placements.py."""
    blocks: list[np.ndarray] = []
    for _ in range(n_blocks):
        kind = rng.integers(3)
        if kind == 0 or not blocks:
            spot = np.append(rng.uniform(-0.12, 0.12, 2), 0.0)
        elif kind == 1:
            spot = blocks[rng.integers(len(blocks))] + [0, 0, BLOCK_SIZE]
        else:
            i, j = rng.integers(len(blocks), size=2)
            if i == j or blocks[i][2] != blocks[j][2] or np.linalg.norm(blocks[i] - blocks[j]) > 0.09:
                return None
            spot = (blocks[i] + blocks[j]) / 2 + [0, 0, BLOCK_SIZE]
        if any(np.abs(b - spot).max() < BLOCK_SIZE - 1e-9 for b in blocks):
            return None
        blocks.append(spot)
    return rng.permutation(np.array(blocks))


@pytest.mark.parametrize(("n_blocks", "draws", "least_share"), [(2, 500, 1.0), (3, 20_000, 1.0), (4, 60_000, 0.8)])
def test_random_aligned_placements_produce_the_goals_and_nothing_else(n_blocks, draws, least_share):
    rng = np.random.default_rng(0)
    space = goal_space(n_blocks)
    placements = [p for p in (_aligned(rng, n_blocks) for _ in range(draws)) if p is not None]
    met = space.indices(predicates(np.array(placements)))
    assert (met >= 0).all()
    assert len(set(met)) >= least_share * len(space)


def test_starts_do_not_overlap_however_blocks_are_turned():
    assert MIN_DISTANCE >= 2**0.5 * BLOCK_SIZE - 1e-4


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("a on d", "no block 'd'"),
        ("a under b", "unknown goal 'a under b'"),
        ("", "unknown goal"),
        ("a on b, b on a", "no placement"),
        ("1001", "9 bits"),
        ("000100000", "no placement"),
        (35, "0 to 34"),
        (-1, "0 to 34"),
        ("a on a", "named twice"),
        ("a on b and b", "named twice"),
        ("a on b, b apart", "b cannot be apart and have a relation"),
        ("a on c, b on c", "unknown goal 'a on c, b on c': no placement"),
        ({"a": 1}, "a goal is a name"),
        ([0.5] * 9, "0 or 1"),
        ([np.nan] * 9, "0 or 1"),
        (np.zeros((2, 9)), "shape"),
    ],
)
def test_bad_goals_are_refused_in_one_line(goal, message):
    with pytest.raises(ValueError, match=message) as error:
        goal_space(3).parse(goal)
    assert "\n" not in str(error.value)


def test_an_unknown_name_names_near_ones():
    with pytest.raises(ValueError, match="did you mean 'a on b, c apart'"):
        goal_space(3).parse("a onn b, c apart")


@pytest.mark.parametrize("n_blocks", [1, 6])
def test_number_of_blocks_is_bounded(n_blocks):
    with pytest.raises(ValueError, match="2 to 5"):
        goal_space(n_blocks)
