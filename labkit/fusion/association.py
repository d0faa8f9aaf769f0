"""Which measurement belongs to which track: the source's rule, global nearest neighbour, joint compatibility.

A rule gets the tracks' forecasts and the measurements of one look, all of one station and time, and gives each measurement the
index of its track, or -1. No track gets two.

Sources: source 2, section 5.3.2 (most recent element first, nearest free position, gate (5.32)); S. Blackman, R. Popoli, Design
and Analysis of Modern Tracking Systems, 1999, chapter 6 (gate, assignment); J. Neira, J. Tardos, IEEE Trans. Robotics and
Automation 17(6), 2001 (joint compatibility).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from labkit.fusion.filters import Forecast
from labkit.fusion.measurements import Measurement

#: Share of its true measurements that the usual gate lets through.
GATE = 0.999

#: A search for joint compatibility ends after so many nodes, with the best it has found.
MOST_NODES = 20_000

#: And it takes looks of at most so many measurements.
MOST_JOINT = 200

#: Cost of a pair that is not allowed: more than all that are.
_FORBIDDEN = 1e9


class Pairs(NamedTuple):
    """Every track with every measurement, arrays of shape (tracks, measurements).

    Attributes:
        distance: between forecast and measurement in m.
        squared: squared Mahalanobis distance.
        cost: squared distance plus ln|S|, minus twice the logarithm of the likelihood but for a constant. Without the second
            term a track that knows nothing would be near to everything.
    """

    distance: np.ndarray
    squared: np.ndarray
    cost: np.ndarray


def pairs(forecasts: Sequence[Forecast], look: Sequence[Measurement]) -> Pairs:
    """All pairs of tracks and measurements."""
    x, y, xx, xy, yy = np.array(forecasts, float).T[:, :, None]
    zx, zy, rxx, rxy, ryy = np.array([(m.x, m.y, m.xx, m.xy, m.yy) for m in look]).T[:, None, :]
    dx, dy = zx - x, zy - y
    squared, det = _mahalanobis(dx, dy, xx + rxx, xy + rxy, yy + ryy)
    return Pairs(np.hypot(dx, dy), squared, squared + np.log(det))


def squared_distance(f: Forecast, m: Measurement) -> float:
    """Squared Mahalanobis distance of a measurement from a forecast; of the one that belongs to it, this is its NIS."""
    return _mahalanobis(m.x - f.x, m.y - f.y, f.xx + m.xx, f.xy + m.xy, f.yy + m.yy)[0]


def _mahalanobis(dx: Any, dy: Any, sxx: Any, sxy: Any, syy: Any) -> tuple[Any, Any]:
    """y' S^-1 y and the determinant of S, of numbers or arrays."""
    det = sxx * syy - sxy * sxy
    return (syy * dx * dx - 2 * sxy * dx * dy + sxx * dy * dy) / det, det


def gate_squared(share: float) -> float:
    """The squared Mahalanobis distance that a share of the true measurements stays below: two dimensions, so -2 ln(1 - share)."""
    if not 0 < share < 1:
        raise ValueError(f"the gate is {share}; a share between 0 and 1 is allowed, such as {GATE}")
    return -2 * math.log1p(-share)


class Rule(Protocol):
    """A way to associate."""

    @property
    def again(self) -> bool:
        """Whether a measurement that is left over, and in the gate around another one of the same look, is of the same object. It
        starts a track of its own otherwise.
        """
        ...

    def allowed(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        """Which pairs the gate lets through; `elapsed` is the time in s since the last update of each track."""
        ...

    def owners(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        """Index of the track of each measurement, or -1."""
        ...


@dataclass(frozen=True)
class _Gated:
    """Pairs within a gate by Mahalanobis distance that lets through this share of the true ones."""

    share: float = GATE
    again: bool = True

    def __post_init__(self) -> None:
        gate_squared(self.share)

    def allowed(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        return found.squared <= gate_squared(self.share)


@dataclass(frozen=True)
class GlobalNearest(_Gated):
    """The assignment that explains all measurements of a look best; gate by Mahalanobis distance."""

    def owners(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        allowed = self.allowed(found, elapsed)
        owner = np.full(allowed.shape[1], -1)
        cost = np.where(allowed, found.cost, _FORBIDDEN)
        if 1 in cost.shape:
            track, measurement = np.unravel_index(np.argmin(cost), cost.shape)
            rows, columns = np.array([track]), np.array([measurement])
        else:
            from scipy.optimize import linear_sum_assignment

            rows, columns = linear_sum_assignment(cost)
        good = allowed[rows, columns]
        owner[columns[good]] = rows[good]
        return owner


@dataclass(frozen=True)
class NearestFirst:
    """The source's rule: the most recently updated element chooses first, the nearest free position; gate (5.32).

    S = a_max/2 dt^2 + e_max knows the time since the last update, but not how well the velocity is known.
    """

    a_max: float = 1.0
    e_max: float = 0.09
    again: bool = False

    def __post_init__(self) -> None:
        for name in ("a_max", "e_max"):
            if not 0 <= getattr(self, name) <= 1e9:
                raise ValueError(f"{name} is {getattr(self, name)}; 0 to 1e9 is allowed")

    def reach(self, elapsed: Sequence[float]) -> np.ndarray:
        """The radius of the gate in m, (5.32)."""
        return self.a_max / 2 * np.square(elapsed) + self.e_max

    def allowed(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        return found.distance <= self.reach(elapsed)[:, None]

    def owners(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        allowed = self.allowed(found, elapsed)
        owner = np.full(allowed.shape[1], -1)
        free = np.ones(allowed.shape[1], bool)
        for track in np.argsort(elapsed, kind="stable"):
            nearest = int(np.argmin(np.where(free, found.distance[track], np.inf)))
            if free[nearest] and allowed[track, nearest]:
                owner[nearest], free[nearest] = track, False
        return owner


@dataclass(frozen=True)
class JointCompatible(_Gated):
    """As many pairs as are likely *together*, the nearest of these; branch and bound, by the shortest sum of squared distances.

    Estimates of different elements are independent here, so the joint distance is the sum, and k pairs must stay below the
    quantile of chi-square with 2k degrees of freedom.
    """

    def owners(self, found: Pairs, elapsed: Sequence[float]) -> np.ndarray:
        from scipy.special import chdtri

        allowed = self.allowed(found, elapsed)
        tracks, count = allowed.shape
        if count > MOST_JOINT:
            raise ValueError(f"a look of {count} measurements; joint compatibility is searched for with at most {MOST_JOINT}")
        most = chdtri(2 * np.arange(1, min(tracks, count) + 1), 1 - self.share)
        choices = [np.flatnonzero(allowed[:, j])[np.argsort(found.squared[allowed[:, j], j])].tolist() for j in range(count)]
        squared = found.squared.tolist()
        best: tuple[int, float, list[int]] = (-1, math.inf, [-1] * count)
        nodes = 0

        def search(j: int, chosen: list[int], used: set[int], total: float) -> None:
            nonlocal best, nodes
            nodes += 1
            if nodes > MOST_NODES or len(used) + count - j < best[0]:
                return
            if j == count:
                if (len(used), -total) > (best[0], -best[1]):
                    best = len(used), total, list(chosen)
                return
            for track in choices[j]:
                more = total + squared[track][j]
                if track not in used and more <= most[len(used)]:
                    search(j + 1, [*chosen, track], used | {track}, more)
            search(j + 1, [*chosen, -1], used, total)

        search(0, [], set(), 0.0)
        return np.array(best[2])
