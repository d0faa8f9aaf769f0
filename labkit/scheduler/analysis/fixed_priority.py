"""Response-time analysis of fixed-priority preemptive scheduling on one processor.

Integers only, so every answer is exact. The tasks are given in priority order, highest first, each with a priority of its own.

What is left out: tasks that share a priority (FreeRTOS slices the processor among them), jobs that suspend themselves between
release and completion other than on a lock, and known offsets: all tasks are assumed to be released together, which is the worst.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, lcm

from labkit.scheduler.analysis.verdict import UndecidedError, Verdict
from labkit.scheduler.tasksets import PeriodicTask, check_names

MAX_STEPS = 1_000_000  #: steps of one fixed-point iteration, and jobs of one busy period, before `UndecidedError`


@dataclass(frozen=True)
class Overheads:
    """What the kernel itself takes from the processor, in the unit of the tasks.

    Attributes:
        switch: cost of a context switch. Each job is charged two: one to it and one away from it.
        tick: cost of the tick interrupt, which preempts every task; `tick_period` is the distance between two ticks.
        job: cost of the kernel calls of one job, such as the delay_until that ends it.
        section: longest stretch in which the kernel keeps interrupts off (a switch or call of any task); it delays each
            release once.
    """

    switch: int = 0
    tick: int = 0
    tick_period: int = 0
    job: int = 0
    section: int = 0

    def __post_init__(self) -> None:
        for field, value in vars(self).items():
            if not isinstance(value, int) or value < 0:
                raise ValueError(f"overhead {field} is {value!r}; it must be a whole number of time units, at least 0")
        if self.tick and not self.tick_period:
            raise ValueError("a tick cost needs a tick_period above 0")


NO_OVERHEADS = Overheads()


def utilization(tasks: Iterable[PeriodicTask]) -> Fraction:
    """Sum of C / T, exact."""
    return sum((Fraction(task.wcet, task.period) for task in tasks), Fraction(0))


def least_window(base: int, load: Sequence[tuple[int, int, int]]) -> int | None:
    """Least w > 0 with w = base + sum of ceil((w + J) / T) C over `load`, rows of (C, T, J); None if there is none.

    This one equation gives response times, busy periods and blocking times. It starts from the bound that follows from
    ceil(x) >= x, so that it is quick even near full load.
    """
    used = sum((Fraction(c, t) for c, t, _ in load), Fraction(0))
    carried = base + sum((Fraction(c * j, t) for c, t, j in load), Fraction(0))
    if used > 1 or (used == 1 and carried > 0):
        return None
    window = base + sum(c for c, _, _ in load)
    if used < 1:
        window = max(window, ceil(carried / (1 - used)))
    for _ in range(MAX_STEPS):
        wider = base + sum(-(-(window + j) // t) * c for c, t, j in load)
        if wider == window:
            return window
        window = wider
    raise UndecidedError(f"no answer after {MAX_STEPS} steps; at a utilisation of {float(used):.9f} the window grows too slowly")


def job_responses(
    tasks: Iterable[PeriodicTask],
    name: str,
    *,
    blocking: Mapping[str, int | None] | None = None,
    overheads: Overheads = NO_OVERHEADS,
) -> tuple[int, ...] | None:
    """Worst response time, counted from the arrival, of each job of task `name` in its longest busy period.

    Job q of the level-i busy period ends at the least w_q = B + (q + 1) C + sum over higher tasks of ceil((w_q + J_j) / T_j) C_j.
    Its response is w_q - q T + J, and the period is over at the first q with w_q <= (q + 1) T - J (Lehoczky 1990; Tindell,
    Burns and Wellings 1994). A task whose first response is at most T has just that one entry.

    Args:
        tasks: in priority order, highest first.
        blocking: name -> longest time that lower tasks hold this one up (`blocking_bounds`); None in it means without bound.

    Returns:
        The responses in order of the jobs, or None if they have no bound (utilisation at this level above 1, or
        unbounded blocking). At a utilisation of exactly 1 a busy period may never end; the responses then repeat, and one
        round is returned.

    Raises:
        ValueError: unknown name, or two tasks with one name.
        UndecidedError: more than `MAX_STEPS` jobs or steps.
    """
    tasks = check_names(tasks)
    names = [task.name for task in tasks]
    for wanted in {name, *(blocking or {})}:
        if wanted not in names:
            raise ValueError(f"no task {wanted!r} in this set; it has {', '.join(names)}")
    held = (blocking or {}).get(name, 0)
    rank = names.index(name)
    task, cost = tasks[rank], _charge(tasks[rank], overheads)
    load = [(_charge(t, overheads), t.period, t.jitter) for t in tasks[:rank]]
    if overheads.tick:
        load.append((overheads.tick, overheads.tick_period, 0))
    level = Fraction(cost, task.period) + sum(Fraction(c, t) for c, t, _ in load)
    if held is None or level > 1:
        return None
    rounds = lcm(task.period, *(t for _, t, _ in load)) // task.period if level == 1 else MAX_STEPS + 1
    responses: list[int] = []
    for job in range(rounds):
        if job == MAX_STEPS:
            raise UndecidedError(f"task {name!r}: more than {MAX_STEPS} jobs in one busy period")
        window = least_window(held + overheads.section + (job + 1) * cost, load)
        responses.append(window - job * task.period + task.jitter)
        if window <= (job + 1) * task.period - task.jitter:
            break
    return tuple(responses)


def response_times(
    tasks: Iterable[PeriodicTask], *, blocking: Mapping[str, int | None] | None = None, overheads: Overheads = NO_OVERHEADS
) -> dict[str, int | None]:
    """Worst response time of each task, counted from the arrival; None where there is no bound. See `job_responses`."""
    tasks = check_names(tasks)
    jobs = {task.name: job_responses(tasks, task.name, blocking=blocking, overheads=overheads) for task in tasks}
    return {name: None if responses is None else max(responses) for name, responses in jobs.items()}


def response_time_test(
    tasks: Iterable[PeriodicTask], *, blocking: Mapping[str, int | None] | None = None, overheads: Overheads = NO_OVERHEADS
) -> Verdict:
    """Compare every worst response time with its deadline.

    Exact without blocking, overheads and offsets (those are bounds, not certainties).
    """
    tasks = check_names(tasks)
    exact = not any((blocking or {}).values()) and overheads == NO_OVERHEADS and not any(task.offset for task in tasks)
    responses = response_times(tasks, blocking=blocking, overheads=overheads)
    late = [_late(task, responses[task.name]) for task in tasks if _misses(task, responses[task.name])]
    if late:
        return Verdict(False, "response time", "; ".join(late), exact)
    tightest = min(tasks, key=lambda task: task.deadline - responses[task.name])
    answer = f"every response time is within its deadline; the closest is {tightest.name!r}"
    return Verdict(True, "response time", f"{answer} with {responses[tightest.name]} of {tightest.deadline}", exact)


def _charge(task: PeriodicTask, overheads: Overheads) -> int:
    return task.wcet + 2 * overheads.switch + overheads.job


def _misses(task: PeriodicTask, response: int | None) -> bool:
    return response is None or response > task.deadline


def _late(task: PeriodicTask, response: int | None) -> str:
    if response is None:
        return f"task {task.name!r}: response time without bound, deadline {task.deadline}"
    return f"task {task.name!r}: response time {response} exceeds the deadline {task.deadline} by {response - task.deadline}"
