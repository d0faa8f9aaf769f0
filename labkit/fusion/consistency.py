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


def gains(kind: Kind, q: float, steps: int, dt: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains (steps, 2, 1) and claimed covariances (steps + 1, 2, 2) from the first measurement on: no data change them."""
    A, Q = transition("cv", dt), process_noise("cv", q, dt)
    found, claimed = [], [np.diag([sigma**2, UNKNOWN])]
    for _ in range(steps):
        K, P = gain(kind, A @ claimed[-1] @ A.T + Q, claimed[-1], dt, sigma)
        found.append(K)
        claimed.append(P)
    return np.array(found), np.array(claimed)


def claimed_and_real(
    kind: Kind, q: float, steps: int, *, dt: float = 0.165, sigma: float = 0.03, motion: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances after the first measurement and each of `steps` more, shape (steps + 1, 2, 2): claimed, and of the real error.

    Args:
        q: white noise that the filter assumes, m^2/s^3. motion: white noise of the real motion; None: the same.
        dt: s between measurements. sigma: of a measurement, in m.
    """
    A, Q = transition("cv", dt), process_noise("cv", q if motion is None else motion, dt)
    found, claimed = gains(kind, q, steps, dt, sigma)
    real = [claimed[0]]
    for K in found:
        keep = np.eye(2) - K @ _POSITION
        real.append(keep @ (A @ real[-1] @ A.T + Q) @ keep.T + K @ K.T * sigma**2)
    return claimed, np.array(real)


def expected_nees(claimed: np.ndarray, real: np.ndarray) -> np.ndarray:
    """The mean NEES of both axes together: 2 tr(P^-1 E), which is 4 for a consistent filter."""
    return 2 * np.trace(np.linalg.solve(claimed, real), axis1=-2, axis2=-1)


def sampled_errors(
    kind: Kind, q: float, steps: int, runs: int, seed: int, *, dt: float = 0.165, sigma: float = 0.03, motion: float | None = None
) -> np.ndarray:
    """Real errors of position and velocity of so many runs, complex for both axes, shape (steps + 1, runs, 2)."""
    A, Q = transition("cv", dt), process_noise("cv", q if motion is None else motion, dt)
    found, _ = gains(kind, q, steps, dt, sigma)
    rng = np.random.default_rng(seed)
    noise = sigma * _both(rng, (steps + 1, runs))
    pushes = _both(rng, (steps, runs, 2)) @ np.linalg.cholesky(Q + 1e-30 * np.eye(2)).T
    errors = [np.stack([noise[0], -np.sqrt(UNKNOWN) * _both(rng, (runs,))], axis=-1)]
    for K, push, n in zip(found, pushes, noise[1:]):
        ahead = errors[-1] @ A.T - push
        errors.append(ahead + (n[:, None] - ahead[:, :1]) * K[:, 0])
    return np.array(errors)


def _both(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Normal numbers for both axes."""
    pair = rng.normal(size=(2, *shape))
    return pair[0] + 1j * pair[1]
