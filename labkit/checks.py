"""The one check of a whole number, and its sentence."""

from __future__ import annotations

from operator import index
from typing import Any


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
        shown = number if found is None else found  # a numpy integer as its plain value
        allowed = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ValueError(f"{what} is {shown!r}; a whole number {allowed} is allowed")
    return found
