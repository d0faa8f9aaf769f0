"""What a person types as a number, and how near it is."""

from __future__ import annotations

import math
import re
from typing import Any

from labkit.experiment import Metric

#: Seconds in a unit of time.
TIMES = {"ns": 1e-9, "us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
RIGHT, NEAR = 0.01, 0.1  # relative distance to the answer

_NUMBER = re.compile(r"([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:e[+-]?\d+)?)\s*(.*)", re.IGNORECASE | re.DOTALL)


def read_number(text: str, unit: str) -> float | str:
    """The number in `unit` that a text says: `13`, `13 ms`, `1,5`, `0.013 s`; "" of an empty one.

    Raises ValueError with a sentence for everything else: no number, not finite, another unit, a negative time, `1,000` (one or
    a thousand?).
    """
    squeezed = re.sub(r"(?<=\d)[ \u00a0\u202f](?=\d{3}\b)", "", text.strip())  # thousands apart
    if not squeezed:
        return ""
    found = _NUMBER.fullmatch(squeezed)
    wanted = f"13 or 13 {unit}" if unit else "13 or 1.5"
    if not found:
        raise ValueError(f"{text.strip()[:40]!r} is no number that can be compared; write it like {wanted}.")
    digits, behind = found[1], found[2].strip()
    if re.fullmatch(r"[+-]?\d{1,3},\d{3}", digits):
        plain = digits.replace(",", "")
        raise ValueError(f"{digits} could be {plain} or {digits.replace(',', '.')}; write it with a point or without the comma.")
    value = float(digits.replace(",", "."))
    if behind and behind != unit:
        if behind not in TIMES or unit not in TIMES:
            raise ValueError(
                f"The answer is {f'in {unit}' if unit else 'a bare number'}, not in {behind[:20]!r}; write {wanted}."
            )
        value *= TIMES[behind] / TIMES[unit]
    if not math.isfinite(value):
        raise ValueError("The answer is a finite number.")
    if value < 0 and unit in TIMES:
        raise ValueError("A time that something takes is not negative.")
    return value


def judge(guess: float | str, m: Metric) -> str:
    """How near a guess is, in words that begin with `right`, `near`, `too low`, `too high` or `the model disagrees`."""
    if guess == "":
        return "not guessed"
    if isinstance(guess, str) or not _is_number(m.value):
        return "right" if guess == m.value else "the model disagrees"
    assert isinstance(m.value, int | float)
    off = abs(guess - m.value)
    if off <= RIGHT * abs(m.value):
        return "right"
    if off <= NEAR * abs(m.value):
        return f"near, within {NEAR:.0%}"
    return "too low" if guess < m.value else "too high"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
