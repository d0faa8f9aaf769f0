"""What a picture of a schedule is drawn from: runs, waits and jobs of a trace, folded once, and the busy share of any stretch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from labkit.trace import Occupancy, Trace, holds, occupancy, owners, ready, runs, slices, spans, waits

MAIN, BEYOND, EXCEPTION = 0, 1, 2  # kinds of a run: main part within its expected time, or beyond it; exception part


class History:
    """What a Gantt draws, read out of a trace once and only when it is needed. Keep one to draw many windows of a long trace.

    Intervals are int64 arrays with a row each: the owner's index in `Trace.names` first, start and end last. Events have the
    columns (task, job, time). `occupancy` and the events are a few passes over the columns of the trace; for the other
    intervals of a window, ask them of its `part`.

    A log of a board knows begins and ends and no switches: there a run is what lies between a begin and its end.
    """

    def __init__(self, trace: Trace, log: bool | None = None):
        self.trace = trace
        self._owner, _ = owners(trace)
        self._log = not trace.of("switch").any() and bool(trace.of("begin", "end").any()) if log is None else log

    @cached_property
    def occupancy(self) -> Occupancy:
        """When each name ran, a row per name of the trace."""
        name, start, end = self._spans.T if self._log else runs(self.trace).T
        return occupancy(name, start, end, len(self.trace.names))

    def shares(self, edges: np.ndarray) -> np.ndarray:
        """How much of each stretch between two edges each task ran, exception parts included, shape (names, stretches)."""
        found = self.occupancy.shares(edges)
        made = np.zeros_like(found)
        np.add.at(made, self._owner, found)
        return made

    def part(self, tasks: Iterable[int], low: int, high: int) -> History:
        """The stretch from which `runs`, `ready` and `waits` of these tasks are those of the whole trace between low and high.

        Each of them, its main part, has begun to run once more between the beginning of the part and `low`; whatever it is at
        `low`, ready, waiting or due to run its exception part, it became after that.
        """
        found, begin = self.occupancy, low
        for task in tasks:
            first, last = found.first[task : task + 2]
            at = first + int(np.searchsorted(found.start[first:last], low, side="right")) - 1
            begin = min(begin, int(found.start[at]) if at >= first else self.trace.start)
        if not self._log:  # who runs on after a tick or an interrupt was switched in before that
            at = int(np.searchsorted(self._switched, begin, side="right")) - 1
            begin = int(self._switched[at]) if at >= 0 else self.trace.start
        rows = np.arange(*np.searchsorted(self.trace.time, (begin, high + 1)))
        end = min(high, self.trace.end)
        return History(
            replace(self.trace.take(rows), start=begin, end=end, closed=self.trace.closed or end < self.trace.end), self._log
        )

    @cached_property
    def _switched(self) -> np.ndarray:
        """When the processor changed hands."""
        return self.trace.time[self.trace.of("switch")]

    @cached_property
    def runs(self) -> np.ndarray:
        """Columns (task, MAIN, BEYOND or EXCEPTION, job, start, end), in order of time, without overlaps."""
        if self._log:
            name, start, end = self._spans.T
            return np.stack([name, np.full_like(name, MAIN), np.full_like(name, -1), start, end], axis=1)
        ran = slices(self.trace)
        if not self.trace.exception_of:
            return ran.rows()
        switch = self.trace.rows("switch")
        edges = np.unique(np.concatenate([ran.start, ran.end, switch[:, 0]]))
        left, right = edges[:-1], edges[1:]
        at = np.searchsorted(ran.start, left, side="right") - 1
        some = (at >= 0) & (left < np.append(ran.end, 0)[at])
        left, right, at = left[some], right[some], at[some]
        level = switch[np.searchsorted(switch[:, 0], left, side="right") - 1, 4]
        kind = np.where(ran.part[at] > 0, EXCEPTION, np.where(level > 0, MAIN, BEYOND))
        new = np.append(True, (at[1:] != at[:-1]) | (kind[1:] != kind[:-1]))[: len(at)]
        end = right[np.append(new[1:], True)[: len(at)]]
        return np.stack([ran.task[at[new]], kind[new], ran.job[at[new]], left[new], end], axis=1)

    @cached_property
    def _spans(self) -> np.ndarray:
        """Columns (name, start, end): from each begin to its end, in order of start."""
        code = {name: i for i, name in enumerate(self.trace.names)}
        table = spans(self.trace).assign(name=lambda found: found["name"].map(code))
        return table.loc[table["duration"] > 0, ["name", "start", "end"]].to_numpy(np.int64)

    @cached_property
    def ready(self) -> np.ndarray:
        """Columns (task, start, end)."""
        return self._owned(ready(self.trace))

    @cached_property
    def waits(self) -> np.ndarray:
        """Columns (task, object, start, end)."""
        return self._owned(waits(self.trace))

    @cached_property
    def holds(self) -> np.ndarray:
        """Columns (task, lock, start, end)."""
        return self._owned(holds(self.trace))

    @cached_property
    def releases(self) -> np.ndarray:
        """Nominal releases."""
        return self._events("release", self.trace.value)

    @cached_property
    def deadlines(self) -> np.ndarray:
        """Absolute deadlines."""
        return self._events("deadline", self.trace.value)

    @cached_property
    def aborts(self) -> np.ndarray:
        """When main parts were aborted."""
        return self._events("abort", self.trace.time)

    @cached_property
    def misses(self) -> np.ndarray:
        """Deadlines missed, those of `labkit.trace.jobs(trace).missed` by less work: all rows are not sorted by job for it."""
        end, tasks = self.trace.last, len(self.trace.names)
        done, when = self._events("complete", self.trace.value), self._events("complete", self.trace.time)[:, 2]
        due = self.deadlines[self.deadlines[:, 2] <= end]
        known = (done[:, 2] >= 0) & (done[:, 2] <= end)
        done, when = done[known], when[known]
        behind = np.bincount(due[:, 0], minlength=tasks) > np.bincount(done[:, 0], minlength=tasks)  # a job of theirs never ended
        due, ended = due[behind[due[:, 0]]], done[behind[done[:, 0]]]
        most = int(self.trace.extra.max(initial=0)) + 1
        never = due[~np.isin(due[:, 0] * most + due[:, 1], ended[:, 0] * most + ended[:, 1])]
        return np.concatenate([done[when > done[:, 2]], never])

    def _events(self, kind: str, time: np.ndarray) -> np.ndarray:
        at = np.flatnonzero(self.trace.of(kind) & (self.trace.task >= 0))
        return np.stack([self._owner[self.trace.task[at]], self.trace.extra[at], time[at]], axis=1)

    def _owned(self, table: np.ndarray) -> np.ndarray:
        """The same with the task in place of its exception part; rows of no task are left out."""
        some = table[table[:, 0] >= 0]
        return np.column_stack([self._owner[some[:, 0]], some[:, 1:]])
