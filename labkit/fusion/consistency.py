"""What a filter claims and what is true, computed without chance: the error of a linear filter has a covariance of its own.

One axis with constant velocity, since both axes are alike. `P` is what the filter believes; `E` is the covariance of its real
error, which follows from the gains K alone: E <- (I - K H) (A E A' + Q) (I - K H)' + K K' sigma^2.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from labkit.fusion.kalman import UNKNOWN, process_noise, transition

#: The textbook's filter; the source's, whose vector has its own last estimate in it; the same, weighted by its own P.
Kind = Literal["textbook", "source", "own P"]

_POSITION = np.array([[1.0, 0.0]])


def gain(kind: Kind, P: np.ndarray, before: np.ndarray, dt: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """The gain of the measured position, shape (2, 1), and the covariance that the filter believes in after it.

    Args:
        P: predicted covariance. before: that of the last update, which "own P" takes for its pseudo-measurement.
    """
    if kind == "textbook":
        K = P @ _POSITION.T / (P[0, 0] + sigma**2)
        return K, (np.eye(2) - K @ _POSITION) @ P
    H = np.array([[1.0, -dt], [1.0, 0.0]])  # (5.31): the position before, the position now
    R = np.diag([sigma**2 if kind == "source" else before[0, 0], sigma**2])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return K[:, 1:], (np.eye(2) - K @ H) @ P  # the innovation of the first half is zero, whatever its gain


def claimed_and_real(
    kind: Kind, q: float, steps: int, *, dt: float = 0.165, sigma: float = 0.03, motion: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances after the first measurement and each of `steps` more, shape (steps + 1, 2, 2): claimed, and of the real error.

    Args:
        q: white noise that the filter assumes, m^2/s^3. motion: white noise of the real motion; None: the same.
        dt: s between measurements. sigma: of a measurement, in m.
    """
    A, unit = transition("cv", dt), process_noise("cv", 1.0, dt)
    P = E = np.diag([sigma**2, UNKNOWN])
    claimed, real = [P], [E]
    for _ in range(steps):
        K, after = gain(kind, A @ P @ A.T + q * unit, P, dt, sigma)
        keep = np.eye(2) - K @ _POSITION
        E = keep @ (A @ E @ A.T + (q if motion is None else motion) * unit) @ keep.T + K @ K.T * sigma**2
        P = after
        claimed.append(P)
        real.append(E)
    return np.array(claimed), np.array(real)


def expected_nees(claimed: np.ndarray, real: np.ndarray) -> np.ndarray:
    """The mean NEES of both axes together: 2 tr(P^-1 E), which is 4 for a consistent filter."""
    return 2 * np.trace(np.linalg.solve(claimed, real), axis1=-2, axis2=-1)
