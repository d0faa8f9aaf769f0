"""Several elements whose ways cross, seen by two stations that miss some and report others that are not there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from labkit.fusion.measurements import Measurement

FIELD = 1.8  # m from the middle to each side
MEETING = 3.3  # s after which all are near the middle


@dataclass(frozen=True)
class Crossing:
    """Elements that start around a field and meet near its middle.

    Attributes:
        elements: how many. speed: of each, m/s. apart: how far beside the middle they pass, at most, in m.
        sigma: of a measurement per axis, m. missed: share of the elements that a look does not see.
        false: mean number of false detections in a look. seed: of everything that is chance.
    """

    elements: int
    speed: float = 0.5
    apart: float = 0.3
    sigma: float = 0.03
    missed: float = 0.0
    false: float = 0.0
    seed: int = 1
    _ways: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng((self.seed, 0))
        direction = np.exp(
            2j * np.pi * (np.arange(self.elements) + rng.uniform(-0.2, 0.2, self.elements)) / max(1, self.elements)
        )
        beside = self.apart * rng.uniform(-1, 1, self.elements) * 1j * direction
        object.__setattr__(self, "_ways", np.stack([beside, self.speed * direction]))

    def places(self, time: float) -> np.ndarray:
        """Where the elements are, complex, in m."""
        return self._ways[0] + self._ways[1] * (time - MEETING)

    def looks(self, periods: int, period: float = 0.330, offset: float = 0.160) -> list[tuple[list[Measurement], list[int]]]:
        """The looks of both stations in order of time, none empty; with each its elements, -1 for a false detection."""
        rng = np.random.default_rng((self.seed, 1))
        found = []
        for k in range(periods):
            for station, late in (("A", 0.0), ("B", offset)):
                time = k * period + late
                who = np.flatnonzero(rng.random(self.elements) >= self.missed)
                noise = self.sigma * (rng.normal(size=len(who)) + 1j * rng.normal(size=len(who)))
                count = rng.poisson(self.false)
                places = np.append(self.places(time)[who] + noise, rng.uniform(-FIELD, FIELD, (count, 2)) @ [1, 1j])
                owners = [*who.tolist(), *[-1] * count]
                order = rng.permutation(len(places)).tolist()
                if order:
                    look = [Measurement.equal(time, places[i].real, places[i].imag, station, self.sigma) for i in order]
                    found.append((look, [owners[i] for i in order]))
        return found
