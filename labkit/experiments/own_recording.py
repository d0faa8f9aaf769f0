"""Notebook 00: the timeline of a recording, the reader's own or the excerpt that source 1 published."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MaxLen, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import published
from labkit.experiment import Experiment, Metric, OfAFile, View
from labkit.figures import History, axis, gantt, stack
from labkit.trace import MOST_BYTES, Report, describe, read_recording, statistics

EXCERPT = "xu2025_trace_unordered.log"
ROWS = 10  # tasks in the picture: those that ran longest
LONGEST = 900_000  # ms that the edges can be set to; the right one, there, means the end of the recording


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording.

    Attributes:
        history: who ran when.
        report: what its reader found and mended.
        ran: name -> its time on the CPU in ms, the longest first, the idle task last.
        told: what the reader found line by line, and the statistics of every name, as text.
    """

    history: History
    report: Report
    ran: dict[str, float]
    told: str

    @property
    def length(self) -> float:
        """In ms."""
        trace = self.history.trace
        return max(trace.end - trace.start, 1) * 1e3 / trace.hz

    def says(self) -> str:
        """What its reader did with it, and the first of what it found."""
        r = self.report
        counts = f"{r.moved_lines} out of order, {r.repaired} repaired, {r.rejected} left out"
        first = "".join(f" First: {problem}." for problem in r.problems[:1])
        far = "" if self.length <= LONGEST else f" Zoom reaches its first {LONGEST // 60_000} minutes."
        return f"{r.source}, read as {r.format}: {r.lines} lines, {counts}.{first}{far}"


class OwnRecording(Experiment[Recorded]):
    """What did your board do?

    The timeline of a recording: a log of stamps, the lab's own CSV, JSON of Perfetto, BTF, or Linux's ftrace as text. Drop the
    file on the bench or write its name. Drag over the picture to zoom in, or turn the wheel with Ctrl; drag along the time axis
    to move; a double click shows all.
    """

    headline: ClassVar[tuple[str, ...]] = ("recorded", "stretches", "lines repaired or left out")

    file: Annotated[
        str, MaxLen(300), OfAFile(MOST_BYTES), Doc("name or path of the recording; nothing: the excerpt published in source 1")
    ] = ""
    start: Annotated[float, Interval(ge=0, le=LONGEST), MultipleOf(0.01), Unit("ms"), View(), Doc("left edge of the picture")] = (
        0.0
    )
    end: Annotated[float, Interval(ge=0, le=LONGEST), MultipleOf(0.01), Unit("ms"), View(), Doc("right edge of the picture")] = (
        float(LONGEST)
    )

    def run(self) -> Recorded:
        """Read the file; of several cores the first. Raises LogError, a sentence, where there is nothing to read."""
        trace, report = read_recording(Path(self.file.strip()) if self.file.strip() else published(EXCERPT))
        report = replace(report, source=Path(report.source).name)
        history = History(next(iter(trace.cores().values())))
        found = history.occupancy
        busy = np.diff(found.busy[found.first]) * (1e3 / history.trace.hz)
        busiest = [i for i in np.argsort(-busy, kind="stable").tolist() if busy[i] > 0]
        ran = {history.trace.names[i]: float(busy[i]) for i in busiest}
        told = f"{report}\n\n{describe(statistics(trace))}"
        return Recorded(history, report, dict(sorted(ran.items(), key=lambda item: item[0] == "IDLE")), told)

    def figure(self, result: Recorded) -> dict[str, Any]:
        right = result.length if self.end >= LONGEST else min(self.end, result.length)
        low, high = sorted((min(self.start, result.length), right))
        if high - low < result.length / 1e6:
            low, high = 0.0, result.length
        rows = tuple(result.ran)[:ROWS] or ("nobody ran",)
        return stack(
            gantt(result.history, rows, low, high),
            height=130 + 32 * max(len(rows), 4),
            shared=axis("time [ms]", range=[low, high]),
            keys=("release", "deadline", "missed"),
            meta={"range": ("start", "end"), "says": result.says(), "told": result.told},
        )

    def metrics(self, result: Recorded) -> list[Metric]:
        mended = result.report.repaired + result.report.rejected
        busiest = next(iter(result.ran), "")
        return [
            Metric("recorded", result.length, "ms", note="of several cores the first is shown"),
            Metric("stretches", len(result.history.occupancy.start), note="uninterrupted, of all tasks together"),
            Metric("lines repaired or left out", mended, good=None if not mended else False),
            Metric(
                "longest on the processor", busiest or None, note=f"{result.ran[busiest]:.4g} ms" if busiest else "nobody ran"
            ),
            Metric("names", len(result.ran), note=f"the picture has the {ROWS} that ran longest"),
        ]
