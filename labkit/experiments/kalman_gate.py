"""Notebook 12: which measurement belongs to which element? The gate (5.32) of the source, and three rules of association."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.experiments.kalman_fusion import CourseChoice, Density, Sigma, Speed
from labkit.figures import BLUE, GREY, INK, PALE, PALETTE, VERMILION, Curve, Dots, Way, axis, curves, stack, tracks
from labkit.fusion import (
    FIELD,
    Crossing,
    Gated,
    GlobalNearest,
    JointCompatible,
    NearestFirst,
    Rule,
    Stations,
    Track,
    Tracker,
    gated,
    gospa,
    ospa,
    rmse,
    start,
    switches,
)

RUNS, PERIODS, WARM, SHOWN = 150, 20, 10, 25  # runs; periods of each; looks before shares count; runs whose innovations are drawn
REACH = 40  # cm of the dart-board
LargestError = Annotated[float, Interval(ge=1, le=10), MultipleOf(0.5), Unit("sigma"), Doc("largest error in the gate (5.32)")]
CUTOFF = 0.5  # m of OSPA and GOSPA
USED = {"used": "used all the same", "left out": "left out"}
RULES = {"global": "global nearest neighbour", "source": "source: most recent first", "joint": "joint compatibility"}


@dataclass(frozen=True, eq=False)
class Gates:
    """The same looks behind the gate of the source and behind one by Mahalanobis distance."""

    source: Gated
    mahalanobis: Gated


class GateShare(Experiment[Gates]):
    """How many true measurements does a gate reject?

    One element, nothing false: every rejection is a mistake. S = a_max/2 dt² + e_max (5.32) knows how long ago the last update
    was, but not how uncertain the velocity is. The other gate asks the filter. 150 runs.
    """

    course: CourseChoice = "straight"
    speed: Speed = 1.0
    sigma: Sigma = 3.0
    a_max: Annotated[float, Interval(ge=0, le=10), MultipleOf(0.5), Unit("m/s²"), Doc("largest acceleration in (5.32)")] = 1.0
    e_max: LargestError = 3.0
    q: Density = "0.1"
    rejected: Annotated[Literal["used", "left out"], Labels(USED), Doc("a rejected measurement is")] = "used"

    def run(self) -> Gates:
        sigma = self.sigma / 100
        looks = Stations(self.speed, self.course, sigma=sigma).look(RUNS, PERIODS, 1)
        source = (self.a_max, self.e_max * sigma)
        used = self.rejected == "used"
        return Gates(*(gated(looks, float(self.q), sigma, gate, used=used) for gate in (source, None)))

    def figure(self, result: Gates) -> dict[str, Any]:
        late = slice(WARM, None)
        seen = 100 * result.source.innovations[late, :SHOWN].ravel()
        out = result.source.rejected[late, :SHOWN].ravel()
        seen = np.clip(seen.real, -1.4 * REACH, 1.4 * REACH) + 1j * np.clip(seen.imag, -REACH, REACH)
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 90))
        board = tracks(
            [
                Way("gate (5.32)", 100 * float(np.median(result.source.radius[late])) * circle, VERMILION),
                Way("99.9 % by Mahalanobis", 100 * float(np.median(result.mahalanobis.radius[late])) * circle, INK, "dash"),
            ],
            [Dots("inside", seen[~out], BLUE, size=6), Dots("rejected by (5.32)", seen[out], VERMILION, "x-thin", 8)],
            axis("measured minus forecast, x [cm]", range=[-1.4 * REACH, 1.4 * REACH]),
            axis("y [cm]", range=[-REACH, REACH]),
            title="Innovations",
            caption="what lies outside stands at the rim",
        )
        numbers = list(range(2, 2 * PERIODS + 1))
        lines = [
            Curve("rejected by (5.32)", numbers, (100 * result.source.rejected.mean(axis=1)).tolist(), VERMILION),
            Curve("by Mahalanobis", numbers, (100 * result.mahalanobis.rejected.mean(axis=1)).tolist(), INK, "dash"),
        ]
        share = curves(
            lines,
            axis("number of the look", range=[1, 2 * PERIODS + 1]),
            axis("rejected [%]", range=[-3, 103]),
            title="Rejected, of 150 runs",
            legend=False,
            left=80,
        )
        return stack([board, share], height=480)

    def metrics(self, result: Gates) -> list[Metric]:
        late = slice(WARM, None)
        source, other = (100 * float(gate.rejected[late].mean()) for gate in (result.source, result.mahalanobis))
        return [
            Metric("rejected by (5.32)", source, "%", good=source < 1, note="of true measurements, from the 12th look on"),
            Metric("rejected by Mahalanobis", other, "%", good=other < 1),
            Metric("second look rejected by (5.32)", 100 * float(result.source.rejected[0].mean()), "%", note="velocity still 0"),
            Metric("error behind (5.32)", 100 * rmse(result.source.errors[late]), "cm"),
            Metric("error behind Mahalanobis", 100 * rmse(result.mahalanobis.errors[late]), "cm"),
        ]


@dataclass(frozen=True, eq=False)
class Followed:
    """What the tracker made of the elements.

    Attributes:
        tracks: those that were not dropped unconfirmed. false: number of those that were.
        places: measured, complex, (n,). real: where the elements are at the looks, (looks, elements).
        ospa: after each look, in m, (looks,). missed, false_now: means over the looks of elements without an estimate and of
            estimates without an element.
        switches: how often an element got another track.
    """

    tracks: list[Track]
    false: int
    places: np.ndarray
    real: np.ndarray
    times: np.ndarray
    ospa: np.ndarray
    missed: float
    false_now: float
    switches: int


class CrossingElements(Experiment[Followed]):
    """Which measurement belongs to which element?

    Elements meet in the middle of the field, seen by two stations 160 ms apart, for 6.6 s. Every look has to be divided among the
    tracks; what nobody takes starts a new one. A track is confirmed by its third measurement.
    """

    rule: Annotated[Literal["global", "source", "joint"], Labels(RULES), Doc("who gets which measurement")] = "global"
    e_max: LargestError = 3.0
    elements: Annotated[int, Interval(ge=1, le=6), Doc("that move")] = 4
    speed: Annotated[float, Interval(ge=0.1, le=0.5), MultipleOf(0.1), Unit("m/s"), Doc("of each")] = 0.5
    apart: Annotated[float, Interval(ge=0, le=1), MultipleOf(0.1), Unit("m"), Doc("they pass the middle so far off, at most")] = (
        0.3
    )
    sigma: Sigma = 3.0
    missed: Annotated[int, Interval(ge=0, le=50), MultipleOf(5), Unit("%"), Doc("of the elements a look does not see")] = 0
    false: Annotated[float, Interval(ge=0, le=2), MultipleOf(0.25), Unit("per look"), Doc("false detections, in the mean")] = 0.0
    q: Density = "0.1"
    seed: Annotated[int, Interval(ge=1, le=50), Doc("of everything that is chance")] = 1

    def run(self) -> Followed:
        sigma = self.sigma / 100
        world = Crossing(self.elements, self.speed, self.apart, sigma, self.missed / 100, self.false, self.seed)
        rules: dict[str, Rule] = {
            "global": GlobalNearest(),
            "source": NearestFirst(e_max=self.e_max * sigma),
            "joint": JointCompatible(),
        }
        tracker = Tracker(lambda first: start("cv", float(self.q), first), rules[self.rule])
        owners, places, real, times, distances, costs = [], [], [], [], [], []
        for look, elements in world.looks(PERIODS):
            taken = tracker.take(look)
            time = look[0].time
            owners += [(element, track.number) for element, track in zip(elements, taken) if element >= 0]
            forecasts = [track.filter.forecast(time) for track in tracker.tracks if tracker.confirmed(track)]
            now, true = np.array([f.x + 1j * f.y for f in forecasts]), world.places(time)
            places += [m.x + 1j * m.y for m in look]
            real.append(true)
            times.append(time)
            distances.append(ospa(now, true, CUTOFF))
            costs.append(gospa(now, true, CUTOFF)[2:])
        found = tracker.all()
        missed, false = np.mean(np.reshape(costs, (-1, 2)), axis=0) / (CUTOFF**2 / 2) if costs else (float(self.elements), 0.0)
        return Followed(
            found,
            len(tracker.ended) + len(tracker.tracks) - len(found),
            np.array(places, complex),
            np.reshape(np.array(real, complex), (-1, self.elements)),
            np.array(times),
            np.array(distances),
            float(missed),
            float(false),
            switches(owners),
        )

    def figure(self, result: Followed) -> dict[str, Any]:
        slots: list[list[complex]] = [[] for _ in PALETTE[:8]]
        for number, track in enumerate(result.tracks):
            slots[number % 8] += [*(complex(*step.row[:2]) for step in track.steps), complex(np.nan, np.nan)]
        ways = [Way(f"track {i + 1}", np.array(slot, complex), colour) for i, (slot, colour) in enumerate(zip(slots, PALETTE))]
        truth = np.concatenate([np.append(way, complex(np.nan, np.nan)) for way in result.real.T])
        side = axis("x [m]", range=[-1.4 * FIELD, 1.4 * FIELD])
        seen = tracks(
            [Way("elements", truth, PALE, width=9), *ways],
            [Dots("measured", result.places, GREY, size=4)],
            side,
            axis("y [m]", range=[-FIELD, FIELD]),
            title="From above",
        )
        error = curves(
            [Curve("OSPA", result.times.tolist(), (100 * result.ospa).tolist(), INK)],
            axis("time [s]", range=[0, 0.33 * PERIODS]),
            axis("OSPA [cm], at most 50", range=[0, 52]),
            title="Distance to the truth",
            legend=False,
            left=80,
        )
        return stack([seen, error], height=455)

    def metrics(self, result: Followed) -> list[Metric]:
        confirmed = sum(len(track.steps) >= 3 for track in result.tracks)
        mean = 100 * float(result.ospa[4:].mean()) if len(result.ospa) > 4 else None
        return [
            Metric("track switches", result.switches, good=result.switches == 0, note="an element got another track"),
            Metric("confirmed tracks", confirmed, good=confirmed == self.elements, note=f"there are {self.elements} elements"),
            Metric("mean OSPA", mean, "cm", note="order 2, cut-off 50 cm, from the fifth look on"),
            Metric("elements without an estimate", result.missed, note="mean over the looks"),
            Metric("estimates without an element", result.false_now, note="mean over the looks"),
            Metric("dropped unconfirmed", result.false, "tracks"),
        ]


def check_gate(answer: GateShare) -> Feedback:
    """Exercise: a gate (5.32) of at most 26 cm that does not lose the element in the circle, what is rejected being left out."""
    start = GateShare(course="circle", rejected="left out")
    if answer != start.replace(a_max=answer.a_max, e_max=answer.e_max):
        return Feedback(False, f"change a_max and e_max only: {start.code()}")
    result = answer.run()
    share, radius = 100 * result.source.rejected.mean(), 100 * float(np.median(result.source.radius[WARM:]))
    return Feedback(share < 1 and radius <= 26, f"{share:.1f} % of the true measurements rejected by a gate of {radius:.0f} cm")
