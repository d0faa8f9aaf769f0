"""Fusion of objects: those of different stations that overlap become one.

Two discs overlap if their circles do, a disc and a polygon if the polygon reaches into the circle, and two polygons if their
outlines come as near as `Settings.join` anywhere: what two stations see of a robot from two sides has no area in common.

Anytime: at once all objects of all stations; then, group by group, objects that overlap become what their edges and arcs make
together: edges that overlap are joined as at the contour level, and what is left are objects as the object filter makes them.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.5, which says overlap; the rules are ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from labkit.fusion.laser.formats import Contours, Disc, Edges, Objects, Polygon
from labkit.fusion.laser.objects import object_filter
from labkit.fusion.laser.quality import to_edges
from labkit.fusion.laser.settings import VISIT_NS, Settings
from labkit.fusion.levels_contours import arcs_of, edge_rows, edges_of, join_arcs, join_edges, pooled, together

Owned = tuple[Disc | Polygon, int]  # an object and the station that has seen it


def fuse_objects(stations: Sequence[Objects], settings: Settings | None = None) -> Iterator[tuple[int, Objects]]:
    """Anytime: the objects of all stations as one set. Their time is the mean of the stations'.

    Raises:
        ValueError: there is no station, or a disc or polygon is none: it is named with its station.
    """
    name, time_ns = together(stations, "objects")
    settings = settings or Settings()
    for one in stations:
        check_objects(one)
    found: list[Owned] = []
    for i, one in enumerate(stations):
        found += [(thing, i) for thing in one.discs] + [(thing, i) for thing in one.polygons]

    def made(things: Sequence[Disc | Polygon]) -> Objects:
        polygons = tuple(thing for thing in things if isinstance(thing, Polygon))
        return Objects(name, time_ns, polygons, tuple(thing for thing in things if isinstance(thing, Disc)))

    yield max(1, len(found)) * VISIT_NS, made([thing for thing, _ in found])
    groups = _groups(found, settings.join)
    done: list[Disc | Polygon] = [found[group[0]][0] for group in groups if len(group) == 1]
    waiting = [group for group in groups if len(group) > 1]
    cost = len(found) ** 2 * VISIT_NS
    while waiting:
        spent, one = _one([found[i] for i in waiting.pop(0)], len(stations), settings)
        done += [*one.discs, *one.polygons]
        yield cost + spent, made([*done, *(found[i][0] for group in waiting for i in group)])
        cost = 0


def sides(polygon: Polygon) -> Edges:
    """The edges of a polygon; its points are spread over them by length."""
    c = polygon.corners
    after = np.concatenate([c[1:], c[:1]]) if polygon.closed else c[1:]
    ends = np.stack([c[: len(after)], after], axis=1)
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    return Edges(ends, np.maximum(1, np.rint(polygon.points * length / max(float(length.sum()), 1e-9))).astype(np.int64))


def overlap(a: Disc | Polygon, b: Disc | Polygon, reach: float) -> bool:
    """Whether two objects overlap; outlines of polygons if they come as near as `reach` m."""
    if isinstance(a, Disc) and isinstance(b, Disc):
        return float(np.hypot(a.x - b.x, a.y - b.y)) < a.radius + b.radius
    if isinstance(a, Polygon) and isinstance(b, Polygon):
        of_a, of_b = sides(a), sides(b)
        nearest = min(to_edges(a.corners, of_b).min(), to_edges(b.corners, of_a).min())
        return bool(nearest <= reach or _cross(of_a.ends, of_b.ends))
    disc, polygon = (a, b) if isinstance(a, Disc) else (b, a)
    assert isinstance(disc, Disc) and isinstance(polygon, Polygon)
    return bool(to_edges(np.array([[disc.x, disc.y]]), sides(polygon))[0] < disc.radius)


def _cross(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether one of the edges a (n, 2, 2) crosses one of b (m, 2, 2)."""

    def sides_of(edges: np.ndarray, points: np.ndarray) -> np.ndarray:
        """On which side of each edge each end of each other edge lies, shape (edges, others, 2)."""
        along, off = edges[:, 1] - edges[:, 0], points[None] - edges[:, None, None, 0]
        return np.sign(along[:, None, None, 0] * off[..., 1] - along[:, None, None, 1] * off[..., 0])

    return bool(((sides_of(a, b).prod(axis=2) < 0) & (sides_of(b, a).prod(axis=2) < 0).T).any())


def _groups(found: Sequence[Owned], reach: float) -> list[list[int]]:
    """Indices of objects that belong together, directly or by way of others."""
    low, high = np.array([_box(thing) for thing, _ in found]).reshape(-1, 2, 2).transpose(1, 0, 2)
    owner = np.array([of for _, of in found])
    near = ((low[:, None] <= high + reach) & (high[:, None] >= low - reach)).all(axis=2) & (owner[:, None] != owner)
    group = list(range(len(found)))
    for i, k in np.argwhere(np.tril(near)).tolist():
        if group[i] != group[k] and overlap(found[i][0], found[k][0], reach):
            group = [group[k] if g == group[i] else g for g in group]
    return [[i for i, g in enumerate(group) if g == name] for name in dict.fromkeys(group)]


def _box(thing: Disc | Polygon) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest x and y of an object."""
    if isinstance(thing, Polygon):
        return thing.corners.min(axis=0), thing.corners.max(axis=0)
    middle = np.array([thing.x, thing.y])
    return middle - thing.radius, middle + thing.radius


def _one(group: Sequence[Owned], stations: int, settings: Settings) -> tuple[int, Objects]:
    """What objects that overlap make together, and the time it takes in ns."""
    edges, arcs = [np.empty((0, 5))] * stations, [np.empty((0, 6))] * stations
    for thing, owner in group:
        if isinstance(thing, Polygon):
            edges[owner] = np.concatenate([edges[owner], edge_rows(sides(thing))])
        else:
            arcs[owner] = np.concatenate([arcs[owner], _whole(thing)])
    circles, lines = pooled(arcs), pooled(edges)
    reach = 2 * float(circles[0][:, 2].max(initial=0))
    fewer_arcs = [(0, circles[0]), *join_arcs(*circles, reach)]
    fewer_edges = [(0, lines[0]), *join_edges(*lines, settings.join)]
    contours = Contours("", 0, edges_of(fewer_edges[-1][1]), arcs_of(fewer_arcs[-1][1]))
    steps = list(object_filter(contours, settings))
    return sum(cost for cost, _ in (*fewer_arcs, *fewer_edges, *steps)), steps[-1][1]


def _whole(disc: Disc) -> np.ndarray:
    """A disc as the only row of arcs (`levels_contours`): one all around."""
    return np.array([[disc.x, disc.y, disc.radius, 0.0, 2 * np.pi, disc.points]])


def check_objects(objects: Objects) -> None:
    """Raises ValueError for what cannot be objects; the message names the station, which one, and what is allowed."""
    of = f"of station {objects.station}"
    for i, disc in enumerate(objects.discs):
        if not (np.isfinite([disc.x, disc.y, disc.radius]).all() and disc.radius > 0 and disc.points >= 1):
            raise ValueError(f"disc {i} {of} is {disc}; finite metres, a radius above 0 and at least one point are needed")
    for i, polygon in enumerate(objects.polygons):
        c = polygon.corners
        if c.ndim != 2 or c.shape[1] != 2 or len(c) < 2 or not np.isfinite(c).all() or polygon.points < 1:
            raise ValueError(
                f"polygon {i} {of} has corners {c.tolist()} and {polygon.points} points; "
                "two or more finite corners and at least one point are needed"
            )
