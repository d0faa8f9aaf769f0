"""Anybody's task set: read from JSON, judged, scheduled, and written as rows."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import IO, Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from labkit.checks import shown, whole
from labkit.outside import MOST_IN_NAME, Name, a_list, a_whole, checked, one_line
from labkit.scheduler.jobs import LONGEST
from labkit.scheduler.periodic import POLICIES, simulate
from labkit.scheduler.tasksets import PeriodicTask, TaskPair, check_names, deadline_monotonic, rate_monotonic
from labkit.trace import EXCEPTION, KINDS, MAIN, PARTS, Trace, jobs, measured, owners, slices

#: Columns of `schedule_rows`.
ROW = ("task", "job", "part", "event", "start", "end")

#: Events of `schedule_rows`: those of the trace, and two that follow from it.
EVENTS = (*KINDS, "miss", "run")
MISS, RUN = len(KINDS), len(KINDS) + 1

#: A set from outside has at most so many tasks, and its schedule so many jobs: seconds of work and below a gigabyte.
MOST_TASKS, MOST_JOBS = 50_000, 1_000_000

#: What a policy needs of a task beside its name.
NEEDS = {policy: ("period", "ecet", "ep_wcet") if policy == "taft" else ("period", "wcet") for policy in POLICIES}


class _Task(BaseModel):
    """A task as its file has it; null stands for what is not given."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Name
    period: Annotated[int, a_whole(1, LONGEST)]
    deadline: Annotated[int | None, a_whole(1, LONGEST)] = None
    offset: Annotated[int, a_whole(0, LONGEST)] = 0
    times: Annotated[list[Annotated[int, a_whole(1, LONGEST)]] | None, a_list("execution times", 1_000_000, least=1)] = None
    wcet: Annotated[int | None, a_whole(1, LONGEST)] = None
    ecet: Annotated[int | None, a_whole(1, LONGEST)] = None
    ep_wcet: Annotated[int | None, a_whole(0, LONGEST)] = None


class _File(BaseModel):
    """A task set as its file has it; what stands beside the tasks is let be."""

    tasks: Annotated[list[_Task], a_list("tasks", MOST_TASKS, least=1)]


@dataclass(frozen=True, eq=False)
class TaskSet:
    """Tasks for rm, dm and edf, or pairs for taft, and the execution times of their jobs, by name."""

    tasks: list[PeriodicTask]
    pairs: list[TaskPair]
    times: dict[str, list[int]]


def read_tasks(data: Any, policy: str) -> TaskSet:
    """A task set from parsed JSON: {"tasks": [{"name", "period", "deadline", "offset", "times", "wcet" | "ecet" and "ep_wcet"},
    ...]}.

    `deadline` is the period if it is missing, `offset` 0, `times` the worst case (taft: the expected time) always. The policies
    rm, dm and edf need `wcet`, taft needs `ecet` and `ep_wcet`; what the other policies need may be there too, and a `wcet` then
    bounds `ecet`. There are at most `MOST_TASKS` tasks, and no time is longer than `LONGEST`.

    Raises:
        ValueError: one sentence that says what is wrong with which task.
    """
    if policy not in POLICIES:
        raise ValueError(f"policy {policy!r}; there are {', '.join(POLICIES)}")
    entries = checked(_File, data, "the task set").tasks
    for entry in entries:
        missing = next((field for field in NEEDS[policy] if getattr(entry, field) is None), None)
        if missing is not None:
            raise ValueError(f"task {entry.name!r} has no {missing}; policy {policy} needs {', '.join(NEEDS[policy])}")
    times = {entry.name: entry.times for entry in entries if entry.times is not None}
    if policy == "taft":
        return TaskSet([], check_names(map(_pair, entries)), times)
    return TaskSet(check_names(map(_periodic, entries)), [], times)


def _periodic(entry: _Task) -> PeriodicTask:
    assert entry.wcet is not None
    return PeriodicTask(entry.name, entry.wcet, entry.period, entry.deadline or entry.period, offset=entry.offset)


def _pair(entry: _Task) -> TaskPair:
    assert entry.ecet is not None and entry.ep_wcet is not None
    if entry.wcet is not None and entry.wcet < entry.ecet:
        over = f"exceeds the wcet {entry.wcet} of its main part by {entry.ecet - entry.wcet}"
        raise ValueError(f"task {entry.name!r}: ecet {entry.ecet} {over}")
    return TaskPair(entry.name, entry.ecet, entry.ep_wcet, entry.period, entry.deadline or entry.period, entry.offset)


def fitted(trace: Trace) -> dict[str, Any]:
    """The task set that was measured in a trace of one core, as `read_tasks` takes it: `wcet` is the longest execution seen,
    `ecet` the 95th percentile, `period` the median; what else was measured stands beside the tasks. In nanoseconds, or in
    microseconds where the trace has those: execution times rounded up, periods down.

    What was observed is no bound: the longest execution may be still to come. `ep_wcet` cannot be measured.

    Raises:
        ValueError: several cores, or no task with a period.
    """
    tasks, left = measured(trace)
    if not tasks:
        why = "; ".join(f"{shown(name)}: {reason}" for name, reason in list(left.items())[:3])
        raise ValueError(f"no task with a period in it{f' ({why})' if why else ''}")
    unit, scale = ("us", 1.0) if trace.hz == 1_000_000 else ("ns", 1e9 / trace.hz)
    entries: list[dict[str, Any]] = []
    more: dict[str, dict[str, float]] = {}
    for task in tasks:
        name, period = one_line(task.name)[:MOST_IN_NAME], floor(task.period * scale + 1e-9)
        wcet, ecet = (max(1, ceil(time * scale - 1e-9)) for time in (task.c_max, task.c_p95))
        entries.append({"name": name, "period": max(1, period), "wcet": wcet, "ecet": ecet})
        counts = {"jobs": task.jobs, "activations": task.activations, "gaps": task.gaps}
        more[name] = {**counts, "c_max": wcet, "c_p95": ecet, "period": task.period * scale, "jitter": task.jitter * scale}
    return {"unit": unit, "tasks": entries, "measured": more, "left_out": left}


