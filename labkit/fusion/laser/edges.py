"""First half of the contour filter: points into groups, groups into edges by split and merge.

An anytime algorithm: a generator that yields `(time_ns, result)`, results that get better, so that it may be aborted at any yield
(the convention of `labkit.phases`). The first result is there when every point has been visited once.

Sources: the gap between groups is that of G. Borges and M. Aldon, J. Intelligent and Robotic Systems 40 (2004); split and merge
as compared in V. Nguyen et al., IROS 2005. What decides the order of the splits, the largest deviation first, is ours.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from heapq import heapify, heappop, heappush

import numpy as np

from labkit.fusion.laser.formats import NO_EDGES, Edges, Points
from labkit.fusion.laser.settings import VISIT_NS, Settings

STEEPEST = np.deg2rad(10.0)  # a surface seen at a smaller angle than this may fall apart
LEAST = 3  # points of an edge
SMALL = 1.0  # m: what is not larger is gone around, what is larger surrounds the scanners
ENDS_APART = 5  # from so many points on, a line is fitted without the two at its ends: they may lie on the neighbour's line
CORNER = np.sin(np.deg2rad(15.0))  # edges that meet at a smaller angle have no corner


def groups(points: Points, settings: Settings) -> list[np.ndarray]:
    """Indices of points that belong together, each in the order of the scan: free space lies left of the way along them."""
    xy, origin = points.xy, points.origin
    if not len(xy):
        return []
    seen_from = points.viewpoints[origin]
    beside, away = xy[1:] - xy[:-1], xy - seen_from
    distance = np.hypot(away[:, 0], away[:, 1])
    cross = away[:-1, 0] * away[1:, 1] - away[:-1, 1] * away[1:, 0]
    turned = np.arctan2(np.abs(cross), (away[:-1] * away[1:]).sum(axis=1))
    nearer = np.minimum(distance[:-1], distance[1:])
    rest = np.sin(np.maximum(STEEPEST - turned, 1e-9))
    apart = np.hypot(beside[:, 0], beside[:, 1]) > settings.gap + nearer * np.sin(turned) / rest
    cut = (apart & (turned < STEEPEST)) | (turned >= STEEPEST) | (origin[1:] != origin[:-1])
    found = np.split(np.arange(len(xy)), np.flatnonzero(cut) + 1)
    return found if len(points.viewpoints) < 2 else _across_stations(points, found, settings.join)


def _across_stations(points: Points, found: list[np.ndarray], reach: float) -> list[np.ndarray]:
    """Join groups of different stations that are near each other; their points in order, as if one scanner had seen them."""
    xy = points.xy
    low, high = (np.array([f(xy[g], axis=0) for g in found]) for f in (np.min, np.max))
    root = list(range(len(found)))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    close = ((low[:, None] <= high + reach) & (high[:, None] >= low - reach)).all(axis=2)
    for i, k in np.argwhere(np.triu(close, 1)).tolist():
        if points.origin[found[i][0]] != points.origin[found[k][0]] and find(i) != find(k):
            gap = xy[found[i], None] - xy[found[k]]
            if (gap**2).sum(axis=2).min() <= reach**2:
                root[find(k)] = find(i)
    joined: dict[int, list[np.ndarray]] = {}
    for i, group in enumerate(found):
        joined.setdefault(find(i), []).append(group)
    return [parts[0] if len(parts) == 1 else _in_order(points, np.concatenate(parts)) for parts in joined.values()]


def _in_order(points: Points, group: np.ndarray) -> np.ndarray:
    """Clockwise around what is small, counterclockwise along what surrounds the scanners, beginning behind the widest gap."""
    xy = points.xy[group]
    around = np.ptp(xy, axis=0).max() <= SMALL
    x, y = (xy - (xy.mean(axis=0) if around else points.viewpoints.mean(axis=0))).T
    angle = np.arctan2(-y if around else y, x)
    order = np.argsort(angle, kind="stable")
    gaps = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
    return group[np.roll(order, -1 - int(np.argmax(gaps)))]


def extract_edges(points: Points, settings: Settings | None = None) -> Iterator[tuple[int, Edges]]:
    """Anytime: every group as one edge; then split where a point is furthest off, merge, and fit lines."""
    settings = settings or Settings()
    found = [group for group in groups(points, settings) if len(group) >= LEAST]
    cost = max(1, len(points.xy)) * VISIT_NS
    if not found:
        yield cost, NO_EDGES
        return
    p = points.xy[np.concatenate(found)]
    ends = np.cumsum([len(group) for group in found])
    pieces = [(int(end) - len(group), int(end) - 1) for group, end in zip(found, ends, strict=True)]  # first and last row of p
    yield cost, _edges(p, pieces)

    waiting = [_furthest(p, i, k) for i, k in pieces]
    cost = len(p) * VISIT_NS
    heapify(waiting)
    whole = list(pieces)  # in order, as the points are
    while waiting and -waiting[0][0] > settings.split:
        _, i, at, k = heappop(waiting)
        place, halves = bisect_left(whole, (i, k)), ((i, at), (at, k))
        whole[place : place + 1] = halves
        for half in halves:
            heappush(waiting, _furthest(p, *half))
        yield cost + (k - i + 1) * VISIT_NS, _edges(p, whole)
        cost = 0

    merged, visits = _merge(p, whole, settings.split)
    yield max(1, cost + visits * VISIT_NS), _edges(p, merged)
    yield len(p) * VISIT_NS, _fitted(p, [piece for piece in merged if piece[1] - piece[0] >= LEAST - 1])


def _furthest(p: np.ndarray, i: int, k: int) -> tuple[float, int, int, int]:
    """The point between rows i and k that is furthest from the chord: (minus its distance, i, its row, k)."""
    if k - i < 2:
        return 0.0, i, i, k
    x, y = (p[i + 1 : k] - p[i]).T
    ex, ey = p[k] - p[i]
    length = np.hypot(ex, ey)
    off = np.abs(x * ey - y * ex) / length if length > 1e-6 else np.hypot(x, y)
    at = int(off.argmax())
    return -float(off[at]), i, i + 1 + at, k


def _edges(p: np.ndarray, pieces: list[tuple[int, int]]) -> Edges:
    rows = np.array(pieces, dtype=np.int64).reshape(-1, 2)
    rows = rows[rows[:, 1] - rows[:, 0] >= LEAST - 1]
    return Edges(p[rows], rows[:, 1] - rows[:, 0] + 1)


def _line(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The line with the least squared distances: a point on it and its direction, from the first row to the last."""
    mean = p.mean(axis=0)
    x, y = (p - mean).T
    angle = 0.5 * np.arctan2(2 * (x @ y), x @ x - y @ y)
    along = np.array([np.cos(angle), np.sin(angle)])
    return mean, along if along @ (p[-1] - p[0]) >= 0 else -along


