"""Fusion of what several stations see: of points, as if one scanner had seen them, and of elements of one kind at one place.

Both are anytime, as the stages of the chain; the first result is what is there without any fusion. Both take the data as they
are: nothing here asks whether they were measured at the same time, and if not, one ball becomes two (source 2, figure 42).
Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.5.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from labkit.fusion.laser.formats import Element, Elements, Points
from labkit.fusion.laser.settings import VISIT_NS, Settings

PARALLEL = np.deg2rad(10.0)  # walls that differ by more are two


def fuse_points(stations: Sequence[Points]) -> Iterator[tuple[int, Points]]:
    """Anytime: the points of the first station, then of the first two, and so on. Their time is the mean of the stations'.

    Raises:
        ValueError: there is no station.
    """
    if not stations:
        raise ValueError("points of no station are to be fused; at least one is needed")
    for count in range(1, len(stations) + 1):
        some = stations[:count]
        first = np.cumsum([0, *(len(points.viewpoints) for points in some)])
        yield (
            max(1, len(some[-1].xy)) * VISIT_NS,
            Points(
                "+".join(points.station for points in some),
                _mean_time([points.time_ns for points in some]),
                np.concatenate([points.xy for points in some]),
                np.concatenate([points.origin + before for points, before in zip(some, first[:-1], strict=True)]),
                np.concatenate([points.viewpoints for points in some]),
                min(points.step for points in some),
                np.concatenate([points.seen for points in some]),
            ),
        )


def _mean_time(times: Sequence[int]) -> int:
    return sum(times) // len(times)


def fuse_elements(stations: Sequence[Elements], settings: Settings | None = None) -> Iterator[tuple[int, Elements]]:
    """Anytime: all elements of all stations; then, the nearest first, two of one kind and of different stations become one, with
    positions weighted by confidence. Walls are one if they lie in one line and overlap.

    Raises:
        ValueError: there is no station.
    """
    if not stations:
        raise ValueError("elements of no station are to be fused; at least one is needed")
    settings = settings or Settings()
    name, time_ns = "+".join(one.station for one in stations), _mean_time([one.time_ns for one in stations])
    parts = dict(enumerate((element, {i}) for i, one in enumerate(stations) for element in one.elements))

    def near(i: int) -> list[tuple[float, int, int]]:
        """The parts that are the same thing as part i, if any: (distance, the later of both, the earlier)."""
        a, of_a = parts[i]
        others = ((k, b) for k, (b, of_b) in parts.items() if a.kind == b.kind and not of_a & of_b)
        return [(apart, max(i, k), min(i, k)) for k, b in others if (apart := _apart(a, b)) <= settings.merge]

    yield max(1, len(parts)) * VISIT_NS, Elements(name, time_ns, tuple(element for element, _ in parts.values()))
    pairs = {pair for i in parts for pair in near(i)}
    visits = len(parts) ** 2
    while pairs:
        _, i, k = min(pairs)
        (b, of_b), (a, of_a) = parts.pop(i), parts[k]
        parts[k] = _one_of(a, b), of_a | of_b
        pairs = {pair for pair in pairs if not {i, k} & set(pair[1:])} | set(near(k))
        yield visits * VISIT_NS, Elements(name, time_ns, tuple(element for element, _ in parts.values()))
        visits = len(parts)  # only the distances of the new one are to be found


def _apart(a: Element, b: Element) -> float:
    """Distance in m between two elements of one kind; of walls, from one line to the other, inf if they do not overlap."""
    if a.kind != "border":
        return float(np.hypot(a.x - b.x, a.y - b.y))
    turned = (a.heading - b.heading + np.pi / 2) % np.pi - np.pi / 2
    c, s = np.cos(a.heading), np.sin(a.heading)
    along, beside = c * (b.x - a.x) + s * (b.y - a.y), c * (b.y - a.y) - s * (b.x - a.x)
    overlap = abs(turned) <= PARALLEL and abs(along) <= (a.size + b.size) / 2
    return float(abs(beside)) if overlap else np.inf


def _one_of(a: Element, b: Element) -> Element:
    """Two elements as one: as sure as that not both are wrong."""
    total = a.confidence + b.confidence
    w = b.confidence / total if total else 0.5
    sure = 1 - (1 - a.confidence) * (1 - b.confidence)
    if a.kind != "border":
        surer = a if a.confidence >= b.confidence else b
        return replace(surer, x=a.x + w * (b.x - a.x), y=a.y + w * (b.y - a.y), confidence=sure)
    c, s = np.cos(a.heading), np.sin(a.heading)
    along, beside = c * (b.x - a.x) + s * (b.y - a.y), w * (c * (b.y - a.y) - s * (b.x - a.x))
    low, high = min(-a.size / 2, along - b.size / 2), max(a.size / 2, along + b.size / 2)
    middle = (low + high) / 2
    x, y = a.x + middle * c - beside * s, a.y + middle * s + beside * c
    return replace(a, x=float(x), y=float(y), size=high - low, confidence=sure)
