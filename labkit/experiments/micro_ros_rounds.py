"""Notebook 06: a few milliseconds of micro-ROS at 1000 Hz, wait by wait (source 1, 5.4.1, figures 17 and 18)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View
from labkit.experiments.micro_ros import Executors, Jitter, Loss, MicroRosRate, RoundTrip, Rule, Spun
from labkit.figures import INK, Panel, axis, colours, gantt, rows_axis, stack
from labkit.robot import DATA, TICK, Recording

ROWS = ("EthIf", "tcpip_thread", "uros", "profile", "IDLE")
SCOPES = ("w_ctrl", "odom", "odometry", "p_ctrl")
LENGTH = 1000  # ms simulated
ENDS = {"a wait ends by data": (DATA, "circle-open"), "by a tick": (TICK, "triangle-down")}


class ExecutorRounds(Experiment[Spun]):
    """Where do the calls go?

    A second of `MicroRosRate` at a target of 1000 Hz, what is not chosen here as it is there. Above: the processor. Below: the
    callbacks inside `uros`, and how each of its waits that could block came to its end.
    """

    slow: ClassVar[bool] = True

    round_trip: RoundTrip = 250
    jitter: Jitter = 100
    loss: Loss = 0.0
    executors: Executors = "three"
    timer_rule: Rule = "jazzy"
    tracing: Annotated[bool, Doc("the tasks that trace, profile and tsink, run too")] = False
    start: Annotated[float, Interval(ge=0, le=LENGTH), MultipleOf(0.05), Unit("ms"), View(), Doc("left edge of the picture")] = (
        137.0
    )
    end: Annotated[float, Interval(ge=0, le=LENGTH), MultipleOf(0.05), Unit("ms"), View(), Doc("right edge of the picture")] = (
        145.0
    )

    def run(self) -> Spun:
        chosen = self.model_dump(exclude={"start", "end"})
        return MicroRosRate(seconds=LENGTH // 1000, **chosen).run()

    def window(self) -> tuple[float, float]:
        """The part shown in ms: in order, inside, and not empty."""
        low, high = sorted((self.start, self.end))
        return (low, high) if high - low >= 0.01 else (max(low - 1.0, 0.0), max(low, 1.0))

    def figure(self, result: Spun) -> dict[str, Any]:
        low, high = self.window()
        return stack(
            gantt(result.history, ROWS, low, high, height=5),  # the first, since its axis is what a zoom tells
            callbacks(result.recording, low, high, title="inside uros", height=5),
            height=450,
            shared=axis("time [ms]", range=[low, high]),
            keys=("ready", "waits for lock, queue, signal"),
            meta={"range": ("start", "end")},
        )

    def metrics(self, result: Spun) -> list[Metric]:
        r, (low, high) = result.recording, self.window()
        shown = (1e3 * r.calls >= low) & (1e3 * r.calls < high)
        return [
            Metric("calls of w_ctrl in the picture", int(shown.sum()), note=f"in {high - low:.4g} ms, at a period of 1 ms"),
            Metric("wheel rate", r.rate, "Hz", good=r.rate >= 990, note="in the whole second"),
            Metric("periods dropped", r.dropped["w_ctrl"], good=not r.dropped["w_ctrl"], note="in the whole second"),
            Metric("D: waits ended by data", r.ended(DATA), "1/s"),
            Metric("K: waits ended by a tick", r.ended(TICK), "1/s"),
            Metric("longest interval", float(r.intervals.max(initial=0)), "ms", note="between two calls of w_ctrl"),
        ]


def callbacks(recording: Recording, low: float, high: float, **more: Any) -> Panel:
    """The callbacks as rows of bars, from their begin to their end, from `low` to `high` in ms, at most 1500 of them; above them
    the ends of the waits that could block.
    """
    ms, paint = recording.trace.hz / 1e3, colours(SCOPES)
    drawn = []
    for row, name in enumerate(SCOPES, start=1):
        found = recording.passes(name) / ms
        found = found[(found[:, 1] > low) & (found[:, 0] < high)][: 1500 // len(SCOPES)]
        drawn.append(
            {
                "type": "bar",
                "orientation": "h",
                "base": found[:, 0],
                "x": found[:, 1] - found[:, 0],
                "y": np.full(len(found), -row),
                "width": 0.6,
                "marker": {"color": paint[name], "line": {"width": 0}},
                "showlegend": False,
                "hovertemplate": f"{name}<br>from %{{base:.3f}} ms for %{{x:.3f}} ms<extra></extra>",
            }
        )
    limit, how, at = recording.waits[:, :3].T
    for name, (kind, symbol) in ENDS.items():
        ended = at[(limit > 0) & (how == kind)] / ms
        ended = ended[(ended >= low) & (ended <= high)][:250]
        drawn.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": ended,
                "y": np.zeros(len(ended)),
                "marker": {"symbol": symbol, "size": 11, "color": INK, "line": {"width": 2.5, "color": INK}},
                "name": name,
                "hovertemplate": f"{name}: %{{x:.3f}} ms<extra></extra>",
            }
        )
    return Panel(drawn, rows_axis(("a wait ends", *SCOPES), automargin=False), **more)
