"""Anybody's task set: read from JSON, judged, scheduled, and written as rows."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from labkit.scheduler.periodic import POLICIES, simulate
from labkit.scheduler.tasksets import PeriodicTask, TaskPair, check_names, deadline_monotonic, rate_monotonic
from labkit.trace import Trace, jobs, slices
from labkit.trace.jobs import EXCEPTION, MAIN, PARTS, owners
from labkit.trace.kinds import KINDS

#: Columns of `schedule_rows`.
ROW = ("task", "job", "part", "event", "start", "end")

#: Events of `schedule_rows`: those of the trace, and two that follow from it.
EVENTS = (*KINDS, "miss", "run")
MISS, RUN = len(KINDS), len(KINDS) + 1

_KNOWN = {"name", "period", "deadline", "offset", "times", "wcet", "ecet", "ep_wcet"}


@dataclass(frozen=True, eq=False)
class TaskSet:
    """Tasks (`TaskPair`s for taft, else `PeriodicTask`s) and the execution times of their jobs, by name."""

    tasks: list[PeriodicTask] | list[TaskPair]
    times: dict[str, list[int]]


def read_tasks(data: Any, policy: str) -> TaskSet:
    """A task set from parsed JSON: {"tasks": [{"name", "period", "deadline", "offset", "times", "wcet" | "ecet" and "ep_wcet"},
    ...]}.

    `deadline` is the period if it is missing, `offset` 0, `times` the worst case (taft: the expected time) always. The policies
    rm, dm and edf need `wcet`, taft needs `ecet` and `ep_wcet`; what the other policies need may be there too, and a `wcet` then
    bounds `ecet`.

    Raises:
        ValueError: one sentence that says what is wrong with which task.
    """
    if policy not in POLICIES:
        raise ValueError(f"policy {policy!r}; there are {', '.join(POLICIES)}")
    if not isinstance(data, Mapping) or not isinstance(data.get("tasks"), list):
        raise ValueError('a task set is an object {"tasks": [...]}; "tasks" is missing or no list')
    tasks, times = [], {}
    for i, entry in enumerate(data["tasks"]):
        task = _task(entry, f"task {i} of the list", policy)
        tasks.append(task)
        if "times" in entry:
            times[task.name] = _times(task.name, entry["times"])
    return TaskSet(check_names(tasks), times)


def _task(entry: Any, where: str, policy: str) -> PeriodicTask | TaskPair:
    if not isinstance(entry, Mapping):
        raise ValueError(f"{where} is {entry!r}; it must be an object with name, period and execution times")
    name = entry.get("name")
    if not isinstance(name, str) or not name:
        raise ValueError(f"{where} has no name; a name is a text that is not empty")
    unknown = next((key for key in entry if key not in _KNOWN), None)
    if unknown is not None:
        raise ValueError(f"task {name!r} has a field {unknown!r}; known are {', '.join(sorted(_KNOWN))}")
    needed = ("period", "ecet", "ep_wcet") if policy == "taft" else ("period", "wcet")
    missing = next((key for key in needed if key not in entry), None)
    if missing is not None:
        raise ValueError(f"task {name!r} has no {missing}; policy {policy} needs {', '.join(needed)}")
    given = {key: entry[key] for key in (*needed, "deadline", "offset") if entry.get(key) is not None}
    if policy != "taft":
        return PeriodicTask(name, **given)
    pair = TaskPair(name, **given)
    wcet = entry.get("wcet")
    if isinstance(wcet, int) and wcet < pair.ecet:
        raise ValueError(f"task {name!r}: ecet {pair.ecet} exceeds the wcet {wcet} of its main part by {pair.ecet - wcet}")
    return pair


def _times(name: str, times: Any) -> list[int]:
    if not isinstance(times, list) or not times:
        raise ValueError(f"task {name!r}: times must be a list of one or more whole numbers")
    for job, time in enumerate(times):
        if isinstance(time, bool) or not isinstance(time, int) or time < 1:
            raise ValueError(f"task {name!r}: execution time {time!r} of job {job}; it must be a whole number of at least 1")
    return times


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
        "taft": lambda: taft_test(tasks.tasks),
    }[policy]
    try:
        verdict = test()
    except UndecidedError as error:
        return {"accepted": False, "test": f"{policy} (undecided)", "why": str(error), "exact": False}
    why = verdict.why
    if policy != "taft":
        for task in tasks.tasks:
            over = [(job, time) for job, time in enumerate(tasks.times.get(task.name, ())) if time > task.wcet]
            if over:
                why += f"; not covered: job {over[0][0]} of task {task.name!r} takes {over[0][1]}, more than its wcet {task.wcet}"
    return {"accepted": bool(verdict), "test": verdict.test, "why": why, "exact": verdict.exact}


def schedule(data: Any, policy: str, until: int, hz: int = 1000) -> tuple[dict[str, Any], Trace]:
    """Read, judge and schedule a task set: the verdict to print, and the trace from 0 to `until` (see `schedule_rows`)."""
    tasks = read_tasks(data, policy)
    if isinstance(until, bool) or not isinstance(until, int):
        raise ValueError(f"a schedule until {until!r}; it must be a whole number of time units")
    trace = simulate(tasks.tasks, policy, until, tasks.times, hz)
    return verdict_of(tasks, policy), trace


def schedule_rows(trace: Trace) -> list[tuple[str, int, str, str, int, int]]:
    """A schedule as rows in the columns of `ROW`, in order of start.

    `run`: a slice of part `mp` or `ep`, contiguous ones merged. With start = end: `release`; `complete` of part `mp`, or of part
    `ep` after an abort; `abort` of part `mp`; `miss` of the part that was late. Of one instant: complete, abort, miss, release,
    run.
    """
    owner, exception = owners(trace)
    ends, releases, table = trace.rows("complete", "abort"), trace.rows("release"), jobs(trace)
    rows: list[tuple[int, ...]] = []  # start, order within the instant, order of the trace, task, part, job, event, end
    for order, (time, kind, who, _, _, job) in enumerate(ends.tolist()):
        rows.append((time, 0, order, int(owner[who]), int(exception[who]), job, kind, time))
    late = table.missed
    part = np.where(table.abort[late] >= 0, EXCEPTION, MAIN)
    columns = (table.deadline[late], table.task[late], part, table.job[late])
    rows += [(due, 1, 0, who, part, job, MISS, due) for due, who, part, job in zip(*(c.tolist() for c in columns), strict=True)]
    rows += [(time, 2, 0, who, MAIN, job, kind, time) for time, kind, who, _, _, job in releases.tolist()]
    rows += [(start, 3, 0, who, part, job, RUN, end) for who, part, job, start, end in slices(trace).rows().tolist()]
    return [
        (trace.names[who], job, PARTS[part], EVENTS[event], start, end)
        for start, _, _, who, part, job, event, end in sorted(rows)
    ]


def write_schedule(trace: Trace, file: IO[str]) -> None:
    """Write `schedule_rows` as CSV with a header; `file` is open for text with newline=""."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(ROW)
    writer.writerows(schedule_rows(trace))


def read_schedule(file: IO[str]) -> list[Sequence[Any]]:
    """The rows that `write_schedule` wrote, numbers as integers."""
    reader = csv.reader(file)
    if tuple(next(reader, ())) != ROW:
        raise ValueError(f"not a schedule: its first line must be {','.join(ROW)}")
    return [(name, int(job), part, event, int(start), int(end)) for name, job, part, event, start, end in reader]
