"""One chain, four places to fuse: of points, of contours, of objects, of elements.

Every station takes its points up to the level of the fusion, sends them, fuses what has come from all, takes the result up to
elements, and there makes one of elements of one kind at one place, since two stations that see opposite sides of a robot have no
contour in common. These are the chains of the diploma thesis, section 6.2; the one with the object level is ours. What a level
costs is counted in bytes on the radio and in modelled time (`Settings`, `VISIT_NS`); what it is worth, `judged` says.

Bytes are those of a compact format, whatever the header that all levels share: lengths as 16-bit millimetres, angles as 16 bits,
counts of points and confidences as one byte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from labkit.fusion.joining import fuse_elements, fuse_points
from labkit.fusion.judging import ospa, rmse
from labkit.fusion.laser.arcs import search_arcs
from labkit.fusion.laser.chain import within
from labkit.fusion.laser.edges import extract_edges
from labkit.fusion.laser.elements import element_filter
from labkit.fusion.laser.formats import NO_ARCS, NO_EDGES, Contours, Element, Elements, Objects, Points
from labkit.fusion.laser.objects import object_filter
from labkit.fusion.laser.quality import seen_bodies
from labkit.fusion.laser.settings import Settings
from labkit.fusion.laser.world import World
from labkit.fusion.levels_contours import fuse_contours
from labkit.fusion.levels_objects import fuse_objects

T = TypeVar("T")
Level = Literal["points", "contours", "objects", "elements"]
Stage = Literal["edges", "arcs", "objects", "elements", "fusion"]
LEVELS: tuple[Level, ...] = ("points", "contours", "objects", "elements")

#: Bytes of one beam's distance, an edge (two ends), an arc (centre, radius, two angles), an object's corner and disc (centre and
#: radius), an element (centre, size, direction), and of what each piece has beside: points or confidence, and a kind.
BEAM, EDGE, ARC, CORNER, DISC, ELEMENT = 2, 8, 10, 4, 6, 8
COUNT, KIND = 1, 1
CUTOFF = 0.50  # m from which on a thing and what is taken for it have nothing to do with each other
KINDS = ("ball", "robot")
FAR = 1e6  # m between the places of one kind and those of another: no pair is made of a ball and a robot


@dataclass(frozen=True, eq=False)
class Fusion:
    """What came of a fusion at one level.

    Attributes:
        sent: what each station sends, in the format of the level. fused: the same format, of all.
        elements: the picture of the world at the end of the chain.
        sent_bytes: of each station. before_ns: time of each station before it sends. fusion_ns, after_ns: of every station.
    """

    level: Level
    sent: tuple[Any, ...]
    fused: Points | Contours | Objects | Elements
    elements: Elements
    sent_bytes: tuple[int, ...]
    before_ns: tuple[int, ...]
    fusion_ns: int
    after_ns: int

    @property
    def station_ns(self) -> int:
        """Time that the busiest station works for one picture."""
        return max(self.before_ns) + self.fusion_ns + self.after_ns


def fuse_at(
    level: Level, stations: Sequence[Points], settings: Settings | None = None, budget_ns: Mapping[Stage, int] | None = None
) -> Fusion:
    """The whole chain of all stations with the fusion at that level.

    Args:
        stations: what each has measured.
        budget_ns: when a stage is aborted; it runs to its end where nothing is said. A stage that has nothing by then hands on
            nothing, a fusion the data of the first station; what a fusion has not yet joined by then it hands on as it came.
    Raises:
        ValueError: there is no such level, or no station.
    """
    if level not in LEVELS:
        raise ValueError(f"there is no fusion at the level {level!r}; there are {', '.join(LEVELS)}")
    return fuse_levels(stations, settings, budget_ns, (level,))[level]


def fuse_levels(
    stations: Sequence[Points],
    settings: Settings | None = None,
    budget_ns: Mapping[Stage, int] | None = None,
    levels: Sequence[Level] = LEVELS,
) -> dict[Level, Fusion]:
    """`fuse_at` for several levels; what the stations do before they send is computed once. Raises ValueError as it does."""
    if not stations:
        raise ValueError("the data of no station are to be fused; at least one is needed")
    settings, budgets = settings or Settings(), budget_ns or {}
    own: list[tuple[int, Any]] = [(0, points) for points in stations]
    made: dict[Level, Fusion] = {}
    for at, level in enumerate(LEVELS):
        if at:
            climbed = [_climb(data, LEVELS[at : at + 1], settings, budgets) for _, data in own]
            own = [(before + cost, data) for (before, _), (cost, data) in zip(own, climbed, strict=True)]
        if level in levels:
            made[level] = _fused(level, own, settings, budgets)
        if len(made) == len(levels):
            break
    return made


def _fused(level: Level, own: Sequence[tuple[int, Any]], settings: Settings, budgets: Mapping[Stage, int]) -> Fusion:
    """Fuse the stations' data, each with the time it has taken, and take the result up to elements."""
    sent = tuple(data for _, data in own)
    fusions: dict[Level, Callable[[], Iterator[tuple[int, Any]]]] = {
        "points": lambda: fuse_points(sent),
        "contours": lambda: fuse_contours(sent, settings),
        "objects": lambda: fuse_objects(sent, settings),
        "elements": lambda: fuse_elements(sent, settings),
    }
    fusion_ns, fused = _timed(fusions[level](), budgets.get("fusion"), sent[0])
    after_ns, elements = _climb(fused, LEVELS[LEVELS.index(level) + 1 :], settings, budgets)
    if level != "elements":
        one_by_one = [replace(elements, elements=(element,)) for element in elements.elements] or [elements]
        cost, last = _timed(fuse_elements(one_by_one, settings), budgets.get("fusion"), elements)
        after_ns, elements = after_ns + cost, replace(elements, elements=last.elements)
    before_ns = tuple(cost for cost, _ in own)
    return Fusion(level, sent, fused, elements, tuple(map(sent_bytes, sent)), before_ns, fusion_ns, after_ns)


