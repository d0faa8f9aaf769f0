"""Phases in their periods: the plan of windows, guarantees kept or broken, a few periods, activity over many of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from labkit.figures.gantt import gantt
from labkit.figures.panel import Panel, stack
from labkit.figures.style import (
    FONT,
    GREEN,
    GREY,
    INK,
    PALE,
    PUBLISHED,
    SMALL,
    VERMILION,
    Spec,
    axis,
    colours,
    held,
    key,
    rows_axis,
)
from labkit.phases import Window
from labkit.trace import Trace

MS = 1e-6  # ms in a ns
GROUND = "#eef2f6"
BAR = 0.86  # height of a bar of the plan, in rows: the longest name fits upright
DOTTED: Spec = {"color": INK, "width": 2, "dash": "dot"}


def short(name: str) -> str:
    """A phase without its prefix, parts after a line: LMSContourFilter.arcs reads 'arcs'."""
    return name.rsplit(".", 1)[-1].removeprefix("LMS")


def plan(
    demands: Mapping[str, int], made: Sequence[Window], published_ns: Sequence[int], period_ms: float, reserve_ms: float
) -> Spec:
    """Windows (upper bar) above what they have to hold (lower bar), and the published ends of the windows as diamonds.

    `demands` is ECET plus exception part of each phase in ns; `made` is empty where the period is too short.
    """
    lengths = np.array([w.deadline_ns for w in made]) * MS
    starts = np.array([w.release_ns for w in made]) * MS
    need = np.array(list(demands.values())) * MS
    right = held(max(period_ms, float(need.sum()) + reserve_ms))
    kept: Spec = {"color": PALE, "line": {"color": GREY, "width": 1}}
    drawn: list[Spec] = [
        _named_bars(list(demands)[: len(made)], 0.0, starts, lengths, "window"),
        _named_bars(list(demands), -1.0, np.cumsum(need) - need, need, "demand"),
        {
            "type": "bar",
            "orientation": "h",
            "base": [period_ms - reserve_ms],
            "x": [reserve_ms],
            "y": [0.0],
            "width": BAR,
            "marker": kept,
            "showlegend": False,
            "hovertemplate": "clock correction: %{x} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": np.array(published_ns) * MS,
            "y": np.full(len(published_ns), 0.5),
            "showlegend": False,
            "marker": PUBLISHED,
            "hovertemplate": "published: %{x:.6f} ms<extra></extra>",
        },
    ]
    end: Spec = {"type": "line", "x0": period_ms, "x1": period_ms, "y0": -1.65, "y1": 0.6}
    note = {"text": "end of the period ", "x": period_ms, "y": -1.68, "yanchor": "bottom", "xanchor": "right"}
    panel = Panel(
        drawn,
        {**rows_axis(("windows", "demand")), "range": [-1.7, 0.65]},
        axis("time from the start of the period [ms]", range=[0, 1.01 * right]),
        [{**end, "line": {"color": INK if made else VERMILION, "width": 3, "dash": "dot"}}],
        [{**note, "font": {"size": SMALL}}],
        left=96,
    )
    return stack(
        panel,
        height=390,
        keys=(
            key("kept for clock correction", type="bar", marker=kept),
            key("published end (source 2, table 5)", type="scatter", mode="markers", marker=PUBLISHED),
        ),
    )


def _named_bars(names: Sequence[str], row: float, base: np.ndarray, size: np.ndarray, label: str) -> Spec:
    colour = colours(names)
    return {
        "type": "bar",
        "orientation": "h",
        "base": base,
        "x": size,
        "y": np.full(len(base), row),
        "width": BAR,
        "showlegend": False,
        "marker": {"color": [colour[n] for n in names], "line": {"color": "white", "width": 2}},
        "text": [f"<b>{short(n)}</b>" for n in names],
        "textposition": "inside",
        "insidetextanchor": "middle",  # upright where the bar is narrow: plotly turns what does not fit
        "textfont": {"color": "white", "size": SMALL},
        "customdata": [f"{short(n)}: {s:.6f} ms" for n, s in zip(names, size.tolist(), strict=True)],
        "hovertemplate": f"{label} of %{{customdata}}, from %{{base:.6f}} ms<extra></extra>",
    }


def verdict_grid(
    designs: Sequence[str], chosen: str, kept: Sequence[Sequence[bool | None]], first: Sequence[Sequence[int | None]]
) -> Panel:
    """Designs against the four guarantees. A click on a cell chooses its design, and of a broken guarantee its first period.

    `kept` is None where there is no plan, `first` the first period in which the guarantee is broken.
    """
    y, x = (a.ravel() for a in np.mgrid[0 : len(designs), 0:4])
    flat = [kept[r][c] for r, c in zip(y, x, strict=True)]
    at = [first[r][c] for r, c in zip(y, x, strict=True)]
    words = ["no plan" if k is None else "kept" if k else f"broken, first in period {p}" for k, p in zip(flat, at, strict=True)]
    grid: Spec = {
        "type": "scatter",
        "mode": "markers+text",
        "x": x + 1,
        "y": -y,
        "showlegend": False,
        "marker": {"symbol": "square", "size": 34, "color": [PALE if k is None else GREEN if k else VERMILION for k in flat]},
        "text": ["–" if k is None else "✓" if k else f"{p}" for k, p in zip(flat, at, strict=True)],
        "textfont": {"color": [INK if k is None else "white" for k in flat], "size": FONT},
        "hovertemplate": "%{customdata}<extra></extra>",
        "customdata": [f"{designs[r]}, G{c + 1}: {text}" for r, c, text in zip(y, x, words, strict=True)],
        "meta": {
            "set": [{"design": designs[r]} | ({"period_shown": p} if p is not None else {}) for r, p in zip(y, at, strict=True)]
        },
    }
    row = -list(designs).index(chosen)
    frame: Spec = {"type": "rect", "x0": 0.5, "x1": 4.5, "y0": row - 0.48, "y1": row + 0.48, "line": {"color": INK, "width": 3}}
    hint: Spec = {"text": "number: first period broken, click it", "x": 0, "y": 0, "xref": "x domain", "yref": "y domain"}
    return Panel(
        [grid],
        rows_axis(designs, automargin=False),
        axis("", range=[0.4, 4.6], tickvals=[1, 2, 3, 4], ticktext=["G1", "G2", "G3", "G4"], showgrid=False, fixedrange=True),
        [frame],
        [{**hint, "xanchor": "center", "x": 0.3, "yanchor": "top", "yshift": -30, "font": {"size": SMALL}}],
        title="Guarantees kept",
        width=0.42,
        left=180,
    )


def periods_gantt(
    trace: Trace,
    parts: Sequence[str],
    period_ns: int,
    shown: range,
    made: Sequence[Window],
    phase_of: Mapping[str, str],
    **more: Any,
) -> Panel:
    """The periods `shown`, a row per part; windows as a pale ground. Time counts from the first of them. `more` are other
    attributes of the `Panel`.
    """
    origin, count = shown.start * period_ns, len(shown)
    trace = replace(trace, start=trace.start + origin)
    window = {w.phase: w for w in made}
    box: Spec = {"type": "rect", "layer": "below", "fillcolor": GROUND, "line": {"width": 0}}
    shapes: list[Spec] = []
    for row, w in ((i, window[phase_of[part]]) for i, part in enumerate(parts) if phase_of[part] in window):
        for begin in (k * period_ns + w.release_ns for k in range(count)):
            x0, x1 = begin * MS, (begin + w.deadline_ns) * MS
            shapes.append({**box, "x0": x0, "x1": x1, "y0": -row - 0.45, "y1": 0.45 - row})
    for at in (k * period_ns * MS for k in range(count + 1)):
        shapes.append({"type": "line", "x0": at, "x1": at, "yref": "y domain", "y0": 0, "y1": 1, "line": DOTTED})
    end = held(count * period_ns * MS)
    labels = {part: short(part) for part in parts}
    x = axis("time from the start of the first period [ms]", range=[0, end])
    return gantt(trace, parts, 0, end, pairs=True, labels=labels, x=x, shapes=shapes, **more)


def activity_stack(
    granted: Mapping[str, np.ndarray],
    exceptions: np.ndarray,
    aborted: np.ndarray,
    margins: Mapping[str, np.ndarray],
    period_ms: float,
    longest_ms: float,
    title: str,
) -> Spec:
    """Left: processor time per period, stacked by phase, exception parts on top in their own colour, aborted periods marked
    above. Right: how much was left before each deadline.

    Args:
        granted: phase -> ms in each period.
        exceptions: ms of exception parts in each period.
        aborted: periods with an abort.
        margins: name and colour of a group of phases as "name #colour" -> ms left of each of their jobs.
        period_ms, longest_ms: the period, and the longest there can be.
        title: above the stack.
    """
    colour = colours(granted)
    layers = [(short(name), colour[name], ms) for name, ms in granted.items()] + [("exception parts", INK, exceptions)]
    drawn: list[Spec] = [
        {
            "type": "scatter",
            "mode": "lines",
            "stackgroup": "time",
            "x": np.arange(len(ms)),
            "y": ms,
            "name": name,
            "fillcolor": paint,
            "line": {"width": 0, "shape": "hv", "color": paint},
            "hovertemplate": f"{name}: %{{y:.2f}} ms in period %{{x}}<extra></extra>",
        }
        for name, paint, ms in layers
    ]
    tick: Spec = {"symbol": "line-ns", "size": 10, "line": {"width": 2, "color": INK}, "color": INK}
    drawn.append(
        {
            "type": "scatter",
            "mode": "markers",
            "x": aborted,
            "y": np.full(len(aborted), 1.03 * period_ms),
            "marker": tick,
            "showlegend": False,
            "hovertemplate": "abort in period %{x}<extra></extra>",
        }
    )
    end: Spec = {"type": "line", "xref": "x domain", "x0": 0, "x1": 1, "y0": period_ms, "y1": period_ms, "line": DOTTED}
    y = axis("processor time [ms]", range=[0, 1.08 * longest_ms])
    panel = Panel(drawn, y, axis("period", range=[0, len(exceptions)]), [end], title=title, width=2.2)
    aborts = key("contour filter aborted", type="scatter", mode="markers", marker=tick)
    return stack([panel, _margins(margins)], height=440, keys=[aborts], aside=200)


MARGINS = np.arange(-10.0, 61.0, 2.0)  # ms: edges of the bars of what was left


def _margins(groups: Mapping[str, np.ndarray]) -> Panel:
    """How often how much was left before the deadline; what is left of 0 was late."""
    drawn: list[Spec] = []
    for name, left in groups.items():
        words, colour = name.rsplit(" ", 1)
        share = np.histogram(np.clip(left, MARGINS[0], MARGINS[-1]), MARGINS)[0] * (100 / max(len(left), 1))
        drawn.append(
            {
                "type": "bar",
                "x": (MARGINS[:-1] + MARGINS[1:]) / 2,
                "y": share,
                "width": 2.0,
                "opacity": 0.75,
                "marker": {"color": colour, "line": {"color": "white", "width": 1}},
                "name": words,
                "hovertemplate": f"{words}: %{{y:.1f}} % of the jobs have about %{{x}} ms left<extra></extra>",
            }
        )
    line: Spec = {"type": "line", "yref": "y domain", "x0": 0, "x1": 0, "y0": 0, "y1": 1, "line": {"color": INK, "width": 3}}
    x = axis("time left [ms]", range=[MARGINS[0], MARGINS[-1]])
    return Panel(drawn, axis("share of the jobs [%]", range=[0, 104]), x, [line], title="Left before the deadline", left=110)
