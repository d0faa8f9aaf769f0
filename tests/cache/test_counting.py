"""The two ways to count agree, with each other, with brute force and with cachegrind."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.cache import Cache, Geometry, Memory, References, count, count_trace, counts, miss_classes, read_trace, replay
from labkit.cache.memory import Attribute
from labkit.cache.policies import POLICIES, draws

ORACLE = Path(__file__).parents[1] / "oracle" / "cachegrind"
COUNTED = {
    (program, geometry): counted
    for program in ("mm", "unaligned")
    for geometry, counted in json.loads((ORACLE / f"{program}.json").read_text())["counts"].items()
}


@pytest.mark.parametrize(("program", "geometry"), COUNTED)
def test_misses_are_those_of_cachegrind(program, geometry):
    size, ways, line = map(int, geometry.split(",")[0].split()[1:])
    found = count_trace(ORACLE / f"{program}_data.npz", size, ways, line)
    counted = COUNTED[program, geometry]
    assert [found[name] for name in ("reads", "read_misses", "writes", "write_misses")] == [
        counted[name] for name in ("Dr", "D1mr", "Dw", "D1mw")
    ]


def test_records_of_a_piece_of_mm_count_as_the_columns_do():
    whole = read_trace(ORACLE / "mm_data.npz")
    start = len(whole) // 2
    piece = References(*(column[start : start + 20_000] for column in (whole.op, whole.address, whole.size)))
    geometry = Geometry(4096, 4, 32)
    assert counts(replay(piece, Cache(Memory.flat(1 << 23), geometry))) == count(piece, geometry)


def as_references(rows):
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return References(table[:, 0].astype(np.uint8), table[:, 1], table[:, 2])


references = st.lists(st.tuples(st.integers(1, 3), st.integers(0, 1000), st.integers(1, 24)), max_size=150).map(as_references)


@st.composite
def runs(draw):
    """References that often continue where the last one ended, as memset does, so that dynamic read-allocate wakes up."""
    rows, at = [], 0
    step = st.tuples(st.sampled_from([1, 1, 1, 1, 2, 3]), st.integers(0, 9), st.integers(0, 1000), st.sampled_from([4, 4, 8, 16]))
    for op, jump, address, size in draw(st.lists(step, max_size=150)):
        at = address if jump == 0 or at > 1000 else at - 4 if jump == 1 and at >= 4 else at
        rows.append((op, at, size))
        at += size
    return as_references(rows)


SMALL = ((64, 1, 16), (64, 4, 16), (128, 2, 8), (256, 4, 16), (256, 16, 16), (512, 32, 16))
geometries = st.sampled_from([Geometry(*numbers) for numbers in SMALL])
write_policies = st.sampled_from(["write-back", "write-through"])
policies = st.sampled_from(sorted(POLICIES))


@given(st.one_of(references, runs()), geometries, policies, write_policies, st.booleans(), st.booleans(), st.integers(0, 3))
@settings(max_examples=250, deadline=None)
def test_columns_and_records_count_the_same(trace, geometry, policy, write_policy, write_allocate, dynamic, seed):
    attribute = Attribute("as drawn", True, write_policy == "write-back", write_allocate)
    cache = Cache(Memory.flat(2048, attribute), geometry, policy, seed=seed, dynamic_read_allocate=dynamic)
    assert count(
        trace,
        geometry,
        policy,
        write_policy=write_policy,
        write_allocate=write_allocate,
        dynamic_read_allocate=dynamic,
        seed=seed,
    ) == counts(replay(trace, cache))


class Tree:
    """Tree-PLRU as the textbook draws it: a node remembers which half was used last, and the victim is in the other one."""

    def __init__(self, leaves):
        self.leaves, self.recent = leaves, 1  # the first victim is way 0
        if len(leaves) > 1:
            half = len(leaves) // 2
            self.halves = Tree(leaves[:half]), Tree(leaves[half:])

    def use(self, leaf):
        if len(self.leaves) > 1:
            self.recent = int(leaf in self.halves[1].leaves)
            self.halves[self.recent].use(leaf)

    def victim(self):
        return self.leaves[0] if len(self.leaves) == 1 else self.halves[1 - self.recent].victim()


def brute_force_misses(lines, sets, ways, policy, seed):
    """One list per set and the whole history per decision; nothing shared with the package but the random draws."""
    held = [[None] * ways for _ in range(sets)]
    trees = [Tree(list(range(ways))) for _ in range(sets)]
    used, filled, chosen, misses = {}, {}, draws(ways, seed), []
    for now, line in enumerate(lines):
        ways_of_set, tree = held[line % sets], trees[line % sets]
        if line not in ways_of_set:
            misses.append(now)
            if None in ways_of_set:
                way = ways_of_set.index(None)
            elif policy == "plru":
                way = tree.victim()
            elif policy == "random":
                way = next(chosen)
            else:
                way = ways_of_set.index(min(ways_of_set, key=(used if policy == "lru" else filled).__getitem__))
            ways_of_set[way] = line
            filled[line] = now
        used[line] = now
        tree.use(ways_of_set.index(line))
    return misses


@given(
    st.lists(st.integers(0, 40), max_size=200),
    st.sampled_from([1, 2, 4]),
    st.sampled_from([1, 2, 4, 8, 16]),
    policies,
    st.integers(0, 5),
)
@settings(max_examples=250, deadline=None)
def test_every_policy_misses_where_brute_force_misses(lines, sets, ways, policy, seed):
    expected = brute_force_misses(lines, sets, ways, policy, seed)
    cache = Cache(Memory.flat(4096), Geometry(sets * ways * 32, ways, 32), policy, seed=seed)
    assert [i for i, line in enumerate(lines) if not cache.read(line * 32, 4)[0].hit] == expected
    trace = References(np.full(len(lines), 2, np.uint8), np.array(lines, np.int64) * 32, np.full(len(lines), 4))
    assert count(trace, cache.geometry, policy, seed=seed)["read_misses"] == len(expected)


def test_an_access_that_straddles_two_lines_touches_both_and_misses_once():
    trace = References(np.array([2, 2, 2], np.uint8), np.array([30, 0, 32]), np.array([4, 4, 4]))
    found = count(trace, Geometry(1024, 4, 32))
    assert (found["reads"], found["read_misses"], found["fills"], found["lines_touched"]) == (3, 1, 2, 4)


def test_a_store_hit_refreshes_lru():
    # A, B, store A, C, A in two ways: the store makes B the oldest, so the last A hits.
    trace = References(np.array([2, 2, 1, 2, 2], np.uint8), np.array([0, 64, 0, 128, 0]), np.full(5, 4))
    found = count(trace, Geometry(64, 2, 32))
    assert found["read_misses"] + found["write_misses"] == 3


def test_memset_does_not_fill_the_cache_with_dynamic_read_allocate():
    words = np.arange(256)
    trace = References(np.ones(256, np.uint8), words * 4, np.full(256, 4))
    assert count(trace, Geometry(16384, 4, 32))["fills"] == 32
    found = count(trace, Geometry(16384, 4, 32), dynamic_read_allocate=True)
    assert (found["fills"], found["stores_to_memory"]) == (3, 256 - 3 * 8)


def test_three_classes_add_up_and_conflict_may_be_negative():
    geometry = Geometry(1024, 4, 32)
    circle = np.tile(np.arange(33) * 32, 20)  # one line more than fits
    trace = References(np.full(len(circle), 2, np.uint8), circle, np.full(len(circle), 4))
    misses = count(trace, geometry)["fills"]
    classes = miss_classes(misses, trace, geometry)
    assert classes.compulsory == 33
    assert classes.capacity == 19 * 33  # LRU throws every line out just before it is needed
    assert classes.conflict < 0
    assert classes.total == misses


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"size": 3000}, "size is 3000 bytes; it must be a power of two"),
        ({"size": 0}, "size is 0 bytes; it must be a power of two"),
        ({"line": 24}, "line is 24 bytes; it must be a power of two"),
        ({"line": 2}, "line is 2 bytes; a line holds at least one word of 4 bytes"),
        ({"line": 8192}, "line is 8192 bytes; a line has 4096 at most"),
        ({"size": 1 << 40}, "size is 1099511627776 bytes; a cache has 67108864 at most"),
        ({"size": 1 << 26}, "67108864 bytes in lines of 32 are 2097152 lines; a cache has 1048576 at most"),
        ({"ways": 1 << 40}, "1099511627776 ways of 32-byte lines do not divide a cache of 16384 bytes"),
        ({"ways": 0}, "ways is 0; a cache has at least 1 way"),
        ({"ways": -4}, "ways is -4; a cache has at least 1 way"),
        ({"ways": 3}, "3 ways of 32-byte lines do not divide a cache of 16384 bytes"),
        ({"ways": 1024}, "1024 ways of 32-byte lines do not divide a cache of 16384 bytes"),
        ({"policy": "mru"}, "no replacement policy 'mru'; there are lru, plru, fifo, random"),
        ({"write_policy": "write-around"}, "no write policy 'write-around'; there are write-back, write-through"),
    ],
)
def test_a_cache_that_cannot_be_is_refused_in_one_sentence(change, says):
    with pytest.raises(ValueError) as error:
        count_trace(ORACLE / "mm_data.npz", **change)
    assert str(error.value) == says


@pytest.mark.parametrize("use", [count, lambda references, geometry: miss_classes(0, references, geometry)])
def test_references_that_touch_too_many_lines_are_refused(use):
    huge = References(np.array([2], np.uint8), np.array([0]), np.array([1 << 40]))
    with pytest.raises(ValueError, match="the references touch 34359738368 lines; at most 10000000 can be counted"):
        use(huge, Geometry(1024, 4, 32))


def test_tree_plru_needs_a_power_of_two():
    with pytest.raises(ValueError, match="tree-PLRU over 3 ways; the tree needs a power of two"):
        POLICIES["plru"](16, 3)
    with pytest.raises(ValueError, match="tree-PLRU over 2048 ways; the tree needs a power of two, 1024 at most"):
        POLICIES["plru"](1, 2048)
