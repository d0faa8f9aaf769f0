"""Tests that need nothing but utilisations: quick, and pessimistic except for EDF with D >= T.

`..._test` answers for one task set, exactly and in words; `accept_...` answers for arrays of sets at once, for acceptance curves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np

from labkit.scheduler.analysis.shares import compared_to_one, product, total
from labkit.scheduler.analysis.verdict import Verdict
from labkit.scheduler.tasksets import PeriodicTask, check_names

NEAR = 1e-9  #: float results this close to a bound are decided again in fractions


def liu_layland_bound(tasks: int) -> float:
    """n (2^(1/n) - 1), up to which rate-monotonic priorities never miss (Liu and Layland 1973, theorem 5)."""
    if tasks < 1:
        raise ValueError(f"the bound is for at least 1 task, not {tasks}")
    return tasks * (2 ** (1 / tasks) - 1)


def hyperbolic_bound(utilizations: Iterable[float]) -> float:
    """Product of (U_i + 1), which rate-monotonic sets keep to when it is at most 2 (Bini, Buttazzo and Buttazzo 2003)."""
    return float(np.prod([u + 1 for u in utilizations]))


def density(task: PeriodicTask) -> Fraction | None:
    """C / (min(D, T) - J), in place of C / T in the bounds below; None if the jitter leaves no time.

    A task asks for no more than one without jitter whose period and deadline are min(D, T) - J: for w > 0,
    ceil((w + J) / T) <= ceil(w / (T - J)). So a bound for D = T holds with densities for any set.
    """
    room = min(task.deadline, task.period) - task.jitter
    return Fraction(task.wcet, room) if room > 0 else None


def liu_layland_test(tasks: Iterable[PeriodicTask]) -> Verdict:
    """Sufficient for rate-monotonic priorities, or deadline-monotonic ones where D < T; whatever the order of the list."""
    tasks = check_names(tasks)
    densities = _densities(tasks, "Liu-Layland")
    if isinstance(densities, Verdict):
        return densities
    used, count = total(densities), len(tasks)
    fits = _within_liu_layland(used, count)
    relation = "is within" if fits else "exceeds"
    why = f"utilisation {float(used):.4f} {relation} {liu_layland_bound(count):.4f} for {count} task{'s'[: count > 1]}"
    return _sufficient(fits, "Liu-Layland", why, tasks)


def _within_liu_layland(used: Fraction, count: int) -> bool:
    """U <= n (2^(1/n) - 1), exact: as many digits as it takes to tell a fraction from an irrational number."""
    if count == 1:
        return used <= 1
    digits = 30
    while True:
        with localcontext(prec=digits + 10):
            gap = count * (2 ** (1 / Decimal(count)) - 1) - Decimal(used.numerator) / Decimal(used.denominator)
            if abs(gap) > Decimal(10) ** -digits * count:
                return gap > 0
        digits *= 2


def hyperbolic_test(tasks: Iterable[PeriodicTask]) -> Verdict:
    """Sufficient for the same priorities as `liu_layland_test`, and accepts every set that one does."""
    tasks = check_names(tasks)
    densities = _densities(tasks, "hyperbolic")
    if isinstance(densities, Verdict):
        return densities
    grown = product(u + 1 for u in densities)
    fits = grown <= 2
    why = f"the product of all (U + 1) is {float(grown):.4f}, {'within' if fits else 'above'} 2"
    return _sufficient(fits, "hyperbolic", why, tasks)


def edf_utilization_test(tasks: Iterable[PeriodicTask]) -> Verdict:
    """EDF meets all deadlines if the densities add up to at most 1; exact for D = T without jitter (Liu and Layland, theorem 7).

    For D > T without jitter, too, as the density is then the utilisation.
    """
    tasks = check_names(tasks)
    densities = _densities(tasks, "EDF utilisation")
    if isinstance(densities, Verdict):
        return densities
    used = total(densities)
    fits = used <= 1
    why = f"utilisation {float(used):.4f} {'is within' if fits else 'exceeds'} 1"
    return _sufficient(fits, "EDF utilisation", why, tasks)


def _densities(tasks: Sequence[PeriodicTask], test: str) -> list[Fraction] | Verdict:
    """The density of each task, or the rejection of the first that has none."""
    found = []
    for task in tasks:
        share = density(task)
        if share is None:
            why = (
                f"task {task.name!r}: jitter {task.jitter} leaves no time before its deadline {task.deadline} or its next arrival"
            )
            return Verdict(False, test, why, task.wcet + task.jitter > task.deadline)
        found.append(share)
    return found


def _sufficient(fits: bool, test: str, why: str, tasks: list[PeriodicTask]) -> Verdict:
    """A rejection proves something only where more than the whole processor is asked for."""
    overload = compared_to_one([(task.wcet, task.period) for task in tasks]) > 0
    if fits or overload:
        return Verdict(fits, test, why, overload)
    return Verdict(fits, test, f"{why}; that proves no miss, only that this test cannot tell", False)


def accept_liu_layland(wcets: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Liu-Layland for integer arrays of shape (sets, tasks), D = T; bool array of shape (sets,), exact."""
    count = np.shape(wcets)[1]
    gap = liu_layland_bound(count) - (wcets / periods).sum(axis=1)
    return _decide(gap, wcets, periods, lambda us: _within_liu_layland(total(us), count))


def accept_hyperbolic(wcets: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Hyperbolic bound for integer arrays of shape (sets, tasks), D = T; bool array of shape (sets,), exact."""

    gap = 2 - (wcets / periods + 1).prod(axis=1)
    return _decide(gap, wcets, periods, lambda us: product(u + 1 for u in us) <= 2)


def accept_edf(wcets: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Sum of C / T <= 1 for integer arrays of shape (sets, tasks); bool array of shape (sets,), exact.

    With min(D, T) in place of the periods it is the density test.
    """
    return _decide(1 - (wcets / periods).sum(axis=1), wcets, periods, lambda us: total(us) <= 1)


def _decide(gap: np.ndarray, wcets: np.ndarray, periods: np.ndarray, exactly: Callable[[list[Fraction]], bool]) -> np.ndarray:
    accepted = gap >= 0
    for row in np.flatnonzero(np.abs(gap) < NEAR):
        accepted[row] = exactly([Fraction(int(c), int(t)) for c, t in zip(wcets[row], periods[row], strict=True)])
    return accepted
