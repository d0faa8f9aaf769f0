"""Notebook 06, first half: why micro-ROS does not reach 1000 Hz (source 1, 5.4.1, figures 17 and 18)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, progress
from labkit.figures import BLUE, GREEN, GREY, INK, ORANGE, PALE, SKY, Curve, History, Steps, axis, curves, key, stack, steps
from labkit.robot import DATA, TICK, TIMER_RULES, WAIT_RULES, Host, MicroRos, Recording, robot, simulate

LONGEST = 3  # s
REACHED = (910, 980)  # Hz at a target of 1000 Hz, as published
REACHED_KEY = key("reached in source 1", type="bar", marker={"color": PALE})
PERIODS = {1: "1000 Hz", 2: "500 Hz", 5: "200 Hz", 10: "100 Hz", 20: "50 Hz", 30: "33 Hz"}

Us = Unit("us")
RoundTrip = Annotated[
    int,
    Interval(ge=50, le=3000),
    MultipleOf(10),
    Us,
    Doc("from the end of a publish until the frame is back at the board, at the least"),
]
Jitter = Annotated[
    int, Interval(ge=0, le=500), MultipleOf(10), Us, Doc("mean of an exponential time added to each message's round trip")
]
Wander = Annotated[
    int, Interval(ge=0, le=1000), MultipleOf(10), Us, Doc("every second the round trip grows by another random part of this")
]
Loss = Annotated[float, Interval(ge=0, le=100), MultipleOf(0.5), Unit("%"), Doc("messages that never come back")]
Executors = Annotated[
    Literal["three", "one"],
    Labels({"three": "three in turn (as in the firmware)", "one": "one for everything"}),
    Doc("executors in the task uros"),
]
Rule = Annotated[Literal["jazzy", "humble"], Labels(TIMER_RULES), Doc("what a timer does when its call comes late")]
Wheel = Annotated[Literal[1, 2, 5, 10, 20], Labels(PERIODS), Doc("target rate of the wheel controller")]
Pose = Annotated[
    Literal[1, 2, 10, 20, 30], Labels(PERIODS), Doc("rate of odometry and pose controller; not published for the 1000 Hz run")
]


@dataclass(frozen=True, eq=False)
class Spun:
    """A run and what its picture is drawn from."""

    recording: Recording
    history: History


class MicroRosRate(Experiment[Spun]):
    """How often is the wheel controller called under micro-ROS?

    Calls in each tenth of a second and in each second of the run; the grey band is what source 1 reached at a target of 1000 Hz.
    """

    slow: ClassVar[bool] = True

    wheel: Wheel = 1
    pose: Pose = 20
    round_trip: RoundTrip = 250
    jitter: Jitter = 100
    wander: Wander = 200
    loss: Loss = 0.0
    executors: Executors = "three"
    reliable: Annotated[
        bool, Doc("a publish waits inside the callback until the agent has acknowledged; the firmware's are best effort")
    ] = False
    timer_rule: Rule = "jazzy"
    wait_rule: Annotated[
        Literal["poll", "at least 1", "0 is for ever", "for ever"],
        Labels(WAIT_RULES),
        Doc("what a wait's limit means to the transport"),
    ] = "poll"
    caches: Annotated[bool, Doc("execution times with the L1 caches on, or off")] = True
    tracing: Annotated[bool, Doc("the tasks that trace, profile and tsink, run too")] = False
    seconds: Annotated[int, Interval(ge=1, le=LONGEST), Unit("s"), Doc("how long")] = LONGEST
    seed: Annotated[int, Interval(ge=1, le=99), Doc("of the random numbers")] = 7

    def setup(self) -> MicroRos:
        """Board and host as the model has them."""
        host = Host(self.round_trip, self.jitter, self.wander, self.loss / 100, seed=self.seed)
        return robot(
            self.wheel,
            self.pose,
            self.caches,
            self.tracing,
            executors=self.executors,
            reliable=self.reliable,
            timer_rule=self.timer_rule,
            wait_rule=self.wait_rule,
            host=host,
        )

    def run(self) -> Spun:
        recording = simulate(self.setup(), self.seconds, progress)
        return Spun(recording, History(recording.trace))

    def figure(self, result: Spun) -> dict[str, Any]:
        recording = result.recording
        target, begin = 1000 / self.wheel, 1000 * recording.begin
        whole = begin + 1000 * self.seconds
        tenths, seconds = recording.windows(0.1), recording.windows()
        lines = [
            Steps("in a tenth of a second", begin + np.arange(len(tenths)) * 100.0, tenths, SKY),
            Steps("in a second", begin + np.arange(len(seconds)) * 1000.0, seconds, BLUE),
            Steps("target", np.zeros(1), np.full(1, target), INK, "dot"),
        ]
        rate = steps(
            lines,
            "calls per second",
            whole,
            shapes=[_band(*REACHED)] if self.wheel == 1 else [_band(0, 0)],
            x=axis("time [ms]", range=[0, whole]),
        )
        lowest, highest = tenths.min() / target, tenths.max() / target
        ends = next(share for share in (0.88, 0.7, 0.4, 0) if share <= lowest), 1.02 if highest <= 1.02 else 1.25
        rate.y.update(range=[target * end for end in ends], rangemode="normal", fixedrange=True)
        return stack(rate, height=400, keys=[{**REACHED_KEY, "visible": self.wheel == 1}])

    def metrics(self, result: Spun) -> list[Metric]:
        r, windows = result.recording, result.recording.windows()
        data, ticks, target = r.ended(DATA), r.ended(TICK), 1000 / self.wheel
        known = r.paid is not None
        guide = r.guide() if self.wheel == 1 else None
        spread = (float(r.intervals.min()), float(r.intervals.max())) if len(r.intervals) else (None, None)
        share = result.history.shares(np.array([r.trace.start, r.trace.end]))[r.trace.code("IDLE"), 0]
        as_published = self == type(self)(seconds=self.seconds)
        return [
            Metric("wheel rate", r.rate, "Hz", published="910 to 980" if as_published else None, good=r.rate >= 0.99 * target),
            Metric("slowest second", float(windows.min()), "Hz", published=REACHED[0] if as_published else None),
            Metric("fastest second", float(windows.max()), "Hz", published=REACHED[1] if as_published else None),
            Metric("periods dropped", r.dropped["w_ctrl"], "", good=not r.dropped["w_ctrl"]),
            Metric("D: waits ended by data", data, "1/s"),
            Metric("K: waits ended by a tick", ticks, "1/s"),
            Metric("a: encoder data per call", r.paid, "", note="" if known else "the wheel controller was never called"),
            Metric("1000 / (2 - a)", guide, "Hz", note="the guide, if every tick ended a wait; at a target of 1000 Hz only"),
            Metric("K / (2 - a)", r.guide(ticks) if self.wheel == 1 else None, "Hz", note="the same with the K counted here"),
            Metric("shortest interval", spread[0], "ms", note="between two calls of the wheel controller"),
            Metric("longest interval", spread[1], "ms", note="between two calls of the wheel controller"),
            Metric("processor busy", 100 * (1 - float(share)), "%"),
        ]


def _band(low: float, high: float) -> dict[str, Any]:
    """What was published, as a band across a panel of rates."""
    return {
        "type": "rect",
        "xref": "x domain",
        "x0": 0,
        "x1": 1,
        "y0": low,
        "y1": high,
        "fillcolor": GREY,
        "opacity": 0.25,
        "line": {"width": 0},
        "layer": "below",
    }


# Many runs


@lru_cache(maxsize=4096)
def reached(setup: MicroRos, seconds: float) -> tuple[float, float | None]:
    """Rate of the wheel controller, and the guide's 1000 / (2 - a), both in Hz."""
    recording = simulate(setup, seconds)
    return recording.rate, recording.guide()


