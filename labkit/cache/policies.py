"""Replacement policies: which way of a full set makes room. A policy knows ways, never addresses.

Four verbs: `touch` after a hit, `fill` after a line was put into a way, `invalidate` after a way was emptied, `victim` to
choose a way of a full set. Empty ways are the cache's business: it fills the lowest-numbered one before it asks.
The policy of the Cortex-M7's caches is not published; it is a parameter here.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, repeat
from typing import Protocol

import numpy as np

from labkit.cache.geometry import is_power_of_two

MOST_LEAVES = 1024  # of a tree: each way has masks of one bit per way


class Policy(Protocol):
    def touch(self, index: int, way: int) -> None: ...
    def fill(self, index: int, way: int) -> None: ...
    def invalidate(self, index: int, way: int) -> None: ...
    def victim(self, index: int) -> int: ...


class LRU:
    """The way whose last use lies longest back."""

    def __init__(self, sets: int, ways: int) -> None:
        self._order: list[dict[int, None]] = [dict.fromkeys(range(ways)) for _ in range(sets)]  # oldest use first

    def touch(self, index: int, way: int) -> None:
        order = self._order[index]
        order[way] = order.pop(way)

    fill = touch

    def invalidate(self, index: int, way: int) -> None:
        pass

    def victim(self, index: int) -> int:
        return next(iter(self._order[index]))


class FIFO(LRU):
    """The way that was filled longest ago, however often it was used since."""

    fill = LRU.touch

    def touch(self, index: int, way: int) -> None:
        pass


class TreePLRU:
    """A binary tree of bits over the ways, each pointing to the half that was not used last (tree pseudo-LRU).

    Node n has the children 2n and 2n + 1; the leaves ways..2*ways-1 are the ways. One integer holds a set's bits, bit n set
    when node n points to its right child.
    """

    def __init__(self, sets: int, ways: int) -> None:
        check_tree(ways)
        self._ways = ways
        self._bits = [0] * sets
        self._paths = [tree_path(way, ways) for way in range(ways)]

    def touch(self, index: int, way: int) -> None:
        keep, point = self._paths[way]
        self._bits[index] = self._bits[index] & keep | point

    fill = touch

    def invalidate(self, index: int, way: int) -> None:
        pass

    def victim(self, index: int) -> int:
        return tree_victim(self._bits[index], self._ways)


class Random:
    """Any way, from a seeded generator; one draw per replacement, in the order of the replacements."""

    def __init__(self, sets: int, ways: int, seed: int = 0) -> None:
        self._draws = draws(ways, seed)

    def touch(self, index: int, way: int) -> None:
        pass

    fill = invalidate = touch

    def victim(self, index: int) -> int:
        return next(self._draws)


POLICIES: dict[str, type] = {"lru": LRU, "plru": TreePLRU, "fifo": FIFO, "random": Random}


def make_policy(name: str, sets: int, ways: int, seed: int = 0) -> Policy:
    """The policy called `name` (a key of `POLICIES`) for `sets` sets of `ways` ways; `seed` matters to `random` only."""
    if name not in POLICIES:
        raise ValueError(f"no replacement policy {name!r}; there are {', '.join(POLICIES)}")
    return Random(sets, ways, seed) if name == "random" else POLICIES[name](sets, ways)


def check_tree(ways: int) -> None:
    """A tree needs a power of two of leaves, `MOST_LEAVES` at most: ValueError otherwise."""
    if not is_power_of_two(ways) or ways > MOST_LEAVES:
        raise ValueError(f"tree-PLRU over {ways} ways; the tree needs a power of two, {MOST_LEAVES} at most")


def tree_path(way: int, ways: int) -> tuple[int, int]:
    """The two masks (and, or) that turn every node above `way` away from it."""
    keep, point, node = -1, 0, ways + way
    while node > 1:
        keep &= ~(1 << node // 2)
        point |= (node & 1 ^ 1) << node // 2
        node //= 2
    return keep, point


def tree_victim(bits: int, ways: int) -> int:
    """The leaf that the bits of a set point to."""
    node = 1
    while node < ways:
        node = 2 * node + (bits >> node & 1)
    return node - ways


def draws(ways: int, seed: int) -> Iterator[int]:
    """Endless ways, uniformly drawn in blocks (a single draw from numpy costs more than a whole access)."""
    generator = np.random.default_rng(seed)
    return chain.from_iterable(generator.integers(ways, size=4096).tolist() for _ in repeat(None))
