"""A bar per row beside those of another panel, with its number at its end, under its bound where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from labkit.figures.panel import Panel
from labkit.figures.style import BOUND, FONT, INK, Spec, rows_axis


def lengths(
    values: Sequence[float | None], bounds: Sequence[float] | None, colour: str, x: Spec, unit: str, **more: Any
) -> Panel:
    """Horizontal bars over the axis `x`, which has a range; the rows have no names, as they stand beside others.

    A value beyond the axis is cut there and still told at its end; None is told as a dash. `bounds` are wide pale bars behind.
    `more` are other attributes of the `Panel`.
    """
    at = [-i for i in range(len(values))]
    most = x["range"][1]
    shown = [min(value or 0, most) for value in values]
    ends = [max(pair) for pair in zip(shown, bounds or shown, strict=True)]
    words = ["–" if value is None else f"{value:.3g} {unit}" if value < 1000 else f"{value:.0f} {unit}" for value in values]
    drawn = [
        _bars(list(bounds or [0] * len(at)), at, 0.72, BOUND, "bound", unit),
        _bars(shown, at, 0.4, {"color": colour}, "here", unit),
        {
            "type": "scatter",
            "mode": "text",
            "x": [min(end, 0.74 * most) for end in ends],
            "y": at,
            "text": [f" {text}" for text in words],
            "textposition": "middle right",
            "textfont": {"size": FONT, "color": INK},
            "cliponaxis": False,
            "showlegend": False,
            "hoverinfo": "skip",
        },
    ]
    y = rows_axis([""] * len(at), margin=0.55)
    return Panel(drawn, {**y, "showticklabels": False, "ticks": ""}, x, **more)


def _bars(length: Sequence[float], at: Sequence[float], width: float, marker: Spec, words: str, unit: str) -> Spec:
    return {
        "type": "bar",
        "orientation": "h",
        "x": length,
        "y": at,
        "base": 0,  # never stacked, whatever the panels beside do
        "width": width,
        "marker": marker,
        "showlegend": False,
        "hovertemplate": f"{words} %{{x:.4g}} {unit}<extra></extra>",
    }
