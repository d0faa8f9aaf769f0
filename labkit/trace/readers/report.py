"""What the reader of a log met: every line is accounted for, and what was repaired or rejected is told line by line."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from labkit.trace.trace import printable

#: Of one sort of problem, and of the lines that were moved, so many are told one by one; the rest is only counted.
MOST_TOLD = 10_000


class LogError(ValueError):
    """The log cannot be read at all: no such file, not text, too large, or not one valid line in it."""


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
    """What the reader met. Every line is in the trace, skipped, rejected, a comment or empty: these counts add up to `lines`.

    Attributes:
        source: name of the file, or "text".
        lines, stamps, comments, empty: counts of lines; a stamp is what is in the trace, in whatever format.
        rejected: number of lines that are not in the trace although they are neither empty nor a comment.
        repaired: number of lines that were repaired in some way, sorting apart.
        moved: numbers of the lines that came later than a stamp of a later time, and were sorted to their place, at most
            the first `MOST_TOLD`. That is normal for this format.
        moved_lines: how many these are in all.
        wraps: how often the counter went around, as far as it was asked for with `clock_hz`.
        problems: what was repaired or rejected, by line; at most the first `MOST_TOLD` of each sort.
        cores: number of cores the stamps come from.
        format: what the recording was recognised as.
        skipped: number of events that are of no kind that is read, such as signals or interrupts.
        notes: what else one has to know of the trace.
    """

    source: str
    lines: int
    stamps: int
    comments: int
    empty: int
    rejected: int
    repaired: int
    moved: tuple[int, ...]
    moved_lines: int
    wraps: int
    problems: tuple[Problem, ...]
    cores: int = 1
    format: str = "log"
    skipped: int = 0
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        source: str,
        cores: int,
        problems: Problems,
        format: str,
        lines: int,
        *,
        comments: int = 0,
        empty: int = 0,
        skipped: int = 0,
        moved: np.ndarray | None = None,
        wraps: int = 0,
        notes: Sequence[str] = (),
    ) -> Report:
        """The report of so many lines (or events) with these problems; `moved`: the numbers of those that were out of order."""
        counts = problems.counts()
        moved = np.zeros(0, np.int64) if moved is None else moved
        return cls(
            source=source,
            lines=lines,
            stamps=lines - comments - empty - skipped - counts["rejected"],
            comments=comments,
            empty=empty,
            rejected=counts["rejected"],
            repaired=counts["repaired"],
            moved=tuple(moved[:MOST_TOLD].tolist()),
            moved_lines=len(moved),
            wraps=wraps,
            problems=problems.by_line(),
            cores=cores,
            format=format,
            skipped=skipped,
            notes=tuple(notes),
        )

    def __str__(self) -> str:
        return self.text()

    def text(self, limit: int | None = 20) -> str:
        """The report for reading; at most `limit` problems in full (None: all there are)."""
        if self.format == "log":
            counts = f"{printable(self.source)}: {_count(self.lines, 'line')}, {_count(self.stamps, 'stamp')}"
        else:
            counts = f"{printable(self.source)}: {self.format}, {self.lines} lines or events, {self.stamps} of them read"
            counts += f", {self.skipped} of other kinds" if self.skipped else ""
        counts += f", {self.rejected} rejected, {self.repaired} repaired, {_count(self.comments, 'comment')}, {self.empty} empty"
        parts = [counts if self.cores == 1 else f"{counts}, {self.cores} cores"]
        if self.moved:
            told = _ranges(self.moved) + (", ..." if len(self.moved) < self.moved_lines else "")
            parts.append(f"  {_count(self.moved_lines, 'line')} out of order, sorted by time: {told}")
        if self.wraps:
            parts.append(f"  the 32-bit counter wrapped {self.wraps} times, unwrapped")
        parts += [f"  {note}" for note in self.notes]
        shown = self.problems if limit is None else self.problems[:limit]
        parts += [f"  {problem}" for problem in shown]
        if len(shown) < len(self.problems):
            parts.append(f"  ... and {len(self.problems) - len(shown)} more")
        return "\n".join(parts)

    def as_dict(self) -> dict[str, Any]:
        """The report as plain values, ready for JSON."""
        counts = ("lines", "stamps", "skipped", "rejected", "repaired", "comments", "empty", "wraps", "moved_lines", "cores")
        problems = [{"line": p.line, "what": p.what, "action": p.action, "done": p.done} for p in self.problems]
        return {
            **{name: getattr(self, name) for name in ("source", "format", *counts)},
            "moved": list(self.moved),
            "notes": list(self.notes),
            "problems": problems,
        }


@dataclass
class Problems:
    """Collects problems: all are counted, of each sort (what was done) the first `MOST_TOLD` are kept."""

    kept: list[Problem] = field(default_factory=list)
    _lines: dict[str, array[int]] = field(default_factory=lambda: {"repaired": array("q"), "rejected": array("q")})
    _sorts: Counter[str] = field(default_factory=Counter)

    def add(self, line: int, what: str, action: str, done: str) -> None:
        self._lines[action].append(line)
        self._sorts[done] += 1
        if self._sorts[done] <= MOST_TOLD:
            self.kept.append(Problem(line, what, action, done))

    def repaired(self, line: int, what: str, done: str) -> None:
        self.add(line, what, "repaired", done)

    def rejected(self, line: int, what: str, done: str = "left out") -> None:
        self.add(line, what, "rejected", done)

    def count(self, lines: np.ndarray, action: str) -> None:
        """Lines that are counted and not told."""
        self._lines[action].frombytes(lines.astype(np.int64).tobytes())

    def counts(self) -> dict[str, int]:
        """How many different lines were repaired and rejected."""
        return {action: len(np.unique(np.frombuffer(lines, np.int64))) for action, lines in self._lines.items()}

    def by_line(self) -> tuple[Problem, ...]:
        return tuple(sorted(self.kept, key=lambda problem: problem.line))


def told(text: str) -> str:
    """Text from outside for a line of output: short, in quotes, with escapes for what is not printable."""
    text = text[:200].strip() if len(text) > 200 else text.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _ranges(numbers: Sequence[int], most: int = 8) -> str:
    """7, 8, 9, 12 as '7-9, 12'."""
    array_ = np.array(numbers)
    runs = np.split(array_, np.flatnonzero(np.diff(array_) != 1) + 1)
    text = ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs[:most])
    return text + (f", ... ({len(runs) - most} more ranges)" if len(runs) > most else "")
