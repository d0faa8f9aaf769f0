"""What a periodic task set is, and how to draw one at random."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from labkit.checks import whole

Kind = TypeVar("Kind", "PeriodicTask", "TaskPair", "PeriodicTask | TaskPair")


def _settle(task: Any, **least: int) -> None:
    """Fill in the deadline of a new task, and see that its times are whole numbers of at least so much each."""
    if task.deadline is None:
        object.__setattr__(task, "deadline", task.period)
    for field, bound in least.items():
        object.__setattr__(task, field, whole(getattr(task, field), bound, f"task {task.name!r}: {field}"))


@dataclass(frozen=True)
class PeriodicTask:
    """One periodic (or sporadic) task. All times are whole numbers of one unit, whichever the caller chose.

    Attributes:
        name: unique within a task set.
        wcet: C, the longest execution time of one job, alone on the processor.
        period: T, the (least) distance between two arrivals.
        deadline: D, relative to the arrival; the period if not given; it may exceed the period.
        jitter: J, the longest delay between a job's arrival and its release (no job being released before an older one of its
            task). Response times and deadlines count from the arrival.
        offset: arrival of the first job. A simulation uses it; the analyses assume the worst offsets.
    """

    name: str
    wcet: int
    period: int
    deadline: int = None  # type: ignore[assignment]  # given as None; an int in every task there is
    jitter: int = 0
    offset: int = 0

    def __post_init__(self) -> None:
        _settle(self, wcet=1, period=1, deadline=1, jitter=0, offset=0)
        if self.wcet > self.deadline:
            over = self.wcet - self.deadline
            raise ValueError(f"task {self.name!r}: wcet {self.wcet} exceeds its deadline {self.deadline} by {over}")


@dataclass(frozen=True)
class TaskPair:
    """One periodic TAFT task: a main part that may be aborted, and an exception part that then runs instead.

    Attributes:
        name, period, offset: as in `PeriodicTask`.
        deadline: as there, but not above the period.
        ecet: expected execution time of the main part, the time it is guaranteed before an abort.
        ep_wcet: longest execution time of the exception part; 0 if an abort needs no cleaning up.
    """

    name: str
    ecet: int
    ep_wcet: int
    period: int
    deadline: int = None  # type: ignore[assignment]  # given as None; an int in every task there is
    offset: int = 0

    def __post_init__(self) -> None:
        _settle(self, ecet=1, ep_wcet=0, period=1, deadline=1, offset=0)
        if self.deadline > self.period:
            raise ValueError(f"task {self.name!r}: deadline {self.deadline} exceeds its period {self.period}; a pair's must not")
        over = self.ecet + self.ep_wcet - self.deadline
        if over > 0:
            parts = f"ecet {self.ecet} and ep_wcet {self.ep_wcet}"
            raise ValueError(f"task {self.name!r}: {parts} exceed its deadline {self.deadline} by {over}")


def check_names(tasks: Iterable[Kind]) -> list[Kind]:
    """The tasks as a list; ValueError if there are none or if two share a name."""
    tasks = list(tasks)
    if not tasks:
        raise ValueError("a task set needs at least one task")
    seen: set[str] = set()
    for task in tasks:
        if task.name in seen:
            raise ValueError(f"two tasks are called {task.name!r}; names must be unique")
        seen.add(task.name)
    return tasks


def rate_monotonic(tasks: Iterable[PeriodicTask]) -> list[PeriodicTask]:
    """The tasks in rate-monotonic priority order, highest first; equal periods keep their order."""
    return sorted(tasks, key=lambda task: task.period)


def deadline_monotonic(tasks: Iterable[PeriodicTask]) -> list[PeriodicTask]:
    """The tasks in order of D - J, highest priority first; equals keep their order.

    Without jitter this is the deadline-monotonic order, optimal for D <= T (Leung and Whitehead 1982); with release
    jitter D - J is (Zuhily and Burns 2007).
    """
    return sorted(tasks, key=lambda task: task.deadline - task.jitter)


def uunifast(tasks: int, utilization: float, sets: int, rng: np.random.Generator) -> np.ndarray:
    """Random utilisations, float array of shape (sets, tasks), each row adding up to `utilization`.

    Rows are uniform over the simplex (Bini and Buttazzo 2005, UUniFast), drawn for all sets at once. With a utilisation above 1 a
    single task may exceed 1.
    """
    tasks, sets = whole(tasks, 1, "the number of tasks in a set"), whole(sets, 0, "the number of sets")
    if not utilization > 0:
        raise ValueError(f"total utilisation is {utilization}; it must be above 0")
    exponents = 1 / np.arange(tasks - 1, 0, -1)
    rest = utilization * np.cumprod(rng.random((sets, tasks - 1)) ** exponents, axis=1)
    ends = np.hstack([np.full((sets, 1), utilization), rest, np.zeros((sets, 1))])
    return ends[:, :-1] - ends[:, 1:]


def log_uniform_periods(tasks: int, sets: int, low: int, high: int, rng: np.random.Generator) -> np.ndarray:
    """Whole periods from `low` to `high`, both included, int64 of shape (sets, tasks); all orders of magnitude equally likely."""
    if not 1 <= low <= high:
        raise ValueError(f"periods from {low} to {high}: the lower end must be at least 1 and not above the upper one")
    return np.exp(rng.uniform(np.log(low), np.log(high + 1), (sets, tasks))).astype(np.int64).clip(low, high)


def whole_wcets(utilizations: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Execution times nearest to u T, at least 1, int64; the total utilisation moves by at most half a unit per task's period."""
    return np.rint(utilizations * periods).astype(np.int64).clip(1)


def as_tasks(wcets: Iterable[int], periods: Iterable[int], deadlines: Iterable[int] | None = None) -> list[PeriodicTask]:
    """One row of a drawn array as tasks named t1, t2, ... in rate-monotonic order (deadline-monotonic if deadlines are given)."""
    periods = list(periods)
    rows = zip(wcets, periods, periods if deadlines is None else deadlines, strict=True)
    tasks = [PeriodicTask(f"t{i}", int(c), int(t), int(d)) for i, (c, t, d) in enumerate(rows, start=1)]
    return rate_monotonic(tasks) if deadlines is None else deadline_monotonic(tasks)
