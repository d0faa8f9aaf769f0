"""Counts of long traces: the same cache without its bytes, over columns instead of objects.

Same numbers as the fold `counts` over the records of a `Cache`, about a hundred times faster: a run of accesses to one line is
decided by its first one; LRU needs no loop over accesses at all; the other policies get a loop with one dictionary.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import pairwise
from os import PathLike
from typing import SupportsInt

import numpy as np

from labkit.cache.geometry import Geometry
from labkit.cache.policies import POLICIES, check_tree, draws, tree_path, tree_victim
from labkit.cache.references import LOAD, STORE, References, read_trace
from labkit.cache.stores import streaming_stores

#: What both ways of counting report. Reads and writes are accesses (a modify counts as one read) and a straddling access misses
#: at most once, as cachegrind counts; the rest counts lines: touched, fetched, replaced, written back, stores sent to memory, and
#: accesses that bypass the cache (none in a trace that is only counted).
COUNTS = (
    "reads",
    "writes",
    "read_misses",
    "write_misses",
    "lines_touched",
    "fills",
    "evictions",
    "write_backs",
    "stores_to_memory",
    "uncached",
)
WRITE_POLICIES = ("write-back", "write-through")
#: One set: (index, tag) of its accesses, which of all accesses may allocate (None: all), ways, where to mark the misses -> the
#: tags it holds at the end.
SetLoop = Callable[[Iterable[tuple[int, int]], "list[bool] | None", int, bytearray], Iterable[int]]
MOST_TOUCHED = 10_000_000  # lines; counting them takes half a minute at worst and 2 GB
_MOST_LEVELS = 16  # ways up to which the LRU stack is unrolled level by level
_LARGEST_TABLE = 8  # ways up to which what a use makes of the tree bits is tabulated


def count_trace(
    trace: str | PathLike[str] | References,
    size: int = 16384,
    ways: int = 4,
    line: int = 32,
    policy: str = "lru",
    *,
    write_policy: str = "write-back",
    write_allocate: bool = True,
    dynamic_read_allocate: bool = False,
    seed: int = 0,
) -> dict[str, int]:
    """Counts of a trace, file or columns, in a cache that is empty at first; reference sizes are cut to a line as in cachegrind.

    Returns:
        A dict with the keys `COUNTS`.

    Raises:
        ValueError: a geometry that cannot be, an unknown policy or write policy, or a bad trace file (`TraceFileError`).
    """
    geometry = Geometry(size, ways, line)
    references = trace if isinstance(trace, References) else read_trace(trace)
    return count(
        references.clipped(line),
        geometry,
        policy,
        write_policy=write_policy,
        write_allocate=write_allocate,
        dynamic_read_allocate=dynamic_read_allocate,
        seed=seed,
    )


def count(
    references: References,
    geometry: Geometry,
    policy: str = "lru",
    *,
    write_policy: str = "write-back",
    write_allocate: bool = True,
    dynamic_read_allocate: bool = False,
    seed: int = 0,
) -> dict[str, int]:
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
    if len(last) and last.max() < 2**31:
        lines, last = lines.astype(np.int32), last.astype(np.int32)  # half the memory to move
    owner, further = None, (last - lines).sum(dtype=float)
    if further + len(op) > MOST_TOUCHED:
        raise ValueError(f"the references touch {further + len(op):.0f} lines; at most {MOST_TOUCHED} can be counted")
    if further:
        spans = last - lines + 1
        owner = np.repeat(np.arange(len(op)), spans)
        first = np.cumsum(spans) - spans
        lines = lines[owner] + (np.arange(len(owner)) - first[owner]).astype(lines.dtype)
        stores, allocates = stores[owner], allocates[owner]

    # A run of accesses to one line hits from the first one on that may allocate, whatever the policy: drop those hits.
    keep, dirtied = _heads(lines, stores, allocates)
    dirtied &= write_policy == "write-back"
    head_misses, evictions, write_backs = _simulate(lines[keep], dirtied, allocates[keep], geometry, policy, seed)
    missed = keep[head_misses]
    straight = stores & (write_policy == "write-through")
    straight[missed] |= ~allocates[missed]
    if owner is not None and len(missed):
        missed = owner[missed]  # in order, so equal ones are neighbours; numpy's `unique` takes longer than all the rest
        missed = missed[np.append(True, missed[1:] != missed[:-1])]
    reads, read_misses = np.count_nonzero(op != STORE), np.count_nonzero(op[missed] != STORE)
    values: tuple[SupportsInt, ...] = (
        reads,
        len(op) - reads,
        read_misses,
        len(missed) - read_misses,
        len(lines),
        np.count_nonzero(allocates[keep[head_misses]]),
        evictions,
        write_backs,
        np.count_nonzero(straight),
        0,
    )
    return {name: int(value) for name, value in zip(COUNTS, values)}


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


def _simulate(
    lines: np.ndarray, dirtied: np.ndarray, allocates: np.ndarray, geometry: Geometry, policy: str, seed: int
) -> tuple[np.ndarray, int, int]:
    """Indices of the misses, number of evictions and of write-backs. Works set by set, in order of time within a set."""
    if not len(lines):
        return np.zeros(0, dtype=np.int64), 0, 0
    order = _stable_order(lines & (geometry.sets - 1))
    line, allocates = lines[order], allocates[order]
    if policy == "random":  # one stream of draws for all sets, so this one goes by time
        at, resident = _random_loop(lines, order, allocates, geometry, seed)
    elif policy == "lru" and geometry.ways <= _MOST_LEVELS and allocates.all():
        at, resident = _lru_levels(line, geometry)
    else:
        at, resident = _loop_by_set(line, allocates, geometry, {"lru": _lru_set, "fifo": _fifo_set, "plru": _plru_set}[policy])
    fills = at[allocates[at]]
    write_backs = _write_backs(line, fills, at, dirtied[order], resident, geometry) if dirtied.any() else 0
    return np.sort(order[at]), len(fills) - len(resident), write_backs


def _stable_order(keys: np.ndarray) -> np.ndarray:
    """Stable argsort of keys >= 0, 16 bits at a time: numpy sorts 16-bit integers by radix, several times faster."""
    order = np.argsort((keys & 0xFFFF).astype(np.uint16), kind="stable")
    rest = keys >> 16
    return order[_stable_order(rest[order])] if rest.any() else order


def _write_backs(
    line: np.ndarray, fills: np.ndarray, misses: np.ndarray, dirtied: np.ndarray, resident: np.ndarray, geometry: Geometry
) -> int:
    """A line is written back once per stay in the cache in which it was stored to, except for the stays that last to the end."""
    starts = np.zeros(len(line), dtype=bool)
    starts[fills] = True
    dirtied[misses[~starts[misses]]] = False  # stores that went past the cache
    tag = line // geometry.sets
    by_line = _stable_order(tag - tag.min())  # by tag, then by set as before: line by line
    grouped, stay = line[by_line], np.cumsum(starts[by_line])
    dirty = np.zeros(len(fills) + 1, dtype=bool)
    dirty[stay[dirtied[by_line]]] = True
    last = np.append(grouped[1:] != grouped[:-1], True)
    dirty[stay[last][np.isin(grouped[last], resident)]] = False
    return int(np.count_nonzero(dirty))


def _lru_levels(line: np.ndarray, geometry: Geometry) -> tuple[np.ndarray, np.ndarray]:
    """LRU without a loop over accesses: a set's recency stack is a chain of one-line buffers.

    An access that misses the first k buffers pushes the content of buffer k into buffer k+1, wherever it hits. So what buffer
    k+1 holds at such an access is what buffer k held at the one before it in the same set. Level by level, over all sets at
    once, only the accesses that missed so far remain; after `ways` levels these are the misses.
    """
    at = np.arange(len(line))  # the accesses that missed all levels so far, set by set, in order of time
    wanted, held = line, line  # what each of them looks for, and what it pushes into the next level
    resident = []
    for _ in range(geometry.ways):
        index = wanted & (geometry.sets - 1)
        head = np.ones(len(at), dtype=bool)  # first of its set
        np.not_equal(index[1:], index[:-1], out=head[1:])
        resident.append(held[np.append(head[1:], True)[: len(at)]])
        before = np.empty_like(held)
        before[1:] = held[:-1]
        before[head] = -1
        miss = np.flatnonzero(before != wanted)
        at, wanted, held = at[miss], wanted[miss], before[miss]
    left = np.concatenate(resident)
    return at, left[left >= 0]


def _loop_by_set(line: np.ndarray, allocates: np.ndarray, geometry: Geometry, run: SetLoop) -> tuple[np.ndarray, np.ndarray]:
    """Run one set after the other through `run`: indices of the misses, and the lines held at the end."""
    index, tag = line & (geometry.sets - 1), line // geometry.sets
    bounds = [0, *(np.flatnonzero(index[1:] != index[:-1]) + 1).tolist(), len(line)]
    lowest, allowed = int(tag.min()), None if allocates.all() else allocates.tolist()
    tags = (tag - lowest).tolist()  # Python has the integers up to 256 ready, and finds the same object in a dict at once
    missed = bytearray(len(tags))  # marks, as a list of a million indices costs more than the loop
    resident: list[int] = []
    for start, stop in pairwise(bounds):
        held = run(enumerate(tags[start:stop], start), allowed, geometry.ways, missed)
        resident += [(number + lowest) * geometry.sets + int(index[start]) for number in held]
    return np.flatnonzero(np.frombuffer(missed, bool)), np.array(resident, dtype=line.dtype)


def fully_associative_misses(lines: np.ndarray, capacity: int) -> np.ndarray:
    """Where an LRU cache of `capacity` lines in a single set misses: bool array, of the shape (n,) of `lines`."""
    missed = bytearray(len(lines))
    _lru_set(enumerate(lines.tolist()), None, capacity, missed)
    return np.frombuffer(missed, bool)


def _lru_set(accesses: Iterable[tuple[int, int]], allowed: list[bool] | None, ways: int, missed: bytearray) -> Iterable[int]:
    held: OrderedDict[int, None] = OrderedDict()  # oldest use first
    for i, line in accesses:
        if line in held:
            held.move_to_end(line)
            continue
        missed[i] = True
        if allowed is None or allowed[i]:
            if len(held) == ways:
                held.popitem(last=False)
            held[line] = None
    return held


def _fifo_set(accesses: Iterable[tuple[int, int]], allowed: list[bool] | None, ways: int, missed: bytearray) -> Iterable[int]:
    filled: dict[int, int] = {}  # line -> number of its latest fill; it stays for as many fills as there are ways
    fills = ways  # so that 0, never filled, is long ago
    for i, line in accesses:
        if filled.get(line, 0) <= fills - ways:
            missed[i] = True
            if allowed is None or allowed[i]:
                fills += 1
                filled[line] = fills
    return [line for line, number in filled.items() if number > fills - ways]


def _plru_set(accesses: Iterable[tuple[int, int]], allowed: list[bool] | None, ways: int, missed: bytearray) -> Iterable[int]:
    after, victims = _tree(ways)
    slots = [-1] * ways
    way_of: dict[int, int] = {}  # line -> the way it was last put into, though another one may be there by now
    used = bits = 0
    for i, line in accesses:
        way = way_of.get(line, 0)
        if slots[way] != line:
            missed[i] = True
            if allowed is not None and not allowed[i]:
                continue
            if used < ways:
                way = used
                used += 1
            else:
                way = victims[bits]
            slots[way] = line
            way_of[line] = way
        bits = after[way][bits]
    return slots[:used]


class _Computed:
    """Looks like a table, but computes its entries; for trees with too many states to tabulate."""

    def __init__(self, entry: Callable[[int], int]) -> None:
        self._entry = entry

    def __getitem__(self, bits: int) -> int:
        return self._entry(bits)


@lru_cache(maxsize=16)
def _tree(ways: int) -> tuple[list[list[int] | _Computed], list[int] | _Computed]:
    """For each way, tree bits -> bits after its use; and tree bits -> victim."""
    check_tree(ways)
    paths = [tree_path(way, ways) for way in range(ways)]
    steps = [lambda bits, keep=keep, point=point: bits & keep | point for keep, point in paths]
    if ways > _LARGEST_TABLE:
        return [_Computed(step) for step in steps], _Computed(lambda bits: tree_victim(bits, ways))
    return [[step(bits) for bits in range(1 << ways)] for step in steps], [tree_victim(bits, ways) for bits in range(1 << ways)]


def _random_loop(
    lines: np.ndarray, order: np.ndarray, allocates: np.ndarray, geometry: Geometry, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Random replacement in order of time; `allocates` is in order of sets, and so are the misses returned."""
    mask, ways, chosen = geometry.sets - 1, geometry.ways, draws(geometry.ways, seed)
    by_time = np.empty_like(allocates)
    by_time[order] = allocates
    allowed = None if allocates.all() else by_time.tolist()
    slots: list[list[int]] = [[] for _ in range(geometry.sets)]
    held: set[int] = set()
    missed = bytearray(len(lines))
    for i, line in enumerate(lines.tolist()):
        if line in held:
            continue
        missed[i] = True
        if allowed is None or allowed[i]:
            slot = slots[line & mask]
            if len(slot) < ways:
                slot.append(line)
            else:
                way = next(chosen)
                held.remove(slot[way])
                slot[way] = line
            held.add(line)
    return np.flatnonzero(np.frombuffer(missed, bool)[order]), np.array(sorted(held), dtype=lines.dtype)
