"""Notebook 04: a receive buffer that is filled again before its frame is read (source 1, 3.1.2; its public firmware)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, sin
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.frame_lab import frame_panel
from labkit.experiments.tick_rates import MS, Caches, window
from labkit.figures import BLUE, GREEN, VERMILION, History, Marks, Panel, axis, gantt, stack, steps
from labkit.robot import CPU_HZ, PRIORITIES, OnBlocks, Read, VelocityLine, build, published
from labkit.sink import FRAME_BYTES

ROWS = ("recv_vel", "wheel_ctrl", "profile")
LENGTH = 400  # ms simulated


@dataclass(frozen=True, eq=False)
class Heard:
    """Who ran when, and what came over the line and was read."""

    history: History
    line: VelocityLine

    @property
    def worst(self) -> Read | None:
        """The first of the torn reads with the most newer bytes; None if no read was torn."""
        torn = [read for read in self.line.reads if read.reception.verdict != "ok"]
        return max(torn, key=lambda read: read.newer, default=None)


class TornFrame(Experiment[Heard]):
    """What does a task read from a buffer that is being filled again?

    An operator moves a joystick, the radio delivers the frames late and in bunches, a DMA writes their bytes into one buffer, and
    `recv_vel` reads it when it gets the processor. `profile`, which prints the tracer's lines, has the same priority.
    """

    frames: Annotated[int, Interval(ge=20, le=400), MultipleOf(20), Unit("1/s"), Doc("frames that the operator sends")] = 100
    delay: Annotated[
        int, Interval(ge=0, le=50), Unit("ms"), Doc("the radio delays each frame by up to this; none overtakes another")
    ] = 20
    buffers: Annotated[
        Literal[1, 2], Labels({1: "one, armed again at once (public firmware)", 2: "two in turn"}), Doc("receive buffers")
    ] = 1
    above: Annotated[bool, Doc("recv_vel has a higher priority than profile and the control tasks, not the same")] = False
    caches: Caches = False
    seed: Annotated[int, Interval(ge=1, le=99), Doc("of the radio's delays")] = 1
    start: Annotated[float, Interval(ge=0, le=LENGTH), MultipleOf(0.05), Unit("ms"), View(), Doc("left edge of the picture")] = (
        25.0
    )
    end: Annotated[float, Interval(ge=0, le=LENGTH), MultipleOf(0.05), Unit("ms"), View(), Doc("right edge of the picture")] = (
        60.0
    )

    def run(self) -> Heard:
        priorities = PRIORITIES | ({"recv_vel": PRIORITIES["recv_vel"] + 1} if self.above else {})
        board = build(replace(published("100|50", self.caches), buffers=self.buffers, priorities=priorities), OnBlocks())
        sent = np.arange(0, LENGTH, 1000 / self.frames)
        come = np.maximum.accumulate(sent + np.random.default_rng(self.seed).uniform(0, self.delay, len(sent)))
        for now, ms in zip((come * MS).astype(np.int64).tolist(), sent.tolist(), strict=True):
            board.advance(now)
            board.command((400 * sin(ms / 150), 200 * cos(ms / 110), 0.5 * sin(ms / 90)))
        board.advance(max(LENGTH * MS, board.kernel.now))
        return Heard(History(board.kernel.trace), board.line)

    def figure(self, result: Heard) -> dict[str, Any]:
        low, high = window(self.start, self.end, LENGTH)
        x = axis("time [ms]", range=[low, high])
        return stack(
            gantt(result.history, ROWS, low, high, height=1.1, x={**x, "visible": False}),
            arriving(result.line, low, high, {**x, "matches": "x"}),
            worst_read(result),
            height=470,
            keys=("ready",),
            meta={"range": ("start", "end")},
        )

    def metrics(self, result: Heard) -> list[Metric]:
        line, worst = result.line, result.worst
        complete = sum(begin + FRAME_BYTES * line.byte <= result.history.trace.end for begin in line.begins)
        wait = max((read.wait for read in line.reads), default=0)
        return [
            Metric("torn frames", line.torn, good=line.torn == 0, note="the checksum finds them, the robot drops them"),
            Metric("longest wait", 1e6 * wait / CPU_HZ, "us", note="from a frame's last byte until it is read"),
            Metric("frames complete", complete),
            Metric("never read", complete - len(line.reads), note="the next one was complete first"),
            Metric("bytes of the next frame", worst.newer if worst else 0, note=f"of {FRAME_BYTES}, in the worst torn one"),
        ]


def arriving(line: VelocityLine, low: float, high: float, x: dict[str, Any]) -> Panel:
    """How many bytes of a frame have come over time, and how many of them stood in the buffer when the task read it."""
    begins = np.array(line.begins) / MS
    ends = begins + FRAME_BYTES * line.byte / MS
    some = (ends >= low) & (begins <= high)
    ramp = {
        "type": "scatter",
        "mode": "lines",
        "x": np.stack([begins, ends, ends], axis=1)[some].ravel(),
        "y": np.tile([0, FRAME_BYTES, np.nan], int(some.sum())),
        "name": "a frame comes",
        "line": {"color": BLUE, "width": 3},
        "hoverinfo": "skip",
    }
    marks = []
    for name, torn, symbol, colour in (("read whole", False, "circle", GREEN), ("read torn", True, "x", VERMILION)):
        found = [r for r in line.reads if (r.reception.verdict != "ok") == torn and low <= r.at / MS <= high]
        at, newer = (np.array([getattr(read, name) for read in found], dtype=float) for name in ("at", "newer"))
        marks.append(Marks(name, at / MS, newer, symbol, colour))
    panel = steps([], "bytes", high, marks, height=1.5, left=110, x=x)
    y = panel.y | {"range": [-3, FRAME_BYTES + 3], "tickvals": [0, 7, 14, 21, 28], "fixedrange": True}
    return replace(panel, traces=[ramp, *panel.traces], y=y)


def worst_read(result: Heard) -> Panel:
    """The frame that was complete, and what the task got in its place."""
    worst, title = result.worst, "the worst read"
    if worst is None:
        whole = result.line.frames[0]
        return frame_panel({"came": whole, "read": whole}, title=title, caption="every frame is read as it came", height=1.2)
    caption = (
        f"at {worst.at / MS:.2f} ms, {1e6 * worst.wait / CPU_HZ:.0f} us late: the first {worst.newer} bytes are the next frame's"
    )
    return frame_panel({"came": result.line.frames[worst.frame], "read": worst.data}, title=title, caption=caption, height=1.2)


def check_untorn(answer: TornFrame) -> Feedback:
    """Exercise: no torn frame, with one buffer, whatever the radio does."""
    if answer.buffers != 1 or answer.frames < 100 or answer.delay < 20 or answer.caches:
        return Feedback(False, "one buffer, at least 100 frames per second, delays of 20 ms or more, and the caches off")
    torn = [answer.replace(seed=seed).run().line.torn for seed in (1, 2, 3)]
    wait = answer.values()["longest wait"]
    return Feedback(not any(torn), f"{sum(torn)} torn frames in three runs; the longest wait is {wait:.0f} us")
