"""The jobs that periodic tasks release, and the trace of a schedule of them; `labkit.trace` reads slices and jobs out of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from labkit.checks import whole
from labkit.scheduler.tasksets import PeriodicTask, TaskPair, check_names
from labkit.trace import CODE, STATES, Trace

#: In a TAFT trace the exception part of task `x` is a name of its own, `x.ep`; `x` is the main part.
SUFFIX = ".ep"

#: More jobs than this are refused: the run would take minutes and gigabytes.
MAX_JOBS = 5_000_000

#: Longest time: 13 days in nanoseconds, far from where sums leave 64 bits.
LONGEST = 1 << 50

#: Task name -> execution times of its jobs 0, 1, ...; the last one repeats.
Times = Mapping[str, Sequence[int] | np.ndarray]

MP, BEYOND, EP = 0, 1, 2  # what a slice is: main part, main part beyond its expected time, exception part


@dataclass(frozen=True, eq=False)
class Releases:
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

    def ordered(self, order: np.ndarray) -> Releases:
        return Releases(*(column[order] for column in (self.task, self.number, self.release, self.deadline, self.time)))

    @property
    def arrivals(self) -> np.ndarray:
        """Indices in order of release; of equal releases the more urgent job comes first."""
        return np.argsort(self.release, kind="stable")


def release_jobs(tasks: Iterable[PeriodicTask | TaskPair], until: int, times: Times) -> Releases:
    """The jobs released before `until`, task by task.

    Args:
        times: as `Times`; a task that is not there always takes its `wcet` (a pair: its `ecet`).

    Raises:
        ValueError: two tasks share a name; `until` or an execution time is below 1; more than `MAX_JOBS` jobs.
    """
    tasks = check_names(tasks)
    until = whole(until, 1, "the end of the schedule")
    names = {task.name: None for task in tasks}
    stranger = next((name for name in times if name not in names), None)
    if stranger is not None:
        raise ValueError(f"execution times for {stranger!r}, which is no task; there are {', '.join(names)}")
    clash = next((name for name in names if name + SUFFIX in names), None)
    if clash is not None:
        raise ValueError(f"a task is called {clash + SUFFIX!r}, the name of the exception part of {clash!r}; rename it")
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
    return Releases(task, number, release, release + deadlines[task], time)


def _times(task: PeriodicTask | TaskPair, times: Sequence[int] | np.ndarray | None, count: int) -> np.ndarray:
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
    """What became of the jobs. Slices in order of time: `job` (index into the jobs), `part` (MP, BEYOND, EP), `start`,
    `end`.

    Per job, -1 for what never happened: `completed` (main part), `aborted`, `recovered` (exception part complete).
    """

    job: np.ndarray
    part: np.ndarray
    start: np.ndarray
    end: np.ndarray
    completed: np.ndarray
    aborted: np.ndarray
    recovered: np.ndarray


def trace_of(
    jobs: Releases, outcome: Outcome, names: Sequence[str], priority: np.ndarray, until: int, hz: int, exceptions: bool = False
) -> Trace:
    """The schedule as a trace from 0 to `until`.

    Of one instant the ends come first (complete, abort), then release with its deadline and ready, then switch. Ends at `until`
    are included, releases are not. A job of which nothing ran between abort and completion is told in that order.

    Args:
        names: of the tasks.
        priority: of each slice, for the `switch` rows.
        exceptions: whether the tasks have exception parts; their names, those of the tasks with `SUFFIX`, come after these.
    """
    tasks = len(names)
    names = (*names, *(name + SUFFIX for name in names if exceptions))
    blocks: list[Rows] = []

    def add_ends(when: np.ndarray, order: int | np.ndarray, kind: str, task: np.ndarray) -> None:
        here = (when >= 0) & (when <= until)
        order = np.broadcast_to(order, when.shape)[here]
        blocks.append((when[here], order, CODE[kind], task[here], -1, jobs.deadline[here], jobs.number[here]))

    exception = jobs.task + tasks
    fallen = outcome.aborted >= 0
    add_ends(outcome.completed, 0, "complete", jobs.task)
    add_ends(outcome.aborted, 1, "abort", jobs.task)
    add_ends(outcome.recovered, np.where(outcome.recovered > outcome.aborted, 0, 2), "complete", exception)
    blocks.append((jobs.release, 4, CODE["release"], jobs.task, -1, jobs.release, jobs.number))
    blocks.append((jobs.release, 4, CODE["deadline"], jobs.task, -1, jobs.deadline, jobs.number))
    main = outcome.part != EP
    urgency, rescue = (_first(outcome.job[some], priority[some], len(jobs)) for some in (main, ~main))
    blocks.append((jobs.release, 5, CODE["ready"], jobs.task, -1, urgency, 0))
    waits = fallen & (outcome.recovered != outcome.aborted) & (outcome.aborted < until)
    blocks.append((outcome.aborted[waits], 5, CODE["ready"], exception[waits], -1, rescue[waits], 0))
    time, task, value, other, state = _switches(jobs, outcome, priority, tasks, until)
    blocks.append((time, 6, CODE["switch"], task, other, value, state))
    columns = _in_order(blocks, until, len(names))
    of = (*(-1 for _ in range(tasks)), *range(tasks)) if exceptions else ()
    return Trace.from_columns(columns, names, hz, end=until, exception_of=of, closed=True)


#: Rows of one kind: time, order within the instant, kind, task, other, value, extra; a number stands for all of them.
Rows = tuple[np.ndarray, int | np.ndarray, int, np.ndarray, int | np.ndarray, int | np.ndarray, int | np.ndarray]


def _in_order(blocks: Sequence[Rows], until: int, names: int) -> np.ndarray:
    """The columns of a trace, int64 array of shape (6, n): all rows by time, order within the instant, task and block."""
    ends = np.cumsum([len(block[0]) for block in blocks]).tolist()
    table = np.empty((7, ends[-1]), np.int64)
    for block, begin, end in zip(blocks, [0, *ends], ends):
        for column, values in zip(table, block, strict=True):
            column[begin:end] = values
    time, within, kind, task, *rest = table
    if until < 1 << 40 and names < 1 << 16:  # one key is sorted in a third of the time of three
        order = np.argsort((time * 8 + within) * names + task, kind="stable")
    else:
        order = np.lexsort((task, within, time))
    columns = np.empty((6, ends[-1]), np.int64)
    for column, values in zip(columns, (time, kind, task, *rest), strict=True):
        np.take(values, order, out=column, mode="clip")
    return columns


def _first(job: np.ndarray, priority: np.ndarray, count: int) -> np.ndarray:
    """Per job the priority of the first of these slices, 0 where there is none."""
    made = np.zeros(count, np.int64)
    made[job[::-1]] = priority[::-1]  # of repeated indices the last one counts
    return made


def _switches(jobs: Releases, outcome: Outcome, priority: np.ndarray, tasks: int, until: int) -> tuple[np.ndarray, ...]:
    """Time, task, priority, task before and its state, of every switch; -1 is idle."""
    job, part, start, end = outcome.job, outcome.part, outcome.start, outcome.end
    if not len(job):
        idle = np.full(1, -1)
        return np.zeros(1, np.int64), idle, np.zeros(1, np.int64), idle, idle
    new = np.ones(len(job), bool)
    new[1:] = (job[1:] != job[:-1]) | (part[1:] != part[:-1]) | (start[1:] != end[:-1])
    last = np.append(new[1:], True)
    first, finish = start[new], end[last]
    task = np.where(part == EP, jobs.task[job] + tasks, jobs.task[job])[new]
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
    left = np.where(gone % 4 == EP, outcome.recovered[gone // 4], np.maximum(outcome.completed, outcome.aborted)[gone // 4])
    over = (left >= 0) & (left <= time)  # its job had ended by then
    state = np.where(who == before, STATES.index("running"), np.where(over, STATES.index("blocked"), STATES.index("ready")))
    return time, who, value, before, np.where(before < 0, -1, state)
