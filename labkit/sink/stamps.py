"""Cycle stamps: a 32-bit counter that wraps, the ring that interrupts write them into, and what that loses.

Source 1, 4.2 and 4.3. A stamp is a name, the count, and whether something begins or ends. Context switches are stamped in the
kernel, where nothing may wait: into a ring of 512, printed later by the task `profile`. Scopes print theirs at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labkit.checks import whole

#: The processor of source 1 counts one per cycle.
CLOCK_HZ = 216_000_000
COUNTER_BITS = 32

#: Entries of the ring in source 1 (in the public code there are 32768).
RING_ENTRIES = 512


def wrap_seconds(hz: int = CLOCK_HZ, bits: int = COUNTER_BITS) -> float:
    """Time after which a counter comes around: 19.884 s for CYCCNT, 0.311 s if a stamp keeps 26 bits of it."""
    return (1 << bits) / hz


def wrap(cycles: ArrayLike, bits: int = COUNTER_BITS) -> np.ndarray:
    """What a counter of so many bits shows after these cycles (whole numbers of at least 0)."""
    return np.asarray(cycles, dtype=np.int64) & ((1 << _bits(bits)) - 1)


def unwrap(counts: ArrayLike, bits: int = COUNTER_BITS, ordered: bool = True) -> np.ndarray:
    """Cycles since the counter's zero before the first count: what `wrap` makes of them are the counts.

    Args:
        counts: shape (n,), as they arrive.
        bits: width of the counter.
        ordered: each count is later than the one before, by less than one wrap. If not, a count may lie up to half a wrap
            before or after the one that arrived before it: lines of context switches arrive after those of scopes.

    Errors: longer silence is not seen, and everything after it is too early by whole wraps: at least one stamp per wrap
    (half a wrap if not ordered) is needed. ValueError for counts that the counter cannot show.
    """
    period = 1 << _bits(bits)
    shown = np.asarray(counts, dtype=np.int64).ravel()
    if len(shown) == 0:
        return shown
    if shown.min() < 0 or shown.max() >= period:
        raise ValueError(f"a counter of {bits} bits shows 0 to {period - 1}, not {shown.min()} to {shown.max()}")
    back = 0 if ordered else period // 2
    steps = (np.diff(shown) + back) % period - back
    return shown[0] + np.concatenate([np.zeros(1, np.int64), np.cumsum(steps)])


def _bits(bits: int) -> int:
    return whole(bits, 1, "the width of the counter", 62)


class Stamp(NamedTuple):
    """What happened, the count of the counter then, and whether it begins or ends."""

    name: str
    cycle: int
    begin: bool


class StampRing:
    """The temporary buffer: who stamps takes the next index by fetch-and-add and never waits; who prints comes later.

    A writer that laps the reader overwrites the oldest stamps. Nobody sees that in the source's loop (`drain(counted=False)`):
    it prints the newest twice in the place of those that are gone. Here they are left out and counted in `lost`.

    Attributes:
        written: stamps so far; the index is this, modulo 2**32.
        lost: stamps overwritten before they were read, known when the reader comes.
    """

    def __init__(self, capacity: int = RING_ENTRIES) -> None:
        self.capacity = whole(capacity, 1, "the capacity of the ring of stamps")
        self._slots: list[Stamp | None] = [None] * capacity
        self.written = self.lost = self._read = 0

    def stamp(self, name: str, cycle: int, begin: bool) -> None:
        """From the kernel: `cycle` is shown as the counter shows it."""
        index, self.written = self.written, self.written + 1
        self._slots[index % self.capacity] = Stamp(name, cycle & ((1 << COUNTER_BITS) - 1), begin)

    def __len__(self) -> int:
        """Stamps that can still be read."""
        return min(self.written - self._read, self.capacity)

    def drain(self, counted: bool = True) -> list[Stamp]:
        """Everything since the last time, oldest first."""
        first = max(self._read, self.written - self.capacity)
        if counted:
            self.lost += first - self._read
        else:
            first = self._read
        indices, self._read = range(first, self.written), self.written
        return [stamp for index in indices if (stamp := self._slots[index % self.capacity]) is not None]
