"""A field with a border, a ball and robots that move, and what a ray hits in it.

Sizes: the ball's radius of 11 cm is that of a football; robots are squares of 50 cm, the most that RoboCup's middle-size league
allows. Everything is cut at one height, the ball through its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from labkit.fusion.laser.formats import Kind, Pose

BALL_RADIUS, ROBOT_SIDE = 0.11, 0.50  # m
SECOND = 1_000_000_000  # ns


class Motion(Protocol):
    """A way to move: poses (x, y, heading) of shape (..., 3) at times in ns of shape (...)."""

    def at(self, time_ns: Any) -> np.ndarray: ...


@dataclass(frozen=True)
class Straight:
    """From `start` at time 0 with a constant velocity in m/s; it looks ahead, and where it stands still as `start` says."""

    start: Pose
    vx: float = 0.0
    vy: float = 0.0

    def at(self, time_ns: Any) -> np.ndarray:
        s = np.asarray(time_ns) / SECOND
        heading = np.arctan2(self.vy, self.vx) if self.vx or self.vy else self.start.heading
        return np.stack([self.start.x + self.vx * s, self.start.y + self.vy * s, np.full_like(s, heading)], axis=-1)


@dataclass(frozen=True)
class Circle:
    """Around (x, y) with a speed in m/s, counterclockwise if it is positive, from the angle `phase` at time 0."""

    x: float
    y: float
    radius: float
    speed: float
    phase: float = 0.0

    def at(self, time_ns: Any) -> np.ndarray:
        angle = self.phase + self.speed / self.radius * np.asarray(time_ns) / SECOND
        ahead = angle + np.copysign(np.pi / 2, self.speed)
        return np.stack([self.x + self.radius * np.cos(angle), self.y + self.radius * np.sin(angle), ahead], axis=-1)


@dataclass(frozen=True)
class StopAndGo:
    """Like `Straight`, but after every `go_s` seconds it stands still for `stop_s`."""

    start: Pose
    vx: float
    vy: float
    go_s: float = 1.0
    stop_s: float = 1.0

    def at(self, time_ns: Any) -> np.ndarray:
        rounds, rest = np.divmod(np.asarray(time_ns) / SECOND, self.go_s + self.stop_s)
        moving = rounds * self.go_s + np.minimum(rest, self.go_s)
        return Straight(self.start, self.vx, self.vy).at(moving * SECOND)


@dataclass(frozen=True)
class Waypoints:
    """Along straight lines from point to point with one speed in m/s, then standing at the last. At least two points, no two in a
    row the same.
    """

    points: tuple[tuple[float, float], ...]
    speed: float

    def at(self, time_ns: Any) -> np.ndarray:
        way = np.asarray(self.points, dtype=float)
        steps = np.diff(way, axis=0)
        travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
        here = np.clip(self.speed * np.asarray(time_ns) / SECOND, 0, travelled[-1])
        leg = np.clip(np.searchsorted(travelled, here, side="right") - 1, 0, len(steps) - 1)
        x, y = (np.interp(here, travelled, way[:, axis]) for axis in (0, 1))
        return np.stack([x, y, np.arctan2(steps[leg, 1], steps[leg, 0])], axis=-1)


@dataclass(frozen=True)
class Body:
    """Something a ray can hit: a circle of `radius`, or, where that is 0, the closed polygon of `corners` around its origin."""

    name: str
    kind: Kind
    motion: Motion
    radius: float = 0.0
    corners: tuple[tuple[float, float], ...] = ()

    def outline(self, time_ns: int) -> np.ndarray:
        """Where its outline is at that time: points of a closed line, shape (k, 2)."""
        x, y, heading = self.motion.at(time_ns)
        if self.radius:
            angle = np.linspace(0, 2 * np.pi, 49)
            return np.stack([x + self.radius * np.cos(angle), y + self.radius * np.sin(angle)], axis=1)
        around = np.array([*self.corners, self.corners[0]])
        c, s = np.cos(heading), np.sin(heading)
        return around @ np.array([[c, s], [-s, c]]) + (x, y)

    def cast(self, origin: np.ndarray, angle: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
        """Distance along each ray to this body as it stands at the ray's own time, inf where the ray misses it."""
        x, y, heading = np.moveaxis(self.motion.at(time_ns), -1, 0)
        dx, dy = origin[:, 0] - x, origin[:, 1] - y
        c, s = np.cos(heading), np.sin(heading)
        ox, oy = c * dx + s * dy, c * dy - s * dx  # the ray in the body's own frame
        ux, uy = np.cos(angle - heading), np.sin(angle - heading)
        if self.radius:
            return _to_circle(ox, oy, ux, uy, self.radius)
        return _to_polygon(ox, oy, ux, uy, np.asarray(self.corners))


