"""How good a filter is, and whether it knows: errors, consistency, distances between sets of elements, track switches.

Sources: Y. Bar-Shalom, X.-R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4
(NEES, NIS); D. Schuhmacher, B.-T. Vo, B.-N. Vo, IEEE Trans. Signal Processing 56(8), 2008 (OSPA); A. Rahmathullah,
A. Garcia-Fernandez, L. Svensson, FUSION 2017 (GOSPA).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import NamedTuple

import numpy as np


def rmse(errors: np.ndarray) -> float:
    """Root of the mean squared length of position errors, complex numbers of any shape: both axes together, in their unit."""
    return float(np.sqrt(np.mean(np.abs(errors) ** 2)))


def normalised_squares(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """e' P^-1 e for errors of shape (..., n) with covariances of shape (..., n, n).

    Of the estimation errors this is the NEES, of innovations with their S the NIS. A consistent filter has n in the mean, and the
    values are distributed as chi-square with n degrees of freedom.
    """
    return np.einsum("...i,...i->...", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])


def consistency_band(freedom: int, samples: int, confidence: float = 0.95) -> tuple[float, float]:
    """Where the mean of `samples` independent NEES or NIS lies with that confidence, if the filter is consistent.

    Args:
        freedom: degrees of freedom of one of them: 4 for position and velocity in the plane, 2 for a measured position.
    """
    from scipy.special import chdtri

    tail = (1 - confidence) / 2
    return tuple(float(chdtri(freedom * samples, p)) / samples for p in (1 - tail, tail))  # type: ignore[return-value]


def _assigned(found: np.ndarray, true: np.ndarray, cutoff: float) -> np.ndarray:
    """Distances, cut off, of the best pairs of two sets of places (n,) and (m,), complex; shape (min(n, m),)."""
    from scipy.optimize import linear_sum_assignment

    cost = np.minimum(np.abs(np.asarray(found)[:, None] - np.asarray(true)[None, :]), cutoff) ** 2
    return np.sqrt(cost[linear_sum_assignment(cost)])


def ospa(found: Sequence[complex] | np.ndarray, true: Sequence[complex] | np.ndarray, cutoff: float) -> float:
    """Optimal sub-pattern assignment distance of order 2 between two sets of places, in their unit; at most `cutoff`.

    Each place of the larger set that has no partner counts as `cutoff`; the mean is over the larger set.
    """
    most = max(len(found), len(true))
    if most == 0:
        return 0.0
    alone = most - min(len(found), len(true))
    return math.sqrt((float(np.sum(_assigned(np.asarray(found), np.asarray(true), cutoff) ** 2)) + cutoff**2 * alone) / most)


class Gospa(NamedTuple):
    """Generalised OSPA of order 2, alpha 2; squared, so that the parts add up.

    Attributes:
        squared: the whole, in the square of the unit.
        localisation: from pairs nearer than the cut-off.
        missed, false: cut-off squared / 2 for each element without an estimate, and each estimate without an element.
    """

    squared: float
    localisation: float
    missed: float
    false: float


def gospa(found: Sequence[complex] | np.ndarray, true: Sequence[complex] | np.ndarray, cutoff: float) -> Gospa:
    """What it costs to take one set of places for the other: errors of place, missed and false elements, kept apart."""
    near = _assigned(np.asarray(found), np.asarray(true), cutoff)
    near = near[near < cutoff]
    localisation = float(np.sum(near**2))
    missed, false = (cutoff**2 / 2 * (len(places) - len(near)) for places in (true, found))
    return Gospa(localisation + missed + false, localisation, missed, false)


def switches(owners: Iterable[tuple[Hashable, Hashable]]) -> int:
    """How often an element got another track than before; `owners` are (element, track) in order of time."""
    last: dict[Hashable, Hashable] = {}
    count = 0
    for element, track in owners:
        count += last.get(element, track) != track
        last[element] = track
    return count
