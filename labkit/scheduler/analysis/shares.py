"""Sums of shares C / T: exact, and quick for any number of tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from operator import add, mul

#: Shares are first added up in units of 1 / ONE, each rounded down.
ONE = 1 << 64


def total(fractions: Iterable[Fraction]) -> Fraction:
    """Exact sum; by halves, so that the long denominators come last."""
    return _by_halves(add, [Fraction(0), *fractions])


def product(fractions: Iterable[Fraction]) -> Fraction:
    """Exact product, by halves."""
    return _by_halves(mul, [Fraction(1), *fractions])


def _by_halves(operation: Callable[[Fraction, Fraction], Fraction], row: list[Fraction]) -> Fraction:
    while len(row) > 1:
        row = [operation(*pair) for pair in zip(row[::2], row[1::2])] + row[len(row) // 2 * 2 :]
    return row[0]


def compared_to_one(shares: Sequence[tuple[int, int]]) -> int:
    """Whether the sum of C / T over rows (C, T) is below 1 (-1), exactly 1 (0) or above it (1).

    Fractions are needed only if the sum is as near to 1 as all roundings together.
    """
    low = sum(c * ONE // t for c, t in shares)
    if low > ONE or low + len(shares) <= ONE:  # each rounding takes less than one unit away
        return 1 if low > ONE else -1
    exact = total(Fraction(c, t) for c, t in shares)
    return (exact > 1) - (exact < 1)
