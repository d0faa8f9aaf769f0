"""The element filter: objects that are known. A disc of the ball's size is a ball; a polygon with a long edge is the border; one
that fits into a robot's square is a robot.

Anytime, as in `edges`: at once every object that has the size of an element is one, where its middle is; then object by object,
the borders first, the hidden side is taken into account. Of a robot one or two sides are seen, and its centre is half a side
behind them. Of a border every long edge is an element of its own, and so is what lies in line with one: a shadow has cut it off.

The confidence of a ball or robot grows with the n points that support it, as n / (n + 4); of a robot it is multiplied with the
share of a side that was seen; of a border it grows with its length up to twice the shortest. A choice of ours: source 2 prints
none.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from labkit.fusion.laser.formats import Disc, Element, Elements, Objects, Polygon
from labkit.fusion.laser.settings import VISIT_NS, Settings

BALL_OFF = 0.03  # m by which a disc's radius may differ from the ball's
SMALLEST, LARGEST = 0.4, 1.15  # of a robot's side, for what is seen of one
ALONG = 0.05  # weight of where a side's middle is against where its line is: its ends may be hidden


def element_filter(objects: Objects, settings: Settings | None = None) -> Iterator[tuple[int, Elements]]:
    """Anytime: objects to elements."""
    settings = settings or Settings()
    rough = [*(_rough(disc, settings) for disc in objects.discs), *(_rough(polygon, settings) for polygon in objects.polygons)]
    parts: list[list[Element]] = [[element] if element else [] for element in rough]

    def made() -> Elements:
        return Elements(objects.station, objects.time_ns, tuple(element for part in parts for element in part))

    yield max(1, len(parts)) * VISIT_NS, made()
    known = [(i, polygon) for i, polygon in enumerate(objects.polygons, start=len(objects.discs)) if parts[i]]
    walls: list[Element] = []
    for i, polygon in known:
        if parts[i][0].kind == "border":
            parts[i] = _walls(polygon, settings)
            walls += parts[i]
            yield 4 * len(polygon.corners) * VISIT_NS, made()
    for i, polygon in known:
        if parts[i][0].kind == "robot":
            parts[i] = _piece_of(walls, polygon, settings) or _robot(polygon, settings)
            yield (len(walls) + 4) * len(polygon.corners) * VISIT_NS, made()


def _sides(polygon: Polygon) -> np.ndarray:
    """The edges of a polygon, shape (k, 2, 2)."""
    c = polygon.corners
    after = np.concatenate([c[1:], c[:1]]) if polygon.closed else c[1:]
    return np.stack([c[: len(after)], after], axis=1)


def _supported(points: int) -> float:
    return points / (points + 4)


def _rough(thing: Disc | Polygon, settings: Settings) -> Element | None:
    """What it is by its size alone, at the middle of what is seen."""
    if isinstance(thing, Disc):
        if abs(thing.radius - settings.ball) > BALL_OFF:
            return None
        return Element("ball", thing.x, thing.y, 2 * thing.radius, _supported(thing.points))
    longest = float(np.hypot(*(thing.corners[1:] - thing.corners[:-1]).T).max())
    x, y = thing.corners.mean(axis=0).tolist()
    if longest >= settings.border:
        return Element("border", x, y, longest, _sure_of_wall(longest, settings))
    extent = float(np.hypot(*(thing.corners[:, None] - thing.corners).T).max())  # whichever way it is turned
    if SMALLEST * settings.robot <= extent <= LARGEST * np.sqrt(2) * settings.robot:
        return Element("robot", x, y, settings.robot, _supported(thing.points))
    return None


def _sure_of_wall(length: float, settings: Settings) -> float:
    return min(1.0, length / (2 * settings.border))


def _wall(side: np.ndarray, settings: Settings) -> Element:
    (ax, ay), (bx, by) = side.tolist()
    length = float(np.hypot(bx - ax, by - ay))
    heading = float(np.arctan2(by - ay, bx - ax))
    return Element("border", (ax + bx) / 2, (ay + by) / 2, length, _sure_of_wall(length, settings), heading)


def _walls(polygon: Polygon, settings: Settings) -> list[Element]:
    """Every edge that is longer than anything on a robot."""
    return [wall for side in _sides(polygon) if (wall := _wall(side, settings)).size > LARGEST * settings.robot]


def _piece_of(walls: list[Element], polygon: Polygon, settings: Settings) -> list[Element]:
    """The polygon as a border, if all of it lies in line with one of the walls."""
    for wall in walls:
        x, y = polygon.corners.T
        off = np.cos(wall.heading) * (y - wall.y) - np.sin(wall.heading) * (x - wall.x)
        if np.abs(off).max() <= settings.gap:
            return [_wall(polygon.corners[[0, -1]], settings)]
    return []


def _robot(polygon: Polygon, settings: Settings) -> list[Element]:
    """The centre lies half a side to the right of every edge, and, less surely, beside its middle: weighted least squares."""
    sides = _sides(polygon)
    along = sides[:, 1] - sides[:, 0]
    length = np.hypot(*along.T)
    sides, along, length = sides[length > 0], along[length > 0], length[length > 0]
    if not len(length) or not SMALLEST <= length.max() / settings.robot <= LARGEST:
        return []
    u = along / length[:, None]
    right = np.stack([u[:, 1], -u[:, 0]], axis=1)
    middle = sides.mean(axis=1)
    rows = np.concatenate([right, ALONG * u]) * np.tile(length, 2)[:, None]
    known = np.concatenate([(right * middle).sum(axis=1) + settings.robot / 2, ALONG * (u * middle).sum(axis=1)])
    x, y = np.linalg.lstsq(rows, known * np.tile(length, 2), rcond=None)[0].tolist()
    shown = min(1.0, float(length.max()) / settings.robot)
    side = u[int(length.argmax())]
    heading = float(np.arctan2(side[1], side[0]))
    return [Element("robot", x, y, settings.robot, _supported(polygon.points) * shown, heading)]
