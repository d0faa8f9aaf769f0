"""Tasks that stand in each other's way: how long one of them waits, and when one runs that should not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from labkit.figures import History, Panel, gantt, happening, priorities
from labkit.kernel import Run
from labkit.trace import Trace, holds, runs, waits
from labkit.trace import priorities as levels

KEYS = ("ready", "waits for lock, queue, signal", "release")


@dataclass(frozen=True)
class Contest:
    """One run of several tasks, seen from one of them. Times in ms.

    Attributes:
        run: the simulation. history: who ran when in it.
        task: the one looked at; it has one job.
        end: when that was done, in cycles.
        response: from its release to its end.
        blocked: the part of it in which it did not run. Of the highest task all of that is blocking.
        wrong: when a rule was broken, int64 of shape (n, 2) in cycles: stretches that the picture marks.
    """

    run: Run
    history: History
    task: str
    end: int
    response: float
    blocked: float
    wrong: np.ndarray

    @classmethod
    def of(cls, run: Run, task: str, release_ms: int, wrong: np.ndarray) -> Contest:
        """Read a run that goes on until everybody has ended."""
        trace = run.trace
        code, ms = trace.code(task), trace.hz // 1000
        end = next(time for time, _, who, *_ in trace.rows("done").tolist() if who == code)
        ran = sum(stop - start for who, start, stop in runs(trace).tolist() if who == code)
        response = end - release_ms * ms
        return cls(run, History(trace), task, end, response / ms, (response - ran) / ms, wrong)

    @property
    def wrong_ms(self) -> float:
        """How long a rule was broken."""
        return float((self.wrong[:, 1] - self.wrong[:, 0]).sum()) * 1e3 / self.run.trace.hz

    def panels(self, title: str, base: Mapping[str, int], locks: Sequence[str], end: float, words: str) -> tuple[Panel, Panel]:
        """Who ran, above the priorities; `words` stand where the task has ended."""
        bands = [(start, stop) for start, stop in self.wrong.tolist()]
        rows = gantt(
            self.history, tuple(base), 0, end, title=title, locks=locks, remarks=[(self.end, self.task, words)], bands=bands
        )
        return rows, priorities(self.run.trace, base, height=1.8)

    def doing(self, base: Mapping[str, int], at: float) -> str:
        """What the tasks do at a time in ms."""
        return happening(self.history, tuple(base), at)


def inversions(trace: Trace, base: Mapping[str, int]) -> np.ndarray:
    """When priorities are turned round: a task waits for a lock while one of a lower base priority runs that does not hold it.

    Args:
        trace: of the kernel.
        base: base priority of each task that counts.

    Returns:
        int64 of shape (n, 2): start and end of each stretch, in units of the trace.
    """
    level = np.full(len(trace.names), np.iinfo(np.int64).max)
    for name, priority in base.items():
        level[trace.code(name)] = priority
    ran, held, found = runs(trace), holds(trace), [np.empty((0, 2), np.int64)]
    for waiter, lock, start, end in waits(trace).tolist():
        owners = held[(held[:, 1] == lock) & (held[:, 2] < end) & (held[:, 3] > start), 0]
        if len(owners) and trace.names[waiter] in base:
            lower = (level[ran[:, 0]] < level[waiter]) & ~np.isin(ran[:, 0], owners)
            found.append(np.clip(ran[lower & (ran[:, 1] < end) & (ran[:, 2] > start), 1:], start, end))
    return np.concatenate(found)


def raised_for_nobody(trace: Trace, base: Mapping[str, int]) -> np.ndarray:
    """When a task runs above its base priority although nobody waits any more for what it holds: columns and units as above."""
    found, waited = [np.empty((0, 2), np.int64)], waits(trace)
    for task, start, end, level in levels(trace).tolist():
        if level > base.get(trace.names[task], level):
            last = max([start, *waited[(waited[:, 2] < end) & (waited[:, 3] > start), 3].tolist()])
            found.append(np.array([[last, end]])[: last < end])
    return np.concatenate(found)
