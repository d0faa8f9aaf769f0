"""Reader of text logs of cycle stamps: one line `<name> <microseconds> <1 begin | 0 end>` per stamp.

The format is that of source 1, section 4.5. Two streams share it: context switches, buffered and printed late, and scopes,
printed at once; so lines are not in order of time. A real log is also cut at both ends, loses lines when the buffer
overflows, and wraps with its 32-bit counter. All of that is repaired or rejected here, and reported line by line.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import IO

import numpy as np

from labkit.trace.kinds import CODE
from labkit.trace.spans import Pairs, nest, pair
from labkit.trace.trace import Trace

FORMAT = "'<name> <microseconds> <1 begin | 0 end>'"
WRAP_CYCLES = 2**32
_US = 1000  # nanoseconds
_LONGEST = 10**18  # ns, 31 years
_FAR_BACK = 10**9  # ns: a line this much too late may be a wrapped counter


class LogError(ValueError):
    """The log cannot be read at all: no such file, not text, or not one valid line in it."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One line of the log that is not as it should be: its number from 1, what is wrong, and what was done about it."""

    line: int
    what: str
    action: str  # "repaired" or "rejected"
    done: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.what}; {self.done}"


@dataclass(frozen=True)
class Report:
    """What the reader met. Every line is a stamp in the trace, rejected, a comment or empty: the four counts add up to `lines`.

    Attributes:
        source: name of the file, or "text".
        lines, stamps, comments, empty: counts of lines.
        moved: numbers of the lines that came later than a stamp of a later time, and were sorted to their place. That is
            normal for this format.
        wraps: how often the counter went around, as far as it was asked for with `clock_hz`.
        problems: all that was repaired or rejected, by line.
    """

    source: str
    lines: int
    stamps: int
    comments: int
    empty: int
    moved: tuple[int, ...]
    wraps: int
    problems: tuple[Problem, ...]

    @property
    def rejected(self) -> int:
        """Number of lines that are not in the trace although they are neither empty nor a comment."""
        return len({p.line for p in self.problems if p.action == "rejected"})

    @property
    def repaired(self) -> int:
        """Number of lines that were repaired in some way, sorting apart."""
        return len({p.line for p in self.problems if p.action == "repaired"})

    def __str__(self) -> str:
        return self.text()

    def text(self, limit: int | None = 20) -> str:
        """The report for reading; at most `limit` problems in full (None: all)."""
        counts = f"{self.source}: {_count(self.lines, 'line')}, {_count(self.stamps, 'stamp')}"
        counts += f", {self.rejected} rejected, {self.repaired} repaired, {_count(self.comments, 'comment')}, {self.empty} empty"
        parts = [counts]
        if self.moved:
            parts.append(f"  {_count(len(self.moved), 'line')} out of order, sorted by time: {_ranges(self.moved)}")
        if self.wraps:
            parts.append(f"  the 32-bit counter wrapped {self.wraps} times, unwrapped")
        shown = self.problems if limit is None else self.problems[:limit]
        parts += [f"  {problem}" for problem in shown]
        if len(shown) < len(self.problems):
            parts.append(f"  ... and {len(self.problems) - len(shown)} more")
        return "\n".join(parts)

    def as_dict(self) -> dict:
        """The report as plain values, ready for JSON."""
        fields = ("source", "lines", "stamps", "rejected", "repaired", "comments", "empty", "wraps")
        problems = [{"line": p.line, "what": p.what, "action": p.action, "done": p.done} for p in self.problems]
        return {**{f: getattr(self, f) for f in fields}, "moved": list(self.moved), "problems": problems}


def read_log(source: str | os.PathLike | bytes | IO, *, clock_hz: float | None = None) -> tuple[Trace, Report]:
    """Read a log of stamps; return the trace and a report of everything that was not as it should be.

    Args:
        source: a path, an open file (text or binary), or the log itself as bytes or as a str (a str with a line break, or of
            the form of a stamp, is the log itself; any other str is a path).
        clock_hz: frequency of the 32-bit counter behind the stamps. If given, stamps are unwrapped: the counter goes around after
            2**32 / clock_hz seconds (19.884 s at 216 MHz). Right as long as stamps of neighbouring lines are less
            than half of that apart.

    Returns:
        trace: `begin` and `end` rows in order of time, `other` of a begin being the enclosing name; in microseconds, or in
            nanoseconds if any stamp has a fraction (finer digits are cut off). It starts at the first stamp and
            ends at the last one.
        report: see `Report`; `print(report)` is for reading.

    At one instant, spans that were open end first, the innermost first; then come spans of no length; then new ones begin, the
    longest first. A name may contain spaces; a task and a scope inside it need different names, for a name does not
    nest in itself. Lines starting with `#` or `//` are comments.

    Raises:
        LogError: there is nothing to read: no such file, not text, no valid line, or an impossible `clock_hz`.
    """
    wrap = _wrap(clock_hz)
    title, text = _text(source)
    lines = text.split("\n")
    if not lines[-1]:
        lines.pop()
    problems: list[Problem] = []
    names, table, comments, empty = _stamps(lines, wrap, problems)
    if not len(table):
        hint = f"; line {problems[0].line}: {problems[0].what}" if problems else ""
        raise LogError(f"{title}: no line has the form {FORMAT}{hint}")

    wraps = 0
    if wrap is not None:
        wraps = _unwrap(table, wrap, problems)
    moved = _out_of_order(table, wrap, problems)

    table = table[np.argsort(table[:, 1], kind="stable")]
    pairs = pair(table[:, 2], table[:, 3])
    _report_unpaired(table, pairs, names, problems)
    fine = not np.any(table[:, 1] % _US)
    table[:, 1] //= _US if fine else 1
    trace = _trace(table, pairs, names, 1_000_000 if fine else 1_000_000_000)
    problems.sort(key=lambda p: p.line)
    return trace, Report(title, len(lines), len(trace), comments, empty, moved, wraps, tuple(problems))


