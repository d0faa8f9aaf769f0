"""The one check of a whole number, and its sentence."""

from __future__ import annotations

from operator import index
from reprlib import Repr
from typing import Any

#: The bound where no other is known: beyond it, sums of times would not fit 64 bits.
UNBOUNDED = 1 << 62

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80


def whole(number: Any, least: int, what: str, most: int | None = None) -> int:
    """`number` as a Python int, if it is a whole number of at least `least`, and at most `most` if that is given.

    Numpy's whole numbers are taken, too, and become Python's: theirs overflow silently. True and False are none.

    Raises:
        ValueError: it is none or out of bounds; names `what`, the number, and what is allowed.
    """
    try:
        found = None if isinstance(number, bool) else index(number)
    except TypeError:
        found = None
    if found is None or found < least or (most is not None and found > most):
        raise ValueError(f"{what} is {shown(number if found is None else found)}; {whole_words(least, most)} is allowed")
    return found


def whole_words(least: int, most: int | None) -> str:
    """The numbers that are allowed, in words."""
    if most is None:
        return f"a whole number of at least {least}"
    bounds = [{UNBOUNDED: "2**62", -UNBOUNDED: "-2**62"}.get(bound, bound) for bound in (least, most)]
    return f"a whole number from {bounds[0]} to {bounds[1]}"


def shown(value: Any) -> str:
    """A value for an error message: its repr, in one line and cut short."""
    return _SHORT.repr(value)
