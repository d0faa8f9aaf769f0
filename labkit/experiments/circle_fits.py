"""Notebook 11: where is the centre of a ball that is seen from one side? Three fits of a circle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View
from labkit.experiments.laser_pipeline import Noise, Rotations
from labkit.figures import BLUE, GREEN, INK, VERMILION, Curve, axis, curves, dots, drawn, enlarged, from_above, stack, there
from labkit.figures import circle as ring
from labkit.fusion import BALL_RADIUS, kasa, known_radius, taubin

DISTANCES = tuple(0.75 + 0.5 * n for n in range(8))  # m
TRIALS = 120
FITS = {"known radius": GREEN, "Taubin": BLUE, "Kasa": VERMILION}


@dataclass(frozen=True, eq=False)
class Fits:
    """Of every fit: its median error in cm at each of `DISTANCES`, None where no ball has four points; and one ball of each
    distance: its points (n, 2), and the (x, y, radius) of the circle that each fit finds.
    """

    errors: dict[str, list[float | None]]
    balls: list[np.ndarray]
    circles: list[dict[str, tuple[float, float, float]]]


class CircleFits(Experiment[Fits]):
    """What is it worth to know how large the ball is?

    The scanner sees less than half of the ball, from one side, in about a dozen points. Each median is of 120 balls; left, one of
    them.
    """

    noise: Noise = 5
    rotations: Rotations = 2
    distance: Annotated[
        float, Interval(ge=DISTANCES[0], le=DISTANCES[-1]), MultipleOf(0.25), Unit("m"), View(), Doc("of the ball on the left")
    ] = 2.25
    seed: Annotated[int, Interval(ge=1, le=20), Doc("another draw of the noise")] = 1

    def run(self) -> Fits:
        rng = np.random.default_rng(self.seed)
        result = Fits({name: [] for name in FITS}, [], [])
        for distance in DISTANCES:
            groups = seen(distance, 1 / self.rotations, self.noise / 1000, rng)
            found = [fitted(xy) for xy in groups]
            for name, errors in result.errors.items():
                off = [np.hypot(centres[:, 0] - distance, centres[:, 1]) for centres, _ in (fits[name] for fits in found)]
                median = float(np.median(np.nan_to_num(np.concatenate(off), nan=np.inf))) if off else np.inf
                errors.append(100 * median if np.isfinite(median) else None)
            result.balls.append(groups[0][0] if groups else np.empty((0, 2)))
            first = found[0] if found else {}
            result.circles.append({name: (*centres[0].tolist(), float(radii[0])) for name, (centres, radii) in first.items()})
        return result

    def figure(self, result: Fits) -> dict[str, Any]:
        at = self.place()
        x, found = DISTANCES[at], result.circles[at]
        (ball,) = enlarged([result.balls[at]], x, 0.0)
        circles = [
            drawn(name, enlarged([ring(*found[name])] if name in found else [], x, 0.0), colour, 3, showlegend=False)
            for name, colour in FITS.items()
        ]
        one = from_above(
            [there(enlarged([ring(x, 0.0, BALL_RADIUS)], x, 0.0)), *circles, dots("points", ball, INK, 8, showlegend=False)],
            (-19, 19),
            (-19, 19),
            unit="cm",
            title=f"a ball at {DISTANCES[at]:g} m",
            caption="seen from the left",
        )
        lines = [Curve(name, DISTANCES, result.errors[name], colour, mark=at) for name, colour in FITS.items()]
        panel = curves(
            lines,
            axis("distance [m]", range=[DISTANCES[0] - 0.15, DISTANCES[-1] + 0.15]),
            axis("median error of the centre [cm]", type="log", range=[-1.6, 1.2], tickvals=[0.1, 0.3, 1, 3, 10]),
            title="error",
            left=80,
            width=1.4,
        )
        return stack([one, panel], height=440)

    def place(self) -> int:
        """Index of the distance that is nearest to the slider."""
        return int(np.argmin(np.abs(np.array(DISTANCES) - self.distance)))

    def metrics(self, result: Fits) -> list[Metric]:
        at = DISTANCES.index(2.25)
        cards = [Metric(f"{name}, 2.25 m", errors[at], "cm") for name, errors in result.errors.items()]
        known, best = result.errors["known radius"][at], result.errors["Taubin"][at]
        worth = best / known if best and known else None
        return [
            *cards,
            Metric("worth of the radius", worth, "times", note="Taubin's error against that with the radius known"),
            Metric("points at 2.25 m", len(result.balls[at])),
        ]


def seen(distance: float, step_deg: float, noise_m: float, rng: np.random.Generator) -> list[np.ndarray]:
    """`TRIALS` balls, each somewhere between two beams: points of shape (balls, n, 2), those with equally many points together.

    Every ball is turned so that it lies at (distance, 0). Those with fewer than four points are left out.
    """
    step, reach = np.deg2rad(step_deg), np.arcsin(BALL_RADIUS / distance)
    side = int(reach / step) + 2
    angle = np.arange(-side, side + 1) * step + rng.uniform(-0.5, 0.5, (TRIALS, 1)) * step
    across = distance * np.sin(angle)
    hits = np.abs(angle) < reach
    exact = distance * np.cos(angle) - np.sqrt(np.maximum(BALL_RADIUS**2 - across**2, 0))
    ranges = np.rint((exact + rng.normal(0, noise_m, angle.shape)) / 0.01) * 0.01
    xy = np.stack([ranges * np.cos(angle), ranges * np.sin(angle)], axis=-1)
    counts = hits.sum(axis=1)
    made = []
    for count in np.unique(counts[counts >= 4]).tolist():
        rows = counts == count
        made.append(xy[rows][hits[rows]].reshape(int(rows.sum()), count, 2))
    return made


def fitted(xy: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Centres and radii of many balls by each fit; nan where a fit finds no circle."""
    start = xy.mean(axis=1) + np.array([0.7 * BALL_RADIUS, 0.0])
    known = known_radius(xy, BALL_RADIUS, start)
    return {"known radius": (known, np.full(len(xy), BALL_RADIUS)), "Taubin": taubin(xy), "Kasa": kasa(xy)}
