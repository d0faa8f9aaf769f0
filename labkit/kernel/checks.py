"""The one check of a whole number in the kernel's room, and its sentence."""

from __future__ import annotations

from operator import index
from typing import Any

from labkit.kernel.objects import FOREVER


def whole(number: Any, least: int, what: str, unit: str = "", most: int = FOREVER) -> int:
    """`number` as a Python int (numpy's are whole numbers, too), if it lies between `least` and `most`, both allowed.

    Errors: ValueError `{what} {number}{unit}; ... allowed`.
    """
    try:
        found = index(number)
    except TypeError:
        found = None
    if found is None or not least <= found <= most:
        if most == FOREVER:
            allowed = f"a whole number of at least {least} is"
        else:
            allowed = f"{least} to {most} are" if found is not None else f"a whole number from {least} to {most} is"
        raise ValueError(f"{what} {number!r}{unit}; {allowed} allowed")
    return found