def _climb(data: Any, formats: Sequence[Level], settings: Settings, budgets: Mapping[Stage, int]) -> tuple[int, Any]:
    """Take data through the formats: the time that takes, and the last of them."""
    spent = 0
    for name in formats:
        station, time_ns = data.station, data.time_ns
        match name:
            case "contours":
                edges_ns, edges = _timed(extract_edges(data, settings), budgets.get("edges"), NO_EDGES)
                arcs_ns, arcs = _timed(search_arcs(data, settings), budgets.get("arcs"), NO_ARCS)
                cost, data = edges_ns + arcs_ns, Contours(station, time_ns, edges, arcs)
            case "objects":
                nothing = Objects(station, time_ns, (), ())
                cost, data = _timed(object_filter(data, settings), budgets.get("objects"), nothing)
            case _:
                unknown = Elements(station, time_ns, ())
                cost, data = _timed(element_filter(data, settings), budgets.get("elements"), unknown)
        spent += cost
    return spent, data


def _timed(steps: Iterator[tuple[int, T]], budget_ns: int | None, nothing: T) -> tuple[int, T]:
    """The time an anytime stage takes, at most its budget, and its result, `nothing` if there is none by then."""
    costs: list[int] = []

    def noted() -> Iterator[tuple[int, T]]:
        for cost, result in steps:
            costs.append(cost)
            yield cost, result

    found = within(noted(), budget_ns)
    spent = sum(costs)
    return spent if budget_ns is None else min(spent, budget_ns), nothing if found is None else found


def sent_bytes(data: Points | Contours | Objects | Elements) -> int:
    """Bytes of one station's data in the compact format of the module; of points, 2 for each beam that came back."""
    match data:
        case Points():
            return BEAM * len(data.xy)
        case Contours():
            return (EDGE + COUNT) * len(data.edges) + (ARC + COUNT) * len(data.arcs)
        case Objects():
            corners = sum(len(polygon.corners) for polygon in data.polygons)
            return CORNER * corners + (KIND + COUNT) * len(data.polygons) + (DISC + COUNT) * len(data.discs)
        case Elements():
            return (ELEMENT + KIND + COUNT) * len(data.elements)


@dataclass(frozen=True)
class Judged:
    """A picture of the world against the world, balls and robots; the border is left out.

    Attributes:
        ospa: OSPA distance in m, cut off at `CUTOFF`: errors of place, ghosts and missed things in one number.
        ghosts: elements with nothing there. missed: names of things that somebody has seen, but are not in the picture.
        things: how many somebody has seen.
        error: root mean square distance in m of the others to what they are, nan if there are none.
    """

    ospa: float
    ghosts: tuple[Element, ...]
    missed: tuple[str, ...]
    things: int
    error: float

    @property
    def completeness(self) -> float:
        """Share of the things that are in the picture; 1 if there is nothing to see."""
        return 1 - len(self.missed) / self.things if self.things else 1.0


def judged(world: World, stations: Sequence[Points], elements: Elements) -> Judged:
    """How good a fused picture is, at its own time; what at least one station has seen should be in it.

    Things and elements of one kind are taken as pairs so that the sum of the squared distances, cut off, is least (as in OSPA).
    """
    from scipy.optimize import linear_sum_assignment

    seen = {body.name for points in stations for body in seen_bodies(world, points)}
    bodies = [body for body in world.bodies if body.name in seen and body.kind in KINDS]
    known = [element for element in elements.elements if element.kind in KINDS]
    true = _places([(body.kind, *body.motion.at(elements.time_ns)[:2].tolist()) for body in bodies])
    found = _places([(element.kind, element.x, element.y) for element in known])
    apart = np.abs(found[:, None] - true)
    rows, columns = linear_sum_assignment(np.minimum(apart, CUTOFF) ** 2)
    near = apart[rows, columns] < CUTOFF
    ghosts = tuple(known[i] for i in sorted({*range(len(known))} - {*rows[near].tolist()}))
    missed = tuple(bodies[k].name for k in sorted({*range(len(bodies))} - {*columns[near].tolist()}))
    error = rmse(apart[rows, columns][near]) if near.any() else float("nan")
    return Judged(ospa(found, true, CUTOFF), ghosts, missed, len(bodies), error)


def _places(things: Sequence[tuple[str, float, float]]) -> np.ndarray:
    """Places of balls and robots as complex numbers, each kind in a plane of its own."""
    return np.array([x + 1j * y + FAR * KINDS.index(kind) for kind, x, y in things], dtype=complex)
