"""A log folded once, so that every step of it can be shown without folding it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from labkit.cache.counting import fully_associative_misses
from labkit.cache.folds import MissClasses, timeline
from labkit.cache.geometry import Geometry
from labkit.cache.records import Access, Operation, Record


@dataclass(frozen=True, eq=False)
class History:
    """What a cache held, and what was counted, after each of n accesses; speculative fills count as accesses here.

    Attributes:
        geometry: of the cache.
        columns: the accesses, each column of shape (n,), as `timeline` makes them.
        totals: name -> int array of shape (n + 1,): how many after each step. `accesses` that did not bypass the cache, `misses`
            of them, `fills`, `write_backs` of victims, `compulsory` first touches, and `full`, the misses of a fully
            associative LRU cache of the same size.
        changes: int array of shape (m, 4), sorted by cell and then by time: cell (way * sets + set), step after which it
            changed, the line it then held (-1: none), and whether that was dirty.
    """

    geometry: Geometry
    columns: Mapping[str, np.ndarray]
    totals: Mapping[str, np.ndarray]
    changes: np.ndarray

    def __len__(self) -> int:
        return len(self.columns["line"])

    def contents(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """After `step` accesses and the operations before the next one: line address (-1: empty), int array, and whether it is
        dirty, bool array, both of shape (ways, sets). Found by bisection, cell by cell."""
        shape = (self.geometry.ways, self.geometry.sets)
        cells, span = np.arange(shape[0] * shape[1]), len(self) + 1
        latest = np.searchsorted(self.changes[:, 0] * span + self.changes[:, 1], cells * span + step, side="right") - 1
        known = latest >= 0
        known[known] = self.changes[latest[known], 0] == cells[known]
        line, dirty = np.full(len(cells), -1), np.zeros(len(cells), dtype=bool)
        line[known], dirty[known] = self.changes[latest[known], 2], self.changes[latest[known], 3]
        return line.reshape(shape), dirty.reshape(shape)

    def miss_classes(self, step: int) -> MissClasses:
        """The lines fetched in the first `step` accesses, by cause."""
        fills, compulsory, full = (int(self.totals[name][step]) for name in ("fills", "compulsory", "full"))
        return MissClasses(compulsory, full - compulsory, fills - full)


def history(log: Sequence[Record], geometry: Geometry) -> History:
    """Fold the log of a cache of this geometry. Lines that were held before its first record are not known until accessed."""
    columns = timeline(log)
    cached = (columns["bypass"] == "") & (columns["op"] != "speculate")
    line = columns["line"][cached]
    first, full = np.zeros(len(cached), dtype=bool), np.zeros(len(cached), dtype=bool)
    first[np.flatnonzero(cached)[np.unique(line, return_index=True)[1]]] = True
    full[cached] = fully_associative_misses(line, geometry.size // geometry.line)
    happened = {
        "accesses": cached,
        "misses": cached & ~columns["hit"],
        "fills": columns["filled"],
        "write_backs": columns["written_back"],
        "compulsory": first,
        "full": full,
    }
    totals = {name: np.concatenate([[0], np.cumsum(column)]) for name, column in happened.items()}
    return History(geometry, columns, totals, _changes(log, geometry))


def _changes(log: Sequence[Record], geometry: Geometry) -> np.ndarray:
    """The attribute `changes` of a history."""
    rows: list[tuple[int, int, int, bool]] = []
    held: dict[int, tuple[int, bool]] = {}  # line -> its cell, and whether it is dirty
    step = 0
    for record in log:
        if isinstance(record, Access):
            step += 1
            if record.victim is not None:
                held.pop(record.victim, None)
            if record.way >= 0:
                dirty = held.get(record.line, (-1, False))[1] or (record.stores and not record.to_memory)
                held[record.line] = cell, _ = record.way * geometry.sets + record.set, dirty
                rows.append((cell, step, record.line, dirty))
        elif isinstance(record, Operation):
            for line in held.keys() & record.written_back:
                held[line] = cell, _ = held[line][0], False
                rows.append((cell, step, line, False))
            for line in held.keys() & record.dropped:
                cell, _ = held.pop(line)
                rows.append((cell, step, -1, False))
    table = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return table[np.lexsort((np.arange(len(table)), table[:, 1], table[:, 0]))]
