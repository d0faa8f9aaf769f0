"""The formats of the chain: scan, points, contours, objects, elements. Every stage takes one and makes the next.

All lengths are in metres in the frame of the field, angles in radians counted from its x axis, times in whole nanoseconds of
the global clock. Every record has the time at which its data were measured and the name of the station, or of several, "A+B".

What is measured from one place keeps the order of the scan, which is counterclockwise as seen from the scanner. Hence an edge
runs with the free space on its left and what it belongs to on its right; later stages rely on it and need to know no viewpoint.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

Kind = Literal["border", "ball", "robot"]


class Pose(NamedTuple):
    """Where something is and where it looks: m, m, rad."""

    x: float
    y: float
    heading: float = 0.0


@dataclass(frozen=True, eq=False)
class Scan:
    """What a scanner hands over.

    Attributes:
        angles: of the beams, relative to the heading, ascending; shape (n,).
        ranges: distances in m, inf where nothing came back; shape (n,).
        beam_ns: when each beam was measured; shape (n,).
        seen: which body of the world each beam hit, -1 for none or not known: for judging only, no stage reads it.
        ready_ns: when the last byte has come over the link.
    """

    station: str
    time_ns: int
    pose: Pose
    angles: np.ndarray
    ranges: np.ndarray
    beam_ns: np.ndarray
    seen: np.ndarray
    ready_ns: int


@dataclass(frozen=True, eq=False)
class Points:
    """Where the beams ended, without those that did not come back.

    Attributes:
        xy: shape (n, 2), in the order of the scan; of several stations one after the other.
        origin: index into `viewpoints` for each point: who measured it; shape (n,).
        viewpoints: where the scanners stood; shape (stations, 2).
        step: angle in rad between neighbouring beams.
        seen: as in `Scan`.
    """

    station: str
    time_ns: int
    xy: np.ndarray
    origin: np.ndarray
    viewpoints: np.ndarray
    step: float
    seen: np.ndarray


@dataclass(frozen=True, eq=False)
class Edges:
    """Straight pieces: `ends` of shape (k, 2, 2) is [edge, first or second end, x or y]; `points` how many support each, (k,)."""

    ends: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @property
    def lengths(self) -> np.ndarray:
        """Length of each in m."""
        return np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)


@dataclass(frozen=True, eq=False)
class Arcs:
    """Round pieces: `centres` (m, 2), `radii` (m,), `first` and `last` angle as seen from the centre (m,), counterclockwise from
    first to last, and how many `points` support each (m,).
    """

    centres: np.ndarray
    radii: np.ndarray
    first: np.ndarray
    last: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


NO_EDGES = Edges(np.empty((0, 2, 2)), np.empty(0, np.int64))
NO_ARCS = Arcs(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int64))


@dataclass(frozen=True, eq=False)
class Contours:
    """Edges and arcs, made by two parts that know nothing of each other: the same points may be in both."""

    station: str
    time_ns: int
    edges: Edges
    arcs: Arcs


@dataclass(frozen=True, eq=False)
class Polygon:
    """Edges that follow each other: `corners` of shape (k, 2); `closed` if the last is joined to the first."""

    corners: np.ndarray
    closed: bool
    points: int


@dataclass(frozen=True)
class Disc:
    """A circular object; `points` is how many support it."""

    x: float
    y: float
    radius: float
    points: int


@dataclass(frozen=True, eq=False)
class Objects:
    """Polygons and discs: every contour belongs to one of them."""

    station: str
    time_ns: int
    polygons: tuple[Polygon, ...]
    discs: tuple[Disc, ...]


@dataclass(frozen=True)
class Element:
    """Something known: where its centre is, its size in m (a diameter, the side of a robot, the length of a border) and how sure
    the filter is, from 0 to 1. `heading` is the direction of a border's wall or of a robot's side.
    """

    kind: Kind
    x: float
    y: float
    size: float
    confidence: float
    heading: float = 0.0


@dataclass(frozen=True)
class Elements:
    """The picture of the world: the end of the chain."""

    station: str
    time_ns: int
    elements: tuple[Element, ...]

    def of(self, kind: Kind) -> tuple[Element, ...]:
        """Those of one kind."""
        return tuple(element for element in self.elements if element.kind == kind)
