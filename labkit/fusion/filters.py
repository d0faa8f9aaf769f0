"""A filter that follows one element through measurements of any stations: fast, general, or with the source's measurement vector.

All three are fed in order of time and say where the element is: `forecast` at a later time, `row` after the last update.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

import numpy as np

from labkit.fusion.kalman import MOTIONS, UNKNOWN, Model, State, axis_covariance, textbook_predict, textbook_update
from labkit.fusion.measurements import Measurement

#: What the source's filter takes as the covariance of the position that it did not measure: that of a measurement, or its own P.
Trust = Literal["sigma", "own P"]


class Forecast(NamedTuple):
    """Where an element will be: position in m, and its covariance in m^2."""

    x: float
    y: float
    xx: float
    xy: float
    yy: float


class Filter(Protocol):
    """What the tracks need of a filter."""

    time: float

    def forecast(self, time: float) -> Forecast:
        """Where the element will be at `time`, which is not before the last measurement."""
        ...

    def update(self, measurement: Measurement) -> Filter:
        """Take a measurement, not older than the last; the filter that goes on from here.

        Raises:
            ValueError: the numbers are too far apart for double precision.
        """
        ...

    def row(self) -> tuple[float, float, float, float, float, float]:
        """x, y, vx, vy, and the variances of x and y; without a velocity in the model it is 0."""
        ...

    @property
    def x(self) -> np.ndarray:
        """The state in the order x, y, vx, vy, ...; shape (2n,)."""
        ...

    @property
    def P(self) -> np.ndarray:
        """Its covariance, shape (2n, 2n)."""
        ...


class PlaneFilter:
    """The fast path, for measurements that are equally good in all directions."""

    __slots__ = ("_motion", "model", "q", "state", "time")

    def __init__(self, model: Model, q: float, first: Measurement) -> None:
        if first.variance is None:
            raise ValueError("the fast path needs a measurement that is equally good in all directions")
        self.model, self.q, self.time = model, q, first.time
        self._motion = MOTIONS[model]
        self.state: State = self._motion.start(complex(first.x, first.y), first.variance)

    def forecast(self, time: float) -> Forecast:
        state = self._motion.predict(self.state, time - self.time, self.q)
        p, a = state[0], state[self._motion.order]
        return Forecast(p.real, p.imag, a, 0.0, a)

    def update(self, measurement: Measurement) -> Filter:
        r = measurement.variance
        if r is None:
            return MatrixFilter(self.model, self.q, self.time, self.x, self.P).update(measurement)
        ahead = self._motion.predict(self.state, measurement.time - self.time, self.q)
        self.state = self._motion.update(ahead, complex(measurement.x, measurement.y), r)
        self.time = measurement.time
        _check(self.state[self._motion.order], self.state[-1])
        return self

    def row(self) -> tuple[float, float, float, float, float, float]:
        p, variance = self.state[0], self.state[self._motion.order]
        v = self.state[1] if self._motion.order > 1 else 0j
        return p.real, p.imag, v.real, v.imag, variance, variance

    @property
    def x(self) -> np.ndarray:
        return np.array([part for number in self.state[: self._motion.order] for part in (number.real, number.imag)])

    @property
    def P(self) -> np.ndarray:
        return np.kron(axis_covariance(self.state), np.eye(2))


class MatrixFilter:
    """The textbook's matrices, for any covariance of a measurement."""

    __slots__ = ("P", "model", "q", "time", "x")

    def __init__(self, model: Model, q: float, time: float, x: np.ndarray, P: np.ndarray) -> None:
        self.model, self.q, self.time, self.x, self.P = model, q, time, x, P

    def forecast(self, time: float) -> Forecast:
        x, P = textbook_predict(self.x, self.P, self.model, self.q, time - self.time)
        return Forecast(float(x[0]), float(x[1]), float(P[0, 0]), float(P[0, 1]), float(P[1, 1]))

    def update(self, measurement: Measurement) -> Filter:
        x, P = textbook_predict(self.x, self.P, self.model, self.q, measurement.time - self.time)
        self.x, self.P, _, _ = textbook_update(x, P, measurement.z, np.eye(2, len(x)), measurement.R)
        self.time = measurement.time
        _check(*np.diag(self.P))
        return self

    def row(self) -> tuple[float, float, float, float, float, float]:
        x, y, vx, vy = np.append(self.x, (0.0, 0.0))[:4].tolist()
        return x, y, vx, vy, float(self.P[0, 0]), float(self.P[1, 1])


class SourceFilter(MatrixFilter):
    """The source's filter: constant velocity, z = (its previous estimate, the new position), (5.27) to (5.31).

    The innovation of the first half is its estimate minus the same estimate, moved ahead and back again: zero, always. So that
    half tells nothing, but (5.26) makes P smaller for it. `pseudo` is that innovation at the last update.
    """

    __slots__ = ("pseudo", "trust")

    def __init__(self, q: float, first: Measurement, trust: Trust = "sigma") -> None:
        P = np.diag([0.0, 0.0, UNKNOWN, UNKNOWN])
        P[:2, :2] = first.R
        super().__init__("cv", q, first.time, np.array([first.x, first.y, 0.0, 0.0]), P)
        self.trust, self.pseudo = trust, np.zeros(2)

    def update(self, measurement: Measurement) -> Filter:
        dt = measurement.time - self.time
        before, own = self.x[:2], self.P[:2, :2]
        x, P = textbook_predict(self.x, self.P, "cv", self.q, dt)
        H = np.block([[np.eye(2), -dt * np.eye(2)], [np.eye(2), np.zeros((2, 2))]])
        R = np.zeros((4, 4))
        R[:2, :2], R[2:, 2:] = measurement.R if self.trust == "sigma" else own, measurement.R
        self.x, self.P, innovation, _ = textbook_update(x, P, np.concatenate([before, measurement.z]), H, R)
        self.time, self.pseudo = measurement.time, innovation[:2]
        _check(*np.diag(self.P))
        return self


def start(model: Model, q: float, first: Measurement) -> Filter:
    """The filter of an element after its first measurement: the fast one where it can be used."""
    if first.variance is not None:
        return PlaneFilter(model, q, first)
    n = MOTIONS[model].order
    P = np.kron(np.diag([0.0, UNKNOWN, UNKNOWN][:n]), np.eye(2))
    P[:2, :2] = first.R
    return MatrixFilter(model, q, first.time, np.append(first.z, np.zeros(2 * n - 2)), P)


def _check(*variances: float) -> None:
    """Rounding has not made a variance negative, nor has one grown beyond all numbers."""
    if not all(0.0 < variance < 1e300 for variance in variances):
        raise ValueError("sigma, q and the times between measurements are too far apart for numbers of double precision")
