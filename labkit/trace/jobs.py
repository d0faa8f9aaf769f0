"""Slices and jobs: what a schedule did, read out of the trace of any scheduler of the lab.

They need `switch`, `release`, `complete` and `abort` rows, as the kernel, the periodic and the TAFT schedulers write them, and
take `deadline` rows where there are some. Jobs of a task are numbered and served in order of release, so a slice belongs to the
job that ends next, or else to the oldest open one, though not before its nominal release. A job that never ends although a later
one of its task does was given up when the next was released.

A window of a trace does not tell everything: a job released before it has no release here, and a slice whose job begins before
the window and ends after it belongs to job -1.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.trace.kinds import CODE
from labkit.trace.trace import Trace

if TYPE_CHECKING:
    import pandas as pd

MAIN, EXCEPTION = 0, 1

#: Names of the parts of a job, by `Slices.part`.
PARTS = ("mp", "ep")


@dataclass(frozen=True, eq=False)
class Slices:
    """Who had the processor, in order of start; int64 arrays of shape (n,). Contiguous slices of one part of one job are one.

    Attributes:
        task: index into `names`; of a slice of an exception part the task it belongs to. The kernel's idle task counts as one.
        part: MAIN or EXCEPTION.
        job: number of the job; -1: none is open, or the trace does not tell which.
        start, end: in time units of the trace. What the kernel takes for itself is in no slice.
        names: those of the trace.
    """

    task: np.ndarray
    part: np.ndarray
    job: np.ndarray
    start: np.ndarray
    end: np.ndarray
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.task)

    def rows(self) -> np.ndarray:
        """The slices as an int64 array of shape (n, 5): task, part, job, start, end."""
        return np.stack([self.task, self.part, self.job, self.start, self.end], axis=1)

    def frame(self) -> pd.DataFrame:
        """The slices as a pandas frame, with the names of tasks and parts and <NA> for no job."""
        import pandas as pd

        return pd.DataFrame(
            {
                "task": np.array(self.names, dtype=object)[self.task],
                "part": np.array(PARTS, dtype=object)[self.part],
                "job": pd.arrays.IntegerArray(self.job, self.job < 0),
                "start": self.start,
                "end": self.end,
            }
        )


@dataclass(frozen=True, eq=False)
class Jobs:
    """One row per job, by task and number; int64 arrays of shape (n,), -1 for what did not happen or is not in the trace.

    Attributes:
        task: index into `names`; job: its number.
        release: nominal release; deadline: absolute deadline; start: when the job first ran.
        completion: of the main part or, after an abort, of the exception part; abort: when the main part was aborted.
        response: completion - release; tardiness: how much later than the deadline it was complete, at least 0.
        missed: bool; the deadline is known, not after `Trace.last`, and the job was not complete by then.
        main, exception: processor time granted to either part.
        names: those of the trace.
    """

    task: np.ndarray
    job: np.ndarray
    release: np.ndarray
    deadline: np.ndarray
    start: np.ndarray
    completion: np.ndarray
    abort: np.ndarray
    response: np.ndarray
    tardiness: np.ndarray
    missed: np.ndarray
    main: np.ndarray
    exception: np.ndarray
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.task)

    def frame(self) -> pd.DataFrame:
        """The jobs as a pandas frame, with the names of tasks and <NA> for -1."""
        import pandas as pd

        times = ("release", "deadline", "start", "completion", "abort", "response", "tardiness")
        return pd.DataFrame(
            {
                "task": np.array(self.names, dtype=object)[self.task],
                "job": self.job,
                **{name: pd.arrays.IntegerArray(getattr(self, name), getattr(self, name) < 0) for name in times},
                "missed": self.missed,
                "main": self.main,
                "exception": self.exception,
            }
        )


def slices(trace: Trace) -> Slices:
    """When each part of each job ran, see `Slices`."""
    names, row = _segments(trace)
    start, end = trace.time[row], np.append(trace.time[row[1:]], trace.end)[: len(row)]
    ran = (names >= 0) & (end > start)
    names, row, start, end = names[ran], row[ran], start[ran], end[ran]
    owner, exception = owners(trace)
    task, part = owner[names], exception[names].astype(np.int64)
    numbers = _numbers(trace.extra[_rows(trace, "release", "complete", "abort")])
    job = np.full(len(task), -1)
    if len(numbers):  # a log of switches knows no jobs
        rank = _main_jobs(trace, numbers, task, row)
        if exception.any():
            rank = np.where(part == MAIN, rank, _exception_jobs(trace, numbers, names, task, row))
        job = np.append(numbers, -1)[rank]
    costs = (trace.kind == CODE["overhead"]) & (trace.value > 0)
    if costs.any():
        begin = trace.time[costs]
        kept, start, end = outside(start, end, begin, begin + trace.value[costs])
        task, part, job = task[kept], part[kept], job[kept]
    new = np.ones(len(task), bool)
    new[1:] = (task[1:] != task[:-1]) | (part[1:] != part[:-1]) | (job[1:] != job[:-1]) | (start[1:] != end[:-1])
    last = np.append(new[1:], True)[: len(new)]
    return Slices(task[new], part[new], job[new], start[new], end[last], trace.names)


def jobs(trace: Trace) -> Jobs:
    """What became of each job that is released or ends in the trace, see `Jobs`.

    A job that is due at the very end counts as missed only if the trace is closed, so that its end there would be in it.
    """
    owner, _ = owners(trace)
    rows = {kind: _rows(trace, kind) for kind in ("release", "deadline", "complete", "abort")}
    told = np.concatenate(list(rows.values()))
    if not len(told):  # a log knows no jobs
        columns: dict[str, Any] = dict.fromkeys((field.name for field in fields(Jobs)), np.empty(0, np.int64))
        return Jobs(**columns | {"missed": np.empty(0, bool), "names": trace.names})
    numbers = _numbers(trace.extra[told])
    span = len(numbers) + 1
    keys, place = np.unique(owner[trace.task[told]] * span + _rank(numbers, trace.extra[told]), return_inverse=True)
    at = dict(zip(rows, np.split(place, np.cumsum([len(some) for some in rows.values()])[:-1]), strict=True))

    def column(kind: str, values: np.ndarray) -> np.ndarray:
        made = np.full(len(keys), -1)
        made[at[kind]] = values[rows[kind]]
        return made

    release, completion, abort = column("release", trace.value), column("complete", trace.time), column("abort", trace.time)
    deadline = np.maximum.reduce([column(kind, trace.value) for kind in ("deadline", "complete", "abort")])
    ended = completion >= 0
    due = (deadline >= 0) & (deadline <= trace.last)

    ran = slices(trace)
    known = ran.job >= 0
    key = ran.task[known] * span + _rank(numbers, ran.job[known])
    mine = np.minimum(np.searchsorted(keys, key), max(len(keys) - 1, 0))
    here = keys[mine] == key if len(keys) else np.zeros(len(key), bool)
    mine, first, part = mine[here], ran.start[known][here], ran.part[known][here]
    granted = np.zeros(2 * len(keys), np.int64)
    np.add.at(granted, 2 * mine + part, (ran.end - ran.start)[known][here])
    start = np.full(len(keys), -1)
    start[mine[::-1]] = first[::-1]  # of repeated indices the last one counts, so the first slice
    return Jobs(
        task=keys // span,
        job=numbers[keys % span] if len(keys) else keys,
        release=release,
        deadline=deadline,
        start=start,
        completion=completion,
        abort=abort,
        response=np.where(ended & (release >= 0), completion - release, -1),
        tardiness=np.where(ended & (deadline >= 0), np.maximum(completion - deadline, 0), -1),
        missed=due & (~ended | (completion > deadline)),
        main=granted[MAIN::2],
        exception=granted[EXCEPTION::2],
        names=trace.names,
    )


def owners(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Per name: the index of the task it belongs to, which is itself but for an exception part, and whether it is one."""
    own = np.arange(len(trace.names))
    if not trace.exception_of:
        return own, np.zeros(len(own), bool)
    of = np.array(trace.exception_of, dtype=np.int64)
    return np.where(of < 0, own, of), of >= 0


