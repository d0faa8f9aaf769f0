"""The chain as a whole: points, contours, objects, elements, every stage within the time it is given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

from labkit.fusion.laser.arcs import search_arcs
from labkit.fusion.laser.edges import extract_edges
from labkit.fusion.laser.elements import element_filter
from labkit.fusion.laser.formats import NO_ARCS, NO_EDGES, Contours, Elements, Objects, Points
from labkit.fusion.laser.objects import object_filter
from labkit.fusion.laser.settings import Settings

T = TypeVar("T")


def within(steps: Iterator[tuple[int, T]], budget_ns: int | None = None) -> T | None:
    """What an anytime stage has when `budget_ns` of its time are used up: the last result that was ready by then, None if there
    was none. Without a budget, its last.
    """
    best, used = None, 0
    for cost, result in steps:
        used += cost
        if budget_ns is not None and used > budget_ns:
            break
        best = result
    return best


def contour_filter(
    points: Points, settings: Settings | None = None, edges_ns: int | None = None, arcs_ns: int | None = None
) -> Contours:
    """Both halves of the contour filter, each aborted when its time is used up."""
    edges = within(extract_edges(points, settings), edges_ns)
    arcs = within(search_arcs(points, settings), arcs_ns)
    return Contours(points.station, points.time_ns, edges or NO_EDGES, arcs or NO_ARCS)


@dataclass(frozen=True, eq=False)
class Chain:
    """What every stage has made of one set of points."""

    points: Points
    contours: Contours
    objects: Objects
    elements: Elements


def run_chain(points: Points, settings: Settings | None = None, edges_ns: int | None = None, arcs_ns: int | None = None) -> Chain:
    """All stages; only the contour filter, by far the longest, may be aborted."""
    return from_contours(points, contour_filter(points, settings, edges_ns, arcs_ns), settings)


def from_contours(points: Points, contours: Contours, settings: Settings | None = None) -> Chain:
    """The later stages, which need the points no more; they are only kept with the rest."""
    objects = within(object_filter(contours, settings))
    assert objects is not None, "an anytime stage has at least one result"
    elements = within(element_filter(objects, settings))
    assert elements is not None
    return Chain(points, contours, objects, elements)
