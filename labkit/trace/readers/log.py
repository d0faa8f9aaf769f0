"""Reader of text logs of cycle stamps: one line `<name> <microseconds> <1 begin | 0 end>` per stamp.

The format is that of source 1, section 4.5. Two streams share it: context switches, buffered and printed late, and scopes,
printed at once; so lines are not in order of time. A real log is also cut at both ends, loses lines when the buffer
overflows, and wraps with its 32-bit counter. All of that is repaired or rejected here, and reported line by line. A log of
several cores has the number of the core, from 0, as a fourth field of every stamp.
"""

from __future__ import annotations

import os
from fractions import Fraction
from typing import IO, Any

import numpy as np

from labkit.trace.kinds import CODE
from labkit.trace.readers.report import MOST_TOLD, LogError, Problems, Report, told
from labkit.trace.readers.source import Source, open_source
from labkit.trace.readers.stamps import LONGEST, US, Stamps, read_stamps
from labkit.trace.readers.suspects import suspects
from labkit.trace.spans import Pairs, nest, pair
from labkit.trace.trace import Trace

WRAP_CYCLES = 2**32
_FAR_BACK = 10**9  # ns: a line this much too late may be a wrapped counter


def read_log(source: str | os.PathLike[str] | bytes | IO[Any], *, clock_hz: float | None = None) -> tuple[Trace, Report]:
    """Read a log of stamps; return the trace and a report of everything that was not as it should be.

    Args:
        source: a path, an open file (text or binary), or the log itself as bytes or as a str (a str with a line break, or of
            the form of a stamp, is the log itself; any other str is a path). At most
            `labkit.trace.readers.source.MOST_BYTES`.
        clock_hz: frequency of the 32-bit counter behind the stamps. If given, stamps are unwrapped: the counter goes around after
            2**32 / clock_hz seconds (19.884 s at 216 MHz). Right as long as stamps of neighbouring lines are less
            than half of that apart.

    Returns:
        trace: `begin` and `end` rows in order of time, `other` of a begin being the enclosing name; in microseconds, or in
            nanoseconds if any stamp has a fraction (finer digits are cut off). It starts at the first stamp and
            ends at the last one. Stamps of several cores have a column `core`; begin and end of a span are on one core.
        report: see `Report`; `print(report)` is for reading.

    At one instant, spans that were open end first, the innermost first; then come spans of no length; then new ones begin, the
    longest first. A name may contain spaces; a task and a scope inside it need different names, for a name does not
    nest in itself. A rare name that is made of others, as where a line end was lost, is rejected. Lines starting with `#` or
    `//` are comments. Stamps end with a core if more lines of the log's first megabyte have that form than only the form
    without.

    Raises:
        LogError: there is nothing to read: no such file, not text, no valid line, or an impossible `clock_hz`; or more than
            the most bytes or names.
    """
    with open_source(source) as opened:
        return log_of(opened, clock_hz)


def log_of(source: Source, clock_hz: float | None) -> tuple[Trace, Report]:
    """`read_log` of what is already open."""
    wrap = _wrap(clock_hz)
    stamps, reading = read_stamps(source, wrap)
    problems = reading.problems
    if not len(stamps):
        hint = f"; line {problems.kept[0].line}: {problems.kept[0].what}" if problems.kept else ""
        raise LogError(f"{source.title}: no line has the form {reading.format}{hint}")

    stamps, names = _without_suspects(stamps, list(reading.names), problems)
    wraps = 0
    if wrap is not None:
        wraps = _unwrap(stamps, wrap, problems)
    moved = _out_of_order(stamps, wrap, problems)

    stamps = stamps.sorted_by_time()
    pairs = pair(stamps.name.astype(np.int64) * 1000 + stamps.core if reading.several else stamps.name, stamps.begin)
    _report_unpaired(stamps, pairs, names, problems)
    trace = trace_of(stamps, pairs, names, reading.several)
    report = Report.of(
        source.title,
        len(np.unique(trace.core)) if trace.core is not None else 1,
        problems,
        "log",
        reading.lines,
        comments=reading.comments,
        empty=reading.empty,
        moved=moved,
        wraps=wraps,
    )
    return trace, report


def _without_suspects(stamps: Stamps, names: list[str], problems: Problems) -> tuple[Stamps, list[str]]:
    """The stamps of names that are some, and these names; the others are rejected."""
    found = suspects(names, np.bincount(stamps.name, minlength=len(names)))
    if not found or len(found) == len(names):
        return stamps, names
    out = np.zeros(len(names), bool)
    out[list(found)] = True
    wrong = out[stamps.name]
    for line, name in zip(stamps.line[wrong].tolist(), stamps.name[wrong].tolist()):
        problems.rejected(line, f"{told(names[name])} {found[name]}")
    left = stamps.ordered(np.flatnonzero(~wrong))
    left.name[:] = (np.cumsum(~out) - 1)[left.name]
    return left, [name for name, gone in zip(names, out) if not gone]


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


def _unwrap(stamps: Stamps, wrap: Fraction, problems: Problems) -> int:
    """Add whole turns to the times, in place, and return how many: a step back by more than half a turn is a wrap."""
    time = stamps.time
    turns = np.concatenate([[0], np.cumsum(-np.rint(np.diff(time) / float(wrap)).astype(np.int64))])
    turns -= np.minimum(np.minimum.accumulate(turns), 0)  # a jump ahead before any wrap is a pause, not a line from before
    if turns.max() * float(wrap) > LONGEST:
        raise LogError(f"the counter seems to wrap {turns.max()} times, longer than any recording lasts; is clock_hz right?")
    unit = US if not np.any(time % US) else 1
    offsets = np.array([round(k * wrap / unit) * unit for k in range(int(turns.max()) + 1)], np.int64)
    time += offsets[turns]
    most = np.maximum.accumulate(turns)
    for at in np.flatnonzero(np.diff(most)) + 1:
        what = f"the counter wrapped after {float(wrap) / 1e9:.3f} s"
        problems.repaired(int(stamps.line[at]), what, f"{offsets[most[at]] // US} us added from here on")
    return int(turns.max())


