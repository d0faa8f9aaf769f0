"""Jobs of periodic tasks, the trace of a schedule of them, and the folds that read jobs and slices back out of that trace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from labkit.scheduler.tasksets import PeriodicTask, TaskPair, check_names
from labkit.trace.kinds import CODE, STATES
from labkit.trace.trace import Trace

if TYPE_CHECKING:
    import pandas as pd

#: In a TAFT trace the exception part of task `x` is a name of its own, `x.ep`; `x` is the main part.
EP = ".ep"

#: More jobs than this are refused: the run would take minutes and gigabytes.
MAX_JOBS = 5_000_000

#: Longest time: 13 days in nanoseconds, far from where sums leave 64 bits.
LONGEST = 1 << 50

MP, BEYOND, EXCEPTION = 0, 1, 2  # the part a slice belongs to: main, main beyond its expected time, exception


@dataclass(frozen=True, eq=False)
class Jobs:
    """All jobs released before some instant, in order of rank, the most urgent first; int64 arrays of shape (n,).

    `task` indexes the task list, `number` counts the jobs of a task from 0, `time` is what the job needs to complete.
    """

    task: np.ndarray
    number: np.ndarray
    release: np.ndarray
    deadline: np.ndarray
    time: np.ndarray

    def __len__(self) -> int:
        return len(self.task)

    def ordered(self, order: np.ndarray) -> Jobs:
        return Jobs(*(column[order] for column in (self.task, self.number, self.release, self.deadline, self.time)))

    @property
    def arrivals(self) -> np.ndarray:
        """Indices in order of release; of equal releases the more urgent job comes first."""
        return np.argsort(self.release, kind="stable")


def release_jobs(tasks: Iterable[PeriodicTask | TaskPair], until: int, times: Mapping[str, Sequence[int]]) -> Jobs:
    """The jobs released before `until`, task by task.

    Args:
        times: task name -> execution times of its jobs 0, 1, ...; the last one repeats. A task that is not there always takes its
            `wcet` (a pair: its `ecet`).
    Raises:
        ValueError: two tasks share a name; `until` or an execution time is below 1; more than `MAX_JOBS` jobs.
    """
    tasks = check_names(tasks)
    if until < 1:
        raise ValueError(f"a schedule until {until}; it must be at least 1")
    stranger = next((name for name in times if all(name != task.name for task in tasks)), None)
    if stranger is not None:
        raise ValueError(
            f"execution times for {stranger!r}, which is no task; there are {', '.join(task.name for task in tasks)}"
        )
    clash = next((task.name for task in tasks if any(other.name == task.name + EP for other in tasks)), None)
    if clash is not None:
        raise ValueError(f"a task is called {clash + EP!r}, the name of the exception part of {clash!r}; rename it")
    longest = max(until, *(max(task.period, task.deadline, task.offset) for task in tasks))
    if longest > LONGEST:
        raise ValueError(f"a time of {longest} units; at most {LONGEST} are allowed")
    counts = [max(0, -((task.offset - until) // task.period)) for task in tasks]
    if sum(counts) > MAX_JOBS:
        raise ValueError(f"{sum(counts)} jobs until {until}; at most {MAX_JOBS} are simulated at once")
    number = np.concatenate([np.arange(count) for count in counts])
    task = np.repeat(np.arange(len(tasks)), counts)
    periods, offsets, deadlines = (np.array([getattr(t, field) for t in tasks]) for field in ("period", "offset", "deadline"))
    release = offsets[task] + number * periods[task]
    time = np.concatenate([_times(t, times.get(t.name), count) for t, count in zip(tasks, counts, strict=True)])
    return Jobs(task, number, release, release + deadlines[task], time)


def _times(task: PeriodicTask | TaskPair, times: Sequence[int] | None, count: int) -> np.ndarray:
    if times is None:
        times = [task.ecet if isinstance(task, TaskPair) else task.wcet]
    given = np.asarray(times)
    if given.ndim != 1 or not given.size or given.dtype.kind not in "iu":
        raise ValueError(f"task {task.name!r}: its execution times must be one or more whole numbers")
    if given.min() < 1:
        raise ValueError(f"task {task.name!r}: execution time {given.min()} of job {given.argmin()}; it must be at least 1")
    if given.max() > LONGEST:
        raise ValueError(
            f"task {task.name!r}: execution time {given.max()} of job {given.argmax()}; at most {LONGEST} are allowed"
        )
    used = given[:count].astype(np.int64)
    return np.concatenate([used, np.full(count - len(used), given[-1], np.int64)])


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of the jobs. Slices in order of time: `job` (index into the jobs), `part` (MP, BEYOND, EXCEPTION), `start`,
    `end`.

    Per job, -1 for what never happened: `completed` (main part), `aborted`, `recovered` (exception part complete), `missed`.
    """

    job: np.ndarray
    part: np.ndarray
    start: np.ndarray
    end: np.ndarray
    completed: np.ndarray
    aborted: np.ndarray
    recovered: np.ndarray
    missed: np.ndarray