def _merge(p: np.ndarray, pieces: list[tuple[int, int]], most: float) -> tuple[list[tuple[int, int]], int]:
    """Neighbours of one group that a single line fits become one; also the number of visits."""
    merged, visits = pieces[:1], 0
    for i, k in pieces[1:]:
        first, last = merged[-1]
        if last == i:
            mean, along = _line(p[first : k + 1])
            x, y = (p[first : k + 1] - mean).T
            visits += 2 * (k + 1 - first)
            if np.abs(x * along[1] - y * along[0]).max() <= most:
                merged[-1] = first, k
                continue
        merged.append((i, k))
    return merged, visits


def _fitted(p: np.ndarray, pieces: list[tuple[int, int]]) -> Edges:
    """Every piece as its best line, and neighbours that share a point meet where their lines do."""
    if not pieces:
        return NO_EDGES
    lines = [_line(p[i + 1 : k] if k - i >= ENDS_APART else p[i : k + 1]) for i, k in pieces]
    ends = np.array(
        [
            [m + along * (along @ (p[i] - m)), m + along * (along @ (p[k] - m))]
            for (m, along), (i, k) in zip(lines, pieces, strict=True)
        ]
    )
    for n in range(len(pieces) - 1):
        (a, u), (b, v) = lines[n], lines[n + 1]
        sine = u[0] * v[1] - u[1] * v[0]
        if pieces[n][1] == pieces[n + 1][0] and abs(sine) > CORNER:
            d = b - a
            ends[n, 1] = ends[n + 1, 0] = a + u * (d[0] * v[1] - d[1] * v[0]) / sine
    return Edges(ends, np.array([k - i + 1 for i, k in pieces]))
