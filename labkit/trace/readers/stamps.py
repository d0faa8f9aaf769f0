"""The lines of a log as columns of stamps, block by block, whatever is in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import repeat
from math import ceil

import numpy as np

from labkit.trace.readers.report import LogError, Problems, told
from labkit.trace.readers.source import Source

#: More different names than this are no names.
MOST_NAMES = 100_000

US = 1000  # nanoseconds
LONGEST = 10**18  # ns, 31 years
MOST_CORE = 999


@dataclass(frozen=True, eq=False)
class Stamps:
    """Columns of shape (n,) in the order of the lines: line from 1, time in ns, index into `names`, begin or end, core."""

    line: np.ndarray
    time: np.ndarray
    name: np.ndarray
    begin: np.ndarray
    core: np.ndarray

    def __len__(self) -> int:
        return len(self.line)

    def columns(self) -> tuple[np.ndarray, ...]:
        return self.line, self.time, self.name, self.begin, self.core

    def ordered(self, order: np.ndarray) -> Stamps:
        return Stamps(*(column[order] for column in self.columns()))

    def sorted_by_time(self) -> Stamps:
        """These stamps in order of time, those of one time as they were; themselves, if they are in order already."""
        if not np.any(self.time[1:] < self.time[:-1]):
            return self
        return self.ordered(np.argsort(self.time, kind="stable").astype(np.int32))


@dataclass
class Reading:
    """What is known of a log while its blocks are read.

    Attributes:
        limit: times from here on are impossible, in ns.
        reach: why, in words.
        names: code of every name seen.
        faults: what is wrong with every name refused.
        several: whether each stamp ends with the number of its core; decided by the first block.
    """

    limit: int
    reach: str
    problems: Problems
    names: dict[str, int] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)
    several: bool = False
    lines: int = 0
    comments: int = 0
    empty: int = 0

    @property
    def format(self) -> str:
        return "'<name> <microseconds> <1 begin | 0 end>" + (" <core>'" if self.several else "'")

    def code_of(self, name: str) -> int | None:
        """The code of a name; None if it cannot be one, which `faults` then explains."""
        code = self.names.get(name)
        if code is not None or name in self.faults:
            return code
        if fault := _name_fault(name):
            if len(self.faults) < MOST_NAMES:
                self.faults[name] = fault
            return None
        if len(self.names) == MOST_NAMES:
            raise LogError(f"line {self.lines}: {told(name)} is name number {MOST_NAMES + 1}; a log has at most {MOST_NAMES}")
        return self.names.setdefault(name, len(self.names))


def read_stamps(source: Source, wrap: Fraction | None) -> tuple[Stamps, Reading]:
    """Read all lines; `wrap` is the time in ns after which the counter goes around, None if that is not known."""
    if wrap is None:
        reading = Reading(LONGEST, "any recording lasts", Problems())
    else:  # a stamp may be rounded up
        reading = Reading(ceil(wrap) + US, "a 32-bit counter of this clock can reach", Problems())
    empty = _columns([], [], [], [], []).columns()
    columns = [bytearray() for _ in empty]  # they grow in place: lists of blocks would be there twice when they are joined
    for lines in source.lines():
        if not reading.lines:
            reading.several = _several(lines)
        block = _quickly(lines, reading) or _carefully(lines, reading)
        for column, part in zip(columns, block.columns(), strict=True):
            if part.strides[0]:  # a core for all takes no memory
                column += part.tobytes()
        reading.lines += len(lines)
    line, time, name, begin, core = (np.frombuffer(column, like.dtype) for column, like in zip(columns, empty, strict=True))
    return Stamps(line, time, name, begin, core if reading.several else np.broadcast_to(np.int16(0), len(line))), reading


def _several(lines: list[str]) -> bool:
    """Do these stamps end with a core? They do if more lines have that form than only that without."""
    with_core = without = 0
    for line in lines:
        fields = line.rsplit(None, 3)
        if len(fields) == 4 and fields[2] in ("0", "1") and _nanoseconds(fields[1]) is not None and _core(fields[3]) is not None:
            with_core += 1
        elif len(fields) >= 3 and fields[-1] in ("0", "1") and _nanoseconds(fields[-2]) is not None:
            without += 1
    return with_core > without


def _quickly(lines: list[str], reading: Reading) -> Stamps | None:
    """A block in which every line is a stamp in whole microseconds of a name without spaces; None if it is not."""
    width = 4 if reading.several else 3
    if {*map(str.count, lines, repeat(" "))} != {width - 1}:
        return None
    fields = " ".join(lines).split(" ")  # one list of texts: a list for each line would take three times as long
    names, times, ends, cores = fields[0::width], fields[1::width], fields[2::width], fields[3::width]
    digits, lengths = "".join(times), {*map(len, times)}
    if not (digits.isascii() and digits.isdigit() and min(lengths) > 0 and max(lengths) <= 15 and {*ends} <= {"0", "1"}):
        return None
    different = dict.fromkeys(names)
    if any(not name or not name.isprintable() or "\ufffd" in name or name.startswith(("#", "//")) for name in different):
        return None
    if any(reading.code_of(name) is None for name in different) or (reading.several and None in map(_core, {*cores})):
        return None
    count = len(lines)
    made = _columns(
        np.arange(reading.lines + 1, reading.lines + count + 1),
        np.fromiter(map(int, times), np.int64, count) * US,
        np.fromiter(map(reading.names.__getitem__, names), np.int32, count),
        np.fromiter(map("1".__eq__, ends), bool, count),
        np.fromiter(map(int, cores), np.int16, count) if reading.several else [],
    )
    return made if made.time.max() < reading.limit else None


def _carefully(lines: list[str], reading: Reading) -> Stamps:
    """Any block, line by line."""
    problems, several = reading.problems, reading.several
    numbers: list[int] = []
    times: list[int] = []
    codes: list[int] = []
    begins: list[bool] = []
    cores: list[int] = []
    for number, line in enumerate(lines, reading.lines + 1):
        fields = line.rsplit(None, 3 if several else 2)
        if not fields:
            reading.empty += 1
        elif line.lstrip().startswith(("#", "//")):
            reading.comments += 1
        elif len(fields) < 3 + several or fields[2] not in ("0", "1"):
            problems.rejected(number, f"{told(line)} is not {reading.format}")
        elif several and (core := _core(fields[3])) is None:
            problems.rejected(number, f"{told(fields[3])} is not the number of a core, 0 to {MOST_CORE}")
        elif (time := _nanoseconds(fields[1])) is None:
            problems.rejected(number, f"{told(fields[1])} is not a time in microseconds")
        elif time >= reading.limit:
            problems.rejected(number, f"{told(fields[1])} us is more than {reading.reach}")
        else:
            name = fields[0].strip()
            code = reading.code_of(name)
            if code is None:
                problems.rejected(number, reading.faults.get(name) or _name_fault(name))
                continue
            numbers.append(number)
            times.append(time)
            codes.append(code)
            begins.append(fields[2] == "1")
            if several:
                cores.append(core or 0)
            if "\ufffd" in name:
                problems.repaired(number, f"{told(name)} has bytes that are not UTF-8", "shown as \ufffd")
    return _columns(numbers, times, codes, begins, cores)


def _columns(
    line: Sequence[int] | np.ndarray,
    time: Sequence[int] | np.ndarray,
    name: Sequence[int] | np.ndarray,
    begin: Sequence[bool] | np.ndarray,
    core: Sequence[int] | np.ndarray,
) -> Stamps:
    """The columns of a block, in small types, for there are many of them; no cores are all 0."""
    return Stamps(
        np.asarray(line, dtype=np.int32),
        np.asarray(time, dtype=np.int64),
        np.asarray(name, dtype=np.int32),
        np.asarray(begin, dtype=bool),
        np.asarray(core, dtype=np.int16) if len(core) else np.broadcast_to(np.int16(0), len(line)),
    )


def _core(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 3 else None


def _nanoseconds(text: str) -> int | None:
    whole, point, fraction = text.partition(".")
    if not (whole.isascii() and whole.isdigit() and len(whole) <= 40):
        return None
    if not point:
        return int(whole) * US
    return int(whole) * US + int(f"{fraction[:3]:0<3}") if fraction.isascii() and fraction.isdigit() else None


def _name_fault(name: str) -> str:
    if not name.isprintable():
        return f"the name {told(name)} has control characters in it"
    row = name.rsplit(None, 2)
    if len(row) == 3 and row[1] in "XRBSD" and row[2].isdigit():
        return f"{told(name)}... is a row of FreeRTOS's task list, not a stamp"
    return ""