def outside(start: np.ndarray, end: np.ndarray, cut_start: np.ndarray, cut_end: np.ndarray) -> tuple[np.ndarray, ...]:
    """What is left of intervals when others are cut out of them; both in order of time, each without overlaps among themselves.

    Returns:
        (index of the interval, start, end) of each piece left, in order.
    """
    edges = np.sort(np.concatenate([start, end, cut_start, cut_end]), kind="stable")  # runs in order: a merge, and no np.unique
    edges = edges[np.diff(edges, prepend=edges[:1] - 1) > 0]
    left, right = edges[:-1], edges[1:]
    owner = np.searchsorted(start, left, side="right") - 1
    cut = np.searchsorted(cut_start, left, side="right") - 1
    free = (cut < 0) | (left >= np.append(cut_end, 0)[cut])
    kept = free & (owner >= 0) & (left < np.append(end, 0)[owner])
    return owner[kept], left[kept], right[kept]


def _rows(trace: Trace, *kinds: str) -> np.ndarray:
    """Positions of the rows of these kinds that belong to a task."""
    return np.flatnonzero(trace.of(*kinds) & (trace.task >= 0))


def _numbers(job: np.ndarray) -> np.ndarray:
    """The job numbers there are, in order; all from 0 on where these are not many more, for then a number is its own rank."""
    if len(job) and job.min() >= 0 and job.max() < 2 * len(job):
        return np.arange(job.max() + 1)
    return np.unique(job)


