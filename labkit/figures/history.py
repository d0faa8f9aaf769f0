"""What a picture of a schedule is drawn from: runs, waits and jobs of a trace, folded once, and the busy share of any stretch."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from labkit.trace import Jobs, Trace, jobs, slices
from labkit.trace.folds import holds, ready, waits
from labkit.trace.jobs import owners

MAIN, BEYOND, EXCEPTION = 0, 1, 2  # kinds of a run: main part within its expected time, or beyond it; exception part


class History:
    """What a Gantt draws, read out of a trace once and only when it is needed. Keep one to draw many windows of a long trace.

    Intervals are int64 arrays with a row each, the owner's index in `Trace.names` first, start and end last.
    """

    def __init__(self, trace: Trace):
        self.trace = trace
        self._owner, _ = owners(trace)

    @cached_property
    def runs(self) -> np.ndarray:
        """Columns (task, MAIN, BEYOND or EXCEPTION, job, start, end), in order of time, without overlaps."""
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
    def busy(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Per task the starts and ends of its runs, and how long it had run before each of them and in all."""
        found = {}
        for task in np.unique(self.runs[:, 0]).tolist():
            start, end = self.runs[self.runs[:, 0] == task, -2:].T
            found[task] = start, end, np.append(0, np.cumsum(end - start))
        return found

    def share(self, task: int, edges: np.ndarray) -> np.ndarray:
        """How much of each interval between two edges the task ran, from 0 to 1."""
        start, end, before = self.busy.get(task, (np.empty(0), np.empty(0), np.zeros(1)))
        at = np.searchsorted(end, edges, side="right")
        inside = np.maximum(0, edges - np.append(start, np.inf)[at])
        return np.diff(before[at] + inside) / np.diff(edges)

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
    def jobs(self) -> Jobs:
        return jobs(self.trace)

    def _owned(self, intervals: np.ndarray) -> np.ndarray:
        return np.column_stack([self._owner[intervals[:, 0]], intervals[:, 1:]])