def verdict_of(tasks: TaskSet, policy: str) -> dict[str, Any]:
    """The sharpest acceptance test of the policy, as {"accepted", "test", "why", "exact"}.

    It judges the declared times: exact response times for rm and dm, the processor demand for edf, `taft_test` for taft. Where a
    job takes longer than its declared worst case, `why` says so, since no test covers that.
    """
    from labkit.scheduler.analysis import UndecidedError, qpa_test, response_time_test, taft_test

    test = {
        "rm": lambda: response_time_test(rate_monotonic(tasks.tasks)),
        "dm": lambda: response_time_test(deadline_monotonic(tasks.tasks)),
        "edf": lambda: qpa_test(tasks.tasks),
        "taft": lambda: taft_test(tasks.pairs),
    }[policy]
    try:
        verdict = test()
    except UndecidedError as error:
        return {"accepted": False, "test": f"{policy} (undecided)", "why": str(error), "exact": False}
    why = verdict.why
    for task in tasks.tasks:
        over = next(((job, time) for job, time in enumerate(tasks.times.get(task.name, ())) if time > task.wcet), None)
        if over:
            why += f"; not covered: job {over[0]} of task {task.name!r} takes {over[1]}, more than its wcet {task.wcet}"
    return {"accepted": bool(verdict), "test": verdict.test, "why": why, "exact": verdict.exact}


def schedule(data: Any, policy: str, until: int, hz: int = 1000) -> tuple[dict[str, Any], Trace]:
    """Read, judge and schedule a task set of at most `MOST_JOBS` jobs until `until`: the verdict to print, and the trace from 0
    on (see `schedule_rows`).
    """
    tasks = read_tasks(data, policy)
    whole(until, 1, "the end of the schedule", LONGEST)
    all_tasks: list[PeriodicTask | TaskPair] = [*tasks.tasks, *tasks.pairs]
    count = sum(max(0, -((task.offset - until) // task.period)) for task in all_tasks)
    if count > MOST_JOBS:
        raise ValueError(f"{count} jobs are released until {until}; at most {MOST_JOBS} are scheduled")
    trace = simulate(tasks.pairs if policy == "taft" else tasks.tasks, policy, until, tasks.times, hz)
    return verdict_of(tasks, policy), trace


def schedule_rows(trace: Trace) -> list[tuple[str, int, str, str, int, int]]:
    """A schedule as rows in the columns of `ROW`, in order of start.

    `run`: a slice of part `mp` or `ep`, contiguous ones merged. With start = end: `release`; `complete` of part `mp`, or of part
    `ep` after an abort; `abort` of part `mp`; `miss` of the part that was late. Of one instant: complete, abort, miss, release,
    run.
    """
    return list(_in_order(trace))


def _in_order(trace: Trace) -> Iterator[tuple[str, int, str, str, int, int]]:
    owner, exception = owners(trace)
    ends, releases, table, ran = trace.rows("complete", "abort"), trace.rows("release"), jobs(trace), slices(trace)
    late = table.missed
    late_part = np.where(table.abort[late] >= 0, EXCEPTION, MAIN)
    time, due = (ends[:, 0], releases[:, 0]), table.deadline[late]
    # start, place within the instant, place in the trace, task, part, job, event, end
    rows = np.concatenate(
        [
            _rows(time[0], 0, np.arange(len(ends)), owner[ends[:, 2]], exception[ends[:, 2]], ends[:, 5], ends[:, 1], time[0]),
            _rows(due, 1, 0, table.task[late], late_part, table.job[late], MISS, due),
            _rows(time[1], 2, 0, releases[:, 2], MAIN, releases[:, 5], releases[:, 1], time[1]),
            _rows(ran.start, 3, 0, ran.task, ran.part, ran.job, RUN, ran.end),
        ]
    )
    order = np.lexsort(rows[:, 5::-1].T)
    for some in np.array_split(order, len(order) // 100_000 + 1):  # as Python objects, rows take ten times the memory
        for start, _, _, task, part, job, event, end in rows[some].tolist():
            yield trace.names[task], job, PARTS[part], EVENTS[event], start, end


def _rows(*columns: np.ndarray | int) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*columns), axis=1).astype(np.int64)


def write_schedule(trace: Trace, file: IO[str]) -> None:
    """Write `schedule_rows` as CSV with a header; `file` is open for text with newline=""."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(ROW)
    writer.writerows(_in_order(trace))


def read_schedule(file: IO[str]) -> list[Sequence[Any]]:
    """The rows that `write_schedule` wrote, numbers as integers."""
    reader = csv.reader(file)
    if tuple(next(reader, ())) != ROW:
        raise ValueError(f"not a schedule: its first line must be {','.join(ROW)}")
    return [(name, int(job), part, event, int(start), int(end)) for name, job, part, event, start, end in reader]
