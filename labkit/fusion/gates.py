"""How many true measurements a gate rejects: one element, no other, nothing false; every rejection is a mistake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labkit.fusion.association import GATE, gate_squared
from labkit.fusion.kalman import MOTIONS
from labkit.fusion.stations import Looks


@dataclass(frozen=True, eq=False)
class Gated:
    """What a gate did, arrays of shape (looks - 1, runs).

    Attributes:
        innovations: measured minus forecast place, complex, in m.
        radius: of the gate, in m. rejected: whether the innovation is longer.
        errors: of the estimate after the look, complex, in m.
    """

    innovations: np.ndarray
    radius: np.ndarray
    rejected: np.ndarray
    errors: np.ndarray


def gated(
    looks: Looks, q: float, sigma: float, source: tuple[float, float] | None = None, *, share: float = GATE, used: bool = False
) -> Gated:
    """The filter with constant velocity behind a gate.

    Args:
        source: (a_max in m/s^2, e_max in m) of the gate (5.32); None: the Mahalanobis gate that lets `share` through.
        used: a rejected measurement is counted and used all the same, so that the gate is judged by a filter that is well.
    """
    motion = MOTIONS["cv"]
    state = motion.start(looks.z[:, 0], sigma**2)
    last = np.full(len(looks.z), looks.stamps[0])
    found: list[tuple[np.ndarray, ...]] = []
    for stamp, z, truth in zip(looks.stamps[1:], looks.z.T[1:], looks.truth[1:]):
        elapsed = stamp - last
        ahead = motion.predict(state, elapsed, q)
        innovation = z - ahead[0]
        if source is None:
            radius = np.sqrt(gate_squared(share) * (ahead[motion.order] + sigma**2))
        else:
            radius = source[0] / 2 * elapsed**2 + source[1]
        rejected = np.abs(innovation) > radius
        keep = rejected & (not used)
        after = motion.update(ahead, z, sigma**2)
        state = tuple(np.where(keep, old, new) for old, new in zip(state, after))
        last = np.where(keep, last, stamp)
        found.append((innovation, radius, rejected, np.where(keep, ahead[0], state[0]) - truth))
    return Gated(*(np.array(column) for column in zip(*found)))