def _out_of_order(stamps: Stamps, wrap: Fraction | None, problems: Problems) -> np.ndarray:
    """Numbers of the lines that come later than a stamp of a later time."""
    late = np.maximum.accumulate(stamps.time) - stamps.time
    if wrap is None and np.any(late > _FAR_BACK):
        at = int(np.argmax(late > _FAR_BACK))
        what = f"time goes back by {late[at] / 1e9:.3f} s"
        done = "sorted by time; if the counter wrapped here, read the log with its clock_hz"
        problems.repaired(int(stamps.line[at]), what, done)
    return stamps.line[late > 0]


def _report_unpaired(stamps: Stamps, pairs: Pairs, names: list[str], problems: Problems) -> None:
    def tell(at: np.ndarray, action: str, done: str) -> None:
        for line, time, name, begin in zip(
            *(column[at[:MOST_TOLD]].tolist() for column in (stamps.line, stamps.time, stamps.name, stamps.begin)), strict=True
        ):
            this, partner = ("begin", "end") if begin else ("end", "begin")
            problems.add(line, f"{this} of {names[name]} at {time / US:.15g} us has no {partner}", action, done)
        problems.count(stamps.line[at[MOST_TOLD:]], action)

    tell(pairs.end[pairs.begin < 0], "repaired", "taken as open since the recording started")
    tell(pairs.begin[pairs.end < 0], "repaired", "taken as open until the recording stopped")
    tell(pairs.lost, "rejected", "left out, its partner is missing in the middle of the recording")


def trace_of(stamps: Stamps, pairs: Pairs, names: list[str], several: bool) -> Trace:
    """The trace of stamps in order of time, in microseconds if they are whole (their times are changed): the events of one
    instant ordered as `read_log` says, the enclosing name of each begin found."""
    fine = not np.any(stamps.time % US)
    np.floor_divide(stamps.time, US if fine else 1, out=stamps.time)
    hz = 1_000_000 if fine else 1_000_000_000
    start, stop = int(stamps.time[0]), int(stamps.time[-1])
    order = _order(stamps, pairs)
    other = _enclosing(stamps, pairs, order, several)
    del pairs  # of a large log each of these columns is a hundred megabytes
    kind = np.where(stamps.begin[order], CODE["begin"], CODE["end"])
    value, extra = np.zeros(len(order), np.int64), np.zeros(len(order), np.int64)  # never touched, they take no memory
    core = stamps.core[order].astype(np.int64) if several else None
    time, task = stamps.time[order], stamps.name[order].astype(np.int64)
    return Trace(time, kind, task, other.astype(np.int64), value, extra, tuple(names), hz, start, stop, core=core)


def _enclosing(stamps: Stamps, pairs: Pairs, order: np.ndarray, several: bool) -> np.ndarray:
    """Per event of the trace the name that encloses what begins there, -1: none."""
    count = len(order)
    place = np.full(len(stamps), -1, np.int32)
    place[order] = np.arange(count, dtype=np.int32)
    has_begin, has_end = pairs.begin >= 0, pairs.end >= 0
    owner = np.where(has_begin, pairs.begin, pairs.end)
    name = stamps.name[owner]
    opened = np.where(has_begin, place[pairs.begin], np.int32(-1))
    closed = np.where(has_end, place[pairs.end], np.int32(count))
    other = np.full(count, -1, np.int32)
    core = stamps.core[owner]
    del place, owner, has_end
    nothing = np.broadcast_to(np.int8(0), len(name))  # who is inside whom is a matter of order, not of times
    for each in np.unique(core):
        mine = np.flatnonzero(core == each) if several else slice(None)
        parent = nest(name[mine], opened[mine], closed[mine], nothing[mine], nothing[mine]).parent
        inner = (parent >= 0) & has_begin[mine]
        other[opened[mine][inner]] = name[mine][parent[inner]]
    return other


def _order(stamps: Stamps, pairs: Pairs) -> np.ndarray:
    """Positions of the stamps that are in the trace, in order of time and, within an instant, as `read_log` says."""
    count = len(stamps)
    both = (pairs.begin >= 0) & (pairs.end >= 0)
    first, last = pairs.begin[both], pairs.end[both]
    empty = stamps.time[first] == stamps.time[last]
    rank, tie = np.zeros(count, np.int8), np.zeros(count, np.int32)
    rank[first], rank[last] = np.where(empty, 1, 2), empty
    tie[first], tie[last] = np.where(empty, first, -last), np.where(empty, last, -first)
    begun = pairs.begin[pairs.end < 0]  # those cut by an edge are open before or after all others
    rank[begun], tie[begun] = 2, -(count + 1)
    ended = pairs.end[pairs.begin < 0]
    tie[ended] = 1
    if not len(pairs.lost):
        return np.lexsort((tie, rank, stamps.time)).astype(np.int32)
    kept = np.delete(np.arange(count, dtype=np.int32), pairs.lost)
    return kept[np.lexsort((tie[kept], rank[kept], stamps.time[kept]))]
