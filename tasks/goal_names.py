"""Conversion of semantic goals to readable names and back.

A name is a list of relations separated by commas: "a on b", "a on b and c" (a pyramid: it implies that b and c are
close), "c close to a and b", "all close". Blocks without any relation are "apart". A block on another block is also
close to it, and the name does not repeat that.
"""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from curiobench.tasks.goals import GoalSpace

BLOCK_NAMES = "abcde"
_LIST = "[a-z](?: and [a-z])*"
_RELATION = re.compile(f"([a-z]) (on|close to) ({_LIST})")
_APART = re.compile(f"({_LIST}) apart")

Relations = set[tuple[int, int]]
"""Pairs of block numbers; ordered (upper, lower) for "on", `i < j` for "close"."""


def describe(space: "GoalSpace", bits: np.ndarray) -> str:
    """The readable name of `bits` `(n_bits,)`; `parse` turns it back into the same bits."""
    on = {(p.i, p.j) for p in space.pairs if bits[p.on_ij]} | {(p.j, p.i) for p in space.pairs if bits[p.on_ji]}
    close = {(p.i, p.j) for p in space.pairs if bits[p.close]}
    if not on and len(close) in (0, len(space.pairs)):
        return "all close" if close else "all apart"
    parts = [f"{BLOCK_NAMES[i]} on {_join(below)}" for i, below in _supports(on)]
    parts += [f"{BLOCK_NAMES[i]} close to {_join(others)}" for i, others in _neighbours(close - _implied(on), on)]
    apart = set(range(space.n_blocks)) - {i for pair in on | close for i in pair}
    return ", ".join(parts + ([f"{_join(apart)} apart"] if apart else []))


def parse(space: "GoalSpace", name: str) -> np.ndarray:
    """The bits `(n_bits,)` that a name describes. Blocks that it does not mention are apart.

    Raises:
      ValueError: a relation cannot be parsed, names a block twice or one that the task does not have, or contradicts
        another.
    """
    text = " ".join(name.lower().split())
    if text in ("all close", "all apart"):
        return _to_bits(space, set(), {(p.i, p.j) for p in space.pairs} if text == "all close" else set())
    text = re.sub(r"on ([a-z]) (?=on )", r"on \1, \1 ", text)  # a on b on c: a on b, b on c
    on: Relations = set()
    close: Relations = set()
    alone: set[int] = set()
    for part in re.split(r"\s*,\s*", text):
        if apart := _APART.fullmatch(part):
            alone.update(_blocks(space, apart[1].split(" and ")))
        elif relation := _RELATION.fullmatch(part):
            subject, *others = _blocks(space, [relation[1], *relation[3].split(" and ")])
            pairs = {(subject, other) for other in others}
            (on if relation[2] == "on" else close).update(pairs)
        else:
            raise ValueError(f"{part!r} is not 'x on y', 'x on y and z', 'x close to y', 'x apart', 'all close/apart'")
    if both := alone & {i for pair in on | close for i in pair}:
        raise ValueError(f"{_join(both)} cannot be apart and have a relation, too")
    return _to_bits(space, on, close | _implied(on))


def _blocks(space: "GoalSpace", letters: list[str]) -> list[int]:
    unknown = [letter for letter in letters if letter not in BLOCK_NAMES[: space.n_blocks]]
    if unknown:
        raise ValueError(f"there is no block {unknown[0]!r}, the blocks are {', '.join(BLOCK_NAMES[: space.n_blocks])}")
    if len(set(letters)) < len(letters):
        raise ValueError(f"a block is named twice: {', '.join(letters)}")
    return [BLOCK_NAMES.index(letter) for letter in letters]


def _to_bits(space: "GoalSpace", on: Relations, close: Relations) -> np.ndarray:
    bits = np.zeros(space.n_bits, np.float32)
    for p in space.pairs:
        bits[p.close] = (p.i, p.j) in close or (p.j, p.i) in close
        bits[p.on_ij] = (p.i, p.j) in on
        bits[p.on_ji] = (p.j, p.i) in on
    return bits


def _implied(on: Relations) -> Relations:
    """Close pairs that a name omits: a block and its support, and the two supports of a pyramid's top."""
    implied = {(min(pair), max(pair)) for pair in on}
    return implied | {(supports[0], supports[1]) for _, supports in _supports(on) if len(supports) == 2}


def _supports(on: Relations) -> Iterator[tuple[int, list[int]]]:
    """Each block that lies on others, with the blocks below it."""
    for i in sorted({i for i, _ in on}):
        yield i, [j for h, j in sorted(on) if h == i]


def _neighbours(close: Relations, on: Relations) -> Iterator[tuple[int, list[int]]]:
    """Groups close pairs by block: blocks with most neighbours first, and in ties unstacked blocks before stacked."""
    stacked = {i for pair in on for i in pair}
    left = set(close)
    while left:
        ends = [i for pair in left for i in pair]
        hub = max(set(ends), key=lambda i: (ends.count(i), i not in stacked, -i))
        yield hub, sorted(j if i == hub else i for i, j in left if hub in (i, j))
        left = {pair for pair in left if hub not in pair}


def _join(blocks: "set[int] | list[int]") -> str:
    return " and ".join(BLOCK_NAMES[i] for i in sorted(blocks))
