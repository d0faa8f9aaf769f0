"""Reader of recorded scans, from anybody's scanner: CSV, and the log files of CARMEN.

- CSV: `time_ms`, then the ranges in metres from right to left, one scan per line; a header and comments (#) are left out. The
  beams are spread evenly over the field of view.
- CARMEN (one message per line): `FLASER` with the laser's pose, over 180 degrees, from -90 in steps of 180 / n if the number n of
  ranges is even and of 180 / (n - 1) if it is odd; `ROBOTLASER1`, which states its angles and its range. Other messages are
  counted and left out.

A range that is empty, nan, infinite, not above 0, or not below the scanner's range means that nothing came back. A line that is
cut, has another length than most, or whose time is negative or that of another scan, is left out and told. Scans come in order of
time; a line in the wrong place is sorted and told. A log has one time per scan, so all beams of it have the same.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass

import numpy as np

from labkit.fusion.laser.formats import Pose, Scan
from labkit.trace import Problem

MOST_BYTES, MOST_SCANS, MOST_VALUES, MOST_TOLD = 64 << 20, 200_000, 8_000, 1_000
LATEST_S = 4e9  # of a time stamp, which may count from 1970
FURTHEST = 1e6  # m, of a pose
HERE = Pose(0.0, 0.0)
NOTHING = {"", "nan", "inf", "+inf", "-inf", "infinity", "-"}


@dataclass(frozen=True)
class ScanReport:
    """What the reader met: every line is a scan, something else, empty, or rejected.

    Attributes:
        source: name of the file.
        lines, scans, other, empty, rejected: counts; `other` are headers, comments and other messages.
        moved: scans that stood behind a later one.
        problems: what was rejected or moved, by line; at most the first `MOST_TOLD`.
    """

    source: str
    lines: int
    scans: int
    other: int
    empty: int
    rejected: int
    moved: int
    problems: tuple[Problem, ...]

    def __str__(self) -> str:
        counts = f"{self.source}: {self.lines} lines, {self.scans} scans, {self.rejected} rejected, {self.moved} moved, "
        told = [f"  {problem}" for problem in self.problems[:20]]
        more = self.rejected + self.moved - len(told)
        return "\n".join(
            [f"{counts}{self.other} other, {self.empty} empty", *told, *([f"  and {more} more"] if more > 0 else [])]
        )


@dataclass(frozen=True, eq=False)
class _Line:
    """A scan as read: its line, time, pose, beam angles as (first, step), and ranges."""

    number: int
    time_ns: int
    pose: Pose
    first: float
    step: float
    ranges: np.ndarray


class _Wrong(Exception):
    """What is wrong with a line, in words."""


def read_scans(
    path: str | os.PathLike[str], station: str = "log", view_deg: float = 180.0, range_m: float = 80.0, pose: Pose = HERE
) -> tuple[list[Scan], ScanReport]:
    """Scans of a CSV file or a CARMEN log, in order of time, and what the reader met.

    Args:
        path: a file of at most 64 MiB, 200 000 scans and 8 000 ranges per scan.
        station: name that the scans get.
        view_deg: field of view of a CSV file, half of it on either side of the heading.
        range_m: from which distance on nothing came back; `ROBOTLASER1` states its own, if that is less.
        pose: where the scanner of a CSV file stood; CARMEN states its own.
    Raises:
        ValueError: there is no scan in the file, it is too long, or a setting is impossible.
        OSError: the file cannot be read.
    """
    if not 0 < view_deg <= 360 or not 0 < range_m < np.inf:
        raise ValueError(f"view_deg is {view_deg!r} and range_m {range_m!r}; above 0, and up to 360 degrees, is allowed")
    with open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path} is longer than {MOST_BYTES >> 20} MiB, the largest scan log that is read")
    texts = data.decode("utf-8-sig", "replace").split("\n")
    if texts and not texts[-1]:
        texts.pop()
    carmen = any(text.startswith(("FLASER ", "ROBOTLASER1 ")) for text in texts)
    read: list[_Line] = []
    rejected: list[Problem] = []
    other = empty = 0
    for number, text in enumerate(texts, start=1):
        words = text.split() if carmen else [cell.strip() for cell in text.split(",")]
        if not text.strip():
            empty += 1
        elif text.startswith(("#", "//")) or _is_other(words, carmen, not read):
            other += 1
        else:
            try:
                read.append(_carmen(number, words, range_m) if carmen else _csv(number, words, view_deg, range_m, pose))
            except _Wrong as wrong:
                rejected.append(Problem(number, str(wrong), "rejected", "left out"))
            if len(read) > MOST_SCANS:
                raise ValueError(f"{path} has more scans than {MOST_SCANS}, the most that are read")
    kept, moved = _in_order(_same_length(read, rejected), rejected)
    if not kept:
        hint = f"; {rejected[0]}" if rejected else ""
        raise ValueError(
            f"{path} has no scan: a line is time_ms and ranges with commas, or a FLASER or ROBOTLASER1 message{hint}"
        )
    problems = sorted([*rejected, *moved], key=lambda problem: problem.line)[:MOST_TOLD]
    report = ScanReport(
        os.path.basename(os.fspath(path)), len(texts), len(kept), other, empty, len(rejected), len(moved), tuple(problems)
    )
    return _scans(kept, station), report


def _is_other(words: list[str], carmen: bool, first: bool) -> bool:
    """A message that is no scan, or the header of a CSV file."""
    if carmen:
        return words[0] not in ("FLASER", "ROBOTLASER1")
    return first and words[0] == "time_ms"


def _number(word: str, what: str) -> float:
    try:
        if not word.isascii() or "_" in word:
            raise ValueError
        return float(word)
    except ValueError:
        raise _Wrong(f"{what} is {word[:30]!r}, no number") from None


def _time(seconds: float) -> int:
    if not 0 <= seconds <= LATEST_S:
        raise _Wrong(f"the time is {seconds:.15g} s; 0 to {LATEST_S:.0f} s is allowed")
    return round(seconds * 1_000_000_000)


def _ranges(words: list[str], range_m: float) -> np.ndarray:
    if not 1 <= len(words) <= MOST_VALUES:
        raise _Wrong(f"there are {len(words)} ranges; 1 to {MOST_VALUES} are allowed")
    found = np.array(
        [np.inf if word.lower() in NOTHING else _number(word, f"range {i}") for i, word in enumerate(words, start=1)]
    )
    return np.where((found > 0) & (found < range_m), found, np.inf)


def _csv(number: int, words: list[str], view_deg: float, range_m: float, pose: Pose) -> _Line:
    time_ns = _time(_number(words[0], "time_ms") / 1000)
    ranges = _ranges(words[1:], range_m)
    half = np.deg2rad(view_deg) / 2
    step = 2 * half / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    return _Line(number, time_ns, pose, -half if len(ranges) > 1 else 0.0, step, ranges)


def _carmen(number: int, words: list[str], range_m: float) -> _Line:
    flaser = words[0] == "FLASER"
    head = 1 if flaser else 8  # where the number of ranges stands
    if len(words) <= head:
        raise _Wrong(f"{words[0]} ends before its number of ranges")
    count = _count(words[head], "the number of ranges")
    after = head + 1 + count
    more = 0
    if not flaser:
        if len(words) <= after:
            raise _Wrong(f"ROBOTLASER1 announces {count} ranges and ends before their end")
        more = 1 + _count(words[after], "the number of remissions")
    wanted = after + more + (9 if flaser else 14)
    if len(words) != wanted:
        raise _Wrong(f"{words[0]} with {count} ranges has {len(words)} words instead of {wanted}")
    x, y, heading = (_number(word, "the pose") for word in words[after + more : after + more + 3])
    if not max(abs(x), abs(y), abs(heading)) <= FURTHEST:
        raise _Wrong(f"the pose is {x:g}, {y:g}, {heading:g}; numbers up to {FURTHEST:g} are allowed")
    if flaser:
        first, step = -np.pi / 2, np.pi / max(1, count - count % 2)
    else:
        first, _, step, stated = (_number(word, "an angle or range") for word in words[2:6])
        if not (abs(first) <= 2 * np.pi and 0 < step <= np.pi and stated > 0):
            raise _Wrong(f"ROBOTLASER1 starts at {first:g} rad with steps of {step:g} rad and a range of {stated:g} m")
        range_m = min(range_m, stated)
    return _Line(
        number,
        _time(_number(words[-3], "ipc_timestamp")),
        Pose(x, y, heading),
        first,
        step,
        _ranges(words[head + 1 : after], range_m),
    )


def _count(word: str, what: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 7):
        raise _Wrong(f"{what} is {word[:30]!r}, no number of at most six digits")
    return int(word)


def _same_length(read: list[_Line], rejected: list[Problem]) -> list[_Line]:
    """Those with as many ranges as most have."""
    lengths = Counter(len(line.ranges) for line in read)
    usual = max(lengths, key=lambda n: (lengths[n], n), default=0)
    for line in read:
        if len(line.ranges) != usual:
            what = f"there are {len(line.ranges)} ranges, {usual} in most lines"
            rejected.append(Problem(line.number, what, "rejected", "left out"))
    return [line for line in read if len(line.ranges) == usual]


def _in_order(read: list[_Line], rejected: list[Problem]) -> tuple[list[_Line], list[Problem]]:
    """In order of time, of several at one time the first; also what stood in the wrong place."""
    kept: list[_Line] = []
    moved, latest, times = [], -1, set[int]()
    for line in read:
        if line.time_ns in times:
            what = f"the time {line.time_ns / 1e9:.6f} s is that of an earlier line"
            rejected.append(Problem(line.number, what, "rejected", "left out"))
            continue
        if line.time_ns < latest:
            what = f"the time goes back by {(latest - line.time_ns) / 1e9:.6f} s"
            moved.append(Problem(line.number, what, "repaired", "sorted by time"))
        latest = max(latest, line.time_ns)
        times.add(line.time_ns)
        kept.append(line)
    return sorted(kept, key=lambda line: line.time_ns), moved


def _scans(read: list[_Line], station: str) -> list[Scan]:
    """Angles are shared by all lines that agree in them."""
    angles: dict[tuple[float, float], np.ndarray] = {}
    unknown = np.full(len(read[0].ranges), -1)
    made = []
    for line in read:
        beams = angles.setdefault((line.first, line.step), line.first + line.step * np.arange(len(unknown)))
        times = np.broadcast_to(np.int64(line.time_ns), len(unknown))
        made.append(Scan(station, line.time_ns, line.pose, beams, line.ranges, times, unknown, line.time_ns))
    return made
