"""What recordings of context switches have in common: who has which core, and jobs that begin and end.

The reader of a format says, in order of time, which task gets and loses a core and which of its jobs begins and ends; here that
becomes the rows of a trace, and what does not fit together is found. No time is ever counted for a task that is not known to have
had the core: where events are missing, the core counts for nobody.
"""

from __future__ import annotations

from array import array
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from labkit.trace.kinds import CODE, STATES
from labkit.trace.readers.report import Problems
from labkit.trace.trace import COLUMNS, Trace

READY, BLOCKED, SUSPENDED, DELETED, _RUNNING = map(STATES.index, ("ready", "blocked", "suspended", "deleted", "running"))
NOBODY = -1  # has the core
UNKNOWN = -1  # core of an event that happens on none

_SWITCH, _READY, _RELEASE, _COMPLETE = (CODE[kind] for kind in ("switch", "ready", "release", "complete"))
_WIDTH = len(COLUMNS) + 1
_TASK, _CORE = COLUMNS.index("task"), len(COLUMNS)


@dataclass
class _Core:
    """A core while it is read: since when it is seen, who has it (None: not known yet) and the row that says so (-1: none)."""

    since: int
    task: int | None = None
    row: int = -1
    lost: bool = False  # events are missing since that row
    beneath: list[int] = field(default_factory=list)  # interrupted without a word of them


class Switches:
    """Collects the rows of a trace; times are integers in its unit, tasks are indices into its names, -1 is nobody."""

    def __init__(self, problems: Problems) -> None:
        self._problems = problems
        self._cores: dict[int, _Core] = {}
        self._rows = array("q")
        self._open: dict[int, deque[tuple[int, int]]] = {}  # task -> number and row of each job released and not complete
        self._next: dict[int, int] = {}
        self._moved = 0

    def seen(self, time: int, core: int) -> None:
        """Something was recorded on this core: it is observed from here on, if it was not before."""
        if core not in self._cores:
            self._cores[core] = _Core(time)

    def lost(self, core: int) -> None:
        """Events of this core are missing between here and its next switch."""
        if core in self._cores:
            self._cores[core].lost = True

    def running(self, core: int) -> int | None:
        """Who has the core; None if that is not known yet."""
        return self._cores[core].task if core in self._cores else None

    def switch(self, line: int, time: int, core: int, before: int, state: int, after: int, priority: int = 0) -> None:
        """A core goes from a task, then in one of STATES, to another."""
        here = self._cores[core]
        self._had(line, here, core, before)
        here.row = self._row(time, _SWITCH, after, before, priority, state, core)
        here.task, here.lost = after, False

    def enter(self, line: int, time: int, core: int, task: int, interrupts: bool = False) -> None:
        """A task gets a core; if it interrupts whoever has it, that one gets it back when the task leaves."""
        here = self._cores[core]
        before = NOBODY if here.task is None else here.task
        if before not in (NOBODY, task) and interrupts:
            self._problems.repaired(line, "an interrupt gets a core that a task has", "the task is taken as preempted by it")
            here.beneath.append(before)
        elif before != NOBODY:
            self._problems.repaired(
                line, "a task gets a core that one has already", "the time since the last switch counts for nobody"
            )
            self._forget(here)
            here.beneath.clear()
        here.row = self._row(time, _SWITCH, task, before, 0, READY, core)
        here.task, here.lost = task, False

    def leave(self, line: int, time: int, core: int, task: int, state: int) -> None:
        """A task loses a core, which nobody has then but a task that it interrupted."""
        here = self._cores[core]
        if task in here.beneath:
            here.beneath.remove(task)
            return
        self.switch(line, time, core, task, state, here.beneath.pop() if here.beneath else NOBODY)

    def ready(self, time: int, core: int, task: int) -> None:
        """A task that waited may go on."""
        self._row(time, _READY, task, -1, 0, 0, core)

    def release(self, time: int, core: int, task: int) -> None:
        """A job of the task is released; jobs are numbered and served in this order."""
        number = self._next.get(task, 0)
        self._next[task] = number + 1
        row = self._row(time, _RELEASE, task, -1, time, number, core)
        self._open.setdefault(task, deque()).append((number, row))

    def complete(self, time: int, core: int, task: int) -> None:
        """The oldest job of the task is complete; one whose release was not recorded gets a number all the same."""
        if jobs := self._open.get(task):
            number, row = jobs.popleft()
            place = row * _WIDTH + _CORE
            self._moved += self._rows[place] not in (core, UNKNOWN)
            self._rows[place] = core  # a trace knows a job on one core only: that of its end
        else:
            number = self._next.get(task, 0)
            self._next[task] = number + 1
        self._row(time, _COMPLETE, task, -1, -1, number, core)

    def trace(self, names: list[str], hz: int, start: int, end: int) -> tuple[Trace, list[str]]:
        """What was collected, and notes on it for the report."""
        for here in self._cores.values():
            if here.lost:
                self._forget(here)
        rows = np.frombuffer(self._rows, np.int64).reshape(-1, _WIDTH).copy()
        rows[rows[:, _CORE] == UNKNOWN, _CORE] = min(self._cores, default=0)
        columns = np.ascontiguousarray(rows[np.argsort(rows[:, 0], kind="stable")].T)
        core = columns[_CORE] if len(self._cores) > 1 else None
        notes = [f"{self._moved} jobs moved to another core; each counts on the core of its end"] if self._moved else []
        return Trace.from_columns(columns[:_CORE], names, hz, start=start, end=end, core=core), notes

    def _had(self, line: int, here: _Core, core: int, task: int) -> None:
        """The task had the core until now, says the recording. Is that what is known?"""
        if here.task is None:
            self._row(here.since, _SWITCH, task, task, 0, _RUNNING, core)  # from itself: it began before
        elif here.task != task or here.lost:
            why = "events before it are lost" if here.lost else "another had it"
            self._problems.repaired(line, f"a task loses a core, but {why}", "the time since the last switch counts for nobody")
            self._forget(here)
            here.beneath.clear()

    def _forget(self, here: _Core) -> None:
        if here.row >= 0:
            self._rows[here.row * _WIDTH + _TASK] = NOBODY

    def _row(self, *row: int) -> int:
        self._rows.extend(row)
        return len(self._rows) // _WIDTH - 1


def in_order(events: array[int], width: int) -> tuple[np.ndarray, np.ndarray]:
    """Events of `width` integers each, the line and the time first, in order of time; and the lines that were not."""
    table = np.frombuffer(events, np.int64).reshape(-1, width)
    late = np.maximum.accumulate(table[:, 1]) > table[:, 1] if len(table) else np.zeros(0, bool)
    return table[np.argsort(table[:, 1], kind="stable")], table[late, 0]
