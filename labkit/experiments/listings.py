"""Notebook 05: what source 1 prints of its recordings above 1 kHz, beside the model (listings 37 and 38)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import published_table
from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.experiments.tick_rates import KEYS, MS, ROWS, starts
from labkit.figures import axis, gantt, stack
from labkit.kernel import Costs
from labkit.robot import CPU_HZ, CREATED, PUBLISHED_NAMES, OnBlocks, build, published
from labkit.trace import CODE, STATES, Trace

SWITCH, BLOCKED = CODE["switch"], STATES.index("blocked")

LISTINGS = {"37": ("xu2025_trace_5000_2000hz.csv", "5000|2000", 288), "38": ("xu2025_trace_10000_5000hz.csv", "10000|5000", 36)}
OURS = {printed: task for task, printed in PUBLISHED_NAMES.items()}


@dataclass(frozen=True, eq=False)
class Excerpts:
    """The published excerpt and the model's, as traces in us, with the gaps between starts around the common release."""

    published: Trace
    model: Trace
    gaps: dict[str, tuple[float, float]]


def excerpt(name: str) -> Trace:
    """A published listing as a trace in us; where two stamps leave a gap, nobody is known to run.

    Of a job whose end was left out of the listing only its begin is known: it gets 1 us.
    """
    table = published_table(name)
    tasks = [OURS.get(task, task) for task in table["name"]]
    names = list(dict.fromkeys(tasks))
    stamps = list(zip(map(names.index, tasks), table["time_us"].tolist(), table["begin"].tolist(), strict=True))
    rows = []
    for (task, time, begin), following in zip(stamps, [*stamps[1:], (-1, 0, 0)], strict=True):
        rows.append((time, SWITCH, task if begin else -1, -1 if begin else task, 0, BLOCKED))
        if begin and following[0] != task:
            rows.append((time + 1, SWITCH, -1, task, 0, BLOCKED))
    return Trace.from_rows(rows, names, 1_000_000, end=stamps[-1][1] + 1)


def begins(trace: Trace, task: str) -> np.ndarray:
    """When a task got the processor, in us."""
    switches = trace.rows("switch")
    return switches[switches[:, 2] == trace.code(task), 0] * (1e6 / trace.hz)


class Listings(Experiment[Excerpts]):
    """Every 200 us, always at the same instants?

    Above: an excerpt of the recording as source 1 prints it (listings 37 and 38). Below: the model at the same rates, its trace
    moved so that the release of all four tasks lies at the same place. Whoever went to sleep first is first to wake, so the slow
    tasks run before the fast ones where both are due, and shift them.
    """

    listing: Annotated[
        Literal["37", "38"], Labels({"37": "37: 5000|2000 Hz", "38": "38: 10000|5000 Hz"}), Doc("which listing of source 1")
    ] = "37"
    switch: Annotated[int, Interval(ge=0, le=500), MultipleOf(10), Unit("cycles"), Doc("what a switch of tasks costs")] = 150

    def run(self) -> Excerpts:
        name, rates, release = LISTINGS[self.listing]
        recorded = excerpt(name)
        slow = ("odometry", "pose_ctrl") if self.listing == "37" else ("pose_ctrl", "odometry")  # who was first at the start
        order = tuple(slow[0] if task == "pose_ctrl" else slow[1] if task == "odometry" else task for task in CREATED)
        board = build(replace(published(rates), order=order, costs=Costs(tick=200, switch=self.switch)), OnBlocks())
        board.advance(4 * MS)
        us = MS // 1000
        shift = release * us - MS  # the release of all at 1 ms lies where the listing has it
        whole = board.kernel.trace
        part = whole.window(-shift, -shift + recorded.end * us)
        moments = part.of("release", "deadline", "complete")  # their values are times, too
        moved = replace(part, time=part.time + shift, value=part.value + shift * (moments & (part.value >= 0)))
        gaps = {}
        for task in ("wheel_ctrl", "hal_fetch", slow[0]):
            told, found = begins(recorded, task), begins(whole, task) + shift / us
            after = found[found >= told[-1] - 40]
            before = found[found < after[0]]
            gaps[task] = float(np.diff(told)[-1]), float(after[0] - before[-1])
        return Excerpts(recorded, replace(moved, start=0, end=recorded.end * us), gaps)

    def figure(self, result: Excerpts) -> dict[str, Any]:
        end = result.published.end / 1000
        above = gantt(result.published, ROWS, 0, end, title="Recorded (source 1)")
        below = gantt(result.model, ROWS, 0, end, title="Model")
        return stack(above, below, height=520, shared=axis("time [ms]", range=[0, end]), keys=KEYS)

    def metrics(self, result: Excerpts) -> list[Metric]:
        names = ("wheel_ctrl, gap between starts", "hal_fetch, gap between starts", "slow task, gap between starts")
        notes = (
            "the last two starts of the listing; in 38 tsink came in between, called by the link",
            "the last two starts of the listing",
            "odometry in listing 37, pose_ctrl in listing 38",
        )
        return [
            Metric(name, model, "us", published=told, note=note)
            for name, note, (told, model) in zip(names, notes, result.gaps.values(), strict=True)
        ]


def check_next_gap(us: float) -> Feedback:
    """Exercise: the gap between wheel starts that follows the one of 217 us."""
    board = build(published("5000|2000"), OnBlocks())
    board.advance(3 * MS)
    gaps = np.diff(starts(board.kernel.trace)) * (1e6 / CPU_HZ)
    right = float(gaps[int(np.argmax(gaps > 210)) + 1])
    if abs(us - right) <= 6:
        return Feedback(True, f"the model says {right:.0f} us: late once is early the next time, and the mean stays 200 us")
    return Feedback(False, f"the model does not say {us:g} us; when is the release after the late start?")
