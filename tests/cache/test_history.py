"""A history answers for every step what the cache held then and what the folds count up to there."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.cache import Access, Cache, Geometry, Memory, counts, history, miss_classes, references_of
from labkit.cache.memory import NON_CACHEABLE, WRITE_BACK, WRITE_BACK_NO_ALLOCATE, WRITE_THROUGH

ACTS = st.sampled_from(["read", "write", "modify", "speculate", "clean", "invalidate", "clean_invalidate", "disable", "enable"])


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(ACTS, st.integers(0, 60)), max_size=40),
    st.sampled_from([1, 2, 4]),
    st.sampled_from(["lru", "plru", "fifo", "random"]),
    st.sampled_from([WRITE_BACK, WRITE_BACK, WRITE_THROUGH, WRITE_BACK_NO_ALLOCATE, NON_CACHEABLE]),
)
def test_contents_are_those_of_the_cache_at_every_step(acts, ways, policy, kind):
    cache = Cache(Memory.flat(1024, kind), Geometry(256, ways, 32), policy)
    held = {0: {}}
    for act, word in acts:
        match act:
            case "read":
                cache.read(16 * word, 4)
            case "write" | "modify":
                getattr(cache, act)(16 * word, bytes(4))
            case "speculate":
                cache.speculate(16 * word)
            case "enable" | "disable":
                getattr(cache, act)()
            case _:
                getattr(cache, act)(16 * word, 20)
        step = sum(isinstance(record, Access) for record in cache.log)
        held[step] = {(way, index): (line.address, line.dirty) for index, way, line in cache.lines()}
    told = history(cache.log, cache.geometry)
    assert len(told) == max(held)
    for step, expected in held.items():
        line, dirty = told.contents(step)
        assert line.shape == dirty.shape == (ways, 8 // ways)
        found = {key: (int(line[key]), bool(dirty[key])) for key in zip(*map(np.ndarray.tolist, np.nonzero(line >= 0)))}
        assert found == expected


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["read", "write", "modify", "speculate"]), st.integers(0, 60)), max_size=40))
def test_totals_and_classes_are_those_of_the_folds_up_to_each_step(acts):
    cache = Cache(Memory.flat(1024), Geometry(256, 2, 32))
    for act, word in acts:
        if act in ("write", "modify"):
            getattr(cache, act)(16 * word, bytes(4))
        else:
            cache.read(16 * word, 4) if act == "read" else cache.speculate(16 * word)
    told = history(cache.log, cache.geometry)
    for step in range(len(told) + 1):
        done = cache.log[:step]
        expected = counts(done)
        found = {name: int(column[step]) for name, column in told.totals.items()}
        assert found["accesses"] == expected["lines_touched"]
        assert found["misses"] == expected["read_misses"] + expected["write_misses"]
        assert (found["fills"], found["write_backs"]) == (expected["fills"], expected["write_backs"])
        assert told.miss_classes(step) == miss_classes(expected["fills"], references_of(done), cache.geometry)


def test_a_history_of_nothing_is_empty():
    told = history([], Geometry(256, 2, 32))
    assert len(told) == 0 and told.miss_classes(0).total == 0
    assert (told.contents(0)[0] == -1).all()


def test_lines_held_before_the_log_began_are_known_once_they_are_used():
    cache = Cache(Memory.flat(1024), Geometry(256, 2, 32))
    cache.write(0, b"a")
    cache.write(32, b"b")
    cache.log.clear()
    cache.read(0, 1)
    cache.clean_invalidate()
    line, _ = history(cache.log, cache.geometry).contents(1)
    assert (line == -1).all()