def _rank(numbers: np.ndarray, job: np.ndarray) -> np.ndarray:
    dense = len(numbers) and numbers[0] == 0 and numbers[-1] == len(numbers) - 1
    return job if dense else np.searchsorted(numbers, job)


def _segments(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Name on the processor from a row on, and the row: every switch, and what begins or ends a job of the one that runs."""
    switches = np.flatnonzero(trace.of("switch"))
    turns = _rows(trace, "release", "complete", "abort")
    row = np.sort(np.concatenate([switches, turns]))
    last = np.searchsorted(switches, row, side="right") - 1
    running = np.where(last >= 0, np.append(trace.task[switches], -1)[last], -1)
    kept = trace.of("switch")[row] | (trace.task[row] == running)
    return running[kept], row[kept]


class _Events:
    """Rows of some kinds, findable by task and row and by task and job; jobs are known by their rank in `numbers`."""

    def __init__(self, trace: Trace, numbers: np.ndarray, *kinds: str):
        row = _rows(trace, *kinds)
        self.row = row[np.argsort(trace.task[row], kind="stable")]
        task, job = trace.task[self.row], _rank(numbers, trace.extra[self.row])
        self._rows, self._jobs = len(trace) + 1, len(numbers) + 1
        self._by_row = task * self._rows + self.row
        keys = task * self._jobs + job
        by_job = np.argsort(keys, kind="stable")
        self._job_keys, self._by_job = keys[by_job], np.append(by_job, -1)
        self.task, self.job, self.value = (np.append(column, -1) for column in (task, job, trace.value[self.row]))

    def _get(self, column: np.ndarray, at: np.ndarray, task: np.ndarray) -> np.ndarray:
        """What stands there, where that is of the task; before the first row and after the last one stands -1."""
        return np.where(self.task[at] == task, column[at], -1)

    def last(self, task: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Job of the last event of the task up to this row, -1: none."""
        return self._get(self.job, np.searchsorted(self._by_row, task * self._rows + row, side="right") - 1, task)

    def next(self, task: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Job of the first event of the task after this row, -1: none."""
        return self._get(self.job, np.searchsorted(self._by_row, task * self._rows + row, side="right"), task)

    def following(self, task: np.ndarray, job: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The lowest job of the task above this one, and the value of its event; -1: none."""
        at = self._by_job[np.searchsorted(self._job_keys, task * self._jobs + job, side="right")]
        return self._get(self.job, at, task), self._get(self.value, at, task)

    def value_of(self, task: np.ndarray, job: np.ndarray) -> np.ndarray:
        """The value of the event of this job, -1: none."""
        found, value = self.following(task, job - 1)
        return np.where(found == job, value, -1)

    def has(self, task: np.ndarray, job: np.ndarray) -> np.ndarray:
        """Whether there is an event of this job."""
        return self.following(task, job - 1)[0] == job


def _main_jobs(trace: Trace, numbers: np.ndarray, task: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Rank of the job a main part works on from this row on, see the text of the module."""
    now = trace.time[row]
    releases, ends = _Events(trace, numbers, "release"), _Events(trace, numbers, "complete", "abort")
    ending = ends.next(task, row)
    begun = (ending >= 0) & (releases.value_of(task, ending) <= now)  # -1: released before the trace
    latest = releases.last(task, row)
    given_up = np.where(ends.has(task, latest), -1, latest)
    ended = ends.last(task, row)
    oldest, nominal = releases.following(task, ended)
    number = np.append(numbers, -1)  # rank -1: none
    known = (oldest >= 0) & (nominal <= now) & ((number[oldest] == number[ended] + 1) | (trace.start == 0))
    return np.where(begun, ending, np.where(ending >= 0, given_up, np.where(known, oldest, -1)))


def _exception_jobs(trace: Trace, numbers: np.ndarray, name: np.ndarray, task: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Its rank: an exception part belongs to the last job aborted; if that was before the trace, to the one it completes."""
    aborts = _Events(trace, numbers, "abort")
    aborted = aborts.last(task, row)
    completed = _Events(trace, numbers, "complete").next(name, row)
    before = np.where(aborts.has(task, completed), -1, completed)
    return np.where(aborted >= 0, aborted, before)
