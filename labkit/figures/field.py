"""A field seen from above: what is there, where the beams ended, and what the stages of the laser chain make of it.

One picture language for all of them: what is there is a dotted grey line, points are dots, what is straight and what is round are
lines of their own, a scanner is a triangle. Lengths in m; lines of one kind are one trace, with gaps between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from labkit.figures.outline import SPOT, outline
from labkit.figures.panel import Panel
from labkit.figures.style import FONT, GREY, INK, Spec, axis, key
from labkit.fusion import Arcs, Edges, Element, Objects, World

CORNERS = 37  # of the line that draws a whole circle

Lines = list[np.ndarray]  # each of shape (k, 2)


def outlines(world: World, time_ns: int, without: Sequence[str] = ()) -> Lines:
    """Every body of the world at that time."""
    return [body.outline(time_ns)[:: 2 if body.radius else 1] for body in world.bodies if body.name not in without]


def circle(x: float, y: float, radius: float, first: float = 0.0, last: float = 2 * np.pi) -> np.ndarray:
    """A circle or the arc of one from one angle to another."""
    angle = np.linspace(first, last, max(3, round(CORNERS * (last - first) / (2 * np.pi))))
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)


def edge_lines(edges: Edges) -> Lines:
    """Every edge."""
    return list(edges.ends)


def arc_lines(arcs: Arcs) -> Lines:
    """Every arc, as far as it was seen."""
    found = zip(arcs.centres.tolist(), arcs.radii.tolist(), arcs.first.tolist(), arcs.last.tolist(), strict=True)
    return [circle(x, y, radius, first, last) for (x, y), radius, first, last in found]


def polygon_lines(objects: Objects) -> Lines:
    """Every polygon, the closed ones closed."""
    return [np.concatenate([p.corners, p.corners[:1]]) if p.closed else p.corners for p in objects.polygons]


def disc_lines(objects: Objects) -> Lines:
    """Every disc as a whole circle."""
    return [circle(disc.x, disc.y, disc.radius) for disc in objects.discs]


def element_lines(elements: Iterable[Element]) -> Lines:
    """Borders as lines, balls as circles, robots as squares."""
    made = []
    for e in elements:
        dx, dy = np.cos(e.heading) * e.size / 2, np.sin(e.heading) * e.size / 2
        match e.kind:
            case "border":
                around = np.array([(-dx, -dy), (dx, dy)])
            case "robot":
                around = np.array(
                    [(dx + dy, dy - dx), (dx - dy, dy + dx), (-dx - dy, dx - dy), (dy - dx, -dx - dy), (dx + dy, dy - dx)]
                )
            case "ball":
                around = circle(0, 0, e.size / 2)
        made.append(around + np.array([e.x, e.y]))
    return made


def enlarged(lines: Lines, x: float, y: float) -> Lines:
    """The same in cm from the point (x, y), to look at something closely."""
    return [100 * (line - np.array([x, y])) for line in lines]


def drawn(name: str, lines: Lines, colour: str, width: int = 4, dash: str = "solid", **more: Any) -> Spec:
    """Lines as one trace; `more` are other attributes of plotly's."""
    gap = np.full((1, 2), np.nan)
    x, y = np.concatenate([piece for line in lines for piece in (line, gap)] or [gap]).T
    line = {"color": colour, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": line, "hoverinfo": "skip"} | more


def there(lines: Lines, legend: bool = True) -> Spec:
    """What is there."""
    return drawn("what is there", lines, GREY, 2, "dot", showlegend=legend)


def dots(name: str, xy: np.ndarray, colour: str, size: int = 5, **more: Any) -> Spec:
    """Points (n, 2) as one trace."""
    mark = {"color": colour, "size": size, "line": {"width": 0}}
    shown = f"{name}: %{{x:.3f}} m, %{{y:.3f}} m<extra></extra>"
    return {"type": "scatter", "mode": "markers", "x": xy[:, 0], "y": xy[:, 1], "name": name, "marker": mark} | {
        "hovertemplate": shown,
        **more,
    }


def spots(name: str, xy: np.ndarray, colour: str, size: float) -> Spec:
    """Hundreds of points (n, 2) as one trace, each a spot of `size` in the unit of the axes. See `spot_key`."""
    x, y, _ = outline(SPOT, xy[:, 0], xy[:, 1], size / 2, size / 2)
    made = {"type": "scatter", "mode": "none", "fill": "toself", "fillcolor": colour, "x": x, "y": y, "name": name}
    return made | {"showlegend": False, "hoverinfo": "skip"}


def spot_key(name: str, colour: str) -> Spec:
    """The entry of the legend for spots."""
    return key(name, type="scatter", mode="markers", marker={"color": colour, "size": 8})


def scanners(names: Sequence[str], places: Sequence[tuple[float, float]], colours: Sequence[str]) -> Spec:
    """A triangle and the name of each scanner."""
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": [x for x, _ in places],
        "y": [y for _, y in places],
        "text": [f"<b>{name}</b>" for name in names],
        "textposition": "bottom center",
        "textfont": {"size": FONT, "color": INK},
        "marker": {"symbol": "triangle-up", "size": 16, "color": list(colours), "line": {"color": "white", "width": 1.5}},
        "showlegend": False,
        "hoverinfo": "skip",
    }


def from_above(
    traces: Sequence[Spec], x: tuple[float, float], y: tuple[float, float], place: int = 1, unit: str = "m", **more: Any
) -> Panel:
    """A panel that shows x[0] to x[1] and y[0] to y[1], at one scale.

    Args:
        place: which panel of the picture it is, counted from 1: its axes are tied to each other by their names.
        unit: of both axes.
        more: other attributes of the `Panel`.
    """
    across = axis(f"x [{unit}]", range=list(x), constrain="domain")
    up = axis(f"y [{unit}]", range=list(y), constrain="domain", scaleanchor="x" if place == 1 else f"x{place}")
    return Panel(list(traces), up, across, **{"left": 64, **more})
