"""Folds over records: counts, a timeline as columns, and the three classes of misses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from labkit.cache.cache import Cache
from labkit.cache.counting import COUNTS, count
from labkit.cache.geometry import Geometry
from labkit.cache.records import Access, Record
from labkit.cache.references import LOAD, STORE, References

TIMELINE = (
    "number",
    "op",
    "address",
    "size",
    "line",
    "set",
    "way",
    "bypass",
    "hit",
    "filled",
    "victim",
    "written_back",
    "to_memory",
)


def replay(references: References, cache: Cache) -> list[Access]:
    """Run references through a cache (stores write zeros) and return their records."""
    records: list[Access] = []
    for op, address, size in zip(references.op.tolist(), references.address.tolist(), references.size.tolist()):
        if op == LOAD:
            records += cache.read(address, size)
        else:
            records += (cache.write if op == STORE else cache.modify)(address, bytes(size))
    return records


def counts(records: Iterable[Record]) -> dict[str, int]:
    """The counts `labkit.cache.counting.COUNTS` of the CPU's accesses. One that bypasses the cache neither hits nor misses.

    Fills, evictions and write-backs include those of speculative fills; write-backs include those of clean operations.
    """
    total = dict.fromkeys(COUNTS, 0)
    previous = missed = None  # the number of the latest access, and of the latest that missed
    for record in records:
        if not isinstance(record, Access):
            total["write_backs"] += len(getattr(record, "written_back", ()))
            continue
        total["fills"] += record.filled
        total["evictions"] += record.victim is not None
        total["write_backs"] += record.written_back
        if record.op == "speculate":
            continue
        kind = "write" if record.op == "write" else "read"
        total[f"{kind}s"] += record.number != previous
        previous = record.number
        if record.bypass:
            total["uncached"] += 1
            continue
        total["lines_touched"] += 1
        total["stores_to_memory"] += record.to_memory
        if not record.hit and record.number != missed:
            total[f"{kind}_misses"] += 1
            missed = record.number
    return total


def timeline(records: Iterable[Record]) -> dict[str, np.ndarray]:
    """The CPU's accesses and speculative fills as columns, one entry per record, named as the fields of `Access`.

    A victim of -1 means none; `op` and `bypass` are arrays of strings, the rest integers and booleans.
    """
    rows = [[getattr(r, name) for name in TIMELINE] for r in records if isinstance(r, Access)]
    columns = dict(zip(TIMELINE, map(list, zip(*rows)))) if rows else {name: [] for name in TIMELINE}
    columns["victim"] = [-1 if v is None else v for v in columns["victim"]]
    types = {"op": str, "bypass": str, **dict.fromkeys(("hit", "filled", "written_back", "to_memory"), bool)}
    return {name: np.array(values, dtype=types.get(name, np.int64)) for name, values in columns.items()}


def references_of(records: Iterable[Record]) -> References:
    """The CPU's cached accesses as references, one per line touched."""
    code = {"read": LOAD, "write": STORE, "modify": 3}
    rows = [(code[r.op], r.address, r.size) for r in records if isinstance(r, Access) and r.op in code and not r.bypass]
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return References(table[:, 0].astype(np.uint8), table[:, 1], table[:, 2])


@dataclass(frozen=True)
class MissClasses:
    """Misses by cause (Hill's three Cs). `conflict` may be negative; it is a difference, not a number of events.

    compulsory: first touches of a line. capacity: what a fully associative LRU cache of the same size misses beyond these.
    conflict: what the real cache misses beyond that. LRU is not the best policy: walking in circles over slightly more than fits,
    a fully associative LRU cache throws out every line just before it is needed, while sets or another policy keep some of
    them. The real cache then misses less than the yardstick, and the difference is below 0. It is reported, not clamped.
    """

    compulsory: int
    capacity: int
    conflict: int

    @property
    def total(self) -> int:
        return self.compulsory + self.capacity + self.conflict


def miss_classes(misses: int, references: References, geometry: Geometry) -> MissClasses:
    """Split `misses` lines missed by a cache of this geometry on these references (loads and stores both allocate) by cause."""
    full = count(references, Geometry(geometry.size, geometry.size // geometry.line, geometry.line))["fills"]
    shift = geometry.line.bit_length() - 1
    first, last = references.address >> shift, (references.address + references.size - 1) >> shift
    inner = [np.arange(a + 1, b) for a, b in zip(first.tolist(), last.tolist()) if b > a + 1]
    compulsory = len(np.unique(np.concatenate([first, last, *inner])))
    return MissClasses(compulsory, full - compulsory, misses - full)
