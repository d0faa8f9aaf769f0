"""Earliest deadline first, preemptive, on one processor: processor demand, and exact response times.

Integers and fractions only. Arrivals are at least a period apart and may come at the worst moments (sporadic tasks, or periodic
ones of unknown offsets); known offsets are not used. A release jitter J shortens a deadline to D - J, counted from the release.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from heapq import merge
from itertools import count
from math import lcm

from labkit.scheduler.analysis.fixed_priority import least_window, utilization
from labkit.scheduler.analysis.shares import compared_to_one, total
from labkit.scheduler.analysis.verdict import Budget, Verdict
from labkit.scheduler.tasksets import PeriodicTask, check_names


def demand_bound(tasks: Iterable[PeriodicTask], time: int) -> int:
    """Most work that can be released and due within any interval of length `time` (Baruah, Rosier and Howell 1990)."""
    return sum(max(0, (time - _room(task)) // task.period + 1) * task.wcet for task in tasks)


def demand_limit(tasks: Iterable[PeriodicTask]) -> Fraction | None:
    """L* = sum of (T - D) U over 1 - U, beyond which demand cannot exceed the time; None for U >= 1.

    D counts without jitter, and a task with D > T adds nothing (its demand stays below U t).
    """
    tasks = list(tasks)
    used = utilization(tasks)
    if used >= 1:
        return None
    return total(Fraction(max(0, t.period - _room(t)) * t.wcet, t.period) for t in tasks) / (1 - used)


def busy_period(tasks: Iterable[PeriodicTask]) -> int | None:
    """Longest time the processor can be busy without a pause; None if for ever.

    That is so for U > 1, and for U = 1 with jitter; at U = 1 without jitter it is the time to the next moment at which no work is
    pending.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps.
    """
    return _busy(tasks, Budget("busy period"))


def _busy(tasks: Iterable[PeriodicTask], budget: Budget) -> int | None:
    return least_window(0, [(t.wcet, t.period, t.jitter) for t in tasks], budget)


def processor_demand_test(tasks: Iterable[PeriodicTask]) -> Verdict:
    """Compare the demand with the time at every absolute deadline up to L* or the end of the busy period; exact.

    Reports the first deadline at which it is exceeded. `qpa_test` gives the same answer in far fewer steps.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps; each deadline takes one for each task.
    """
    tasks, budget = check_names(tasks), Budget("processor demand")
    refused = _overload(tasks, "processor demand")
    if refused is not None:
        return refused
    checked = 0
    for time in _deadlines(tasks, _horizon(tasks, budget)):
        checked += 1
        budget.spend(len(tasks))
        if (demand := demand_bound(tasks, time)) > time:
            return _exceeded("processor demand", demand, time, tasks)
    return Verdict(True, "processor demand", f"the demand is within the time at all {checked} deadlines that matter", True)


def qpa_test(tasks: Iterable[PeriodicTask]) -> Verdict:
    """Quick processor-demand analysis (Zhang and Burns 2009, theorem 5): the same criterion, searched from the far end.

    From a time t at which the demand h(t) is less, no deadline between h(t) and t can be exceeded, so the search jumps there. A
    rejection names a deadline, not always the first.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps; each deadline takes two for each task.
    """
    tasks, budget = check_names(tasks), Budget("QPA")
    refused = _overload(tasks, "QPA")
    if refused is not None:
        return refused
    least = min(_room(task) for task in tasks)
    time = _deadline_up_to(tasks, _horizon(tasks, budget))
    steps = 0
    while True:
        steps += 1
        budget.spend(2 * len(tasks))
        demand = demand_bound(tasks, time) if time is not None else 0
        if time is not None and demand > time:
            return _exceeded("QPA", demand, time, tasks)
        if time is None or demand <= least:
            return Verdict(True, "QPA", f"the demand is within the time at every deadline ({steps} checked)", True)
        time = demand if demand < time else _deadline_up_to(tasks, time - 1)


def edf_job_response(tasks: Sequence[PeriodicTask], name: str, arrival: int) -> int:
    """Worst response of a job of task `name` that arrives `arrival` after the start of a busy period (Spuri 1996).

    All others are released together at the start with all their jitter, and as often as they can be; the task itself arrives at
    `arrival` and every period before it. Jobs with equal deadlines count against it.

    Raises:
        ValueError: no task of that name.
        UndecidedError: more than `MAX_STEPS` steps.
    """
    task = next((task for task in tasks if task.name == name), None)
    if task is None:
        raise ValueError(f"no task {name!r} in this set; it has {', '.join(task.name for task in tasks)}")
    return _job_response(tasks, task, arrival, Budget("EDF response time"))


def _job_response(tasks: Sequence[PeriodicTask], task: PeriodicTask, arrival: int, budget: Budget) -> int:
    due = arrival + task.deadline
    own = (1 + (arrival + task.jitter) // task.period) * task.wcet
    others = [(t.wcet, t.period, t.jitter, 1 + (due - _room(t)) // t.period) for t in tasks if t is not task and _room(t) <= due]
    window = own + sum(c for c, _, _, _ in others)
    budget.spend(2 * len(tasks))
    while True:
        budget.spend(2 * (1 + len(others)))  # such a term takes twice as long as others
        wider = own + sum(min(-(-(window + j) // t), most) * c for c, t, j, most in others)
        if wider == window:
            return max(task.jitter + task.wcet, window - arrival)
        window = wider


def edf_response_times(tasks: Iterable[PeriodicTask]) -> dict[str, int | None]:
    """Exact worst response time of each task under EDF, from its arrival (Spuri 1996); None if the utilisation is above 1.

    A task's worst job need not be the first of a busy period: all arrivals are tried at which its deadline falls together with
    another's, which are the only ones that matter.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps for all tasks together.
    """
    tasks, budget = check_names(tasks), Budget("EDF response times")
    if _level(tasks) > 0:
        return {task.name: None for task in tasks}
    busy = _busy(tasks, budget)
    worst: dict[str, int | None] = {}
    for task in tasks:
        # at U = 1 with jitter the busy period never ends; the responses repeat once all tasks take part
        last = busy
        if last is None:
            last = lcm(*(t.period for t in tasks)) + max(0, max(_room(t) for t in tasks) - task.deadline)
        budget.spend(sum(last // t.period + 1 for t in tasks))
        arrivals = {arrival for other in tasks for arrival in range(_first_arrival(other, task), last, other.period)}
        worst[task.name] = max(_job_response(tasks, task, arrival, budget) for arrival in arrivals | {-task.jitter})
    return worst


def _level(tasks: Sequence[PeriodicTask]) -> int:
    """Utilisation below (-1), at (0) or above 1 (1)."""
    return compared_to_one([(task.wcet, task.period) for task in tasks])


def _first_arrival(other: PeriodicTask, task: PeriodicTask) -> int:
    """First arrival of `task` from -J on whose deadline is one of the deadlines of `other`, released at 0."""
    shift = _room(other) - task.deadline
    return shift + max(0, -(-(-task.jitter - shift) // other.period)) * other.period


def _room(task: PeriodicTask) -> int:
    """Time from the latest release of a job to its deadline."""
    return task.deadline - task.jitter


def _overload(tasks: Sequence[PeriodicTask], test: str) -> Verdict | None:
    if _level(tasks) > 0:
        return Verdict(False, test, f"utilisation {float(utilization(tasks)):.4f} exceeds 1", True)
    late = next((task for task in tasks if task.wcet > _room(task)), None)
    if late is not None:
        why = f"task {late.name!r}: jitter {late.jitter} and wcet {late.wcet} exceed its deadline {late.deadline}"
        return Verdict(False, test, f"{why} by {late.wcet - _room(late)}", True)
    return None


def _horizon(tasks: Sequence[PeriodicTask], budget: Budget) -> int:
    """No deadline after this one need be checked, for a set with U <= 1."""
    limit = demand_limit(tasks)
    if limit is not None:
        return int(limit)
    busy = _busy(tasks, budget)
    return busy if busy is not None else lcm(*(t.period for t in tasks)) + max(_room(t) for t in tasks)


def _deadlines(tasks: Sequence[PeriodicTask], last: int) -> Iterator[int]:
    """All absolute deadlines up to `last` of a set released together at 0, in order, each once."""
    before = 0
    for time in merge(*(count(_room(task), task.period) for task in tasks)):
        if time > last:
            return
        if time > before:
            yield time
            before = time


def _deadline_up_to(tasks: Sequence[PeriodicTask], last: int) -> int | None:
    ends = [_room(t) + (last - _room(t)) // t.period * t.period for t in tasks if _room(t) <= last]
    return max(ends, default=None)


def _exceeded(test: str, demand: int, time: int, tasks: Sequence[PeriodicTask]) -> Verdict:
    exact = not any(task.offset for task in tasks)
    return Verdict(False, test, f"{demand} must be done within {time} after a common release, {demand - time} too much", exact)
