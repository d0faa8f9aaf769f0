"""Dynamic read-allocate: how the Cortex-M7 notices a block of stores and stops allocating for it (DDI0489 5.9.1)."""

from __future__ import annotations

import numpy as np

FULL_LINES = 3  # lines written in full before stores stop allocating


class StoreRun:
    """The current run of stores to consecutive addresses.

    The hardware compares stores with line fills under way; this model, which has no time, calls a line written in full when one
    run of consecutive stores covers it. A store elsewhere ends the run, and so does a load from the line being written.
    """

    def __init__(self, line: int) -> None:
        self._line = line
        self._start = self._end = -1

    def load(self, address: int, size: int) -> None:
        writing = (self._end - 1) // self._line
        if self._end >= 0 and address // self._line <= writing <= (address + size - 1) // self._line:
            self._end = -1

    def store(self, address: int, size: int) -> bool:
        """Take note of a store; True if it must not allocate."""
        if address != self._end:
            self._start = self._end = address
        full = self._end // self._line + -self._start // self._line  # floor of the end minus ceiling of the start
        self._end += size
        return full >= FULL_LINES


def streaming_stores(loads: np.ndarray, stores: np.ndarray, address: np.ndarray, size: np.ndarray, line: int) -> np.ndarray:
    """The same rule over whole columns: a bool array, True where a store must not allocate.

    `loads` and `stores` are bool arrays (a modify is both, its load first), `address` and `size` int64, all of shape (n,).
    """
    result = np.zeros(len(address), dtype=bool)
    where = np.flatnonzero(stores)
    if not len(where):
        return result
    position = np.arange(len(address))
    before = np.maximum.accumulate(np.where(stores, position, -1))
    before = np.concatenate([[-1], before[:-1]])  # the latest store before each access
    writing = (address[before] + size[before] - 1) // line
    ends = loads & (before >= 0) & (address // line <= writing) & (writing <= (address + size - 1) // line)
    ended = np.cumsum(ends)[where]  # a modify's load comes before its own store

    start, end = address[where], address[where] + size[where]
    follows = np.zeros(len(where), dtype=bool)
    follows[1:] = (start[1:] == end[:-1]) & (ended[1:] == ended[:-1])
    run_start = start[~follows][np.cumsum(~follows) - 1]
    result[where] = follows & (start // line + -run_start // line >= FULL_LINES)
    return result
