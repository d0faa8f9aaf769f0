"""The Kalman filter of moving elements: constant position, velocity or acceleration, driven by white noise.

Two ways to the same numbers. `textbook_predict` and `textbook_update` are (5.21) to (5.26) of source 2 with matrices, for any
covariance of a measurement. The fast path uses that x and y do not influence each other: if a measurement is equally good in all
directions, both axes share one covariance for ever, and the plane is the complex numbers. Its formulas are plain arithmetic, so
that the same lines filter one track of Python numbers or thousands in numpy arrays.

A fast state is a tuple: position, velocity, acceleration (complex; as many as the model has), then the covariance of one axis,
upper triangle row by row. Units: m, s.

Sources: source 2, section 5.3.1; Y. Bar-Shalom, X.-R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, section 6.2 (white-noise models).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

Model = Literal["cp", "cv", "ca"]
State = tuple[Any, ...]  # complex and float numbers, or arrays of them

#: Variance of what a first measurement does not tell: velocity in (m/s)^2, acceleration in (m/s^2)^2.
UNKNOWN = 4.0


def transition(model: Model, dt: float) -> np.ndarray:
    """The matrix A of one axis for a step of `dt` seconds: (5.9), (5.11) to (5.14) or (5.15) to (5.20), shape (n, n)."""
    full = np.array([[1.0, dt, dt * dt / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    n = MOTIONS[model].order
    return full[:n, :n]


def process_noise(model: Model, q: float, dt: float) -> np.ndarray:
    """The matrix Q of one axis: white noise of density `q` on the highest derivative, over `dt` seconds, shape (n, n)."""
    n = MOTIONS[model].order
    full = np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]])
    return q * full[3 - n :, 3 - n :]


def textbook_predict(x: np.ndarray, P: np.ndarray, model: Model, q: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(5.21), (5.22): state x of shape (2n,) in the order x, y, vx, vy, ..., its covariance P, after `dt` seconds."""
    A, Q = (np.kron(part, np.eye(2)) for part in (transition(model, dt), process_noise(model, q, dt)))
    return A @ x, A @ P @ A.T + Q


def textbook_update(
    x: np.ndarray, P: np.ndarray, z: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(5.24) to (5.26): state and covariance after the measurement z, its innovation and the covariance of that.

    P in the form (I - KH) P (I - KH)' + K R K', equal to (5.26) and symmetric whatever is rounded.
    """
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    innovation = z - H @ x
    I_KH = np.eye(len(x)) - K @ H
    return x + K @ innovation, I_KH @ P @ I_KH.T + K @ R @ K.T, innovation, S


# ------------------------------------------------------------------------------------------------------------- fast path


def _start_cp(z: Any, r: Any) -> State:
    return z, r + 0.0 * abs(z)


def _predict_cp(state: State, dt: Any, q: Any) -> State:
    p, a = state
    return p, a + q * dt


def _update_cp(state: State, z: Any, r: Any) -> State:
    p, a = state
    k = a / (a + r)
    return p + k * (z - p), k * r


def _start_cv(z: Any, r: Any) -> State:
    zero = 0.0 * abs(z)  # a number or an array, as z is one
    return z, 0.0 * z, r + zero, zero, UNKNOWN + zero


def _predict_cv(state: State, dt: Any, q: Any) -> State:
    p, v, a, b, c = state
    w = q * dt
    return p + dt * v, v, a + dt * (2 * b + dt * (c + w / 3)), b + dt * (c + w / 2), c + w


def _update_cv(state: State, z: Any, r: Any) -> State:
    p, v, a, b, c = state
    s = a + r
    k, m = a / s, b / s
    y = z - p
    return p + k * y, v + m * y, k * r, m * r, c - m * b


def _start_ca(z: Any, r: Any) -> State:
    zero = 0.0 * abs(z)
    return z, 0.0 * z, 0.0 * z, r + zero, zero, zero, UNKNOWN + zero, zero, UNKNOWN + zero


def _predict_ca(state: State, dt: Any, q: Any) -> State:
    p, v, w, a, b, c, d, e, f = state
    h = dt * dt / 2
    e1, c1 = e + dt * f, c + dt * e + h * f  # A P A', written out: f stays
    d1 = d + 2 * dt * e + dt * dt * f
    b1 = b + dt * (d + c) + (dt * dt + h) * e + h * dt * f
    a1 = a + 2 * dt * b + 2 * h * c + dt * dt * d + 2 * dt * h * e + h * h * f
    n = q * dt
    return (
        p + dt * v + h * w,
        v + dt * w,
        w,
        a1 + n * dt**4 / 20,
        b1 + n * dt**3 / 8,
        c1 + n * dt * dt / 6,
        d1 + n * dt * dt / 3,
        e1 + n * dt / 2,
        f + n,
    )


def _update_ca(state: State, z: Any, r: Any) -> State:
    p, v, w, a, b, c, d, e, f = state
    s = a + r
    k, m, n = a / s, b / s, c / s
    y = z - p
    return p + k * y, v + m * y, w + n * y, k * r, m * r, n * r, d - m * b, e - m * c, f - n * c


class ProcessModel(NamedTuple):
    """A process model as the fast path knows it.

    Attributes:
        name: in words. order: numbers per axis, which is also where in a state the variance of the position stands.
        start: (z, r) -> state after a first measurement: position z, everything else 0 with variance `UNKNOWN`.
        predict: (state, dt, q) -> state, (5.21) and (5.22). dt in s, q the density of the white noise.
        update: (state, z, r) -> state, (5.24) to (5.26); r is the variance of the measurement per axis in m^2.
    """

    name: str
    order: int
    start: Callable[[Any, Any], State]
    predict: Callable[[State, Any, Any], State]
    update: Callable[[State, Any, Any], State]


MOTIONS: dict[str, ProcessModel] = {
    "cp": ProcessModel("constant position", 1, _start_cp, _predict_cp, _update_cp),
    "cv": ProcessModel("constant velocity", 2, _start_cv, _predict_cv, _update_cv),
    "ca": ProcessModel("constant acceleration", 3, _start_ca, _predict_ca, _update_ca),
}


def axis_covariance(state: State) -> np.ndarray:
    """The covariance of one axis as a matrix, shape (..., n, n), from a fast state."""
    n = {2: 1, 5: 2, 9: 3}[len(state)]
    upper = state[n:]
    place = {1: ((0,),), 2: ((0, 1), (1, 2)), 3: ((0, 1, 2), (1, 3, 4), (2, 4, 5))}[n]
    return np.stack([np.stack([np.asarray(upper[i], float) for i in row], axis=-1) for row in place], axis=-2)
