"""Notebook 13: two stations with a chain of phases each, one radio, and what their fusion works on (source 2, T7 and T8)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Labels, Metric, View, progress
from labkit.figures import BLUE, INK, VERMILION, Panel, axis, colours, stack
from labkit.network import CORRECTIONS, Correction, GilbertElliott
from labkit.phases import LaserTeam, laser_team

MS = 1_000_000
STATIONS = ("station 1", "station 2")
PERIODS = 60
MOST_APART = 200  # ms that are drawn; what is further apart lies at the edge


class DistributedFusion(Experiment[LaserTeam]):
    """Do two stations fuse what belongs together?

    Each runs the chain of experiment 1 in periods of 100 ms, sends its contours to the other one in the window of the
    communication, and fuses its own with those that have come. Incoherent: the timestamps differ by more than the threshold SW
    of (5.1).
    """

    slow: ClassVar[bool] = True
    headline: ClassVar[tuple[str, ...]] = ("coherent fusions", "windows in common", "deadlines missed")
    correction: Annotated[Correction, Labels(CORRECTIONS), Doc("how the periods are kept together")] = "absolute"
    offset: Annotated[int, Interval(ge=0, le=99), Unit("ms"), Doc("station 2 starts so much later")] = 0
    drift: Annotated[float, Interval(ge=0, le=100), MultipleOf(0.01), Unit("ppm"), Doc("its clock is fast by that")] = 2.14
    mirror: Annotated[int, Interval(ge=0, le=25), Unit("ms"), Doc("longest wait of a scanner for its mirror")] = 13
    loss: Annotated[int, Interval(ge=0, le=60), Unit("%"), Doc("share of the transmissions that a receiver loses")] = 0
    omission_degree: Annotated[int, Interval(ge=1, le=3), Doc("OD of the group communication")] = 1
    threshold: Annotated[int, Interval(ge=0, le=100), Unit("ms"), View(), Doc("SW: data that differ by more are incoherent")] = 15
    period: Annotated[int, Interval(ge=0, le=PERIODS - 1), View(), Doc("the period that is shown")] = 10
    seed: Annotated[int, Interval(ge=0, le=99), Doc("another one draws other times and losses")] = 1

    def run(self) -> LaserTeam:
        loss = GilbertElliott.bursts(self.loss / 100)
        [found] = [
            laser_team(
                2,
                PERIODS,
                self.correction,
                self.drift,
                self.offset * MS,
                mirror_ns=self.mirror * MS,
                omission_degree=self.omission_degree,
                loss=loss,
                seed=self.seed,
            )
            for _ in progress([0])
        ]
        return found

    def figure(self, result: LaserTeam) -> dict[str, Any]:
        team = result.team
        begin = int(team.begin(0, team.organisers[0].windows[0])[self.period])
        names = [window.phase for window in team.organisers[0].windows]
        colour = colours(names)
        bars = [_windows(result, index, name, colour[name], begin) for index, name in enumerate(names)]
        own = [fused for fused in team.fused if 0 <= fused.begin_ns - begin < 100 * MS]
        taken = {
            "type": "scatter",
            "mode": "markers",
            "x": [(fused.begin_ns - begin) / MS for fused in own],
            "y": [-fused.station + 0.42 for fused in own],
            "name": "fusion begins",
            "marker": {"symbol": "triangle-down", "size": 14, "color": INK},
            "hovertemplate": "fusion begins at %{x:.1f} ms<extra></extra>",
        }
        y = axis("", range=[-1.6, 0.75], tickvals=[0, -1], ticktext=[f"<b>{name}</b>" for name in STATIONS], showgrid=False)
        x = axis(f"time since the begin of period {self.period} of station 1 [ms]", range=[0, 100])
        apart = result.apart_ns / MS
        inside, beyond = (apart >= 0) & (apart <= self.threshold), apart > self.threshold
        near = apart <= MOST_APART
        number = np.array([fused.period for fused in team.fused])
        alone = len(apart) - int(inside.sum() + beyond.sum())
        lacking = f"; {alone} of {len(apart)} had those of one station only" if alone else ""
        drawn = [
            _points("coherent", number[inside], apart[inside], BLUE, "circle"),
            _points("incoherent", number[beyond & near], apart[beyond & near], VERMILION, "x"),
            _points(f"beyond {MOST_APART} ms", number[~near], apart[~near], VERMILION, "triangle-up"),
            {
                "type": "scatter",
                "mode": "lines",
                "x": [-1, PERIODS],
                "y": [self.threshold] * 2,
                "name": "threshold SW",
                "line": {"color": INK, "width": 2, "dash": "dot"},
                "hoverinfo": "skip",
            },
        ]
        across = axis("period", range=[-1, PERIODS])
        return stack(
            Panel([*bars, taken], y, x, title="Windows on the global clock", above=46, height=0.8, left=96),
            Panel(
                drawn,
                axis("apart [ms]", range=[-5, MOST_APART + 10]),
                across,
                title="Timestamps that one fusion works on" + lacking,
                height=1.2,
                left=96,
            ),
            height=436,  # the legend has three lines
        )

    def metrics(self, result: LaserTeam) -> list[Metric]:
        share, there = result.coherent(self.threshold * MS), result.apart_ns[result.apart_ns >= 0]
        alone = len(result.apart_ns) - len(there)
        overlap = result.team.overlap()
        return [
            Metric("coherent fusions", 100 * share, "%", good=share == 1, note=f"of {len(result.apart_ns)}, by the threshold"),
            Metric("windows in common", 100 * float(overlap.mean()), "%", note="of equal phases, on the global clock"),
            Metric("deadlines missed", result.missed, good=result.missed == 0),
            Metric(
                "data of both",
                100 * len(there) / max(1, len(result.apart_ns)),
                "%",
                note=f"at the begin of the fusion, however old; {alone} fusions had one station's only",
            ),
            Metric(
                "largest difference",
                float(there.max()) / MS if len(there) else None,
                "ms",
                note="of the timestamps in one fusion",
            ),
            Metric("least in common", 100 * float(overlap.min()), "%", note="of any window in any period"),
            Metric(
                "delivery bound",
                result.bound_ns / MS,
                "ms",
                good=result.bound_ns <= result.window_ns,
                note=f"has to fit into the window of the communication, {result.window_ns / MS:.2f} ms",
            ),
            Metric("left the group", result.left, "times"),
        ]


def _windows(result: LaserTeam, index: int, name: str, colour: str, begin: int) -> dict[str, Any]:
    """The windows of one phase on both stations that lie in the hundred milliseconds after `begin`."""
    at, length, row = [], [], []
    for station, organiser in enumerate(result.team.organisers):
        window = organiser.windows[index]
        starts = result.team.begin(station, window) - begin
        for start in starts[(starts > -window.deadline_ns) & (starts < 100 * MS)].tolist():
            first, last = max(0, start), min(100 * MS, start + window.deadline_ns)
            at.append(first / MS)
            length.append((last - first) / MS)
            row.append(-station)
    return {
        "type": "bar",
        "orientation": "h",
        "base": at,
        "x": length,
        "y": row,
        "width": 0.6,
        "name": name.removeprefix("LMS"),
        "marker": {"color": colour, "line": {"color": "white", "width": 1}},
        "hovertemplate": f"{name}: %{{x:.2f}} ms<extra></extra>",
    }


def _points(name: str, x: np.ndarray, y: np.ndarray, colour: str, symbol: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": np.minimum(y, MOST_APART),
        "name": name,
        "marker": {"symbol": symbol, "size": 9, "color": colour, "opacity": 1},
        "customdata": y,
        "hovertemplate": f"period %{{x}}: %{{customdata:.1f}} ms apart, {name}<extra></extra>",
    }
