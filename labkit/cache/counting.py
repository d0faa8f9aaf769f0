"""Counts of long traces: the same cache without its bytes, over columns instead of objects.

Same numbers as the fold `counts` over the records of a `Cache`, hundreds of times faster: a run of accesses to one line is
decided by its first one; LRU needs no loop over accesses at all; the other policies get a loop with one dictionary.
"""

from __future__ import annotations

from os import PathLike

import numpy as np

from labkit.cache.geometry import Geometry
from labkit.cache.policies import POLICIES, check_tree, draws, tree_path, tree_victim
from labkit.cache.references import LOAD, STORE, References, read_trace
from labkit.cache.stores import streaming_stores

#: What both ways of counting report. Reads and writes are accesses (a modify counts as one read) and a straddling access misses
#: at most once, as cachegrind counts; the rest counts lines: touched, fetched, replaced, written back, stores sent to memory, and
#: accesses that bypass the cache (none in a trace that is only counted).
COUNTS = ("reads", "writes", "read_misses", "write_misses", "lines_touched", "fills", "evictions", "write_backs", "stores_to_memory",
          "uncached")
WRITE_POLICIES = ("write-back", "write-through")
_MOST_LEVELS = 16  # ways up to which the LRU stack is unrolled level by level


def count_trace(trace: str | PathLike[str] | References, size: int = 16384, ways: int = 4, line: int = 32, policy: str = "lru", *,
                write_policy: str = "write-back", write_allocate: bool = True, dynamic_read_allocate: bool = False,
                seed: int = 0) -> dict[str, int]:
    """Counts of a trace, file or columns, in a cache that is empty at first; reference sizes are cut to a line as in cachegrind.

    Returns:
        A dict with the keys `COUNTS`.

    Raises:
        ValueError: a geometry that cannot be, an unknown policy or write policy, or a bad trace file (`TraceFileError`).
    """
    geometry = Geometry(size, ways, line)
    references = trace if isinstance(trace, References) else read_trace(trace)
    return count(references.clipped(line), geometry, policy, write_policy=write_policy, write_allocate=write_allocate,
                 dynamic_read_allocate=dynamic_read_allocate, seed=seed)


def count(references: References, geometry: Geometry, policy: str = "lru", *, write_policy: str = "write-back",
          write_allocate: bool = True, dynamic_read_allocate: bool = False, seed: int = 0) -> dict[str, int]:
    """Counts of references of any size; arguments and errors otherwise as `count_trace`."""
    if policy not in POLICIES:
        raise ValueError(f"no replacement policy {policy!r}; there are {', '.join(POLICIES)}")
    if write_policy not in WRITE_POLICIES:
        raise ValueError(f"no write policy {write_policy!r}; there are {', '.join(WRITE_POLICIES)}")
    op, address, size = references.op, references.address, references.size
    stores, allocates = op != LOAD, op != STORE
    if not write_allocate:
        pass
    elif dynamic_read_allocate:
        allocates = allocates | ~streaming_stores(op != STORE, stores, address, size, geometry.line)
    else:
        allocates = np.ones(len(op), dtype=bool)

    shift = geometry.line.bit_length() - 1
    lines, last = address >> shift, (address + size - 1) >> shift
    owner = None
    if (lines != last).any():
        spans = last - lines + 1
        owner = np.repeat(np.arange(len(op)), spans)
        first = np.cumsum(spans) - spans
        lines = lines[owner] + np.arange(len(owner)) - first[owner]
        stores, allocates = stores[owner], allocates[owner]

    # A run of accesses to one line hits from the first one on that may allocate, whatever the policy: drop those hits.
    keep, dirtied = _heads(lines, stores, allocates)
    head_misses, evictions, write_backs = _simulate(lines[keep], dirtied & (write_policy == "write-back"), allocates[keep], geometry, policy, seed)
    missed = keep[head_misses]
    straight = stores & (write_policy == "write-through")
    straight[missed] |= ~allocates[missed]
    if owner is not None:
        missed = np.unique(owner[missed])
    reads, read_misses = np.count_nonzero(op != STORE), np.count_nonzero(op[missed] != STORE)
    values = (reads, len(op) - reads, read_misses, len(missed) - read_misses, len(lines),
              np.count_nonzero(allocates[keep[head_misses]]), evictions, write_backs, np.count_nonzero(straight), 0)
    return dict(zip(COUNTS, map(int, values)))


