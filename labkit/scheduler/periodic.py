"""Periodic tasks on one core in integer time: rate monotonic, deadline monotonic, earliest deadline first, and TAFT.

The rules, complete for any task set (those of TAFT's parts are in `labkit.scheduler.taft`):

1. Job k of a task is released at offset + k * period and due `deadline` later. It needs its execution time, a whole number of at
   least 1, whatever the declared worst case is.
2. At every instant, after all completions and releases of that instant, the unfinished released job with the highest priority
   runs; it is preempted without cost. The processor idles only when there is none.
3. Priorities, ties decided by what follows: rm: shorter period, order in the list, older job. dm: shorter relative deadline,
   order in the list, older job. edf: earlier absolute deadline, order in the list, older job.
4. A job not complete at its deadline misses then, and goes on until it is. Completing exactly at the deadline is in time.
5. The schedule covers 0 to `until`: what is released at `until` is not in it, what ends at `until` is.

The jobs are known beforehand, so the engine sorts them once by priority and keeps only the ranks of ready jobs in a heap; from
release to release it runs the top of the heap. All else is done on whole columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from labkit.scheduler.dispatch import dispatch
from labkit.scheduler.jobs import MP, Outcome, Releases, Times, release_jobs, trace_of
from labkit.scheduler.taft import schedule_pairs
from labkit.scheduler.tasksets import Kind, PeriodicTask, TaskPair, check_names
from labkit.trace import Trace

#: The policies, by the name `simulate` and the command line know them.
POLICIES = ("rm", "dm", "edf", "taft")


def simulate(
    tasks: Iterable[PeriodicTask | TaskPair], policy: str, until: int, times: Times | None = None, hz: int = 1000
) -> Trace:
    """The schedule of a task set from 0 to `until`, as a trace.

    Args:
        tasks: `PeriodicTask`s for rm, dm and edf, `TaskPair`s for taft. Release jitter is not simulated.
        policy: one of `POLICIES`.
        until: length of the schedule in time units.
        times: as `Times`; a task that is missing always takes its `wcet`, a pair its `ecet`.
        hz: time units per second; 1000 makes the unit a millisecond.

    Returns:
        The trace: release, deadline, ready, complete, abort and switch rows. A `switch` has as priority the place of the task
        counted from the least urgent (rm, dm), 0 (edf), or 2 exception part, 1 main part within its expected time, 0 beyond it
        (taft). `labkit.trace.jobs` and `labkit.trace.slices` read jobs and slices out of it.

    Raises:
        ValueError: unknown policy, wrong kind of task, or what `release_jobs` refuses.
    """
    given = check_names(tasks)
    if policy not in POLICIES:
        raise ValueError(f"policy {policy!r}; there are {', '.join(POLICIES)}")
    if policy == "taft":
        pairs = _all_of(TaskPair, given, policy)
        return schedule_pairs(pairs, release_jobs(pairs, until, times or {}), until, hz)
    plain = _all_of(PeriodicTask, given, policy)
    shaky = next((task for task in plain if task.jitter), None)
    if shaky is not None:
        raise ValueError(f"task {shaky.name!r} has a release jitter of {shaky.jitter}; the simulation releases without jitter")
    jobs = release_jobs(plain, until, times or {})
    place = priority_places(plain, policy)
    jobs = jobs.ordered(np.lexsort((jobs.number, jobs.task, jobs.deadline if policy == "edf" else place[jobs.task])))
    outcome = _run(jobs, until)
    value = np.zeros(len(outcome.job), np.int64) if policy == "edf" else len(plain) - 1 - place[jobs.task[outcome.job]]
    return trace_of(jobs, outcome, [task.name for task in plain], value, until, hz)


def _all_of(wanted: type[Kind], tasks: Iterable[PeriodicTask | TaskPair], policy: str) -> list[Kind]:
    """The tasks, if all are of the kind that the policy schedules."""
    found = []
    for task in tasks:
        if not isinstance(task, wanted):
            raise ValueError(f"task {task.name!r} is a {type(task).__name__}; policy {policy} schedules {wanted.__name__}s")
        found.append(task)
    return found


def priority_places(tasks: Sequence[PeriodicTask], policy: str) -> np.ndarray:
    """Place of each task in the fixed priority order of "rm" or "dm", 0 the highest; equals keep their order."""
    if policy == "edf":
        return np.zeros(len(tasks), np.int64)
    by = np.array([task.period if policy == "rm" else task.deadline for task in tasks])
    return np.argsort(np.argsort(by, kind="stable"))


def _run(jobs: Releases, until: int) -> Outcome:
    arrivals = jobs.arrivals
    left = jobs.time.tolist()
    who, start, end = dispatch(jobs.release[arrivals].tolist(), arrivals.tolist(), left, until)
    completed = np.full(len(jobs), -1)
    completed[who] = end  # of repeated indices the last one counts
    completed[np.array(left, dtype=np.int64) > 0] = -1
    never = np.full(len(jobs), -1)
    return Outcome(who, np.full(len(who), MP), start, end, completed, never, never)
