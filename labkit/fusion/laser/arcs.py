"""Second half of the contour filter: the search for arcs. It takes the same points as the edges and knows nothing of them.

Anytime, as in `edges`. At once every group that is as small as the ball is taken for a ball, wherever its middle is. Then group
by group it is fitted and kept or dropped: with the known radius, or, if that does not fit, with a free one. At last the larger
groups are searched window by window, for a ball that touches something else.

What is accepted: the points are off the circle by at most `Settings.arc` in the mean, the circle fits clearly better than a line
and than the two lines of a robot's corner, and it bulges towards the scanner. These rules are ours; source 2 names the format and
the split into two parts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from labkit.fusion.laser.circles import known_radius, off_circle, taubin
from labkit.fusion.laser.edges import groups
from labkit.fusion.laser.formats import NO_ARCS, Arcs, Points
from labkit.fusion.laser.settings import VISIT_NS, Settings

LEAST = 4  # points of an arc with a known radius
LEAST_FREE = LEAST_HIDDEN = 8  # of one without, and of one that is part of a larger group: enough to tell it from a corner
FREE_RADII = 0.04, 0.40  # m
CURVED = 0.6  # a circle's error is at most this share of a line's
ROUND, HIDDEN = 1.4, 0.9  # and of that of a corner's two lines, which have more to adapt: on its own, in a larger group
SMALL = 3.0  # radii: the diagonal of what shows of a ball alone is no longer, from whatever sides it is seen
FIT_VISITS = 12  # visits to a point by one fit: its rounds and the two errors
Found = tuple[np.ndarray, float, np.ndarray]  # centre, radius, indices of the points


def search_arcs(points: Points, settings: Settings | None = None) -> Iterator[tuple[int, Arcs]]:
    """Anytime: rough arcs, then fitted ones, then those hidden in larger groups."""
    settings = settings or Settings()
    xy, away = points.xy, _away(points)
    every = [group for group in groups(points, settings) if len(group) >= LEAST]
    wide = [float(np.hypot(*np.ptp(xy[group], axis=0))) for group in every]
    small = [group for group, width in zip(every, wide, strict=True) if width <= SMALL * settings.ball]
    found: dict[int, Found] = {}
    for group in small:
        found[int(group[0])] = xy[group].mean(axis=0) + 0.7 * settings.ball * away[group].mean(axis=0), settings.ball, group
    yield max(1, len(xy)) * VISIT_NS, _arcs(xy, found)

    for group, width in zip(every, wide, strict=True):
        if width <= 2.2 * FREE_RADII[1]:
            visits, kept = 0, None
            for part in (group, group[1:], group[:-1], group[1:-1]):  # a mixed pixel is at an end
                if kept is None and len(part) >= LEAST and width <= SMALL * settings.ball:
                    visits += FIT_VISITS * len(part)
                    kept = _with_known_radius(xy, away, part, settings)
            if kept is None and len(group) >= LEAST_FREE:
                visits += FIT_VISITS * len(group)
                kept = _with_free_radius(xy, away, group, settings)
            found.pop(int(group[0]), None)
            if kept is not None:
                found[int(group[0])] = kept
            yield max(1, visits) * VISIT_NS, _arcs(xy, found)

    for group, width in zip(every, wide, strict=True):
        if int(group[0]) in found or width <= 2.2 * settings.ball:
            continue
        before = found
        for visits, hidden in _in_windows(points, away, group, settings):
            found = before | {int(kept[2][0]): kept for kept in hidden}
            yield max(1, visits) * VISIT_NS, _arcs(xy, found)


def _away(points: Points) -> np.ndarray:
    """Unit vectors from the scanner to each point."""
    away = points.xy - points.viewpoints[points.origin]
    return away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]


def _off_line(xy: np.ndarray) -> np.ndarray:
    """Root mean square distance of the points (..., n, 2) from their best line."""
    x, y = np.moveaxis(xy - xy[..., :1, :], -1, 0)
    sums = [q.sum(axis=-1) for q in (x, y, x * x, x * y, y * y)]
    return np.sqrt(_squares(xy.shape[-2], *sums) / xy.shape[-2])


def _off_corner(xy: np.ndarray) -> np.ndarray:
    """The same for the best two lines that share the points between them, at least three each: all splits from running sums."""
    count = xy.shape[-2]
    x, y = np.moveaxis(xy - xy[..., :1, :], -1, 0)
    running = [np.cumsum(q, axis=-1) for q in (x, y, x * x, x * y, y * y)]
    first = [q[..., 2:-3] for q in running]
    second = [q[..., -1:] - one for q, one in zip(running, first, strict=True)]
    size = np.arange(3, count - 2)
    return np.sqrt((_squares(size, *first) + _squares(count - size, *second)).min(axis=-1) / count)


def _squares(n: Any, x: Any, y: Any, xx: Any, xy: Any, yy: Any) -> Any:
    """Sum of the squared distances of n points from their best line, from sums over them: the smaller eigenvalue."""
    a, b, d = xx - x * x / n, xy - x * y / n, yy - y * y / n
    return np.maximum((a + d) / 2 - np.sqrt((a - d) ** 2 / 4 + b * b), 0)


def _round(xy: np.ndarray, error: np.ndarray, settings: Settings, share: float = ROUND) -> np.ndarray:
    """Whether a circle with this error is good, and points (..., n, 2) are rather round than straight or a corner.

    With few points a corner cannot be told.
    """
    good = (error <= settings.arc) & (error <= CURVED * _off_line(xy))
    if good.any() and xy.shape[-2] >= LEAST_HIDDEN:
        good &= error <= share * _off_corner(xy)
    return good


def _with_known_radius(xy: np.ndarray, away: np.ndarray, group: np.ndarray, settings: Settings) -> Found | None:
    p, mean = xy[group], xy[group].mean(axis=0)
    outward = away[group].mean(axis=0)
    centre = known_radius(p, settings.ball, mean + 0.7 * settings.ball * outward)
    error = off_circle(p, centre, settings.ball)
    several = np.hypot(*outward) < 0.9  # seen from several sides: the middle of the points is no sign of the bulge
    bulges = several or (centre - mean) @ outward > 0
    return (centre, settings.ball, group) if bulges and _round(p, error, settings) else None


def _with_free_radius(xy: np.ndarray, away: np.ndarray, group: np.ndarray, settings: Settings) -> Found | None:
    p, mean = xy[group], xy[group].mean(axis=0)
    centre, radius = taubin(p)
    if not FREE_RADII[0] <= radius <= FREE_RADII[1] or abs(radius - settings.ball) < 0.2 * settings.ball:
        return None
    error = off_circle(p, centre, radius)
    bulges = (centre - mean) @ away[group].mean(axis=0) > 0
    return (centre, float(radius), group) if bulges and _round(p, error, settings) else None


def _in_windows(points: Points, away: np.ndarray, group: np.ndarray, settings: Settings) -> Iterator[tuple[int, list[Found]]]:
    """Windows as wide as the ball would be seen, slid along a group: (visits, the best ones that do not overlap).

    Windows of one width are treated together, and only those are fitted that bulge by a good part of the radius.
    """
    xy, radius = points.xy, settings.ball
    seen_from = points.viewpoints[points.origin[group]]
    distance = np.hypot(*(xy[group] - seen_from).T)
    half = np.arcsin(np.minimum(radius / np.maximum(distance + radius, 1e-6), 1))
    widths = np.minimum(np.rint(2 * half / max(points.step, 1e-6)), 200).astype(int) * len(points.viewpoints)
    candidates: list[tuple[float, np.ndarray, np.ndarray]] = []
    for width in np.unique(widths[widths >= LEAST_HIDDEN]).tolist():
        start = np.flatnonzero(widths == width)
        start = start[start + width <= len(group)]
        if not len(start):
            continue
        rows = group[start[:, None] + np.arange(width)]
        p = xy[rows]
        chord = p[:, -1] - p[:, 0]
        span = np.hypot(*chord.T)
        middle = p[:, width // 2] - p[:, 0]
        bulge = (chord[:, 0] * middle[:, 1] - chord[:, 1] * middle[:, 0]) / np.maximum(span, 1e-9)  # to the left: free space
        fits = (bulge > 0.35 * radius) & (span > radius) & (span < 2.4 * radius)
        visits = 3 * len(rows)
        if fits.any():
            p, rows = p[fits], rows[fits]
            centre = known_radius(p, radius, p.mean(axis=1) + 0.7 * radius * away[rows].mean(axis=1))
            error = off_circle(p, centre, radius)
            good = _round(p, error, settings, HIDDEN)
            candidates += zip(error[good].tolist(), centre[good], rows[good], strict=True)
            visits += FIT_VISITS * p.shape[0] * width
        yield visits, _apart(candidates, radius)


def _apart(candidates: list[tuple[float, np.ndarray, np.ndarray]], radius: float) -> list[Found]:
    """The best candidates, none of which lies within another."""
    kept: list[Found] = []
    for _, centre, rows in sorted(candidates, key=lambda candidate: candidate[0]):
        if all(np.hypot(*(centre - other)) > 2 * radius for other, _, _ in kept):
            kept.append((centre, radius, rows))
    return kept


def _arcs(xy: np.ndarray, found: dict[int, Found]) -> Arcs:
    if not found:
        return NO_ARCS
    first, last = zip(*(_span(xy[group] - centre) for centre, _, group in found.values()))
    return Arcs(
        np.array([centre for centre, _, _ in found.values()]),
        np.array([radius for _, radius, _ in found.values()]),
        np.array(first),
        np.array(last),
        np.array([len(group) for _, _, group in found.values()]),
    )


def _span(p: np.ndarray) -> tuple[float, float]:
    """First and last angle of points around the origin, counterclockwise: all of the circle but the widest gap."""
    angle = np.sort(np.arctan2(p[:, 1], p[:, 0]))
    gaps = np.diff(angle, append=angle[0] + 2 * np.pi)
    widest = int(np.argmax(gaps))
    first = angle[(widest + 1) % len(angle)]
    last = angle[widest]
    return float(first), float(last if last >= first else last + 2 * np.pi)
