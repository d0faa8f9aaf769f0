"""Notebook 09: experiment 2 of source 2, two stations with and without correction of their periods (5.2 and 7, figure 43)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import nan
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import published_table
from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.experiments.global_time import MS, US, Seed, thinned
from labkit.figures import BLUE, GREEN, INK, ORANGE, Curve, Panel, axis, curves, held, stack
from labkit.network import CORRECTIONS, Correction, Plan, period_starts

COLOUR: dict[Correction, str] = {"none": ORANGE, "differences": BLUE, "absolute": GREEN}
DASH: dict[Correction, str] = {"none": "solid", "differences": "solid", "absolute": "dot"}
#: Reading errors in us at which the curve is computed.
READ_ERRORS = (0, 25, 50, 75, 100, 125, 150, 200)
#: Deadline_C of table 5 of source 2 is 2 ms; that the thread itself takes 0.1 ms of it is an assumption.
WCET_NS, SHIFT_NS = 100 * US, 1_900 * US
NEEDED = "where the curve meets the published 128.17 us"

Way = Annotated[Correction, Labels(CORRECTIONS), Doc("of the starts of the periods, once per period")]
Period = Annotated[int, Interval(ge=50, le=1000), MultipleOf(10), Unit("ms"), Doc("of both stations")]
Drift = Annotated[float, Interval(ge=0, le=100), MultipleOf(0.01), Unit("ppm"), Doc("rate of one station against the other")]


@cache
def published_difference(word: str) -> float:
    """The largest timestamp difference printed in source 2, `with` or `without` coordination, in us."""
    table = published_table("diplom_measurements.csv")
    row = table[table["quantity"] == f"max timestamp difference {word} coordination"].iloc[0]
    return float(row["value"]) * {"ns": 1e-3, "ms": 1e3}[row["unit"]]


def difference_line(way: Correction, difference: np.ndarray, chosen: bool, named: bool = True) -> dict[str, Any]:
    """The difference of two stations over the period, in us, in the colour of the correction."""
    x, y = thinned(np.arange(len(difference)), difference)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": CORRECTIONS[way],
        "showlegend": named,
        "line": {"color": COLOUR[way], "width": 3.5 if chosen else 1.5, "dash": DASH[way]},
        "hovertemplate": f"{CORRECTIONS[way]}: %{{y:.1f}} us in period %{{x}}<extra></extra>",
    }


def _points(way: Correction, difference: np.ndarray) -> dict[str, Any]:
    """Some of the periods as points, those with the largest differences among them."""
    few, far = np.linspace(0, len(difference) - 1, 500).astype(int), np.argsort(np.abs(difference))[-20:]
    x = np.union1d(few, far)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": difference[x],
        "showlegend": False,
        "marker": {"color": COLOUR[way], "size": 4},
        "hovertemplate": "%{y:.1f} us in period %{x}<extra></extra>",
    }


@dataclass(frozen=True, eq=False)
class Apart:
    """How far two stations' periods start apart.

    Attributes:
        difference: us in every period, by kind of correction; shape (periods + 1,).
        curve: largest difference in us for each of `READ_ERRORS`, by kind of correction.
    """

    difference: dict[Correction, np.ndarray]
    curve: dict[Correction, list[float]]

    def needed(self, way: Correction, wanted: float) -> float | None:
        """The reading error in us at which the curve reaches `wanted`; None if it begins above, or does not."""
        curve = self.curve[way]
        above = next((i for i, value in enumerate(curve) if value >= wanted), 0)
        if not above:
            return None
        share = (wanted - curve[above - 1]) / (curve[above] - curve[above - 1])
        return READ_ERRORS[above - 1] + share * (READ_ERRORS[above] - READ_ERRORS[above - 1])


class TimestampDrift(Experiment[Apart]):
    """How far apart are the time stamps of two stations?

    Experiment 2 of source 2: both begin together and start a period every 500 ms, each by its own clock. Only the drift of one
    clock against the other counts. Every correction reads the common clock, each time with another error.
    """

    period: Period = 500
    periods: Annotated[int, Interval(ge=10, le=5000), MultipleOf(10), Doc("that are observed")] = 2200
    drift: Drift = 2.14
    correction: Way = "differences"
    read_error: Annotated[
        float, Interval(ge=0, le=500), MultipleOf(0.5), Unit("us"), Doc("of reading the common clock, to either side, at most")
    ] = 50.0
    seed: Seed = 1

    def run(self) -> Apart:
        ways: list[Correction] = list(CORRECTIONS)
        corrected = ways[1:]
        cases = [(way, self.read_error) for way in ways] + [(way, error) for way in corrected for error in READ_ERRORS]
        draws = np.random.default_rng(self.seed).uniform(-1, 1, (self.periods, 2))
        errors = np.concatenate([np.rint(draws * size * US) for _, size in cases], axis=1).astype(np.int64)
        rates = np.tile([round(self.drift * 1000), 0], len(cases))
        kinds = [way for way, _ in cases for _ in range(2)]
        starts = period_starts(Plan(self.period * MS, WCET_NS, SHIFT_NS), kinds, rates, errors)
        apart = [starts.difference(2 * i + 1, 2 * i) / US for i in range(len(cases))]
        largest = iter([float(np.abs(d).max()) for d in apart[len(ways) :]])
        return Apart(dict(zip(ways, apart)), {way: [next(largest) for _ in READ_ERRORS] for way in corrected})

    def published(self) -> bool:
        """Whether period and number of periods are those of the source."""
        return (self.period, self.periods) == (500, 2200)

    def figure(self, result: Apart) -> dict[str, Any]:
        free, kept = published_difference("without"), published_difference("with")
        height = held(1.05 * max(free, self.drift * 1e-3 * self.period * self.periods), coarse=True)
        fine = held(max(1.5 * kept, 3 * self.read_error), coarse=True)
        across = [0, 1.02 * held(self.periods, coarse=True)]
        level = {"type": "line", "xref": "x domain", "x0": 0, "x1": 1, "line": {"color": INK, "dash": "dash", "width": 2}}
        levels = [{**level, "y0": y, "y1": y} for y in (kept, -kept)]
        note = {"text": f"published: {kept:.2f}", "x": 1, "xref": "x domain", "xanchor": "right", "y": kept, "yanchor": "bottom"}
        nearest = int(np.argmin(np.abs(np.array(READ_ERRORS) - self.read_error)))
        by_error = [
            Curve(CORRECTIONS[way], READ_ERRORS, largest, COLOUR[way], DASH[way], nearest if way == self.correction else None)
            for way, largest in result.curve.items()
        ]
        end = curves([], axis("", range=across), axis("apart [us]"), [(2200, free if self.published() else nan)])
        lines = [difference_line(way, d, way == self.correction) for way, d in result.difference.items()]
        return stack(
            Panel([*lines, *end.traces], axis("apart [us]", range=[-0.1 * height, height]), end.x, title="Figure 43", left=92),
            [
                Panel(
                    [_points(self.correction, result.difference[self.correction])],
                    axis("apart [us]", range=[-fine, fine]),
                    axis("period", range=across),
                    levels,
                    title="The same near zero",
                    caption=CORRECTIONS[self.correction],
                    left=92,
                ),
                curves(
                    by_error,
                    axis("reading error [us]", range=[-5, READ_ERRORS[-1] + 5]),
                    axis("largest [us]", range=[0, 820]),
                    shapes=levels[:1],
                    notes=[note],
                    legend=False,
                    title="By reading error",
                    left=92,
                ),
            ],
            height=500,
            keys=["published (source 2)"],
        )

    def metrics(self, result: Apart) -> list[Metric]:
        largest = {way: float(np.abs(d).max()) for way, d in result.difference.items()}
        printed = {way: published_difference("without" if way == "none" else "with") for way in CORRECTIONS}
        return [
            Metric(
                "largest difference",
                largest[self.correction],
                "us",
                published=printed[self.correction] if self.published() else None,
            ),
            Metric("without correction", largest["none"], "us", published=printed["none"] if self.published() else None),
            Metric("drift per period", self.drift * 1e-3 * self.period, "us"),
            *(Metric(f"reading error, {way}", result.needed(way, printed[way]), "us", note=NEEDED) for way in result.curve),
        ]


def check_read_error(answer: TimestampDrift) -> Feedback:
    """Exercise: experiment 2 by absolute phase, with a reading error that gives the published difference within 2 us."""
    asked = TimestampDrift(correction="absolute")
    if answer != asked.replace(read_error=answer.read_error):
        return Feedback(False, f"start from {asked.code()} and change read_error only.")
    found, wanted = answer.measure("largest difference"), published_difference("with")
    return Feedback(abs(found - wanted) <= 2, f"{answer.read_error} us give {found:.1f} us; published are {wanted:.2f} us.")
