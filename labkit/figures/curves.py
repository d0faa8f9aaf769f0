"""Lines over a number: one or several panels side by side, with the published points where there are any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.style import PUBLISHED, axis


@dataclass(frozen=True)
class Curve:
    """A line through points; `dash` as plotly has it; `mark` is the index of the point to be emphasised, where the sliders stand."""

    name: str
    x: Sequence[Any]
    y: Sequence[float]
    colour: str
    dash: str = "solid"
    mark: int | None = None


def curves(
    lines: Sequence[Curve],
    x_title: str,
    y_title: str,
    domain: tuple[float, float] = (0, 1),
    suffix: str = "",
    *,
    points: Sequence[tuple[float, float]] = (),
    y_range: tuple[float, float] | None = None,
    legend: bool = True,
    **x_axis: Any,
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Traces and axes of one panel on the axes `x{suffix}`, `y{suffix}`; `points` are published ones. `x_axis` goes to the axis as it is."""
    where = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
    data: list[dict[str, Any]] = []
    for line in lines:
        data.append(
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
                **where,
            }
        )
    if points:
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [p[0] for p in points],
                "y": [p[1] for p in points],
                "marker": PUBLISHED,
                "name": "measured (source 1)",
                "showlegend": False,
                "hovertemplate": "measured: %{y:.4g}<extra></extra>",
                **where,
            }
        )
    return data, {
        f"xaxis{suffix}": axis(x_title, domain=list(domain), anchor=f"y{suffix}", **x_axis),
        f"yaxis{suffix}": axis(
            y_title, anchor=f"x{suffix}", **({"rangemode": "tozero"} if y_range is None else {"range": list(y_range)})
        ),
    }
