"""What analysis promises beside what happened: responses under their bounds, run times against the time reserved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.style import BLUE, GREEN, GREY, INK, LEGEND, ORANGE, PALE, VERMILION, axis, layout


@dataclass(frozen=True)
class Response:
    """A task's bound, longest simulated response and deadline, in ms; None where there is no bound."""

    name: str
    bound: float | None
    longest: float
    deadline: float


def responses(rows: Sequence[Response], height: int = 430) -> dict[str, Any]:
    """A row per task: the bound as a wide pale bar, the simulation as a narrow one inside it, the deadline as a line."""
    at = list(range(len(rows)))[::-1]
    bounds = [0 if r.bound is None else r.bound for r in rows]
    over = [r.longest > r.deadline for r in rows]
    most = max(max(r.longest, r.deadline, b) for r, b in zip(rows, bounds, strict=True))
    data: list[dict[str, Any]] = [
        {
            "type": "bar",
            "orientation": "h",
            "x": bounds,
            "y": at,
            "width": 0.72,
            "name": "bound by analysis",
            "marker": {"color": PALE, "line": {"color": GREY, "width": 1.5}},
            "hovertemplate": "bound %{x:.2f} ms<extra></extra>",
        },
        {
            "type": "bar",
            "orientation": "h",
            "x": [r.longest for r in rows],
            "y": at,
            "width": 0.36,
            "name": "longest response, simulated",
            "marker": {"color": [VERMILION if late else BLUE for late in over], "line": {"width": 0}},
            "hovertemplate": "longest response %{x:.2f} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": [v for r in rows for v in (r.deadline, r.deadline, None)],
            "y": [v for y in at for v in (y - 0.45, y + 0.45, None)],
            "line": {"color": INK, "width": 3},
            "name": "deadline",
            "hoverinfo": "skip",
        },
        {
            "type": "scatter",
            "mode": "text",
            "x": [max(r.longest, r.deadline, b) for r, b in zip(rows, bounds, strict=True)],
            "y": at,
            "showlegend": False,
            "text": [f"  {r.longest:.1f} of {'no bound' if r.bound is None else f'{r.bound:.1f}'}" for r in rows],
            "textposition": "middle right",
            "hoverinfo": "skip",
            "textfont": {"color": INK},
        },
    ]
    return {
        "data": data,
        "layout": layout(
            height,
            barmode="overlay",
            legend=LEGEND,
            xaxis=axis("response time [ms]", range=[0, 1.16 * most]),
            margin={"l": 80, "r": 16, "t": 46, "b": 54},
            yaxis=axis(
                "",
                tickvals=at,
                ticktext=[f"<b>{r.name}</b>" for r in rows],
                range=[-0.6, len(rows) - 0.4],
                showgrid=False,
                fixedrange=True,
            ),
        ),
    }


def reserve(
    times: np.ndarray,
    longest: float,
    expected: float,
    published: tuple[float, float],
    needs: Sequence[tuple[str, Sequence[float]]],
    period: float,
    height: int = 470,
) -> dict[str, Any]:
    """Left: how long the jobs ran, with the expected and the longest time. Right: what each way of planning needs of a period.

    Args:
        times: run times in ms.
        longest, expected: the worst case and the ECET, in ms.
        published: (share, time in ms) of a published quantile, drawn as the point of the rising curve it is.
        needs: (name, (main parts, exception parts)) in ms per period; the same number for every picture.
        period: length of the period in ms.
    """
    edges = np.arange(0.0, longest + 5, 5.0)
    count = np.histogram(times, edges)[0] * (100 / len(times))
    middle = (edges[:-1] + edges[1:]) / 2
    steps = np.sort(times)
    names = [name for name, _ in needs][::-1]
    where = [names.index(name) for name, _ in needs]
    totals = [sum(parts) for _, parts in needs]
    right = 1.3 * max(period, *totals)
    data: list[dict[str, Any]] = [
        {
            "type": "bar",
            "x": middle,
            "y": count,
            "width": 5.0,
            "name": "share of jobs per 5 ms",
            "showlegend": False,
            "marker": {"color": [BLUE if m <= expected else ORANGE for m in middle], "line": {"color": "white", "width": 1}},
            "hovertemplate": "about %{x} ms: %{y:.1f} % of the jobs<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": steps,
            "y": np.arange(1, len(steps) + 1) * (100 / len(steps)),
            "name": "share of jobs below",
            "line": {"color": INK, "width": 3},
            "showlegend": False,
            "hovertemplate": "%{y:.1f} % run at most %{x:.1f} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": [published[1], longest],
            "y": [100 * published[0], 100],
            "name": "published (source 2)",
            "marker": {"symbol": "diamond", "size": 14, "color": INK, "line": {"width": 1.5, "color": "white"}},
            "cliponaxis": False,
            "hovertemplate": "published: %{y:.0f} % below %{x:.0f} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": [expected, expected],
            "y": [0, 100],
            "name": "ECET",
            "line": {"color": VERMILION, "width": 4, "dash": "dash"},
            "hoverinfo": "skip",
        },
        {
            "type": "bar",
            "orientation": "h",
            "x": [parts[0] for _, parts in needs],
            "y": where,
            "width": 0.55,
            "xaxis": "x2",
            "yaxis": "y2",
            "name": "main parts",
            "marker": {"color": BLUE},
            "hovertemplate": "main parts: %{x:.1f} ms<extra></extra>",
        },
        {
            "type": "bar",
            "orientation": "h",
            "x": [parts[1] for _, parts in needs],
            "y": where,
            "width": 0.55,
            "xaxis": "x2",
            "yaxis": "y2",
            "name": "exception parts",
            "marker": {
                "color": GREEN,
                "pattern": {"shape": "x", "fillmode": "overlay", "fgcolor": "white", "fgopacity": 1, "size": 7, "solidity": 0.3},
            },
            "hovertemplate": "exception parts: %{x:.1f} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "text",
            "x": [max(total, period) for total in totals],
            "y": where,
            "xaxis": "x2",
            "yaxis": "y2",
            "text": [f"  <b>{total:.0f} ms</b>" for total in totals],
            "textposition": "middle right",
            "textfont": {"color": [VERMILION if total > period else INK for total in totals]},
            "showlegend": False,
            "hoverinfo": "skip",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": [period, period],
            "y": [-0.6, len(needs) - 0.2],
            "xaxis": "x2",
            "yaxis": "y2",
            "name": "period",
            "line": {"color": INK, "width": 4},
            "hoverinfo": "skip",
        },
    ]
    return {
        "data": data,
        "layout": layout(
            height,
            barmode="stack",
            legend=LEGEND,
            margin={"l": 64, "r": 16, "t": 46, "b": 54},
            xaxis=axis("run time of a contour filter [ms]", domain=[0, 0.44], range=[0, longest + 5]),
            yaxis=axis("share of the jobs [%]", range=[0, 104]),
            xaxis2=axis("processor time in a period [ms]", domain=[0.6, 1], range=[0, right], anchor="y2"),
            yaxis2=axis(
                "",
                tickvals=where,
                ticktext=[f"<b>{name}</b>" for name, _ in needs],
                range=[-0.6, len(needs) - 0.2],
                showgrid=False,
                fixedrange=True,
                anchor="x2",
            ),
        ),
    }
