"""Phases in their periods: the plan of windows, a few periods as a Gantt chart, guarantees kept or broken, activity over many periods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from labkit.figures.style import GREEN, GREY, INK, PALE, PUBLISHED, VERMILION, axis, colours, layout
from labkit.phases.windows import Window
from labkit.trace import Trace

MS = 1e-6  # ms in a ns


def short(name: str) -> str:
    """A phase without its prefix, parts after a line: LMSContourFilter.arcs reads 'arcs'."""
    return name.rsplit(".", 1)[-1].removeprefix("LMS")


def plan(
    demands: Mapping[str, int], made: Sequence[Window], published_ns: Sequence[int], period_ms: float, reserve_ms: float
) -> dict[str, Any]:
    """Windows (upper bar) above what they have to hold (lower bar), and the published ends of the windows as diamonds.

    `demands` is ECET plus exception part of each phase in ns; `made` is empty where the period is too short.
    """
    colour = colours(demands)
    lengths = np.array([w.deadline_ns for w in made]) * MS
    starts = np.array([w.release_ns for w in made]) * MS
    need = np.array(list(demands.values())) * MS
    names = list(demands)

    def bars(row: float, base: np.ndarray, size: np.ndarray, label: str) -> dict[str, Any]:
        return {
            "type": "bar",
            "orientation": "h",
            "base": base,
            "x": size,
            "y": np.full(len(base), row),
            "width": 0.62,
            "showlegend": False,
            "marker": {"color": [colour[n] for n in names[: len(base)]], "line": {"color": "white", "width": 2}},
            "text": [f"<b>{short(n)}</b>" if s > 8 else "" for n, s in zip(names, size)],
            "textposition": "inside",
            "insidetextanchor": "middle",
            "textangle": 0,
            "textfont": {"color": "white", "size": 15},
            "customdata": [f"{short(n)}: {s:.6f} ms" for n, s in zip(names, size)],
            "hovertemplate": f"{label} of %{{customdata}}, from %{{base:.6f}} ms<extra></extra>",
        }

    right = max(period_ms, need.sum() + reserve_ms)
    data = [
        bars(2.0, starts, lengths, "window"),
        bars(1.0, np.cumsum(need) - need, need, "demand"),
        {
            "type": "bar",
            "orientation": "h",
            "base": [period_ms - reserve_ms],
            "x": [reserve_ms],
            "y": [2.0],
            "width": 0.62,
            "name": "kept for clock correction",
            "marker": {"color": PALE, "line": {"color": GREY, "width": 1}},
            "hovertemplate": "clock correction: %{x} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": np.array(published_ns) * MS,
            "y": np.full(len(published_ns), 2.42),
            "name": "published end (source 2, table 5)",
            "marker": PUBLISHED,
            "hovertemplate": "published: %{x:.6f} ms<extra></extra>",
        },
    ]
    line = {
        "type": "line",
        "x0": period_ms,
        "x1": period_ms,
        "y0": 0.5,
        "y1": 2.6,
        "line": {"color": VERMILION if not made else INK, "width": 3, "dash": "dot"},
    }
    return {
        "data": data,
        "layout": layout(
            300,
            barmode="overlay",
            shapes=[line],
            margin={"l": 90, "r": 20, "t": 40, "b": 56},
            annotations=[
                {
                    "text": "end of the period",
                    "x": period_ms,
                    "y": 0.5,
                    "yanchor": "bottom",
                    "xanchor": "right",
                    "showarrow": False,
                    "font": {"size": 14},
                }
            ],
            xaxis=axis("time from the start of the period [ms]", range=[0, 1.01 * right]),
            yaxis=axis(
                "",
                range=[0.45, 2.65],
                tickvals=[2, 1],
                ticktext=["<b>windows</b>", "<b>demand</b>"],
                showgrid=False,
                fixedrange=True,
            ),
        ),
    }


def verdict_grid(
    designs: Sequence[str],
    chosen: str,
    kept: Sequence[Sequence[bool | None]],
    first: Sequence[Sequence[int | None]],
    gantt: dict[str, Any],
) -> dict[str, Any]:
    """Designs against guarantees on the left, a Gantt chart (from `periods_gantt`) of the chosen design on the right.

    A click on a cell chooses its design, and of a broken guarantee the period in which it is broken first.
    """
    rows, columns = len(designs), 4
    y, x = (a.ravel() for a in np.mgrid[0:rows, 0:columns])
    flat = [kept[r][c] for r, c in zip(y, x)]
    at = [first[r][c] for r, c in zip(y, x)]
    grid = {
        "type": "scatter",
        "mode": "markers+text",
        "x": x + 1,
        "y": rows - 1 - y,
        "xaxis": "x2",
        "yaxis": "y2",
        "showlegend": False,
        "marker": {"symbol": "square", "size": 34, "color": [PALE if k is None else GREEN if k else VERMILION for k in flat]},
        "text": ["–" if k is None else "✓" if k else f"{p}" for k, p in zip(flat, at)],
        "textfont": {"color": "white", "size": 16},
        "hovertemplate": "%{customdata}<extra></extra>",
        "customdata": [
            f"{designs[r]}, G{c + 1}: " + ("no plan" if k is None else "kept" if k else f"broken, first in period {p}")
            for r, c, k, p in zip(y, x, flat, at)
        ],
        "meta": {"set": [{"design": designs[r]} | ({"period_shown": p} if p is not None else {}) for r, p in zip(y, at)]},
    }
    row = rows - 1 - list(designs).index(chosen)
    frame = {
        "type": "rect",
        "xref": "x2",
        "yref": "y2",
        "x0": 0.5,
        "x1": columns + 0.5,
        "y0": row - 0.48,
        "y1": row + 0.48,
        "line": {"color": INK, "width": 3},
    }
    more = gantt["layout"]
    notes = [
        *more.get("annotations", []),
        {
            "text": "number: first period broken, click it",
            "xref": "paper",
            "yref": "paper",
            "x": 0,
            "y": 0,
            "yshift": -34,
            "xanchor": "left",
            "yanchor": "top",
            "showarrow": False,
            "font": {"size": 13},
        },
    ]
    made = more | {
        "shapes": [*more["shapes"], frame],
        "annotations": notes,
        "xaxis": more["xaxis"] | {"domain": [0.46, 1]},
        "xaxis2": axis(
            "",
            domain=[0.15, 0.32],
            range=[0.4, columns + 0.6],
            tickvals=[1, 2, 3, 4],
            ticktext=["G1", "G2", "G3", "G4"],
            side="top",
            showgrid=False,
            fixedrange=True,
            anchor="y2",
        ),
        "yaxis": more["yaxis"] | {"anchor": "x"},
        "yaxis2": axis(
            "",
            anchor="x2",
            range=[-0.6, rows - 0.4],
            tickvals=list(range(rows - 1, -1, -1)),
            ticktext=[f"<b>{d}</b>" for d in designs],
            showgrid=False,
            fixedrange=True,
            automargin=False,
        ),
        "margin": {"l": 20, "r": 16, "t": 56, "b": 64},
    }
    return {"data": [*gantt["data"], grid], "layout": made}


def periods_gantt(
    trace: Trace,
    parts: Sequence[str],
    period_ns: int,
    first: int,
    count: int,
    made: Sequence[Window],
    phase_of: Mapping[str, str],
) -> dict[str, Any]:
    """`count` periods from `first`: main parts within their ECET and beyond it, exception parts, aborts; windows as a pale ground."""
    colour, row = colours(parts), {name: len(parts) - 1 - i for i, name in enumerate(parts)}
    switch = trace.rows("switch")
    task, start, rank = switch[:, 2], switch[:, 0], switch[:, 4]
    end = np.append(start[1:], trace.end)
    low, high = first * period_ns, (first + count) * period_ns
    seen = (task >= 0) & (end > low) & (start < high) & (end > start)
    task, start, end, rank = task[seen], np.maximum(start[seen], low), np.minimum(end[seen], high), rank[seen]
    exception = task >= len(parts)
    name = np.array(parts, dtype=object)[task % len(parts)] if len(task) else np.array([], dtype=object)

    def bars(mine: np.ndarray, label: str, **marker: Any) -> dict[str, Any]:
        who = name[mine]
        marker = {"line": {"width": 0}, "color": [colour[n] for n in who]} | marker
        return {
            "type": "bar",
            "orientation": "h",
            "base": start[mine] * MS,
            "x": (end - start)[mine] * MS,
            "y": [row[n] for n in who],
            "width": 0.62,
            "name": label,
            "marker": marker,
            "customdata": [f"{short(n)}, {label}" for n in who],
            "hovertemplate": "%{customdata}<br>from %{base:.3f} ms for %{x:.3f} ms<extra></extra>",
        }

    aborts = trace.rows("abort")
    aborts = aborts[(aborts[:, 0] >= low) & (aborts[:, 0] <= high)]
    data = [
        bars(~exception & (rank >= 1), "main part"),
        bars(~exception & (rank < 1), "main part beyond its ECET", opacity=0.45),
        bars(exception, "exception part", color=VERMILION),
        {
            "type": "scatter",
            "mode": "markers",
            "x": aborts[:, 0] * MS,
            "y": [row[parts[t]] for t in aborts[:, 2]],
            "name": "abort",
            "marker": {"symbol": "x-thin", "size": 13, "color": VERMILION, "line": {"width": 3, "color": VERMILION}},
            "hovertemplate": "abort at %{x:.3f} ms<extra></extra>",
        },
    ]
    shapes = [
        {
            "type": "line",
            "x0": k * period_ns * MS,
            "x1": k * period_ns * MS,
            "yref": "y domain",
            "y0": 0,
            "y1": 1,
            "line": {"color": INK, "width": 2, "dash": "dot"},
        }
        for k in range(first, first + count + 1)
    ]
    window = {w.phase: w for w in made}
    for k in range(first, first + count):
        for part in parts:
            if phase_of[part] in window:
                w = window[phase_of[part]]
                x0 = k * period_ns + w.release_ns
                shapes.append(
                    {
                        "type": "rect",
                        "layer": "below",
                        "x0": x0 * MS,
                        "x1": (x0 + w.deadline_ns) * MS,
                        "y0": row[part] - 0.45,
                        "y1": row[part] + 0.45,
                        "fillcolor": "#eef2f6",
                        "line": {"width": 0},
                    }
                )
    return {
        "data": data,
        "layout": layout(
            470,
            barmode="overlay",
            shapes=shapes,
            margin={"l": 130, "r": 16, "t": 46, "b": 56},
            xaxis=axis("time [ms]", range=[low * MS, high * MS]),
            yaxis=axis(
                "",
                range=[-0.6, len(parts) - 0.4],
                tickvals=list(row.values()),
                ticktext=[f"<b>{short(n)}</b>" for n in row],
                showgrid=False,
                fixedrange=True,
                automargin=False,
            ),
        ),
    }


def activity_stack(
    granted: Mapping[str, np.ndarray], exceptions: np.ndarray, aborted: np.ndarray, period_ms: float, title: str
) -> dict[str, Any]:
    """Processor time per period, stacked by phase; exception parts on top in their own colour, aborted periods marked above.

    `granted`: phase -> ms in each period; `exceptions`: ms of exception parts in each period; `aborted`: periods with an abort.
    """
    colour = colours(granted)
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "stackgroup": "time",
            "x": np.arange(len(ms)),
            "y": ms,
            "name": short(name),
            "fillcolor": colour[name],
            "line": {"width": 0, "shape": "hv", "color": colour[name]},
            "hovertemplate": f"{short(name)}: %{{y:.2f}} ms in period %{{x}}<extra></extra>",
        }
        for name, ms in granted.items()
    ]
    data.append(
        {
            "type": "scatter",
            "mode": "lines",
            "stackgroup": "time",
            "x": np.arange(len(exceptions)),
            "y": exceptions,
            "name": "exception parts",
            "fillcolor": VERMILION,
            "line": {"width": 0, "shape": "hv", "color": VERMILION},
            "hovertemplate": "exception parts: %{y:.2f} ms<extra></extra>",
        }
    )
    data.append(
        {
            "type": "scatter",
            "mode": "markers",
            "x": aborted,
            "y": np.full(len(aborted), 1.03 * period_ms),
            "name": "contour filter aborted",
            "marker": {"symbol": "line-ns", "size": 10, "line": {"width": 2, "color": VERMILION}, "color": VERMILION},
            "hovertemplate": "abort in period %{x}<extra></extra>",
        }
    )
    line = {
        "type": "line",
        "xref": "x domain",
        "x0": 0,
        "x1": 1,
        "y0": period_ms,
        "y1": period_ms,
        "line": {"color": INK, "width": 2, "dash": "dot"},
    }
    return {
        "data": data,
        "layout": layout(
            470,
            shapes=[line],
            margin={"l": 70, "r": 190, "t": 44, "b": 56},
            annotations=[
                {
                    "text": f"<b>{title}</b>",
                    "xref": "paper",
                    "yref": "paper",
                    "x": 0,
                    "y": 1,
                    "yshift": 34,
                    "xanchor": "left",
                    "showarrow": False,
                    "font": {"size": 17},
                }
            ],
            legend={"x": 1.01, "y": 1, "xanchor": "left", "yanchor": "top", "traceorder": "reversed"},
            xaxis=axis("period", range=[0, len(exceptions)]),
            yaxis=axis("processor time [ms]", range=[0, 1.08 * period_ms]),
        ),
    }