def trace_of(jobs: Jobs, outcome: Outcome, names: Sequence[str], priority: np.ndarray, until: int, hz: int) -> Trace:
    """The schedule as a trace from 0 to `until`.

    Of one instant the ends come first (complete, abort, miss), then release and ready, then switch. Ends at `until` are included,
    releases are not. A job of which nothing ran between abort and completion is told in that order.

    Args:
        names: of the tasks; if any job was or may be aborted, followed by those of the exception parts.
        priority: of each slice, for the `switch` rows.
    """
    tasks = len(names) // 2 if names[-1].endswith(EP) and names[-1].removesuffix(EP) in names else len(names)
    parts = []  # (time, order within the instant, kind, task, other, value, extra)

    def add(at: np.ndarray, order: int | np.ndarray, kind: str, task: np.ndarray, other, value, extra) -> None:
        parts.append(np.stack(np.broadcast_arrays(at, order, CODE[kind], task, other, value, extra)).astype(np.int64))

    def add_ends(when: np.ndarray, order: int | np.ndarray, kind: str, task: np.ndarray) -> None:
        here = (when >= 0) & (when <= until)
        order = np.broadcast_to(order, when.shape)[here]
        add(when[here], order, kind, task[here], -1, jobs.deadline[here], jobs.number[here])

    exception = jobs.task + tasks
    fallen = outcome.aborted >= 0
    add_ends(outcome.completed, 0, "complete", jobs.task)
    add_ends(outcome.aborted, 1, "abort", jobs.task)
    add_ends(outcome.recovered, np.where(outcome.recovered > outcome.aborted, 0, 2), "complete", exception)
    add_ends(outcome.missed, 3, "miss", np.where(fallen, exception, jobs.task))
    add(jobs.release, 4, "release", jobs.task, -1, jobs.release, jobs.number)
    add(jobs.release, 5, "ready", jobs.task, -1, 0, -1)
    waits = fallen & (outcome.recovered != outcome.aborted) & (outcome.aborted < until)
    add(outcome.aborted[waits], 5, "ready", exception[waits], -1, 0, -1)
    time, task, value, other, state = _switches(jobs, outcome, priority, tasks, until)
    add(time, 6, "switch", task, other, value, state)

    table = np.concatenate(parts, axis=1)
    if until < 1 << 40 and len(names) < 1 << 16:  # one key is sorted in a third of the time of three
        order = np.argsort((table[0] * 8 + table[1]) * len(names) + table[3], kind="stable")
    else:
        order = np.lexsort((table[3], table[1], table[0]))
    columns = np.ascontiguousarray(table[[0, 2, 3, 4, 5, 6]][:, order])
    return Trace(*columns, names=tuple(names), hz=hz, start=0, end=until)


