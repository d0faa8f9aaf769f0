"""Schedules of periodic jobs, one panel per policy: who ran, in which part, what was aborted, which deadline was missed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.style import GREY, INK, LEGEND, VERMILION, axis, colours, layout
from labkit.scheduler.jobs import EP
from labkit.trace import Trace

BAR, THIN = 0.56, 0.1  # heights in a row of height 1: a slice, the wait of an unfinished job
BEYOND = 0.45  # opacity of what a TAFT main part runs beyond its expected time


@dataclass(frozen=True)
class Panel:
    """One schedule; `remark` is (time in units of the trace, task, text): a text to the right of that time above the row of that task."""

    title: str
    trace: Trace
    remark: tuple[int, str, str] | None = None


def schedule(panels: Sequence[Panel], deadlines: Mapping[str, int], end: float, height: int = 560, pairs: bool = True) -> dict[str, Any]:
    """Panels one above the other on one time axis.

    Args:
        panels: traces of `labkit.scheduler.periodic.simulate`.
        deadlines: task -> relative deadline in units of the trace, in the order of the rows from top to bottom; a task that is not
            in a trace has an empty row.
        end: end of the time axis in ms.
        pairs: whether the legend explains exception parts and aborts.

    The number and order of plotly traces depends on the number of panels only.
    """
    tasks = list(deadlines)
    row = {name: float(len(tasks) - 1 - i) for i, name in enumerate(tasks)}
    share = 1 / len(panels)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    notes: list[dict[str, Any]] = []
    for i, panel in enumerate(panels):
        top, suffix = 1 - i * share, str(i + 1) if i else ""
        axes[f"yaxis{suffix}"] = axis(
            "", domain=[top - share + 0.05 * share, top - 0.17 * share], range=[-0.5, len(tasks) - 0.4], tickvals=list(row.values()),
            ticktext=[f"<b>{name}</b>" for name in row], showgrid=False, fixedrange=True, automargin=False)
        data += _traces(panel.trace, row, deadlines, end, f"y{suffix}", legend=i == 0, pairs=pairs)
        notes.append({"text": f"<b>{panel.title}</b>", "xref": "paper", "yref": "paper", "x": 0, "y": top - 0.17 * share, "yanchor": "bottom",
                      "xanchor": "left", "showarrow": False, "font": {"size": 17}})
        if panel.remark is not None:
            time, name, text = panel.remark
            notes.append({"text": f"  {text}", "x": _ms(panel.trace, time), "xref": "x", "xanchor": "left", "y": row[name], "yref": f"y{suffix}",
                          "showarrow": False, "bgcolor": "rgba(255,255,255,0.88)", "font": {"size": 15, "color": VERMILION}})
    return {"data": data, "layout": layout(
        height, **axes, xaxis=axis("time [ms]", range=[0, end], anchor=f"y{len(panels) if len(panels) > 1 else ''}", automargin=False),
        barmode="overlay", annotations=notes, legend=LEGEND, margin={"l": 80, "r": 16, "t": 34, "b": 58})}


def _ms(trace: Trace, time: Any) -> Any:
    return time * (1e3 / trace.hz)


def _traces(trace: Trace, row: Mapping[str, float], deadlines: Mapping[str, int], end: float, yaxis: str, legend: bool,
            pairs: bool) -> list[dict[str, Any]]:
    limit = end * trace.hz / 1e3
    owner = [name.removesuffix(EP) for name in trace.names]
    colour = colours(row)
    switch = trace.rows("switch")
    task, start, level = switch[:, 2], switch[:, 0], switch[:, 4]
    stop = np.append(start[1:], trace.end)
    exception = np.array([name.endswith(EP) and name.removesuffix(EP) in trace.names for name in trace.names])
    taft = exception.any()

    def bars(kept: np.ndarray, label: str, opacity: float, **marker: Any) -> dict[str, Any]:
        kept = kept & (task >= 0) & (stop > start) & (start < limit)
        who = [owner[t] for t in task[kept].tolist()]
        return {"type": "bar", "orientation": "h", "base": _ms(trace, start[kept]), "x": _ms(trace, stop[kept] - start[kept]), "width": BAR,
                "y": [row[name] for name in who], "yaxis": yaxis, "showlegend": False, "customdata": who,
                "marker": {"color": [colour[name] for name in who], "opacity": opacity, "line": {"width": 0}, **marker},
                "hovertemplate": f"%{{customdata}}{label}<br>from %{{base:.3f}} ms for %{{x:.3f}} ms<extra></extra>"}

    def marks(kind: str, symbol: str, size: int, fill: str, line: dict[str, Any], label: str, show: bool) -> dict[str, Any]:
        rows = trace.rows(kind)
        rows = rows[rows[:, 0] <= limit]
        return {"type": "scatter", "mode": "markers", "x": _ms(trace, rows[:, 0]), "y": [row[owner[t]] for t in rows[:, 2].tolist()], "yaxis": yaxis,
                "marker": {"symbol": symbol, "size": size, "color": fill, "line": line}, "cliponaxis": False, "name": label, "showlegend": legend and show,
                "customdata": rows[:, 5], "hovertemplate": f"{label}: job %{{customdata}} at %{{x:.3f}} ms<extra></extra>"}

    releases = trace.rows("release")
    releases = releases[releases[:, 0] <= limit]
    names = [owner[t] for t in releases[:, 2].tolist()]
    at = np.array([row[name] for name in names])
    due = releases[:, 4] + np.array([deadlines[name] for name in names], dtype=np.int64)
    shown = due <= limit
    ran = exception[task] & (task >= 0)
    return [
        _waiting(trace, row, limit, yaxis),
        bars(~ran & ~(taft & (level == 0)), "", 1.0),
        bars(~ran & taft & (level == 0), ", beyond its expected time", BEYOND),
        bars(ran, ", exception part", 1.0, pattern={"shape": "x", "fgcolor": "white", "size": 7, "solidity": 0.45},
             line={"color": INK, "width": 1.5}),
        {"type": "scatter", "mode": "lines", "x": _gaps(_ms(trace, due[shown]), _ms(trace, due[shown])),
         "y": _gaps(at[shown] - 0.46, at[shown] + 0.42), "yaxis": yaxis, "line": {"color": INK, "width": 2}, "name": "deadline",
         "showlegend": legend, "hoverinfo": "skip"},
        {"type": "scatter", "mode": "markers", "x": _ms(trace, releases[:, 0]), "y": at - 0.36, "marker": {"symbol": "triangle-up", "size": 11, "color": INK},
         "yaxis": yaxis, "cliponaxis": False, "name": "release", "showlegend": legend, "hovertemplate": "release %{x:.3f} ms<extra></extra>"},
        marks("abort", "octagon", 13, "white", {"color": INK, "width": 3}, "main part aborted", pairs),
        marks("miss", "x", 15, VERMILION, {"color": "white", "width": 1.5}, "deadline missed", True),
        *({"type": "bar", "orientation": "h", "x": [None], "y": [None], "yaxis": yaxis, "name": label, "showlegend": legend and pairs,
           "marker": {"color": GREY, **more}} for label, more in (
               ("beyond expected time", {"opacity": BEYOND}),
               ("exception part", {"pattern": {"shape": "x", "fgcolor": "white", "size": 7, "solidity": 0.45}, "line": {"color": INK, "width": 1.5}}))),
    ]


def _waiting(trace: Trace, row: Mapping[str, float], limit: float, yaxis: str) -> dict[str, Any]:
    """A thin bar from the release of each job to its end, under the slices: where only it is seen, the job waits."""
    ends: dict[tuple[str, int], int] = {}
    told = trace.rows("complete", "miss")
    for time, _, task, _, _, job in told[told[:, 0] <= limit].tolist():
        key = trace.names[task].removesuffix(EP), job
        ends[key] = max(time, ends.get(key, 0))
    releases = trace.rows("release")
    begun = [(trace.names[task], time, ends.get((trace.names[task], job), min(int(limit), trace.end)))
             for time, _, task, _, _, job in releases[releases[:, 0] < limit].tolist()]
    return {"type": "bar", "orientation": "h", "base": [_ms(trace, b) for _, b, _ in begun], "x": [_ms(trace, e - b) for _, b, e in begun],
            "y": [row[name] for name, _, _ in begun], "width": THIN, "yaxis": yaxis, "marker": {"color": GREY, "line": {"width": 0}},
            "name": "released, waits", "showlegend": False, "hoverinfo": "skip"}


def _gaps(low: Sequence[float], high: Sequence[float]) -> np.ndarray:
    """low, high, nan for each: many separate lines in one trace."""
    return np.stack([low, high, np.full(len(low), np.nan)], axis=1).ravel()
