"""Pictures of any number of slices: prepared once, then any window of them in about a millisecond.

A picture shows the slices of a window as they are while these are few, and above that the share of every pixel column in which
each row was busy. Nothing gets lost on the way, as it does where only some of the slices are drawn: a column says exactly how
much of it is filled. The busy time up to an instant is a search in the cumulated lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Slices by row, then by start; made by `occupancy`.

    Attributes:
        start, end: int64 arrays of shape (n,).
        busy: shape (n + 1,), the lengths of all slices before this one together.
        first: shape (rows + 1,), where each row begins.
        order: shape (n,), the place of each slice among those given.
    """

    start: np.ndarray
    end: np.ndarray
    busy: np.ndarray
    first: np.ndarray
    order: np.ndarray

    @property
    def rows(self) -> int:
        return len(self.first) - 1

    def count(self, start: float, end: float) -> int:
        """How many slices have a part in the window from `start` to `end`."""
        return sum(high - low for low, high in self._window(start, end))

    def inside(self, start: float, end: float) -> np.ndarray:
        """Which of the slices given have a part in the window: their places, by row, then by start."""
        return np.concatenate([self.order[low:high] for low, high in self._window(start, end)] or [self.order[:0]])

    def shares(self, edges: np.ndarray) -> np.ndarray:
        """How much of each column every row was busy, 0 to 1, shape (rows, columns).

        Args:
            edges: rising, shape (columns + 1,), in the unit of the slices; column i is from edges[i] to edges[i + 1].
        """
        edges = np.asarray(edges)
        whole = np.floor(edges).astype(np.int64)  # to search integers for floats would copy them all
        busy = np.zeros((self.rows, len(edges)), np.result_type(edges, np.int64))
        for row, (low, high) in enumerate(zip(self.first[:-1].tolist(), self.first[1:].tolist(), strict=True)):
            at = low + np.searchsorted(self.end[low:high], whole, side="right")
            busy[row] = self.busy[at]
            on = at < high  # those that end after the edge may have begun before it
            busy[row, on] += np.maximum(edges[on] - self.start[at[on]], 0)
        return np.diff(busy, axis=1) / np.diff(edges)

    def _window(self, start: float, end: float) -> list[tuple[int, int]]:
        """First and last place, per row, of the slices with a part in the window."""
        made, from_, to = [], floor(start), ceil(end)
        for low, high in zip(self.first[:-1].tolist(), self.first[1:].tolist(), strict=True):
            begin = low + int(np.searchsorted(self.end[low:high], from_, side="right"))
            made.append((begin, max(begin, low + int(np.searchsorted(self.start[low:high], to, side="left")))))
        return made


def occupancy(row: np.ndarray, start: np.ndarray, end: np.ndarray, rows: int) -> Occupancy:
    """Prepare slices for pictures, as those of `labkit.trace.slices` or any intervals that do not overlap within their row.

    Args:
        row, start, end: int64 arrays of shape (n,), in any order; those of negative rows are left out.
        rows: how many rows there are.

    Raises:
        ValueError: a row that is not there, a slice that ends before it begins, or two in one row at the same time.
    """
    if len(row) and row.max() >= rows:
        raise ValueError(f"a slice in row {row.max()}; there are {rows} rows, counted from 0")
    order = np.lexsort((end, start, row))
    order = order[row[order] >= 0]
    row, start, end = row[order], start[order], end[order]
    if np.any(end < start):
        at = int(np.argmax(end < start))
        raise ValueError(f"a slice from {start[at]} to {end[at]}; a slice ends at its start or later")
    overlap = (row[1:] == row[:-1]) & (start[1:] < end[:-1])
    if overlap.any():
        at = int(np.argmax(overlap))
        raise ValueError(
            f"row {row[at]} has a slice to {end[at]} and another from {start[at + 1]}; slices of a row do not overlap"
        )
    first = np.searchsorted(row, np.arange(rows + 1))
    return Occupancy(start, end, np.append(0, np.cumsum(end - start)), first, order)