def _switches(jobs: Jobs, outcome: Outcome, priority: np.ndarray, tasks: int, until: int) -> tuple[np.ndarray, ...]:
    """Time, task, priority, task before and its state, of every switch; -1 is idle."""
    job, part, start, end = outcome.job, outcome.part, outcome.start, outcome.end
    if not len(job):
        idle = np.full(1, -1)
        return np.zeros(1, np.int64), idle, np.zeros(1, np.int64), idle, idle
    new = np.ones(len(job), bool)
    new[1:] = (job[1:] != job[:-1]) | (part[1:] != part[:-1]) | (start[1:] != end[:-1])
    last = np.append(new[1:], True)
    first, finish = start[new], end[last]
    task = np.where(part == EXCEPTION, jobs.task[job] + tasks, jobs.task[job])[new]
    idles = np.flatnonzero(np.append(first[1:], until) > finish)
    if first[0] > 0:
        finish, idles = np.append(finish, 0), np.append(idles, len(finish))
    time = np.concatenate([first, finish[idles]])
    who = np.concatenate([task, np.full(len(idles), -1)])
    value = np.concatenate([priority[new], np.zeros(len(idles), np.int64)])
    mine = np.concatenate([job[new] * 4 + part[new], np.full(len(idles), -1)])
    order = np.argsort(time, kind="stable")
    time, who, value, mine = time[order], who[order], value[order], mine[order]
    before, gone = np.append(-1, who[:-1]), np.append(-1, mine[:-1])
    left = np.where(
        gone % 4 == EXCEPTION, outcome.recovered[gone // 4], np.maximum(outcome.completed, outcome.aborted)[gone // 4]
    )
    over = (left >= 0) & (left <= time)  # its job had ended by then
    state = np.where(who == before, STATES.index("running"), np.where(over, STATES.index("blocked"), STATES.index("ready")))
    return time, who, value, before, np.where(before < 0, -1, state)


# --------------------------------------------------------------------------------------------------- reading a schedule


def slices(trace: Trace) -> np.ndarray:
    """When each job ran: int64 array of shape (n, 4), columns (task, job number, start, end) in order of start.

    `task` indexes `trace.names`, so that a slice of an exception part has that of `x.ep`. Contiguous slices of one job are one.
    """
    switch = trace.rows("switch")
    task, start = switch[:, 2], switch[:, 0]
    end = np.append(start[1:], trace.end)
    keep = (task >= 0) & (end > start)
    task, start, end = task[keep], start[keep], end[keep]
    number = np.zeros_like(task)
    ends, begins = trace.rows("complete", "abort"), {kind: trace.rows(kind) for kind in ("release", "abort")}
    for code, name in enumerate(trace.names):
        mine = task == code
        over = ends[ends[:, 2] == code]
        base = _base(trace, name)
        if base != name:  # an exception part belongs to the last job aborted
            begun = begins["abort"][begins["abort"][:, 2] == trace.code(base)]
            number[mine] = begun[np.searchsorted(begun[:, 0], start[mine], side="right") - 1, 5]
            continue
        released = begins["release"][begins["release"][:, 2] == code, 5]  # a slice belongs to the job whose end comes next
        open_job = released[~np.isin(released, over[:, 5])][:1]
        number[mine] = np.append(over[:, 5], open_job)[np.searchsorted(over[:, 0], start[mine], side="right")]
    table = np.stack([task, number, start, end], axis=1)
    if not len(table):
        return table
    first = np.ones(len(table), bool)
    first[1:] = (table[1:, :2] != table[:-1, :2]).any(axis=1) | (start[1:] != end[:-1])
    merged = table[first]
    merged[:, 3] = end[np.append(first[1:], True)]
    return merged


def job_table(trace: Trace) -> pd.DataFrame:
    """One row per job of a schedule, by task and number, times in units of the trace.

    Columns: task, job, release, deadline (<NA> if nothing in the trace tells it), end (of the main part or, after an abort, of
    the exception part), aborted, missed, main and exception (processor time granted to either part), response (end - release).
    What has not happened is <NA>.
    """
    import pandas as pd

    owner = np.array([trace.names.index(_base(trace, name)) for name in trace.names], dtype=np.int64)
    exception = owner != np.arange(len(owner))
    released = trace.rows("release")
    released = released[np.lexsort((released[:, 5], released[:, 2]))]
    span = int(released[:, 5].max(initial=0)) + 1
    key = released[:, 2] * span + released[:, 5]

    def place(task: np.ndarray, job: np.ndarray) -> np.ndarray:
        return np.searchsorted(key, owner[task] * span + job)

    columns = {name: np.full(len(key), -1) for name in ("deadline", "end", "aborted", "missed")}
    for kind, column in (("complete", "end"), ("abort", "aborted"), ("miss", "missed")):
        rows = trace.rows(kind)
        at = place(rows[:, 2], rows[:, 5])
        columns[column][at], columns["deadline"][at] = rows[:, 0], rows[:, 4]
    ran = slices(trace)
    at, part = place(ran[:, 0], ran[:, 1]), exception[ran[:, 0]]
    main, rescue = np.zeros(len(key), np.int64), np.zeros(len(key), np.int64)
    np.add.at(main, at[~part], (ran[:, 3] - ran[:, 2])[~part])
    np.add.at(rescue, at[part], (ran[:, 3] - ran[:, 2])[part])

    def known(values: np.ndarray) -> pd.arrays.IntegerArray:
        return pd.arrays.IntegerArray(values, values < 0)

    response = np.where(columns["end"] < 0, -1, columns["end"] - released[:, 4])
    return pd.DataFrame(
        {
            "task": np.array(trace.names, dtype=object)[released[:, 2]],
            "job": released[:, 5],
            "release": released[:, 4],
            **{name: known(values) for name, values in columns.items()},
            "main": main,
            "exception": rescue,
            "response": known(response),
        }
    )


def _base(trace: Trace, name: str) -> str:
    base = name.removesuffix(EP)
    return base if base in trace.names else name


def totals(trace: Trace) -> pd.DataFrame:
    """Per task: jobs, completed, aborted, missed, time granted to the main and exception parts, worst response; attribute `idle`.

    `totals(trace).attrs["idle"]` is the time in which nothing ran.
    """
    jobs = job_table(trace)
    by = jobs.groupby("task", sort=False)
    frame = by.agg(
        jobs=("job", "count"),
        aborted=("aborted", "count"),
        missed=("missed", "count"),
        main=("main", "sum"),
        exception=("exception", "sum"),
        response=("response", "max"),
    )
    frame.insert(1, "completed", (jobs["end"].notna() & jobs["aborted"].isna()).groupby(jobs["task"], sort=False).sum())
    ran = slices(trace)
    frame.attrs["idle"] = int(trace.end - trace.start - np.sum(ran[:, 3] - ran[:, 2]))
    return frame
