"""Fusion of contours: equal arcs become one, and so do edges that overlap.

Anytime, as the stages of the chain: at once all contours of all stations; then, the nearest first, two that are one thing become
one. Arcs are equal if their radii and centres are; edges overlap if they run the same way beside each other. As an edge has the
free space on its left, the two faces of a robot, which run opposite ways, are never taken for one.

Contours may be empty, and edges without a length, which show in no direction, are left out; what cannot be a contour is refused.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.5, which names arcs and overlapping edges; the
rules are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from labkit.fusion.joining import PARALLEL
from labkit.fusion.laser.formats import Arcs, Contours, Edges, Objects
from labkit.fusion.laser.settings import VISIT_NS, Settings

SAME_RADIUS = 0.03  # m by which the radii of equal arcs may differ
SHORTEST = 1e-6  # m: an edge without a length

#: What is known of edges: ax, ay, bx, by, points; of arcs: x, y, radius, first, last, points. One row each.
Rows = np.ndarray


def together(stations: Sequence[Contours] | Sequence[Objects], what: str) -> tuple[str, int]:
    """The name of all stations as one, and the mean of their times; ValueError if there is none."""
    if not stations:
        raise ValueError(f"{what} of no station are to be fused; at least one is needed")
    return "+".join(one.station for one in stations), sum(one.time_ns for one in stations) // len(stations)


def fuse_contours(stations: Sequence[Contours], settings: Settings | None = None) -> Iterator[tuple[int, Contours]]:
    """Anytime: the contours of all stations as one set. Their time is the mean of the stations'.

    Raises:
        ValueError: there is no station, or something in its contours is none: it is named with its station.
    """
    name, time_ns = together(stations, "contours")
    settings = settings or Settings()
    for one in stations:
        check_contours(one)
    edges, of_edges = pooled([edge_rows(one.edges) for one in stations])
    arcs, of_arcs = pooled([arc_rows(one.arcs) for one in stations])

    def made() -> Contours:
        return Contours(name, time_ns, edges_of(edges), arcs_of(arcs))

    yield max(1, len(edges) + len(arcs)) * VISIT_NS, made()
    for cost, fewer in join_arcs(arcs, of_arcs, settings.join):
        arcs = fewer
        yield cost, made()
    for cost, fewer in join_edges(edges, of_edges, settings.join):
        edges = fewer
        yield cost, made()


def join_arcs(arcs: Rows, owners: np.ndarray, reach: float) -> Iterator[tuple[int, Rows]]:
    """Anytime: arcs of different stations with one radius and centres at most `reach` m apart as one."""

    def apart(rows: Rows) -> np.ndarray:
        distance = np.hypot(*np.moveaxis(rows[:, None, :2] - rows[None, :, :2], -1, 0))
        return np.where(np.abs(rows[:, None, 2] - rows[None, :, 2]) <= SAME_RADIUS, distance, np.inf)

    return _joined(arcs, owners, apart, _one_arc, reach)


def join_edges(edges: Rows, owners: np.ndarray, reach: float) -> Iterator[tuple[int, Rows]]:
    """Anytime: edges of different stations that run the same way, at most `reach` m beside each other, and overlap, as one."""
    return _joined(edges, owners, _beside, _one_edge, reach)


def _joined(
    rows: Rows, owners: np.ndarray, apart: Callable[[Rows], np.ndarray], one: Callable[[Rows, Rows], Rows], reach: float
) -> Iterator[tuple[int, Rows]]:
    """Join the two nearest rows, again and again, as long as they are within reach and not both of one and the same station.

    Args:
        owners: of each row the stations that have seen it, one bit each. apart: distances (n, n) of rows, inf for different ones.
    """
    visits = len(rows) ** 2
    while len(rows) > 1:
        both = owners[:, None] | owners
        distance = np.where(both & (both - 1), apart(rows), np.inf)  # more than one bit: more than one station
        distance[np.tril_indices(len(rows))] = np.inf
        i, k = np.unravel_index(int(distance.argmin()), distance.shape)
        if distance[i, k] > reach:
            return
        rows, owners = rows.copy(), owners.copy()
        rows[i], owners[i] = one(rows[i], rows[k]), both[i, k]
        rows, owners = np.delete(rows, k, axis=0), np.delete(owners, k)
        yield visits * VISIT_NS, rows
        visits = len(rows)  # a distance that has been computed need not be again


def _beside(rows: Rows) -> np.ndarray:
    """How far the middle of the shorter of two edges is from the line of the longer, inf if they do not run beside each other."""
    a, b = rows[:, 0:2], rows[:, 2:4]
    length = np.hypot(*(b - a).T)
    u = (b - a) / length[:, None]
    along_a, along_b = (np.einsum("jkc,jc->jk", end[None] - a[:, None], u) for end in (a, b))  # ends of k along j, from its begin
    off = (a + b)[None] / 2 - a[:, None]
    beside = np.abs(u[:, None, 0] * off[..., 1] - u[:, None, 1] * off[..., 0])
    overlap = np.minimum(np.maximum(along_a, along_b), length[:, None]) - np.maximum(np.minimum(along_a, along_b), 0)
    found = np.where((u @ u.T >= np.cos(PARALLEL)) & (overlap > 0), beside, np.inf)
    return np.where(length[:, None] >= length, found, found.T)


def _one_edge(p: Rows, q: Rows) -> Rows:
    """The line that fits the points of both best, taken as evenly spread along each edge; it ends where the outermost does."""
    ends = np.array([p[0:2], p[2:4], q[0:2], q[2:4]])
    count = np.array([p[4], q[4]])
    middles, halves = (ends[0::2] + ends[1::2]) / 2, (ends[1::2] - ends[0::2]) / 2
    mean = count @ middles / count.sum()
    off = middles - mean
    xx, xy, yy = (
        float(count @ (off[:, i] * off[:, k] + halves[:, i] * halves[:, k] / 3)) for i, k in ((0, 0), (0, 1), (1, 1))
    )  # a stretch of half length h spreads by h^2 / 3
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    u = np.array([np.cos(angle), np.sin(angle)])
    u = u if u @ halves[0] >= 0 else -u
    along = (ends - mean) @ u
    return np.array([*(mean + along.min() * u), *(mean + along.max() * u), count.sum()])


def _one_arc(p: Rows, q: Rows) -> Rows:
    """Centre and radius weighted by points; from the first angle that one of them has seen to the last."""
    share = q[5] / (p[5] + q[5])
    turns = 2 * np.pi * np.rint((p[3] + p[4] - q[3] - q[4]) / (4 * np.pi))
    first = min(p[3], q[3] + turns)
    last = min(max(p[4], q[4] + turns), first + 2 * np.pi)
    return np.array([*(p[:3] + share * (q[:3] - p[:3])), first, last, p[5] + q[5]])


def edge_rows(edges: Edges) -> Rows:
    """Edges as rows, without those that have no length."""
    return np.column_stack([edges.ends.reshape(-1, 4), edges.points]).astype(float)[edges.lengths > SHORTEST]


def edges_of(rows: Rows) -> Edges:
    """Rows as edges."""
    return Edges(rows[:, :4].reshape(-1, 2, 2), np.rint(rows[:, 4]).astype(np.int64))


def arc_rows(arcs: Arcs) -> Rows:
    """Arcs as rows."""
    return np.column_stack([arcs.centres, arcs.radii, arcs.first, arcs.last, arcs.points]).astype(float)


def arcs_of(rows: Rows) -> Arcs:
    """Rows as arcs."""
    return Arcs(rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4], np.rint(rows[:, 5]).astype(np.int64))


def pooled(stations: Sequence[Rows]) -> tuple[Rows, np.ndarray]:
    """The rows of all stations, and for each row the station it is of, as a bit of its own."""
    return np.concatenate(stations), np.repeat(1 << np.arange(len(stations)), [len(rows) for rows in stations])


def check_contours(contours: Contours) -> None:
    """Raises ValueError for what cannot be contours; the message names the station, which one, and what is allowed."""
    edges, arcs, of = contours.edges, contours.arcs, f"of station {contours.station}"
    if edges.ends.shape != (len(edges), 2, 2):
        raise ValueError(f"the edges {of} have ends of shape {edges.ends.shape}; for {len(edges)} it is {(len(edges), 2, 2)}")
    shapes = {"centres": (len(arcs), 2), "radii": (len(arcs),), "first": (len(arcs),), "last": (len(arcs),)}
    for name, shape in shapes.items():
        if getattr(arcs, name).shape != shape:
            raise ValueError(f"the arcs {of} have {name} of shape {getattr(arcs, name).shape}; for {len(arcs)} it is {shape}")
    circle = np.column_stack([arcs.centres, arcs.radii, arcs.first, arcs.last])
    turn = arcs.last - arcs.first
    wrong = (
        ("edge", ~np.isfinite(edges.ends).all(axis=(1, 2)), "an end that is no finite number", "finite metres are"),
        ("edge", edges.points < 1, "no point that supports it", "at least 1 is"),
        ("arc", ~np.isfinite(circle).all(axis=1), "something that is no finite number", "finite metres and angles are"),
        ("arc", arcs.radii <= 0, "a radius that is not above 0", "a length above 0 is"),
        ("arc", (turn < 0) | (turn > 2 * np.pi + 1e-9), "angles that are no part of one turn", "0 to 2 pi from first to last is"),
        ("arc", arcs.points < 1, "no point that supports it", "at least 1 is"),
    )
    for kind, rows, what, allowed in wrong:
        if rows.any():
            raise ValueError(f"{kind} {int(rows.argmax())} {of} has {what}; {allowed} allowed")
