"""Who ran, who waited for which lock, who held it and at which priority: one panel per trace, one above the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.style import GREY, INK, YELLOW, axis, colours, layout
from labkit.trace import Trace
from labkit.trace.folds import holds, priorities, ready, runs, waits

BAR, THIN, LOCK = 0.62, 0.16, 0.2  # heights within a row of height 1


@dataclass(frozen=True)
class Panel:
    """One timeline of the figure.

    Attributes:
        title: what this trace is, shown above it.
        trace: a kernel trace.
        span: an interval to point at, (start, end, task, text) in time units of the trace, or None.
    """

    title: str
    trace: Trace
    span: tuple[int, int, str, str] | None = None


def timeline(panels: Sequence[Panel], tasks: Sequence[str], base: Mapping[str, int], end: float, height: int = 560) -> dict[str, Any]:
    """Panels of rows: running (solid), ready (thin), waiting for a lock (hatched), holding it (yellow strip), and the priority below.

    `tasks` are the rows from top to bottom, `base` their base priorities, `end` the end of the time axis in ms. The number
    and order of plotly traces depends on the number of panels and tasks only.
    """
    colour = colours(tasks)
    row = {name: len(tasks) - 1 - i for i, name in enumerate(tasks)}
    levels = sorted(set(base.values()))
    share = 1 / len(panels)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    notes: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    for i, panel in enumerate(panels):
        top, gantt, steps = 1 - i * share, 2 * i + 1, 2 * i + 2
        ids = ["y" if n == 1 else f"y{n}" for n in (gantt, steps)]
        low = top - share
        axes[f"yaxis{gantt if gantt > 1 else ''}"] = axis(
            "", domain=[low + 0.36 * share, top - 0.085 * share], range=[-0.55, len(tasks) - 0.4], tickvals=list(row.values()),
            ticktext=[f"<b>{name}</b>" for name in row], showgrid=False, fixedrange=True)
        axes[f"yaxis{steps}"] = axis(
            "priority", domain=[low + 0.075 * share, low + 0.31 * share], range=[levels[0] - 0.5, levels[-1] + 0.5],
            tickvals=levels, fixedrange=True)
        data += _bars(panel.trace, row, colour, ids[0], legend=i == 0) + _steps(panel.trace, tasks, colour, ids[1])
        notes.append({"text": f"<b>{panel.title}</b>", "xref": "paper", "yref": "paper", "x": 0, "y": top, "yanchor": "top",
                      "xanchor": "left", "showarrow": False, "font": {"size": 17}})
        if panel.span is not None:
            start, stop, name, text = panel.span
            shapes.append(_bracket(_ms(panel.trace, start), _ms(panel.trace, stop), row[name] + 0.42, ids[0]))
            notes.append({"text": f"<b>{text}</b>", "x": (_ms(panel.trace, start) + _ms(panel.trace, stop)) / 2, "xref": "x",
                          "y": row[name] + 0.44, "yref": ids[0], "yanchor": "bottom", "showarrow": False, "font": {"size": 15}})
    return {"data": data, "layout": layout(
        height, **axes, xaxis=axis("time [ms]", range=[0, end], anchor=f"y{2 * len(panels)}"), barmode="overlay", annotations=notes,
        shapes=shapes, margin={"l": 64, "r": 16, "t": 30, "b": 48},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1, "xanchor": "right"})}


def _ms(trace: Trace, time: Any) -> Any:
    return (np.asarray(time) - trace.start) * (1e3 / trace.hz)


def _bracket(start: float, end: float, y: float, yref: str) -> dict[str, Any]:
    return {"type": "line", "x0": start, "x1": end, "y0": y, "y1": y, "xref": "x", "yref": yref, "line": {"color": INK, "width": 4}}


def _bars(trace: Trace, row: Mapping[str, int], colour: Mapping[str, str], yaxis: str, legend: bool) -> list[dict[str, Any]]:
    names = trace.names

    def bars(intervals: np.ndarray, height: float, shift: float, marker: dict[str, Any], label: str, **more: Any) -> dict[str, Any]:
        kept = intervals[[names[t] in row for t in intervals[:, 0]]] if len(intervals) else intervals
        start, end = _ms(trace, kept[:, -2]), _ms(trace, kept[:, -1])
        who = [names[t] for t in kept[:, 0]]
        if marker.get("color") is None:
            marker = {**marker, "color": [colour[n] for n in who]}
        what = [names[o] for o in kept[:, 1]] if kept.shape[1] == 4 else [""] * len(who)
        return {"type": "bar", "orientation": "h", "base": start, "x": end - start, "y": [row[n] + shift for n in who], "width": height,
                "marker": marker, "yaxis": yaxis, "name": label, "legendgroup": label, "showlegend": legend and bool(label),
                "customdata": [f"{n} {label} {o}".strip() for n, o in zip(who, what, strict=True)], "text": what if more.get("textposition") else None,
                "hovertemplate": "%{customdata}<br>%{base:.3f} ms for %{x:.3f} ms<extra></extra>"} | more

    waiting = {"color": "rgba(255,255,255,0)", "line": {"color": GREY, "width": 1.5},
               "pattern": {"shape": "/", "fgcolor": GREY, "size": 7, "solidity": 0.25}}
    releases = trace.rows("release")
    releases = releases[[names[t] in row for t in releases[:, 2]]] if len(releases) else releases
    return [
        bars(ready(trace), THIN, 0.0, {"color": GREY}, "ready, not running"),
        bars(waits(trace), BAR, 0.0, waiting, "waits for lock"),
        bars(runs(trace), BAR, 0.0, {"line": {"width": 0}}, "runs", showlegend=False),
        bars(holds(trace), LOCK, -BAR / 2 + LOCK / 2, {"color": YELLOW, "line": {"color": INK, "width": 1}}, "holds lock",
             textposition="inside", insidetextanchor="middle", textfont={"size": 12, "color": INK}),
        {"type": "scatter", "mode": "markers", "x": _ms(trace, releases[:, 0]), "y": [row[names[t]] - 0.45 for t in releases[:, 2]],
         "marker": {"symbol": "triangle-up", "size": 11, "color": INK}, "yaxis": yaxis, "name": "release", "legendgroup": "release",
         "showlegend": legend, "hovertemplate": "release %{x:.3f} ms<extra></extra>"},
    ]


def _steps(trace: Trace, tasks: Sequence[str], colour: Mapping[str, str], yaxis: str) -> list[dict[str, Any]]:
    steps = priorities(trace)
    made = []
    for i, name in enumerate(tasks):
        mine = steps[steps[:, 0] == trace.code(name)]
        offset = (i - (len(tasks) - 1) / 2) * 0.12  # so that equal priorities stay visible side by side
        x = np.ravel(_ms(trace, mine[:, 1:3]))
        made.append({"type": "scatter", "mode": "lines", "x": x, "y": np.repeat(mine[:, 3], 2) + offset, "yaxis": yaxis, "name": name,
                     "line": {"color": colour[name], "width": 4}, "showlegend": False,
                     "hovertemplate": f"{name}: priority %{{customdata}} at %{{x:.3f}} ms<extra></extra>", "customdata": np.repeat(mine[:, 3], 2)})
    return made
