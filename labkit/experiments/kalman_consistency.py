"""Notebook 12: does a filter know how good it is? The source's measurement vector beside the textbook's filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Labels, Metric
from labkit.experiments.kalman_fusion import Density
from labkit.figures import BLUE, GREY, ORANGE, Curve, axis, curves, held, stack
from labkit.fusion import FilterKind, claimed_and_real, consistency_band, expected_nees, normalised_squares, sampled_errors

RUNS, INTERVAL, SIGMA = 50, 0.165, 0.03  # runs behind the average NEES; s between measurements; m
KINDS = {"source": "source: R of a measurement", "own P": "source: R from its own P", "textbook": "textbook"}
MOTION = {"same": "as the filter assumes", "0": "none: straight on", "0.1": "0.1", "1": "1"}


@dataclass(frozen=True, eq=False)
class Honesty:
    """Claimed and real covariance of one axis, (steps + 1, 2, 2), and the mean NEES of `RUNS` runs, (steps + 1,); by filter."""

    claimed: dict[FilterKind, np.ndarray]
    real: dict[FilterKind, np.ndarray]
    nees: dict[FilterKind, np.ndarray]

    def claims(self, kind: FilterKind) -> np.ndarray:
        """What the filter says of its position error, both axes, one sigma, in cm."""
        return 100 * np.sqrt(2 * self.claimed[kind][:, 0, 0])

    def error(self, kind: FilterKind) -> np.ndarray:
        """What the error really is, in cm."""
        return 100 * np.sqrt(2 * self.real[kind][:, 0, 0])


class ClaimedError(Experiment[Honesty]):
    """Does a filter know how good it is?

    The source measures the new position and calls its own last estimate a second measurement. That one says nothing new, but the
    filter believes that it does. Lines are exact; the average NEES is of 50 runs. Sigma 3 cm, a measurement every 165 ms.
    """

    filter: Annotated[FilterKind, Labels(KINDS), Doc("beside the textbook's")] = "source"
    q: Density = "0"
    motion: Annotated[Literal["same", "0", "0.1", "1"], Labels(MOTION), Doc("white noise in the real motion")] = "same"
    steps: Annotated[int, Interval(ge=10, le=200), Unit("measurements"), Doc("after the first one")] = 100
    seed: Annotated[int, Interval(ge=1, le=50), Doc("of the noise")] = 1

    def run(self) -> Honesty:
        found = Honesty({}, {}, {})
        setting: dict[str, Any] = {
            "dt": INTERVAL,
            "sigma": SIGMA,
            "motion": None if self.motion == "same" else float(self.motion),
        }
        kinds: tuple[FilterKind, ...] = ("textbook", self.filter)
        for kind in kinds:
            found.claimed[kind], found.real[kind] = claimed_and_real(kind, float(self.q), self.steps, **setting)
            errors = sampled_errors(kind, float(self.q), self.steps, RUNS, self.seed, **setting)
            squares = [normalised_squares(part, found.claimed[kind][:, None]) for part in (errors.real, errors.imag)]
            found.nees[kind] = np.mean(np.sum(squares, axis=0), axis=1)
        return found

    def figure(self, result: Honesty) -> dict[str, Any]:
        some = np.unique(np.linspace(0, self.steps, 41).astype(int))
        steps = some.tolist()
        drawn, honest = [], []
        both: tuple[tuple[FilterKind, str], ...] = (("textbook", BLUE), (self.filter, ORANGE))
        for kind, colour in both:
            name = "textbook" if kind == "textbook" and colour == BLUE else f"chosen: {kind}"
            drawn.append(Curve(f"{name}, real", steps, result.error(kind)[some].tolist(), colour))
            drawn.append(Curve(f"{name}, claimed", steps, result.claims(kind)[some].tolist(), colour, "dash"))
            honest.append(Curve(name, steps, result.nees[kind][some].tolist(), colour))
        low, high = consistency_band(4, RUNS)
        band = {"type": "rect", "x0": 0, "x1": 1, "xref": "x domain", "y0": low, "y1": high, "fillcolor": GREY, "opacity": 0.35}
        x = axis("measurements", range=[0, held(self.steps, coarse=True)])
        size = axis("position error [cm]", type="log", range=[-0.5, 1.95], tickvals=[0.5, 1, 2, 5, 10, 20, 50])
        error = curves(drawn, x, size, title="Real and claimed")
        nees = curves(
            honest,
            x,
            axis("mean NEES of 50 runs", type="log", range=[0, 2.95], tickvals=[1, 2, 4, 10, 100, 1000]),
            legend=False,
            title="4 is right",
            caption="grey: where 95 % lie if P is right",
            shapes=[band | {"line": {"width": 0}, "layer": "below"}],
            left=80,
        )
        return stack([error, nees], height=470)

    def metrics(self, result: Honesty) -> list[Metric]:
        claims, error = result.claims(self.filter)[-1], result.error(self.filter)[-1]
        nees = {kind: float(expected_nees(result.claimed[kind], result.real[kind])[-1]) for kind in result.claimed}
        beyond = claims < 1e-4 * error  # no digits of P are left that mean anything
        return [
            Metric("real error at the end", float(error), "cm", note="chosen filter, both axes, root of the mean square"),
            Metric(
                "claimed error at the end", float(claims), "cm", good=bool(claims > 0.9 * error), note="chosen filter, by its P"
            ),
            Metric(
                "expected NEES",
                None if beyond else nees[self.filter],
                good=not beyond and nees[self.filter] < 4.4,
                note="chosen filter; 4 is right" + ", this is beyond all measure" * bool(beyond),
            ),
            Metric("real error, textbook", float(result.error("textbook")[-1]), "cm"),
            Metric("expected NEES, textbook", nees["textbook"]),
        ]
