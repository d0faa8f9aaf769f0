"""Response-time analysis of fixed-priority preemptive scheduling on one processor.

Integers only, so every answer is exact. The tasks are given in priority order, highest first, each with a priority of its own.

What is left out: tasks that share a priority (FreeRTOS slices the processor among them), jobs that suspend themselves between
release and completion other than on a lock, and known offsets: all tasks are assumed to be released together, which is the worst.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm

from labkit.checks import whole
from labkit.scheduler.analysis.shares import ONE, compared_to_one, total
from labkit.scheduler.analysis.verdict import Budget, Verdict
from labkit.scheduler.tasksets import PeriodicTask, check_names


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
            object.__setattr__(self, field, whole(value, 0, f"overhead {field}"))
        if self.tick and not self.tick_period:
            raise ValueError("a tick cost needs a tick_period above 0")


NO_OVERHEADS = Overheads()


def utilization(tasks: Iterable[PeriodicTask]) -> Fraction:
    """Sum of C / T, exact."""
    return total(Fraction(task.wcet, task.period) for task in tasks)


def least_window(base: int, load: Sequence[tuple[int, int, int]], budget: Budget) -> int | None:
    """Least w > 0 with w = base + sum of ceil((w + J) / T) C over `load`, rows of (C, T, J); None if there is none.

    This one equation gives response times, busy periods and blocking times. It starts from the bound that follows from
    ceil(x) >= x, so that it is quick even near full load.

    Raises:
        UndecidedError: the steps of `budget`, one for each row and one more in each round, do not suffice.
    """
    budget.spend(1 + 4 * len(load))  # long integers below
    level = compared_to_one([(c, t) for c, t, _ in load])
    if level > 0 or (level == 0 and (base > 0 or any(j for _, _, j in load))):
        return None
    window = base + sum(c for c, _, _ in load)
    spare = ONE - sum(c * ONE // t for c, t, _ in load)
    if spare > 0:  # (base + sum of C J / T) / (1 - U) in units of 1 / ONE, rounded so that it stays a lower bound
        window = max(window, -(-(base * ONE + sum(c * j * ONE // t for c, t, j in load)) // spare))
    while True:
        budget.spend(1 + len(load))
        wider = base + sum(-(-(window + j) // t) * c for c, t, j in load)
        if wider == window:
            return window
        window = wider


def job_responses(
    tasks: Iterable[PeriodicTask],
    name: str,
    *,
    blocking: Mapping[str, int | None] | None = None,
    overheads: Overheads = NO_OVERHEADS,
    interrupts: Iterable[PeriodicTask] = (),
) -> tuple[int, ...] | None:
    """Worst response time, counted from the arrival, of each job of task `name` in its longest busy period.

    Job q of the level-i busy period ends at the least w_q = B + (q + 1) C + sum over higher tasks of ceil((w_q + J_j) / T_j) C_j.
    Its response is w_q - q T + J, and the period is over at the first q with w_q <= (q + 1) T - J (Lehoczky 1990; Tindell,
    Burns and Wellings 1994). A task whose first response is at most T has just that one entry.

    Args:
        tasks: in priority order, highest first.
        blocking: name -> longest time that lower tasks hold this one up (`blocking_bounds`); None in it means without bound.
        interrupts: device interrupts, which come before every task: `wcet` of a handler with its entry and exit, `period` the
            least distance of two of them. Their switches are in `wcet`; they are charged none.

    Returns:
        The responses in order of the jobs, or None if they have no bound (utilisation at this level above 1, or
        unbounded blocking). At a utilisation of exactly 1 a busy period may never end; the responses then repeat, and one
        round is returned.

    Raises:
        ValueError: unknown name, or two tasks with one name.
        UndecidedError: more than `MAX_STEPS` steps.
    """
    tasks = check_names(tasks)
    rank = {task.name: i for i, task in enumerate(tasks)}
    for wanted in {name, *(blocking or {})}:
        if wanted not in rank:
            raise ValueError(f"no task {wanted!r} in this set; it has {', '.join(rank)}")
    held, above = (blocking or {}).get(name, 0), _loads(interrupts)
    return level_responses(tasks, rank[name], held, overheads, Budget("response time"), above)


def level_responses(
    tasks: Sequence[PeriodicTask],
    rank: int,
    held: int | None,
    overheads: Overheads,
    budget: Budget,
    interrupts: Sequence[tuple[int, int, int]] = (),
) -> tuple[int, ...] | None:
    """`job_responses` of the task at `rank`, which lower ones hold up for `held`; interrupts as rows of (C, T, J)."""
    budget.spend(4 * rank)
    task, cost = tasks[rank], _charge(tasks[rank], overheads)
    load = [*interrupts, *((_charge(t, overheads), t.period, t.jitter) for t in tasks[:rank])]
    if overheads.tick:
        load.append((overheads.tick, overheads.tick_period, 0))
    level = compared_to_one([(cost, task.period), *((c, t) for c, t, _ in load)])
    if held is None or level > 0:
        return None
    rounds = lcm(task.period, *(t for _, t, _ in load)) // task.period if level == 0 else None
    responses: list[int] = []
    while rounds is None or len(responses) < rounds:
        job = len(responses)
        window = least_window(held + overheads.section + (job + 1) * cost, load, budget)
        if window is None:  # the tasks above take all of the processor
            return None
        responses.append(window - job * task.period + task.jitter)
        if window <= (job + 1) * task.period - task.jitter:
            break
    return tuple(responses)


def response_times(
    tasks: Iterable[PeriodicTask],
    *,
    blocking: Mapping[str, int | None] | None = None,
    overheads: Overheads = NO_OVERHEADS,
    interrupts: Iterable[PeriodicTask] = (),
) -> dict[str, int | None]:
    """Worst response time of each task, counted from the arrival; None where there is no bound. See `job_responses`.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps for all of them together.
    """
    tasks, budget = check_names(tasks), Budget("response time")
    unknown = set(blocking or {}) - {task.name for task in tasks}
    if unknown:
        raise ValueError(f"no task {min(unknown)!r} in this set; it has {', '.join(task.name for task in tasks)}")
    found: dict[str, int | None] = {}
    above = _loads(interrupts)
    for rank, task in enumerate(tasks):
        responses = level_responses(tasks, rank, (blocking or {}).get(task.name, 0), overheads, budget, above)
        found[task.name] = None if responses is None else max(responses)
    return found


def response_time_test(
    tasks: Iterable[PeriodicTask],
    *,
    blocking: Mapping[str, int | None] | None = None,
    overheads: Overheads = NO_OVERHEADS,
    interrupts: Iterable[PeriodicTask] = (),
) -> Verdict:
    """Compare every worst response time with its deadline.

    Exact without blocking, overheads and offsets (those are bounds, not certainties).
    """
    tasks, interrupts = check_names(tasks), list(interrupts)
    exact = not any((blocking or {}).values()) and overheads == NO_OVERHEADS and not any(task.offset for task in tasks)
    responses = response_times(tasks, blocking=blocking, overheads=overheads, interrupts=interrupts)
    late = [sentence for task in tasks if (sentence := _late(task, responses[task.name]))]
    if late:
        return Verdict(False, "response time", "; ".join(late), exact)
    spare = {task.name: task.deadline - (responses[task.name] or 0) for task in tasks}
    tightest = min(tasks, key=lambda task: spare[task.name])
    answer = f"every response time is within its deadline; the closest is {tightest.name!r}"
    return Verdict(True, "response time", f"{answer} with {responses[tightest.name]} of {tightest.deadline}", exact)


def _loads(interrupts: Iterable[PeriodicTask]) -> list[tuple[int, int, int]]:
    return [(each.wcet, each.period, each.jitter) for each in interrupts]


def _charge(task: PeriodicTask, overheads: Overheads) -> int:
    return task.wcet + 2 * overheads.switch + overheads.job


def _late(task: PeriodicTask, response: int | None) -> str:
    """What is wrong with this response time; nothing if it is within the deadline."""
    if response is None:
        return f"task {task.name!r}: response time without bound, deadline {task.deadline}"
    over = response - task.deadline
    return f"task {task.name!r}: response time {response} exceeds the deadline {task.deadline} by {over}" if over > 0 else ""