def _heads(lines: np.ndarray, stores: np.ndarray, allocates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the accesses that are not sure hits, and for each whether it or the sure hits after it store."""
    if not len(lines):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
    repeats = np.zeros(len(lines), dtype=bool)
    np.equal(lines[1:], lines[:-1], out=repeats[1:])
    if not allocates.all():
        allocated = np.cumsum(allocates) - allocates  # allocating accesses before this one
        start = np.flatnonzero(~repeats)
        repeats &= allocated > allocated[start][np.cumsum(~repeats) - 1]
    keep = np.flatnonzero(~repeats)
    return keep, np.logical_or.reduceat(stores, keep)


def _simulate(lines: np.ndarray, dirtied: np.ndarray, allocates: np.ndarray, geometry: Geometry, policy: str,
              seed: int) -> tuple[np.ndarray, int, int]:
    """Indices of the misses, number of evictions and of write-backs."""
    everything = bool(allocates.all())
    if policy == "lru" and everything and geometry.ways <= _MOST_LEVELS:
        return _lru_levels(lines, dirtied, geometry)
    columns = lines.tolist(), dirtied.tolist(), allocates.tolist()
    if policy == "lru":
        misses, evictions, write_backs = _lru_loop(*columns, geometry)
    elif policy == "plru":
        misses, evictions, write_backs = _plru_loop(*columns, geometry)
    else:
        misses, evictions, write_backs = _in_place_loop(*columns, geometry, draws(geometry.ways, seed) if policy == "random" else None)
    return np.array(misses, dtype=np.int64), evictions, write_backs


def _lru_levels(lines: np.ndarray, dirtied: np.ndarray, geometry: Geometry) -> tuple[np.ndarray, int, int]:
    """LRU without a loop over accesses: a set's recency stack is a chain of one-line buffers.

    An access that misses the first k buffers pushes the content of buffer k into buffer k+1, wherever it hits. So what buffer
    k+1 holds at such an access is what buffer k held at the one before it in the same set. Level by level, over all sets at
    once, only the accesses that missed so far remain; after `ways` levels these are the misses.
    """
    index = lines & (geometry.sets - 1)
    order = _stable_order(index)
    line, index = lines[order], index[order]

    at = np.arange(len(line))  # the accesses that missed all levels so far, set by set, in order of time
    held = line  # what each of them pushes into the next level
    stays = []  # the lines held at the end
    for _ in range(geometry.ways):
        if not len(at):
            break
        head = np.ones(len(at), dtype=bool)
        np.not_equal(index[at[1:]], index[at[:-1]], out=head[1:])
        before = np.empty_like(held)
        before[1:] = held[:-1]
        before[head] = -1
        tail = np.append(head[1:], True)
        stays.append(held[tail])
        miss = before != line[at]
        at, held = at[miss], before[miss]
    evictions = int(np.count_nonzero(held >= 0)) if len(at) else 0

    # A line is written back once per stay in the cache in which it was stored to, except for the stays that last to the end.
    misses = np.zeros(len(line), dtype=bool)
    misses[at] = True
    by_line = _stable_order(line)
    grouped, stay = line[by_line], np.cumsum(misses[by_line])
    dirty = np.zeros(len(at) + 1, dtype=bool)
    dirty[stay[dirtied[order[by_line]]]] = True
    last = np.append(grouped[1:] != grouped[:-1], True)[:len(line)]
    dirty[stay[last][np.isin(grouped[last], np.concatenate(stays) if stays else ())]] = False
    write_backs = int(np.count_nonzero(dirty))
    return np.sort(order[at]), evictions, write_backs


def _stable_order(keys: np.ndarray) -> np.ndarray:
    """Stable argsort of keys >= 0, 16 bits at a time: numpy sorts 16-bit integers by radix, several times faster than 64-bit ones."""
    order = np.argsort((keys & 0xFFFF).astype(np.uint16), kind="stable")
    rest = keys >> 16
    return order[_stable_order(rest[order])] if len(keys) and rest.max() else order


def _lru_loop(lines: list[int], dirtied: list[bool], allocates: list[bool], geometry: Geometry) -> tuple[list[int], int, int]:
    """LRU one access at a time: one dict per set, oldest use first, line -> dirty."""
    sets: list[dict[int, bool]] = [{} for _ in range(geometry.sets)]
    mask, ways = geometry.sets - 1, geometry.ways
    misses, evictions, write_backs = [], 0, 0
    for i, line in enumerate(lines):
        held = sets[line & mask]
        if line in held:
            held[line] = held.pop(line) or dirtied[i]
            continue
        misses.append(i)
        if allocates[i]:
            if len(held) == ways:
                evictions += 1
                write_backs += held.pop(next(iter(held)))
            held[line] = dirtied[i]
    return misses, evictions, write_backs


def _in_place_loop(lines: list[int], dirtied: list[bool], allocates: list[bool], geometry: Geometry,
                   chosen: object) -> tuple[list[int], int, int]:
    """FIFO (`chosen` None: the ways in turn) and random (`chosen`: iterator of ways): policies that take no note of hits."""
    dirty: dict[int, bool] = {}
    mask, ways = geometry.sets - 1, geometry.ways
    slots: list[list[int]] = [[] for _ in range(geometry.sets)]
    turn = [0] * geometry.sets
    misses, evictions, write_backs = [], 0, 0
    for i, line in enumerate(lines):
        if line in dirty:
            if dirtied[i]:
                dirty[line] = True
            continue
        misses.append(i)
        if not allocates[i]:
            continue
        index = line & mask
        slot = slots[index]
        if len(slot) < ways:
            slot.append(line)
        else:
            if chosen is None:
                way = turn[index]
                turn[index] = way + 1 if way + 1 < ways else 0
            else:
                way = next(chosen)
            evictions += 1
            write_backs += dirty.pop(slot[way])
            slot[way] = line
        dirty[line] = dirtied[i]
    return misses, evictions, write_backs


def _plru_loop(lines: list[int], dirtied: list[bool], allocates: list[bool], geometry: Geometry) -> tuple[list[int], int, int]:
    """Tree-PLRU: one integer of tree bits per set, two masks per way."""
    mask, ways = geometry.sets - 1, geometry.ways
    check_tree(ways)
    keeps, points = zip(*(tree_path(way, ways) for way in range(ways)))
    bits = [0] * geometry.sets
    slots: list[list[int]] = [[] for _ in range(geometry.sets)]
    dirty = [[False] * ways for _ in range(geometry.sets)]
    way_of: dict[int, int] = {}
    victims: dict[int, int] = {}  # tree bits -> victim, as far as they were met
    misses, evictions, write_backs = [], 0, 0
    for i, line in enumerate(lines):
        index = line & mask
        way = way_of.get(line)
        if way is None:
            misses.append(i)
            if not allocates[i]:
                continue
            slot = slots[index]
            if len(slot) < ways:
                way = len(slot)
                slot.append(line)
            else:
                state = bits[index]
                way = victims.get(state)
                if way is None:
                    way = victims[state] = tree_victim(state, ways)
                evictions += 1
                write_backs += dirty[index][way]
                del way_of[slot[way]]
                slot[way] = line
            way_of[line] = way
            dirty[index][way] = dirtied[i]
        elif dirtied[i]:
            dirty[index][way] = True
        bits[index] = bits[index] & keeps[way] | points[way]
    return misses, evictions, write_backs
