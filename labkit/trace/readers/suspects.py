"""Names that are none: two lines of a log run together where a line end was lost, or bytes that are no text.

A line such as `IDLE 5 1odom 7 1` has the form of a stamp, and its name would be a task of its own that never ends. It is told
from a task by the names that the rest of the log has: it is rare, and made of pieces of them. In a log so short that nothing in
it is frequent, a name of a single stamp is none if there is a stamp in it, or if it is made of whole names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

#: A name with a stamp in it: what stands before, and what follows the begin or end.
_STAMP_INSIDE = re.compile(r"(?P<before>.*\S)\s+\d+(?:\.\d+)?\s+[01]\s*(?P<after>\D.*)?")
_TIME_INSIDE = re.compile(r"(?P<before>.*\S)\s+\d[\d.]*\s*(?P<after>[^\d\s.].*)?")

#: A piece of a name that is cut is told from chance if it has so many characters.
_LEAST = 2
_LONGEST = 200  # characters; a longer name is not looked into

#: A name that stands for itself occurs so often, and so many times as often as what is made of it.
_OFTEN, _TIMES = 3, 5


def suspects(names: Sequence[str], counts: np.ndarray) -> dict[int, str]:
    """Codes of the names that are none, and why.

    Args:
        counts: by name, the number of stamps.
    """
    common = {name: int(count) for name, count in zip(names, counts) if count >= _OFTEN}
    starts, ends = _pieces(common, first=True), _pieces(common, first=False)
    pairs = {name for name, count in zip(names, counts) if count > 1}
    found = {}
    for code, (name, count) in enumerate(zip(names, counts.tolist())):
        if "\ufffd" in name and count == 1:
            found[code] = "has bytes that are not UTF-8, and is there only once"
        elif len(name) <= _LONGEST and (
            _run_together(name, _TIMES * count, common, starts, ends) or (count == 1 and _once_run_together(name, pairs))
        ):
            found[code] = "looks like two lines run together"
    return found


def _once_run_together(name: str, pairs: set[str]) -> bool:
    """Whether a name that is there once has a stamp in it, or is two of the names that are there more often."""
    if (parts := _STAMP_INSIDE.fullmatch(name)) and parts["after"]:
        return True
    if (parts := _TIME_INSIDE.fullmatch(name)) and {parts["before"], parts["after"]} <= pairs:
        return True
    return any(name[:at] in pairs and name[at:] in pairs for at in range(1, len(name)))


def _pieces(common: dict[str, int], first: bool) -> dict[str, int]:
    """Beginnings or ends of the common names, with the count of the most common name they are of."""
    made: dict[str, int] = {}
    for name, count in common.items():
        for at in range(_LEAST, min(len(name), _LONGEST)):
            piece = name[:at] if first else name[-at:]
            made[piece] = max(made.get(piece, 0), count)
    return made


def _run_together(name: str, least: int, common: dict[str, int], starts: dict[str, int], ends: dict[str, int]) -> bool:
    """Whether the name is one common name and the rest of a line or of another one; `least`: what counts as common."""

    def whole(text: str | None) -> bool:
        return text is not None and common.get(text, 0) >= least

    for inside in (_STAMP_INSIDE, _TIME_INSIDE):
        if (parts := inside.fullmatch(name)) and whole(parts["before"]):
            after = parts["after"]
            if inside is _STAMP_INSIDE or whole(after) or ends.get(after or "", 0) >= least:
                return True
    for at in range(1, len(name)):
        before, after = name[:at], name[at:]
        if whole(before) and (whole(after) or ends.get(after, 0) >= least):
            return True
        if whole(after) and starts.get(before, 0) >= least:
            return True
    return False
