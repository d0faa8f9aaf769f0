"""The one check of a whole number, and its sentence."""

from __future__ import annotations

from operator import index
from typing import Any


def whole(number: Any, least: int, what: str) -> int:
    """`number` as a Python int, if it is a whole number of at least `least` (numpy's are; they would overflow silently).

    Raises:
        ValueError: it is none (True and False are none either), or it is less; names `what`, the number, and what is allowed.
    """
    try:
        found = None if isinstance(number, bool) else index(number)
    except TypeError:
        found = None
    if found is None or found < least:
        shown = number if found is None else found  # a numpy integer as its plain value
        raise ValueError(f"{what} is {shown!r}; a whole number of at least {least} is allowed")
    return found
