"""Where the kernel writes down what happens, event by event; it becomes the trace."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from struct import pack

import numpy as np

from labkit.trace import COLUMNS, Trace

WIDTH = len(COLUMNS)

#: Numbers after which the rows are packed; small enough to stay in the processor's cache.
PAGE = 1000 * WIDTH


class Journal:
    """Rows in order of time, written by `log((time, kind, task, other, value, extra))`, several in one call if they are known.

    They are kept one behind the other as plain integers and packed into bytes page by page: half the time and a fifth of the
    memory of a list of tuples. Pages become columns when a trace is read, and only those that are new since the last time.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self.rows: list[int] = []
        self.log = self.rows.extend
        self._pages: deque[bytes] = deque()
        self._columns = np.empty((WIDTH, 0), dtype=np.int64)
        self._length = self._packed = 0

    def pack(self) -> None:
        """Put the rows so far away; ValueError if they are more than `most`."""
        self._packed += len(self.rows) // WIDTH
        if self._packed > self.most:
            raise ValueError(f"the run makes more than {self.most} events, the most that are recorded")
        self._pages.append(pack(f"{len(self.rows)}q", *self.rows))
        self.rows.clear()

    def trace(self, names: Iterable[str], hz: int, end: int) -> Trace:
        """The trace of all rows that lie before `end`. Its columns are read-only: later traces share them."""
        self.pack()
        self._convert()
        length = int(np.searchsorted(self._columns[0, : self._length], end))
        columns = self._columns[:, :length]
        columns.flags.writeable = False
        time, kind, task, other, value, extra = columns
        return Trace(time, kind, task, other, value, extra, names=tuple(names), hz=hz, start=0, end=end)

    def _convert(self) -> None:
        """Move the pages into the columns, which are exactly long enough the first time and then at least double."""
        needed = self._length + sum(map(len, self._pages)) // (8 * WIDTH)
        if needed > self._columns.shape[1]:
            wider = np.empty((WIDTH, max(needed, 2 * self._length)), dtype=np.int64)
            wider[:, : self._length] = self._columns[:, : self._length]
            self._columns = wider
        while self._pages:
            page = np.frombuffer(self._pages.popleft(), dtype=np.int64).reshape(-1, WIDTH)
            self._columns[:, self._length : self._length + len(page)] = page.T
            self._length += len(page)
