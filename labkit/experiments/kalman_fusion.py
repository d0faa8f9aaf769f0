"""Notebook 12: does it matter when a measurement was taken? Experiment 3 of source 2 (two stations, 330 ms, 160 ms apart)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.figures import BLUE, GREEN, GREY, INK, ORANGE, PALE, PURPLE, Curve, Dots, Way, axis, curves, stack, tracks
from labkit.fusion import (
    COURSES,
    MOTIONS,
    Course,
    Looks,
    Model,
    Stations,
    averages,
    axis_covariance,
    consistency_band,
    fuse,
    normalised_squares,
    place,
    rmse,
)

RUNS, PERIODS, WARM = 200, 20, 5  # runs behind the numbers; periods of each, and how many of them pass before errors count
WINDOW = 0.9, 0.6  # m that the map shows to each side of the element
STAMPS = {"measured": "when it was measured", "read": "when the fusion reads it"}

Speed = Annotated[float, Interval(ge=0, le=3), MultipleOf(0.1), Unit("m/s"), Doc("of the element")]
CourseChoice = Annotated[Course, Labels(COURSES), Doc("how the element moves")]
Sigma = Annotated[float, Interval(ge=1, le=10), MultipleOf(0.5), Unit("cm"), Doc("noise of a measurement per axis, one sigma")]
Density = Annotated[
    Literal["0", "0.001", "0.01", "0.03", "0.1", "0.3", "1", "3", "10"],
    Doc("q, the white noise that the filter assumes in the motion; its unit depends on the model"),
]
ModelChoice = Annotated[
    Model, Labels({name: motion.name for name, motion in MOTIONS.items()}), Doc("process model of the filter")
]


@dataclass(frozen=True, eq=False)
class Fused:
    """What the stations measured and what the fusion made of it.

    Attributes:
        looks: in the order in which the filter takes them.
        stamps: the times that the filter believes, s. places: where the element is at these times.
        positions: estimates after each look, shape (runs, looks). variances: what the filter claims, per axis, shape (looks,).
        nees: mean over runs and looks, both axes together.
        average, truth: of A's and B's place of each period, and where the element is at the later look; shapes (runs, periods),
            (periods,).
    """

    looks: Looks
    stamps: np.ndarray
    places: np.ndarray
    positions: np.ndarray
    variances: np.ndarray
    nees: float
    average: np.ndarray
    truth: np.ndarray

    @property
    def later(self) -> np.ndarray:
        """Indices of the looks that come last in their period, when the fused estimate is judged."""
        return np.arange(1, len(self.stamps), 2)

    def errors(self) -> np.ndarray:
        """Of the estimates at the later looks, against where the element is at the time that is on them; (runs, periods)."""
        return self.positions[:, self.later] - self.places[self.later]


class TwoStations(Experiment[Fused]):
    """Does it matter when a measurement was taken?

    Two stations see one element, each every 330 ms, B later than A. The average of the two places takes them as if they were of
    one time. The filter takes each at its own. Numbers are over 200 runs, the picture shows one.
    """

    speed: Speed = 1.0
    course: CourseChoice = "straight"
    offset: Annotated[int, Interval(ge=0, le=280), MultipleOf(10), Unit("ms"), Doc("B looks so much later than A")] = 160
    sigma: Sigma = 3.0
    clock_error: Annotated[int, Interval(ge=-50, le=50), Unit("ms"), Doc("B's clock is ahead by")] = 0
    stamp: Annotated[Literal["measured", "read"], Labels(STAMPS), Doc("the time at which the filter takes a measurement")] = (
        "measured"
    )
    model: ModelChoice = "cv"
    q: Density = "0.1"
    assumed: Annotated[
        float,
        Interval(ge=0.25, le=4),
        MultipleOf(0.25),
        Unit("times"),
        Doc("sigma in the filter's R, as a multiple of the real one"),
    ] = 1.0
    seed: Annotated[int, Interval(ge=1, le=50), Doc("of the noise")] = 3
    period: Annotated[int, Interval(ge=1, le=PERIODS), View(), Doc("the map shows the end of this period, from the element")] = 8

    def run(self) -> Fused:
        sigma = self.sigma / 100
        setting = Stations(self.speed, self.course, offset=self.offset / 1000, sigma=sigma, clock_error=self.clock_error / 1000)
        looks = setting.look(RUNS, PERIODS, self.seed)
        stamps = looks.stamps if self.stamp == "measured" else np.repeat(looks.stamps[1::2], 2)
        states = fuse(self.model, float(self.q), looks, sigma * self.assumed, stamps)
        n = MOTIONS[self.model].order
        derivatives = _derivatives(self.course, self.speed, stamps, n)
        warm = slice(2 * WARM, None)
        errors = np.stack(
            [np.array([state[i] for state in states]) - derivative[:, None] for i, derivative in enumerate(derivatives)], axis=-1
        )[warm]
        covariances = np.array([axis_covariance(tuple(np.ravel(part)[0].real for part in state)) for state in states])[warm]
        squares = [normalised_squares(part, covariances[:, None]) for part in (errors.real, errors.imag)]
        return Fused(
            looks,
            stamps,
            derivatives[0],
            np.array([state[0] for state in states]).T,
            np.array([np.ravel(state[n])[0] for state in states]),
            float(np.mean(np.sum(squares, axis=0))),
            *averages(looks),
        )

    def figure(self, result: Fused) -> dict[str, Any]:
        looks, later = result.looks, result.later
        now = later[self.period - 1]
        centre, time = result.places[now], float(result.stamps[now])
        span = min(7.0, 2 * WINDOW[0] / max(self.speed, 0.01))  # s before and after that the map shows: no second lap
        near = np.abs(looks.times - time) < span
        path = place(self.course, self.speed, np.clip(np.linspace(time - span, time + span, 100), 0, 0.33 * PERIODS))
        seen = tracks(
            [
                Way("where it was", path - centre, PALE, width=8),
                Way("as measured", looks.z[0, near] - centre, GREY, "dot", 2),
                Way("average", result.average[0, near[later]] - centre, ORANGE, width=2, marks=True),
                Way("filter, 95 %", result.positions[0, near] - centre, BLUE, covariances=_discs(result.variances[near])),
            ],
            [
                Dots("station A", looks.z[0, near & (looks.station == 0)] - centre, PURPLE, "square"),
                Dots("station B", looks.z[0, near & (looks.station == 1)] - centre, GREEN, "diamond", 11),
                Dots("element now", np.zeros(1, complex), INK, "star", 17),
                Dots(
                    "average now",
                    result.average[0, self.period - 1 : self.period] - centre,
                    ORANGE,
                    "circle-open",
                    22,
                    legend=False,
                ),
                Dots("filter now", result.positions[0, now : now + 1] - centre, BLUE, "circle-open", 22, legend=False),
            ],
            axis("x from the element [m]", range=[-WINDOW[0], WINDOW[0]]),
            axis("y from it [m]", range=[-WINDOW[1], WINDOW[1]]),
            title="From above",
            caption="rings: where average and filter say it is",
            width=1.35,
        )
        at = looks.times[later].tolist()
        claimed = (100 * np.sqrt(2 * result.variances[later])).tolist()
        lines = [
            Curve("average", at, _root(result.average - result.truth), ORANGE),
            Curve("filter", at, _root(result.errors()), BLUE),
            Curve("claimed by the filter", at, claimed, INK, "dash"),
        ]
        error = curves(
            lines,
            axis("time [s]", range=[0, 0.33 * PERIODS]),
            axis("error [cm]", type="log", range=[0, 1.95], tickvals=[1, 2, 5, 10, 20, 50]),
            title="Error, 200 runs",
            caption="dashed: claimed",
            legend=False,
            shapes=[_cursor(time)],
            left=80,
        )
        return stack([seen, error], height=428)

    def metrics(self, result: Fused) -> list[Metric]:
        sigma = self.sigma / 100
        freedom = 2 * MOTIONS[self.model].order
        high = consistency_band(freedom, RUNS)[1]
        errors = result.errors()[:, WARM:]
        average = rmse((result.average - result.truth)[:, WARM:])
        single = rmse((result.looks.z - result.looks.truth)[:, 2 * WARM :])
        late = self.speed * self.offset / 2000 if self.course == "straight" else None
        claimed = float(np.sqrt(np.mean(2 * result.variances[result.later][WARM:])))
        return [
            Metric("error of the average", 100 * average, "cm", note="root of the mean square, at the later look"),
            Metric(
                "error of the filter",
                100 * rmse(errors),
                "cm",
                good=rmse(errors) < single,
                note="good: less than one measurement",
            ),
            Metric("claimed by the filter", 100 * claimed, "cm", note="by its covariance P"),
            Metric(
                "error of the average, by arithmetic",
                None if late is None else 100 * math.hypot(sigma, late),
                "cm",
                note="root of sigma^2 + (speed x offset / 2)^2, straight on only",
            ),
            Metric("error of one measurement", 100 * single, "cm"),
            Metric(
                "NEES",
                result.nees,
                good=result.nees <= high,
                note=f"{freedom} if the filter knows how good it is, more if it is too sure",
            ),
        ]


def _derivatives(course: Course, speed: float, times: np.ndarray, count: int) -> list[np.ndarray]:
    """Place, velocity, acceleration at times (looks,): the first `count`, by differences that are exact where nothing turns."""
    h = 1e-3
    ahead, here, behind = (place(course, speed, times + shift) for shift in (h, 0.0, -h))
    return [here, (ahead - behind) / (2 * h), (ahead - 2 * here + behind) / h**2][:count]


def _ring(name: str, at: complex, colour: str) -> Dots:
    return Dots(name, np.array([at]), colour, "circle-open", 22, legend=False)


def _discs(variances: np.ndarray) -> np.ndarray:
    """Covariances in the plane from the variance of each axis."""
    return variances[:, None, None] * np.eye(2)


def _root(errors: np.ndarray) -> list[float]:
    """Root of the mean square over the runs, in cm; errors (runs, n) in m."""
    return (100 * np.sqrt(np.mean(np.abs(errors) ** 2, axis=0))).tolist()


def _cursor(time: float) -> dict[str, Any]:
    line = {"color": GREY, "width": 2, "dash": "dot"}
    return {"type": "line", "x0": time, "x1": time, "y0": 0, "y1": 1, "yref": "y domain", "line": line}


def check_offset(answer: float) -> Feedback:
    """Exercise: at 2 m/s, from which offset in ms on is the average of two stations worse than one measurement alone?"""
    if not isinstance(answer, int | float) or not 0 <= answer <= 280:
        return Feedback(False, "an offset from 0 to 280 ms is wanted")
    looks = Stations(2.0, offset=answer / 1000).look(2000, PERIODS, 1)
    average, truth = averages(looks)
    found, single = 100 * rmse(average - truth), 100 * rmse(looks.z - looks.truth)
    told = f"at {answer:g} ms the average is {found:.2f} cm wrong, one measurement {single:.2f} cm"
    return Feedback(abs(found / single - 1) < 0.03, told)


def check_clocks(answer: int) -> Feedback:
    """Exercise: at 3 m/s, by how many whole ms may B's clock be ahead so that the filter is at most 10 % worse?"""
    if isinstance(answer, bool) or not isinstance(answer, int) or not 0 <= answer < 50:
        return Feedback(False, "a whole number of ms from 0 to 49 is wanted")

    def error(ms: int) -> float:
        return TwoStations(speed=3, clock_error=ms).measure("error of the filter")

    right, found, more = error(0), error(answer), error(answer + 1)
    told = f"with clocks that agree {right:.2f} cm, with {answer} ms {found:.2f} cm, {100 * (found / right - 1):.1f} % more"
    return Feedback(found <= 1.1 * right < more, told + ("; one more ms is allowed" if more <= 1.1 * right else ""))


def check_noise(answer: TwoStations) -> Feedback:
    """Exercise: in the circle at 1 m/s, below 3.75 cm and a claim within 5 % of the real error, by model and q alone."""
    start = TwoStations(course="circle")
    if not answer.same_run(start.replace(model=answer.model, q=answer.q)):
        return Feedback(False, f"change the model and q only: {start.code()}")
    values = answer.values()
    found, claimed = values["error of the filter"], values["claimed by the filter"]
    return Feedback(found < 3.75 and abs(claimed / found - 1) < 0.05, f"{found:.2f} cm wrong, and it claims {claimed:.2f} cm")