def _is_log(source: str) -> bool:
    """Is this str a log rather than the path of one?"""
    return "\n" in source or not source.strip() or (source.endswith((" 0", " 1")) and not os.path.exists(source))


def _text(source: str | os.PathLike | bytes | IO) -> tuple[str, str]:
    title = "text"
    try:
        if isinstance(source, str) and _is_log(source):
            raw = source
        elif isinstance(source, (str, os.PathLike)):
            title = os.fspath(source)
            raw = Path(source).read_bytes()
        elif isinstance(source, (bytes, bytearray)):
            raw = bytes(source)
        elif hasattr(source, "read"):
            title = str(getattr(source, "name", "text"))
            raw = source.read()
        else:
            raise LogError(f"a log is a path, an open file, bytes or text, not {type(source).__name__}")
    except (OSError, UnicodeError) as error:
        raise LogError(f"{title}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    except ValueError as error:  # a NUL in a path, a closed file
        raise error if isinstance(error, LogError) else LogError(f"{title!r}: cannot be read ({error})") from None
    if isinstance(raw, bytes):
        utf16 = raw.startswith((b"\xff\xfe", b"\xfe\xff"))  # what a redirection in PowerShell writes
        raw = raw.decode("utf-16" if utf16 else "utf-8-sig", errors="replace")
    return title, str(raw)


def _stamps(lines: list[str], wrap: Fraction | None, problems: list[Problem]) -> tuple[list[str], np.ndarray, int, int]:
    """The lines that are stamps, as an int64 array (line, time in ns, name, begin), and the names."""
    codes: dict[str, int] = {}
    faults: dict[str, str] = {}
    stamps: list[tuple[int, int, int, int]] = []
    comments = empty = 0
    limit = _LONGEST if wrap is None else wrap + _US  # a stamp may be rounded up

    def reject(what: str) -> None:
        problems.append(Problem(number, what, "rejected", "left out"))

    for number, line in enumerate(lines, 1):
        fields = line.rsplit(None, 2)
        if not fields:
            empty += 1
        elif line.lstrip().startswith(("#", "//")):
            comments += 1
        elif len(fields) < 3 or fields[2] not in ("0", "1"):
            reject(f"{told(line)} is not {FORMAT}")
        elif (time := _nanoseconds(fields[1])) is None:
            reject(f"{told(fields[1])} is not a time in microseconds")
        elif time >= limit:
            reach = "any recording lasts" if wrap is None else "a 32-bit counter of this clock can reach"
            reject(f"{told(fields[1])} us is more than {reach}")
        else:
            name = fields[0].strip()
            if name not in codes and name not in faults:
                if fault := _name_fault(name):
                    faults[name] = fault
                else:
                    codes[name] = len(codes)
            if name in faults:
                reject(faults[name])
                continue
            stamps.append((number, time, codes[name], fields[2] == "1"))
            if "\ufffd" in name:
                problems.append(Problem(number, f"{told(name)} has bytes that are not UTF-8", "repaired", "shown as \ufffd"))
    return list(codes), np.array(stamps, np.int64).reshape(-1, 4), comments, empty


def _nanoseconds(text: str) -> int | None:
    whole, point, fraction = text.partition(".")
    if not (whole.isascii() and whole.isdigit() and len(whole) <= 40):
        return None
    if not point:
        return int(whole) * _US
    return int(whole) * _US + int(f"{fraction[:3]:0<3}") if fraction.isascii() and fraction.isdigit() else None


def _name_fault(name: str) -> str:
    if not name.isprintable():
        return f"the name {told(name)} has control characters in it"
    row = name.rsplit(None, 2)
    if len(row) == 3 and row[1] in "XRBSD" and row[2].isdigit():
        return f"{told(name)}... is a row of FreeRTOS's task list, not a stamp"
    return ""


def _wrap(clock_hz: float | None) -> Fraction | None:
    """Nanoseconds after which a 32-bit counter goes around, exactly."""
    if clock_hz is None:
        return None
    try:
        clock = Fraction(clock_hz)
    except (TypeError, ValueError, OverflowError):
        clock = Fraction(0)
    if not 1000 <= clock <= 10**11:
        raise LogError(f"clock_hz is {clock_hz!r}; it is the frequency of the counter, 1e3 to 1e11 Hz")
    return WRAP_CYCLES * 10**9 / clock


def _unwrap(table: np.ndarray, wrap: Fraction, problems: list[Problem]) -> int:
    """Add whole turns to the times, in place, and return how many: a step back by more than half a turn is a wrap."""
    turns = np.concatenate([[0], np.cumsum(-np.rint(np.diff(table[:, 1]) / float(wrap)).astype(np.int64))])
    turns -= np.minimum(np.minimum.accumulate(turns), 0)  # a jump ahead before any wrap is a pause, not a line from before
    if turns.max() * float(wrap) > _LONGEST:
        raise LogError(f"the counter seems to wrap {turns.max()} times, longer than any recording lasts; is clock_hz right?")
    unit = _US if not np.any(table[:, 1] % _US) else 1
    offsets = np.array([round(k * wrap / unit) * unit for k in range(int(turns.max()) + 1)], np.int64)
    table[:, 1] += offsets[turns]
    most = np.maximum.accumulate(turns)
    for at in np.flatnonzero(np.diff(most)) + 1:
        what = f"the counter wrapped after {float(wrap) / 1e9:.3f} s"
        problems.append(Problem(int(table[at, 0]), what, "repaired", f"{offsets[most[at]] // _US} us added from here on"))
    return int(turns.max())


def _out_of_order(table: np.ndarray, wrap: Fraction | None, problems: list[Problem]) -> tuple[int, ...]:
    late = np.maximum.accumulate(table[:, 1]) - table[:, 1]
    if wrap is None and np.any(late > _FAR_BACK):
        at = int(np.argmax(late > _FAR_BACK))
        what = f"time goes back by {late[at] / 1e9:.3f} s"
        done = "sorted by time; if the counter wrapped here, read the log with its clock_hz"
        problems.append(Problem(int(table[at, 0]), what, "repaired", done))
    return tuple(table[late > 0, 0].tolist())


def _report_unpaired(table: np.ndarray, pairs: Pairs, names: list[str], problems: list[Problem]) -> None:
    def tell(at: np.ndarray, action: str, done: str) -> None:
        for line, time, name, begin in table[at].tolist():
            this, partner = ("begin", "end") if begin else ("end", "begin")
            problems.append(Problem(line, f"{this} of {names[name]} at {time / _US:.15g} us has no {partner}", action, done))

    tell(pairs.end[pairs.begin < 0], "repaired", "taken as open since the recording started")
    tell(pairs.begin[pairs.end < 0], "repaired", "taken as open until the recording stopped")
    tell(pairs.lost, "rejected", "left out, its partner is missing in the middle of the recording")


def _trace(table: np.ndarray, pairs: Pairs, names: list[str], hz: int) -> Trace:
    """Order the events of one instant, as `read_log` says, and find the enclosing name of each begin."""
    count, far = len(table), len(table) + 1
    has_begin, has_end = pairs.begin >= 0, pairs.end >= 0
    begin = np.where(has_begin, table[pairs.begin, 1], table[0, 1])
    end = np.where(has_end, table[pairs.end, 1], table[-1, 1])
    empty = has_begin & has_end & (begin == end)
    opened, closed = np.where(has_begin, pairs.begin, -1), np.where(has_end, pairs.end, far)

    rank, tie = np.zeros(count, np.int64), np.zeros(count, np.int64)
    rank[pairs.begin[has_begin]] = np.where(empty, 1, 2)[has_begin]
    rank[pairs.end[has_end]] = empty[has_end]
    tie[pairs.begin[has_begin]] = np.where(empty, opened, -closed)[has_begin]
    tie[pairs.end[has_end]] = np.where(empty, closed, -opened)[has_end]
    kept = np.delete(np.arange(count), pairs.lost)
    order = kept[np.lexsort((tie[kept], rank[kept], table[kept, 1]))]
    place = np.full(far + 1, -1)
    place[order] = np.arange(len(order))
    place[far] = len(order)

    span_name = table[np.where(has_begin, pairs.begin, pairs.end), 2]
    opened, closed = np.where(has_begin, place[opened], -1), place[closed]  # from here on in the final order
    parent = nest(span_name, opened, closed, begin, end).parent
    other = np.full(count, -1)
    other[pairs.begin[has_begin]] = np.where(parent >= 0, span_name[parent], -1)[has_begin]

    kind = np.where(table[order, 3] == 1, CODE["begin"], CODE["end"])
    none = np.zeros(len(order), np.int64)
    start, stop = int(table[0, 1]), int(table[-1, 1])
    return Trace(table[order, 1], kind, table[order, 2], other[order], none, none.copy(), tuple(names), hz, start, stop)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def told(text: str) -> str:
    """Text from outside for a line of output: short, in quotes, with escapes for what is not printable."""
    text = text.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _ranges(numbers: tuple[int, ...], most: int = 8) -> str:
    """7, 8, 9, 12 as '7-9, 12'."""
    array = np.array(numbers)
    runs = np.split(array, np.flatnonzero(np.diff(array) != 1) + 1)
    text = ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs[:most])
    return text + (f", ... ({len(runs) - most} more ranges)" if len(runs) > most else "")