def _to_circle(ox: np.ndarray, oy: np.ndarray, ux: np.ndarray, uy: np.ndarray, radius: float) -> np.ndarray:
    """Solve |o + t u| = radius for the smallest t > 0."""
    ahead = -(ox * ux + oy * uy)
    room = radius**2 - (ox * uy - oy * ux) ** 2
    half = np.sqrt(np.maximum(room, 0))
    near, far = ahead - half, ahead + half
    hit = np.where(near > 0, near, far)
    return np.where((room >= 0) & (hit > 0), hit, np.inf)


def _to_polygon(ox: np.ndarray, oy: np.ndarray, ux: np.ndarray, uy: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Solve o + t u = a + w e for every side from a along e; the smallest t > 0 with w between 0 and 1."""
    ax, ay = corners.T
    ex, ey = np.roll(corners, -1, axis=0).T - corners.T
    rx, ry = ax - ox[:, None], ay - oy[:, None]
    ux, uy = ux[:, None], uy[:, None]
    cross = ux * ey - uy * ex
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a side misses it
        t, w = (rx * ey - ry * ex) / cross, (rx * uy - ry * ux) / cross
        return np.where((t > 0) & (w >= 0) & (w <= 1), t, np.inf).min(axis=1)


def ball(motion: Motion, name: str = "ball") -> Body:
    """A ball of 11 cm radius."""
    return Body(name, "ball", motion, BALL_RADIUS)


def robot(name: str, motion: Motion) -> Body:
    """A square robot, its origin in the middle."""
    half = ROBOT_SIDE / 2
    return Body(name, "robot", motion, corners=((-half, -half), (half, -half), (half, half), (-half, half)))


def border(length: float, width: float) -> Body:
    """The border of a field, from (0, 0) to (length, width)."""
    return Body("border", "border", Straight(Pose(0.0, 0.0)), corners=((0, 0), (length, 0), (length, width), (0, width)))


@dataclass(frozen=True)
class World:
    """Bodies with different names. A scanner stands in the middle of one of them and does not see that one."""

    bodies: tuple[Body, ...]

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        if len(set(names)) < len(names):
            raise ValueError(f"the bodies of a world are called {', '.join(names)}; each needs a name of its own")

    def index(self, name: str) -> int:
        """Place of the body of that name; ValueError lists those there are."""
        names = [body.name for body in self.bodies]
        if name not in names:
            raise ValueError(f"the world has no body {name!r}; it has {', '.join(names) or 'none'}")
        return names.index(name)

    def cast(
        self, origin: np.ndarray, angle: np.ndarray, time_ns: np.ndarray, without: int = -1
    ) -> tuple[np.ndarray, np.ndarray]:
        """What rays hit first: distances (n,), inf for nothing, and the index of the body (n,), -1 for none.

        Args:
            origin, angle, time_ns: of the rays, shapes (n, 2), (n,) and (n,). Each meets the world of its own instant.
            without: index of a body that is not there.
        """
        nearest, seen = np.full(len(angle), np.inf), np.full(len(angle), -1)
        for i, body in enumerate(self.bodies):
            if i != without:
                distance = body.cast(origin, angle, time_ns)
                closer = distance < nearest
                nearest[closer], seen[closer] = distance[closer], i
        return nearest, seen


def field(length: float, width: float, others: Sequence[Body]) -> World:
    """A bordered field with a ball, robots, or whatever else."""
    return World((border(length, width), *others))