POINT = 0.3  # s, of a run that makes one point
OVER: dict[str, Sequence[float]] = {
    "round_trip": (100, 200, 300, 500, 700, 900, 1200),
    "jitter": (0, 20, 50, 100, 200, 300, 400),
    "loss": (0, 1, 2, 5, 10, 20, 50),
}
AXES = {"round_trip": "round trip [us]", "jitter": "mean jitter [us]", "loss": "messages lost [%]"}
LINES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "three": ("three executors, Jazzy", BLUE, {}),
    "humble": ("three executors, Humble", ORANGE, {"timer_rule": "humble"}),
    "one": ("one executor", GREEN, {"executors": "one"}),
}


@dataclass(frozen=True)
class Rates:
    """Rates in Hz over `x`, by the names of `LINES`, and what the guide says of the first."""

    x: Sequence[float]
    rate: dict[str, list[float]]
    guide: list[float | None]


class RateCurves(Experiment[Rates]):
    """Does a faster network help? The rate at a target of 1000 Hz over the round trip, its jitter, or the loss.

    Each point is a run of 0.3 s; what is not on the axis is 300 us, the jitter chosen, and no loss. The dashed
    line is the guide 1000 / (2 - a) with the a counted in the runs of the blue line.
    """

    slow: ClassVar[bool] = True

    over: Annotated[
        Literal["round_trip", "jitter", "loss"],
        Labels({"round_trip": "round trip", "jitter": "jitter", "loss": "loss"}),
        Doc("what changes from left to right"),
    ] = "round_trip"
    pose: Pose = 20
    jitter: Annotated[Literal[0, 100, 300], Us, Doc("mean jitter, where it is not on the axis")] = 100
    tracing: Annotated[bool, Doc("the tasks that trace, profile and tsink, run too")] = False

    def setup(self, x: float, line: str) -> MicroRos:
        """The run of one point."""
        values = {"round_trip": 300.0, "jitter": self.jitter, "loss": 0.0, self.over: x}
        host = Host(values["round_trip"], values["jitter"], loss=values["loss"] / 100)
        return robot(1, self.pose, tracing=self.tracing, host=host, **LINES[line][2])

    def run(self) -> Rates:
        points = OVER[self.over]
        found = {
            (line, x): reached(self.setup(x, line), POINT) for line, x in progress([(line, x) for line in LINES for x in points])
        }
        rate = {line: [found[line, x][0] for x in points] for line in LINES}
        return Rates(points, rate, [found["three", x][1] for x in points])

    def figure(self, result: Rates) -> dict[str, Any]:
        lines = [Curve(name, result.x, result.rate[line], colour) for line, (name, colour, _) in LINES.items()]
        lines.append(Curve("guide 1000 / (2 - a)", result.x, result.guide, GREY, "dash"))
        lowest = min(min(rates) for rates in result.rate.values())
        y = axis("calls per second", range=[100 * ((min(900, lowest) - 20) // 100), 1030])
        return stack(
            curves(lines, axis(AXES[self.over], range=[0, 1.03 * max(result.x)]), y, shapes=[_band(*REACHED)]),
            height=480,
            keys=[REACHED_KEY],
        )

    def metrics(self, result: Rates) -> list[Metric]:
        found = []
        for line, (name, _, _) in LINES.items():
            rates = result.rate[line]
            found.append(Metric(f"lowest: {name}", min(rates), "Hz"))
            found.append(Metric(f"highest: {name}", max(rates), "Hz"))
        return found


# Exercises


def check_thousand(answer: MicroRosRate) -> Feedback:
    """Exercise 1: 1000 Hz over the network as it is."""
    given = MicroRosRate()
    for name in ("wheel", "round_trip", "jitter", "wander", "loss", "caches"):
        if getattr(answer, name) != getattr(given, name):
            return Feedback(False, f"{name.replace('_', ' ')} has to stay as it is.")
    slowest = float(simulate(answer.setup(), 3).windows().min())
    return Feedback(slowest >= 998, f"the slowest of three seconds has {slowest:.0f} calls.")


def check_longer_is_faster(shorter: MicroRosRate, longer: MicroRosRate) -> Feedback:
    """Exercise 2: two round trips, of which the longer one gives 50 Hz more."""
    if shorter.replace(round_trip=longer.round_trip) != longer:
        return Feedback(False, "the two may differ in the round trip only.")
    if shorter.round_trip >= longer.round_trip:
        return Feedback(False, "the first must have the shorter round trip.")
    slow, fast = (simulate(e.setup(), 2).rate for e in (shorter, longer))
    text = f"{shorter.round_trip} us give {slow:.0f} Hz, {longer.round_trip} us give {fast:.0f} Hz."
    return Feedback(fast - slow >= 50, text)
