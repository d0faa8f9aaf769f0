"""The trace: what happened, as columns. Every picture, statistic, check and export reads this type."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from labkit.trace.kinds import CODE, KINDS, STATES

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("time", "kind", "task", "other", "value", "extra")


def printable(name: str) -> str:
    """A name for a line of output: as it is, or with escapes for control characters, which would break the line."""
    return name if name.isprintable() else repr(name)[1:-1]


@dataclass(frozen=True, eq=False)
class Trace:
    """Events in the order in which they happened, observed from `start` to `end`.

    Attributes:
        time, kind, task, other, value, extra: int64 arrays of shape (n,); `labkit.trace.kinds` says what each kind
            puts into them. `time` never decreases.
        names: tasks, locks, queues and scopes; `task` and `other` index it, -1 means none.
        hz: time units per second, so 216_000_000 for CPU cycles, 1_000_000 for microseconds.
        start, end: the observed interval, in time units; a run or span still open at `end` is cut there.
        exception_of: per name the index of the task whose exception part it is, or -1; empty if there is no such part.
        core: number of the core of each event, int64 of shape (n,); None if there is only one. See `cores`.
        closed: whether what happens at `end` itself is in it, as in a schedule, or not, as in a kernel that was stopped there.
    """

    time: np.ndarray
    kind: np.ndarray
    task: np.ndarray
    other: np.ndarray
    value: np.ndarray
    extra: np.ndarray
    names: tuple[str, ...]
    hz: int
    start: int
    end: int
    exception_of: tuple[int, ...] = ()
    core: np.ndarray | None = None
    closed: bool = False

    @property
    def last(self) -> int:
        """The last instant of which everything is known: a deadline up to it is met or missed."""
        return self.end if self.closed else self.end - 1

    @classmethod
    def from_rows(
        cls,
        rows: Sequence[tuple[int, ...]],
        names: Iterable[str],
        hz: int,
        *,
        end: int,
        start: int = 0,
        exception_of: Iterable[int] = (),
        closed: bool = False,
    ) -> Trace:
        """Build a trace from tuples in the order of `COLUMNS`, already in order of time."""
        table = np.array(rows, dtype=np.int64).reshape(-1, len(COLUMNS))
        columns = np.ascontiguousarray(table.T)
        return cls.from_columns(columns, names, hz, end=end, start=start, exception_of=exception_of, closed=closed)

    @classmethod
    def from_columns(
        cls,
        columns: np.ndarray,
        names: Iterable[str],
        hz: int,
        *,
        end: int,
        start: int = 0,
        exception_of: Iterable[int] = (),
        core: np.ndarray | None = None,
        closed: bool = False,
    ) -> Trace:
        """Build a trace from an int64 array of shape (6, n), its rows in the order of `COLUMNS`, already in order of time.

        Raises:
            ValueError: an event is earlier than the one before it.
        """
        time, kind, task, other, value, extra = columns
        back = time[1:] < time[:-1]
        if back.any():
            at = int(np.argmax(back)) + 1
            raise ValueError(f"event {at} at time {time[at]} comes after one at {time[at - 1]}; a trace is in order of time")
        return cls(time, kind, task, other, value, extra, tuple(names), hz, start, end, tuple(exception_of), core, closed)

    def __len__(self) -> int:
        return len(self.time)

    def rows(self, *kinds: str) -> np.ndarray:
        """The events of these kinds (all of them if none is named) as an int64 array of shape (m, 6)."""
        some = np.flatnonzero(self.of(*kinds)) if kinds else slice(None)
        return np.stack([getattr(self, name)[some] for name in COLUMNS], axis=1)

    def take(self, rows: np.ndarray) -> Trace:
        """The trace of some of the events only: their positions in order, or a bool for each."""
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        return replace(self, **columns, core=None if self.core is None else self.core[rows])

    def cores(self) -> dict[int, Trace]:
        """Core number -> what happened there, as a trace of one core. With a single core that is {0: this trace}.

        Spans, runs and slices are found core by core, since what runs at once on two of them is not nested.
        """
        if self.core is None:
            return {0: self}
        return {int(core): replace(self.take(self.core == core), core=None) for core in np.unique(self.core)}

    def of(self, *kinds: str) -> np.ndarray:
        """Which events are of these kinds, as a bool array of shape (n,)."""
        wanted = np.zeros(len(KINDS), bool)
        wanted[[CODE[kind] for kind in kinds]] = True
        return wanted[self.kind]

    def code(self, name: str) -> int:
        """Index of a task, lock, queue or scope in `names`; ValueError lists the names there are."""
        try:
            return self.names.index(name)
        except ValueError:
            raise ValueError(f"no {name!r} in this trace; it has {', '.join(map(printable, self.names))}") from None

    def frame(self, *kinds: str) -> pd.DataFrame:
        """The events as a pandas frame, names in place of codes and None for -1; `time` stays in time units."""
        import pandas as pd

        table = self.rows(*kinds)
        names = np.array([*self.names, None], dtype=object)  # index -1 is the None
        frame = pd.DataFrame(table, columns=list(COLUMNS))
        if self.core is not None:
            frame["core"] = self.core[self.of(*kinds)] if kinds else self.core
        frame["kind"] = np.array(KINDS, dtype=object)[table[:, 1]]
        for column in ("task", "other"):  # as object: pandas would turn None into NaN in one column and not in another
            frame[column] = pd.Series(names[frame[column]], dtype=object)
        return frame

    def seconds(self, time: np.ndarray | int) -> np.ndarray | float:
        """Time units since the start of the recording, as seconds (for axes and reports, never for computing)."""
        return (time - self.start) / self.hz

    def window(self, start: int, end: int) -> Trace:
        """The part from `start` (included) to `end`: of what happens at `end` only the ends of jobs are in it, unless the
        recording itself ends there.

        Who runs at `start`, and what is left of a kernel overhead then, are kept as rows at `start`; such a switch is from the
        task to itself.
        """
        if not self.start <= start <= end <= self.end:
            raise ValueError(f"window {start}..{end} is not inside the recording {self.start}..{self.end}")
        closed = self.closed or end < self.end
        ending = (self.time == end) & (self.of("complete", "abort") | (end == self.end))
        inside = (self.time >= start) & (self.time < end) | ending
        if start == self.start or start == end:
            return replace(self.take(inside), start=start, end=end, closed=closed)
        early = self.time < start
        running = [rows[-1] for rows in self._by_core(early & self.of("switch"))]
        costs = np.flatnonzero(early & self.of("overhead") & (self.time + self.value > start))
        made = self.take(np.concatenate([np.array(running, dtype=np.int64), costs, np.flatnonzero(inside)]))
        first, last = len(running), len(running) + len(costs)
        made.other[:first], made.extra[:first] = made.task[:first], STATES.index("running")
        made.value[first:last] -= start - made.time[first:last]
        made.time[:last] = start
        return replace(made, start=start, end=end, closed=closed)

    def _by_core(self, wanted: np.ndarray) -> list[np.ndarray]:
        """Positions of the events wanted, core by core; cores without any are left out."""
        rows = np.flatnonzero(wanted)
        if self.core is None:
            return [rows] if len(rows) else []
        return [rows[self.core[rows] == core] for core in np.unique(self.core[rows])]
