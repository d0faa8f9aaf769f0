"""Lines over a number, with the published points where there are any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.panel import Panel
from labkit.figures.style import PUBLISHED, Spec


@dataclass(frozen=True)
class Curve:
    """A line through points; `dash` as plotly has it; `mark`: index of a point to be emphasised, where the sliders stand."""

    name: str
    x: Sequence[Any]
    y: Sequence[float | None]
    colour: str
    dash: str = "solid"
    mark: int | None = None


def curves(
    lines: Sequence[Curve], x: Spec, y: Spec, points: Sequence[tuple[float, float]] = (), legend: bool = True, **more: Any
) -> Panel:
    """Lines on the axes `x` and `y`; `points` are published ones. `more` are other attributes of the `Panel`."""
    drawn: list[Spec] = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "x": list(line.x),
            "y": list(line.y),
            "name": line.name,
            "showlegend": legend,
            "line": {"color": line.colour, "width": 3, "dash": line.dash},
            "marker": {"size": [15 if i == line.mark else 7 for i in range(len(line.x))], "color": line.colour, "opacity": 1},
            "hovertemplate": f"{line.name}: %{{y:.4g}} at %{{x}}<extra></extra>",
        }
        for line in lines
    ]
    if points:
        drawn.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [p[0] for p in points],
                "y": [p[1] for p in points],
                "marker": PUBLISHED,
                "showlegend": False,
                "hovertemplate": "measured: %{y:.4g}<extra></extra>",
            }
        )
    return Panel(drawn, y, x, **more)
