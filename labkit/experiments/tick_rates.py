"""Notebook 05: the robot's tasks from 50 Hz to 10 kHz, and what the stamps of the tracer cost (source 1, 5.2 and 5.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import published_table
from labkit.experiment import Experiment, Feedback, Labels, Metric, View, progress
from labkit.figures import SKY, VERMILION, History, Marks, Panel, Steps, axis, gantt, stack, steps
from labkit.robot import CPU_HZ, PERIODIC, PRIORITIES, RATES, Board, Firmware, OnBlocks, Sink, TracePath, build, published
from labkit.trace import Trace

ROWS = ("tsink", "hal_fetch", "wheel_ctrl", "odometry", "pose_ctrl", "profile", "IDLE")
KEYS = ("ready", "waits for lock, queue, signal", "release", "deadline", "missed")
MS = CPU_HZ // 1000
WINDOW = 100  # ms simulated for a slider
BINARY_STAMP = 108  # cycles to put a binary stamp into the ring, 0.5 us: an assumption, nobody has measured it
COLUMNS = 700  # of a fill curve, with a lowest and a highest value each
CROSSES = 100  # columns for the marks at lost stamps: of more of them side by side each would cover the next

RateName = Literal["50|30", "100|50", "1000", "5000|2000", "10000|5000"]
RATE_NAMES = {name: f"{name} Hz" for name in RATES}
BAUDS = {115_200: "115 200", 1_152_000: "1 152 000", 2_000_000: "2 000 000", 12_500_000: "12 500 000"}

Rate = Annotated[RateName, Labels(RATE_NAMES), Doc("rate of encoder fetch and wheel control | of odometry and pose control")]
Caches = Annotated[bool, Doc("published execution times with the L1 caches on, or off")]
Baud = Annotated[Literal[115_200, 1_152_000, 2_000_000, 12_500_000], Labels(BAUDS), Unit("baud"), Doc("speed of the trace link")]
Stamp = Literal["text", "record", "word"]
Full = Literal["wait", "drop"]
Form = Annotated[
    Stamp,
    Labels({"text": "lines of text", "record": "records of 8 bytes", "word": "words of 4 bytes"}),
    Doc("what a stamp looks like on the link"),
]
WhenFull = Annotated[
    Full,
    Labels({"wait": "the writer waits 1 ms", "drop": "the stamp is dropped"}),
    Doc("what happens to a stamp when the ring is full"),
]


@dataclass(frozen=True, eq=False)
class Recording:
    """What the board did.

    Attributes:
        history: who ran when.
        late: jobs that were not over at their next release.
        sink: what became of the stamps; None without a tracer.
        shares: processor time of each task of `ROWS`, 0 to 1.
        off: the largest deviation of the interval between two starts of wheel_ctrl from its period, in us.
    """

    history: History
    late: int
    sink: Sink | None
    shares: dict[str, float]
    off: float

    @cached_property
    def switches(self) -> int:
        """How often the processor changed hands: counted once, every picture asks."""
        return int(self.history.trace.of("switch").sum())

    def lost(self) -> int:
        """Stamps that never reach the host: no room in the temp buffer or in the ring."""
        return self.sink.lost(self.switches) if self.sink else 0

    def taken(self) -> int:
        """Stamps that `profile` has taken over, and those that scopes have written."""
        return self.sink.arrived() if self.sink else 0

    def stretches(self, task: str) -> float:
        """How often per second the task got the processor; the published tables have it as sum / mean."""
        trace = self.history.trace
        return float((trace.of("switch") & (trace.task == trace.code(task))).sum()) * trace.hz / trace.end

    def intervals(self, task: str = "wheel_ctrl") -> np.ndarray:
        """From one start of a task of `FIRST_LOOK` to the next, in us."""
        return np.diff(starts(self.history.trace, task)) * (1e6 / CPU_HZ)

    def on_air(self) -> float:
        """Share of the time in which the link transmits."""
        if self.sink is None:
            return 0.0
        begin, end, _ = self.sink.transfers().T
        return float((np.minimum(end, self.history.trace.end) - begin).sum() / self.history.trace.end)


#: The queue into which a job of these tasks looks before all else.
FIRST_LOOK = {"wheel_ctrl": "enc_delta_wheel_ctrl_queue", "odometry": "enc_delta_odom_queue"}


def starts(trace: Trace, task: str = "wheel_ctrl") -> np.ndarray:
    """When the jobs of a task of `FIRST_LOOK` began, in units of the trace."""
    looks = trace.of("recv", "recv_fail") & (trace.task == trace.code(task))
    return trace.time[looks & (trace.other == trace.code(FIRST_LOOK[task]))]


def read(board: Board) -> Recording:
    """Fold what the board has done so far."""
    history = History(board.kernel.trace)
    trace = history.trace
    share = history.shares(np.array([0, trace.end]))[:, 0]
    shares = {name: float(share[trace.code(name)]) if name in trace.names else 0.0 for name in ROWS}
    period = board.firmware.rates.period("wheel_ctrl") * CPU_HZ // board.firmware.rates.tick_hz
    off = np.abs(np.diff(starts(trace)) - period).max(initial=0) * 1e6 / CPU_HZ
    return Recording(history, sum(board.late.values()) + overdue(board), board.sink, shares, float(off))


def overdue(board: Board) -> int:
    """Jobs that should be over by now and are not, those included that could not even begin."""
    trace, rates, behind = board.kernel.trace, board.firmware.rates, 0
    for task in PERIODIC:
        over = int((trace.of("complete") & (trace.task == trace.code(task))).sum())
        behind += max(0, trace.end * rates.tick_hz // (rates.period(task) * CPU_HZ) - over)
    return behind


def traced(rates: str, caches: bool, **path: Any) -> Firmware:
    """The published firmware with another trace path, which writes 16 stamps at a time. `path`: attributes of `TracePath`."""
    firmware = published(rates, caches)
    assert firmware.trace_path is not None
    cost = firmware.trace_path.stamp if path.get("form", "text") == "text" else BINARY_STAMP
    return replace(firmware, trace_path=replace(firmware.trace_path, batch=16, stamp=cost, **path))


def window(start: float, end: float, whole: float) -> tuple[float, float]:
    """The part to show, in ms: in order, inside, and not empty."""
    low, high = sorted((min(start, whole), min(end, whole)))
    return (low, high) if high - low >= whole / 1e6 else (max(0.0, high - whole / 1e3), max(high, whole / 1e3))


def fill_panel(sink: Sink | None, low: float, high: float, **more: Any) -> Panel:
    """Bytes in the ring from `low` to `high` in ms, half as far again on either side for a drag, and when the temp buffer lost
    stamps, once per column.
    """
    times, fills = sink.curve() if sink else (np.zeros(1, np.int64), np.zeros(1, np.int64))
    pad = (high - low) / 2
    left, right = low - pad, min(high + pad, max(high, times[-1] / MS))
    at, value = envelope(times / MS, fills, left, right)
    rounds = sink.table() if sink else np.empty((0, 4), np.int64)
    bad = rounds[rounds[:, 2] + rounds[:, 3] > 0, 0] / MS
    bad = bad[(bad >= left) & (bad <= right)]
    _, first = np.unique(np.floor((bad - left) * (CROSSES / (2 * pad + high - low))), return_index=True)
    bad = bad[first]
    capacity = sink.capacity if sink else TracePath.capacity
    lost = Marks("stamps lost", bad, float(capacity), "x", VERMILION)
    panel = steps([Steps("bytes in the ring", at, value, SKY)], "ring [bytes]", right, [lost], **more)
    panel.y.update(range=[0, 1.2 * capacity], rangemode="normal", tickvals=[0, capacity // 2, capacity], fixedrange=True)
    return panel


def envelope(time: np.ndarray, value: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """A step curve within a window: as it is, or where it has many steps its lowest and highest value per column."""
    first = max(0, int(np.searchsorted(time, low, side="right")) - 1)
    last = int(np.searchsorted(time, high, side="right"))
    time, value = time[first:last], value[first:last]
    if len(time) <= 2 * COLUMNS:
        return time, value
    at = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], COLUMNS, endpoint=False)))
    both = np.stack([np.minimum.reduceat(value, at), np.maximum.reduceat(value, at)], axis=1)
    return np.repeat(time[at], 2), both.ravel()


def picture(recording: Recording, low: float, high: float, height: int = 420) -> dict[str, Any]:
    """Who ran, above the fill of the ring, over one axis that can be zoomed."""
    trace = recording.history
    return stack(
        gantt(trace, ROWS, low, high, height=3.4),
        fill_panel(recording.sink, low, high, height=1.0, left=110),
        height=height,
        shared=axis("time [ms]", range=[low, high]),
        keys=KEYS,
        meta={"range": ("start", "end")},
    )


@cache
def published_idle(rates: str, caches: bool) -> float | None:
    """Idle share printed in tables 6 to 9, in %."""
    table = published_table("xu2025_runtime_stats.csv").query("platform == 'FreeRTOS' and name == 'IDLE'")
    fast, _, slow = rates.partition("|")
    found = table[
        (table["wheel_hz"] == int(fast))
        & (table["pose_hz"] == int(slow or fast))
        & (table["caches"] == ("on" if caches else "off"))
    ]
    return float(found["share_pct"].iloc[0]) if len(found) else None


class TickRates(Experiment[Recording]):
    """What is left of the processor at 50 Hz, and what at 10 kHz?

    The tasks of the robot under FreeRTOS with their published execution times, and the tracer that watches them: `profile` makes
    a line of every stamp, `tsink` sends them. Zoom into the picture with the mouse; a double click shows all of it.
    """

    rates: Rate = "100|50"
    caches: Caches = True
    tracer: Annotated[bool, Doc("whether profile and tsink run")] = True
    baud: Baud = 2_000_000
    form: Form = "text"
    when_full: WhenFull = "wait"
    buffer: Annotated[Literal[512, 1024, 2048], Unit("stamps"), Doc("room in the temp buffer; 512 in source 1")] = 512
    scopes: Annotated[bool, Doc("each job stamps its own begin and end as well, straight into the ring")] = False
    profile_below: Annotated[bool, Doc("profile has a lower priority than the control tasks, not the same")] = False
    start: Annotated[float, Interval(ge=0, le=WINDOW), MultipleOf(0.05), Unit("ms"), View(), Doc("left edge of the picture")] = (
        0.0
    )
    end: Annotated[float, Interval(ge=0, le=WINDOW), MultipleOf(0.05), Unit("ms"), View(), Doc("right edge of the picture")] = (
        100.0
    )

    def run(self) -> Recording:
        path = {name: getattr(self, name) for name in ("baud", "form", "when_full", "buffer", "scopes")}
        firmware = traced(self.rates, self.caches, **path)
        priorities = PRIORITIES | ({"profile": 1} if self.profile_below else {})
        firmware = replace(firmware, trace_path=firmware.trace_path if self.tracer else None, priorities=priorities)
        board = build(firmware, OnBlocks())
        board.advance(WINDOW * MS)
        return read(board)

    def figure(self, result: Recording) -> dict[str, Any]:
        return picture(result, *window(self.start, self.end, WINDOW))

    def metrics(self, result: Recording) -> list[Metric]:
        return recording_metrics(result, published_idle(self.rates, self.caches) if self.tracer else None)


def recording_metrics(result: Recording, idle: float | None) -> list[Metric]:
    """The numbers of a recording worth a line; `idle`: the published idle share, if there is one."""
    share, control = result.shares, sum(result.shares[task] for task in PERIODIC)
    lost, all_ = result.lost(), result.lost() + result.taken()
    return [
        Metric("idle", 100 * share["IDLE"], "%", published=idle, good=share["IDLE"] > 0.1),
        Metric("control tasks", 100 * control, "%", note="the four tasks the robot needs"),
        Metric("tracer", 100 * (share["profile"] + share["tsink"]), "%", good=share["profile"] + share["tsink"] < control),
        Metric("wheel_ctrl, interval off by at most", result.off, "us", note="from one start to the next, against its period"),
        Metric("late jobs", result.late, "", good=result.late == 0, note="not over before their next release"),
        Metric(
            "stamps lost",
            lost,
            "",
            good=lost == 0,
            note=f"of {all_}; the link transmits {100 * result.on_air():.0f} % of the time",
        ),
    ]


class LongRun(Experiment[Recording]):
    """Can twenty seconds of a 10 kHz system be looked at?

    The same system for longer, with every event in the trace. The run goes on beside the controls; then the picture is drawn
    from sums, so that any window of millions of slices comes at once. Zoom in: the longer the window, the more a bar becomes a
    share.
    """

    slow: ClassVar[bool] = True
    rates: Rate = "5000|2000"
    seconds: Annotated[int, Interval(ge=1, le=20), Unit("s"), Doc("length of the recording")] = 1
    caches: Caches = True
    baud: Baud = 12_500_000
    start: Annotated[float, Interval(ge=0, le=20_000), MultipleOf(0.05), Unit("ms"), View(), Doc("left edge of the picture")] = (
        0.0
    )
    end: Annotated[float, Interval(ge=0, le=20_000), MultipleOf(0.05), Unit("ms"), View(), Doc("right edge of the picture")] = (
        20_000.0
    )

    @classmethod
    def strategy(cls) -> Any:
        """Short recordings only: the long ones differ in nothing but their time."""
        return super().strategy().map(lambda drawn: drawn.replace(seconds=1))

    def run(self) -> Recording:
        board = build(traced(self.rates, self.caches, baud=self.baud), OnBlocks())
        for tenth in progress(range(1, 10 * self.seconds + 1)):
            board.advance(tenth * 100 * MS)
        return read(board)

    def figure(self, result: Recording) -> dict[str, Any]:
        return picture(result, *window(self.start, self.end, 1000.0 * self.seconds))

    def metrics(self, result: Recording) -> list[Metric]:
        made = recording_metrics(result, published_idle(self.rates, self.caches))
        return [
            Metric("events", len(result.history.trace)),
            Metric("slices", len(result.history.occupancy.start)),
            *made[:1],
            *made[3:],
        ]


def check_no_loss(answer: TickRates) -> Feedback:
    """Exercise: at 10000|5000 Hz with the tracer on, lose no stamp."""
    if answer.rates != "10000|5000" or not answer.tracer:
        return Feedback(False, "leave the rates at 10000|5000 Hz and the tracer on")
    found = answer.run()
    if found.lost():
        table = found.sink.table() if found.sink else np.zeros((1, 4))
        where = "the ring" if found.lost() == table[:, 3].sum() else "the temp buffer"
        return Feedback(False, f"{found.lost()} stamps are lost in {WINDOW} ms, in {where}")
    return Feedback(
        True, f"all {found.taken()} stamps arrive, and the tracer takes {100 * found.shares['profile']:.0f} % of the processor"
    )
