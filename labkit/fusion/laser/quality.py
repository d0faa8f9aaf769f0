"""How good the result of a stage is, from 0 to 1, judged with the world that only the simulation knows.

- edges: share of the points on straight things that are no further than 3 cm from an edge;
- arcs: the balls that were found, each worth less the further off it is (nothing from 5 cm on), per ball there is or is claimed;
- objects: 1 if every body seen is one object; the border, cut by the shadows of what stands before it, keeps it below;
- elements: like arcs, for balls and robots, nothing from 20 cm on. The border is left out.

A body counts as seen if at least four beams hit it. All measures are ours; source 2 judges by eye.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from labkit.fusion.laser.formats import Arcs, Edges, Elements, Objects, Points
from labkit.fusion.laser.world import Body, World

NEAR, ARC_REACH, ELEMENT_REACH, SEEN = 0.03, 0.05, 0.20, 4


def seen_bodies(world: World, points: Points) -> list[Body]:
    """The bodies that at least four of the points lie on."""
    hits = np.bincount(points.seen[points.seen >= 0], minlength=len(world.bodies))
    return [body for body, count in zip(world.bodies, hits, strict=True) if count >= SEEN]


def to_edges(xy: np.ndarray, edges: Edges) -> np.ndarray:
    """Distance of each point (n, 2) to the nearest edge, inf if there is none."""
    if not len(edges):
        return np.full(len(xy), np.inf)
    (ax, ay), (ux, uy) = edges.ends[:, 0].T, (edges.ends[:, 1] - edges.ends[:, 0]).T
    x, y = xy[:, :1] - ax, xy[:, 1:] - ay  # by coordinate: sums over an axis of two take five times as long
    share = np.clip((x * ux + y * uy) / np.maximum(ux**2 + uy**2, 1e-12), 0, 1)
    return np.sqrt(((x - share * ux) ** 2 + (y - share * uy) ** 2).min(axis=1))


def edge_quality(points: Points, world: World, edges: Edges) -> float:
    """Share of the points on straight bodies that an edge explains; 1 if there are none."""
    straight = np.array([not body.radius for body in world.bodies] + [False])[points.seen]
    return float((to_edges(points.xy[straight], edges) <= NEAR).mean()) if straight.any() else 1.0


def score(found: Sequence[tuple[float, float]], wanted: Sequence[tuple[float, float]], reach: float) -> float:
    """Sum over pairs, the nearest first, of 1 - distance / reach, per thing found or wanted; 1 if there is none at all."""
    if not found or not wanted:
        return 1.0 if not found and not wanted else 0.0
    apart = np.hypot(*np.moveaxis(np.array(found)[:, None] - np.array(wanted)[None], -1, 0))
    gained, pairs = 0.0, 0
    while apart.size and apart.min() < reach:
        i, k = np.unravel_index(apart.argmin(), apart.shape)
        gained, pairs = gained + 1 - float(apart[i, k]) / reach, pairs + 1
        apart = np.delete(np.delete(apart, i, axis=0), k, axis=1)
    return gained / (len(found) + len(wanted) - pairs)


def _places(bodies: Iterable[Body], kind: str, time_ns: int) -> list[tuple[float, float]]:
    places = (body.motion.at(time_ns) for body in bodies if body.kind == kind)
    return [(float(x), float(y)) for x, y, _ in places]


def arc_quality(points: Points, world: World, arcs: Arcs) -> float:
    """See the module."""
    wanted = _places(seen_bodies(world, points), "ball", points.time_ns)
    return score([(float(x), float(y)) for x, y in arcs.centres], wanted, ARC_REACH)


def object_quality(points: Points, world: World, objects: Objects) -> float:
    """See the module."""
    bodies, claimed = len(seen_bodies(world, points)), len(objects.polygons) + len(objects.discs)
    return min(bodies, claimed) / max(bodies, claimed, 1) if bodies or claimed else 1.0


def element_quality(points: Points, world: World, elements: Elements) -> float:
    """See the module: balls and robots together, weighted by how many there are or are claimed."""
    bodies = seen_bodies(world, points)
    gained = total = 0.0
    for kind in ("ball", "robot"):
        found = [(element.x, element.y) for element in elements.elements if element.kind == kind]
        wanted = _places(bodies, kind, elements.time_ns)
        weight = max(len(found), len(wanted))
        gained, total = gained + weight * score(found, wanted, ELEMENT_REACH), total + weight
    return gained / total if total else 1.0
