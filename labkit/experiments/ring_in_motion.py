"""Notebook 04: the ring of the sink at work, between `profile`, `tsink` and the DMA (source 1, 4.1; the model: `TracePath`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.tick_rates import BAUDS, MS, Form, Rate, WhenFull, envelope, traced, window
from labkit.figures import BLUE, GREY, ORANGE, PURPLE, SKY, History, Steps, axis, gantt, stack, steps
from labkit.robot import CPU_HZ, OnBlocks, Sink, build, lines
from labkit.sink import link_load

ROWS = ("tsink", "profile")
WINDOW = 100  # ms simulated
WARM = 20  # ms after which throughput is measured: the first round of `profile` comes later than the stamps


@dataclass(frozen=True, eq=False)
class Motion:
    """What the ring and the link did.

    Attributes:
        history: who ran when. sink: the ring.
        sizes: bytes of each stamp that was made.
    """

    history: History
    sink: Sink
    sizes: np.ndarray

    @property
    def stamps(self) -> float:
        """Stamps made per second."""
        return len(self.sizes) * CPU_HZ / self.history.trace.end

    @property
    def offered(self) -> float:
        """Bytes per second that these need."""
        return float(self.sizes.sum()) * CPU_HZ / self.history.trace.end

    def sent(self) -> float:
        """Bytes per second that the link has carried, transfers cut at both ends of what is measured."""
        begin, end, size = self.sink.transfers().T
        low, high = WARM * MS, self.history.trace.end
        inside = np.clip(np.minimum(end, high) - np.maximum(begin, low), 0, None)
        return float((size * inside / np.maximum(end - begin, 1)).sum() * CPU_HZ / (high - low))

    def chunks(self) -> np.ndarray:
        """Sizes of the transfers."""
        return self.sink.transfers()[:, 2]

    def lost(self) -> int:
        """Stamps that found no room in the temp buffer or in the ring."""
        return self.sink.lost(len(self.sizes) // 2)


class RingInMotion(Experiment[Motion]):
    """What does a full ring look like?

    `profile` writes, `tsink` hands to the DMA what is there: in two chunks where the ring comes around. The read index advances
    only when all of it has gone out, so room comes back in bursts. 100 ms are simulated.
    """

    rates: Rate = "1000"
    baud: Annotated[Literal[115_200, 1_152_000, 2_000_000, 12_500_000], Labels(BAUDS), Unit("baud"), Doc("speed of the link")] = (
        2_000_000
    )
    capacity: Annotated[int, Interval(ge=1024, le=8192), MultipleOf(1024), Unit("bytes"), Doc("of the ring")] = 2048
    buffer: Annotated[int, Interval(ge=64, le=1024), MultipleOf(64), Unit("stamps"), Doc("of the temp buffer")] = 512
    form: Form = "text"
    when_full: WhenFull = "wait"
    start: Annotated[float, Interval(ge=0, le=WINDOW), MultipleOf(0.05), Unit("ms"), View(), Doc("left edge of the picture")] = (
        28.0
    )
    end: Annotated[float, Interval(ge=0, le=WINDOW), MultipleOf(0.05), Unit("ms"), View(), Doc("right edge of the picture")] = (
        62.0
    )

    def run(self) -> Motion:
        path = {
            "baud": self.baud,
            "capacity": self.capacity,
            "form": self.form,
            "when_full": self.when_full,
            "buffer": self.buffer,
        }
        board = build(traced(self.rates, True, **path), OnBlocks())
        board.advance(WINDOW * MS)
        assert board.sink is not None, "the firmware is traced"
        trace = board.kernel.trace
        return Motion(History(trace), board.sink, lines(trace, 0, self.form))

    def figure(self, result: Motion) -> dict[str, Any]:
        low, high = window(self.start, self.end, WINDOW)
        times, fills = result.sink.curve()
        at, fill = envelope(times / MS, fills, low, high)
        capacity = Steps("capacity", np.array([low]), np.array([self.capacity]), GREY, "dot")
        bytes_ = steps([Steps("bytes in the ring", at, fill, SKY), capacity], "bytes", high, height=1.5, left=110)
        indices = steps(_indices(result.sink, low, high), "index", high, height=1.1, left=110)
        top = 1.12 * 2 ** math.ceil(math.log2(self.capacity))  # four heights in all while the slider moves
        for panel in (bytes_, indices):
            panel.y.update(range=[0, top], rangemode="normal", fixedrange=True)
        return stack(
            gantt(result.history, ROWS, low, high, height=0.8),
            replace(bytes_, traces=[_on_air(result.sink, low, high), *bytes_.traces]),
            indices,
            height=470,
            shared=axis("time [ms]", range=[low, high]),
            meta={"range": ("start", "end")},
        )

    def metrics(self, result: Motion) -> list[Metric]:
        load = link_load(result.offered / result.stamps, result.stamps, self.baud)
        busy = link_load(result.sent(), 1, self.baud)
        chunks, lost = result.chunks(), result.lost()
        fullest = int(result.sink.curve()[1].max())
        return [
            Metric("link load by arithmetic", 100 * load, "%", good=load < 1, note="stamps made x their bytes x 10 bits / baud"),
            Metric("link busy in the model", 100 * busy, "%"),
            Metric("stamps lost", lost, good=lost == 0, note="in the temp buffer or at the ring"),
            Metric("fullest", fullest, "bytes", bound=self.capacity),
            Metric("chunks", len(chunks)),
            Metric("largest chunk", int(chunks.max(initial=0)), "bytes", bound=self.capacity),
        ]


def _on_air(sink: Sink, low: float, high: float) -> dict[str, Any]:
    """A bar per transfer, as long as it takes and as high as it is large."""
    moved = sink.transfers()
    begin, end, size = moved[(moved[:, 1] >= low * MS) & (moved[:, 0] <= high * MS)].T
    return {
        "type": "bar",
        "x": begin / MS,
        "width": (end - begin) / MS,
        "offset": 0,
        "y": size,
        "name": "sent by the DMA",
        "marker": {"color": ORANGE, "line": {"width": 1.5, "color": "white"}},
        "hovertemplate": "%{y} bytes from %{x:.3f} ms<extra></extra>",
    }


def _indices(sink: Sink, low: float, high: float) -> list[Steps]:
    """Where in the ring the next byte is written, and where the next one is read.

    The fill alone tells them apart: it rises by what is written and falls by what is read.
    """
    times, fills = sink.curve()
    change = np.diff(fills, prepend=0)
    written, read = np.cumsum(np.maximum(change, 0)), np.cumsum(np.maximum(-change, 0))
    drawn = []
    for name, index, colour in (("write", written, BLUE), ("read", read, PURPLE)):
        at, value = envelope(times / MS, index % sink.capacity, low, high)
        drawn.append(Steps(name, at, value, colour))
    return drawn


def check_slowest_link(answer: int | float) -> Feedback:
    """Exercise: the link speed in baud, within 3 %, that just carries the lines of text made at 1000 Hz over 12.5 Mbaud."""
    found = RingInMotion(rates="1000", baud=12_500_000).run()
    wanted = found.offered * 10
    if not isinstance(answer, int | float) or not abs(answer / wanted - 1) <= 0.03:
        return Feedback(False, "not within 3 %; how many stamps per second, how many bytes each, and how many bits is a byte?")
    stamps, size = found.stamps, found.offered / found.stamps
    return Feedback(True, f"{stamps:,.0f} stamps per second x {size:.1f} bytes x 10 bits = {wanted:,.0f} baud")
