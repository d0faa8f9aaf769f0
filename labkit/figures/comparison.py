"""Measured numbers beside each other and beside a model's: dumbbells (before, after), rows of factors, stacked costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log10
from typing import Any

from labkit.figures.style import GREY, INK, LEGEND, PUBLISHED, PUBLISHED_BEFORE, VERMILION, axis, colours, layout

LIFT = 0.21  # distance of a row's two dumbbells from its middle


@dataclass(frozen=True)
class Pair:
    """A row's numbers without and with caches; `upper` says which of the row's two dumbbells this is."""

    row: str
    before: float
    after: float
    upper: bool


def dumbbells(
    panels: Mapping[str, Sequence[Pair]], series: tuple[str, str], title: str, low: float, high: float, height: int = 560
) -> dict[str, Any]:
    """Panels side by side, each with a row per name and in it a dumbbell per series (upper, lower) from `before` to `after`.

    All share a logarithmic axis `title` from `low` to `high`. The factor before / after stands right of each dumbbell.
    """
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    notes = []
    width = 1 / len(panels)
    for i, (name, pairs) in enumerate(panels.items()):
        n = "" if i == 0 else str(i + 1)
        rows = list(dict.fromkeys(p.row for p in pairs))
        row = {r: len(rows) - 1 - k for k, r in enumerate(rows)}
        colour = colours(rows)
        start = i * width + (0.11 if i else 0)
        axes[f"xaxis{n}"] = axis(
            title,
            domain=[start, (i + 1) * width - 0.03],
            type="log",
            range=[log10(low), log10(high)],
            anchor=f"y{n}",
            dtick=1,
            minor={"dtick": "D1", "showgrid": True, "gridcolor": "#f3f5f7"},
        )
        axes[f"yaxis{n}"] = axis(
            "",
            range=[-0.6, len(rows) - 0.4],
            tickvals=list(row.values()),
            ticktext=[f"<b>{r}</b>" for r in row],
            anchor=f"x{n}",
            showgrid=False,
            fixedrange=True,
        )
        notes.append(
            {
                "text": f"<b>{name}</b>",
                "xref": "paper",
                "yref": "paper",
                "x": start,
                "y": 1.005,
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 17},
            }
        )
        where = {"xaxis": f"x{n}", "yaxis": f"y{n}"}
        for upper in (True, False):
            mine = [p for p in pairs if p.upper == upper]
            y = [row[p.row] + (LIFT if upper else -LIFT) for p in mine]
            word = series[0] if upper else series[1]
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": [v for p in mine for v in (p.before, p.after, None)],
                    "y": [v for at in y for v in (at, at, None)],
                    "line": {"color": INK if upper else GREY, "width": 3},
                    "name": word + (" (upper of the two)" if upper else " (lower)"),
                    "showlegend": i == 0,
                    "hoverinfo": "skip",
                    **where,
                }
            )
            for key, marker in (("before", PUBLISHED_BEFORE), ("after", PUBLISHED)):
                paint = [colour[p.row] for p in mine]
                style = {**marker, "line": {"width": 2.5, "color": paint}} if key == "before" else {**marker, "color": paint}
                data.append(
                    {
                        "type": "scatter",
                        "mode": "markers",
                        "x": [getattr(p, key) for p in mine],
                        "y": y,
                        "marker": style,
                        "showlegend": False,
                        "customdata": [p.row for p in mine],
                        "hovertemplate": f"%{{customdata}}, {word}, caches {'off' if key == 'before' else 'on'}: %{{x}}<extra></extra>",
                        **where,
                    }
                )
            data.append(
                {
                    "type": "scatter",
                    "mode": "text",
                    "x": [max(p.before, p.after) for p in mine],
                    "y": y,
                    "text": [f"    {p.before / p.after:.2f}×" for p in mine],
                    "textposition": "middle right",
                    "showlegend": False,
                    "hoverinfo": "skip",
                    "cliponaxis": False,
                    "textfont": {"color": [VERMILION if p.before < p.after else INK for p in mine]},
                    **where,
                }
            )
    for word, marker in (("caches off", PUBLISHED_BEFORE), ("caches on", PUBLISHED)):
        data.append({"type": "scatter", "mode": "markers", "x": [None], "y": [None], "marker": marker, "name": word})
    return {
        "data": data,
        "layout": layout(height, **axes, annotations=notes, margin={"l": 20, "r": 16, "t": 72, "b": 48}, legend=LEGEND),
    }


@dataclass(frozen=True)
class Bar:
    """One stacked bar: the parts in the order of the legend, and the published total (None: there is none)."""

    name: str
    parts: Sequence[float]
    published: float | None = None


def stacked(
    bars: Sequence[Bar], parts: Mapping[str, str], title: str, domain: tuple[float, float], high: float, suffix: str = ""
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Traces and axes of horizontal stacked bars on the axes `x{suffix}`, `y{suffix}`; `parts` gives each part its colour."""
    names = [b.name for b in bars][::-1]
    where = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
    data: list[dict[str, Any]] = [
        {
            "type": "bar",
            "orientation": "h",
            "x": [b.parts[k] for b in bars],
            "y": [names.index(b.name) for b in bars],
            "name": part,
            "width": 0.5,
            "marker": {"color": colour, "line": {"color": "white", "width": 1}},
            "hovertemplate": f"{part}: %{{x:.4g}}<extra></extra>",
            **where,
        }
        for k, (part, colour) in enumerate(parts.items())
    ]
    told = [b for b in bars if b.published is not None]
    data.append(
        {
            "type": "scatter",
            "mode": "markers",
            "x": [b.published for b in told],
            "y": [names.index(b.name) for b in told],
            "marker": PUBLISHED,
            "name": "measured (source 1)",
            "hovertemplate": "measured: %{x:.4g}<extra></extra>",
            "showlegend": bool(told),
            **where,
        }
    )
    return data, {
        f"xaxis{suffix}": axis(title, domain=list(domain), range=[0, high], anchor=f"y{suffix}"),
        f"yaxis{suffix}": axis(
            "",
            range=[-0.55, len(bars) - 0.45],
            tickvals=list(range(len(names))),
            ticktext=[f"<b>{n}</b>" for n in names],
            anchor=f"x{suffix}",
            showgrid=False,
            fixedrange=True,
        ),
    }


@dataclass(frozen=True)
class Factor:
    """A row of measured factors, one per recording, and a guess or model value for this row alone (None: none)."""

    row: str
    measured: Sequence[float]
    colour: str
    guess: float | None = None


def factors(
    rows: Sequence[Factor],
    title: str,
    low: float,
    high: float,
    domain: tuple[float, float] = (0, 1),
    suffix: str = "",
    guess: str = "",
    line: float | None = None,
) -> tuple[list[dict[str, Any]], dict[str, Any], list[dict[str, Any]]]:
    """Traces, axes and shapes: a row per task with its measured factors as diamonds, its guess as a bar, the model's value as a line."""
    where = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
    height = {r.row: len(rows) - 1 - i for i, r in enumerate(rows)}
    guessed = [r for r in rows if r.guess is not None]
    data: list[dict[str, Any]] = [
        {
            "type": "bar",
            "orientation": "h",
            "x": [r.guess for r in guessed],
            "y": [height[r.row] for r in guessed],
            "width": 0.34,
            "name": guess,
            "marker": {"color": [r.colour for r in guessed], "opacity": 0.55},
            "showlegend": bool(guess),
            "text": [f"{r.guess:.1f}×" for r in guessed],
            "textposition": "inside",
            "insidetextanchor": "middle",
            "hovertemplate": f"{guess}: %{{x:.2f}}×<extra></extra>",
            **where,
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": [v for r in rows for v in r.measured],
            "y": [height[r.row] for r in rows for _ in r.measured],
            "marker": PUBLISHED,
            "name": "measured (source 1)",
            "showlegend": any(r.measured for r in rows),
            "hovertemplate": "measured: %{x:.2f}×<extra></extra>",
            **where,
        },
    ]
    axes = {
        f"xaxis{suffix}": axis(title, domain=list(domain), range=[low, high], anchor=f"y{suffix}"),
        f"yaxis{suffix}": axis(
            "",
            range=[-0.6, len(rows) - 0.4],
            tickvals=list(height.values()),
            ticktext=[f"<b>{r}</b>" for r in height],
            anchor=f"x{suffix}",
            showgrid=False,
            fixedrange=True,
        ),
    }
    mark = {
        "type": "line",
        "xref": f"x{suffix}",
        "yref": f"y{suffix} domain",
        "y0": 0,
        "y1": 1,
        "line": {"color": INK, "width": 1.5, "dash": "dash"},
    }
    shapes = [{**mark, "x0": 1, "x1": 1, "line": {"color": GREY, "width": 1.5, "dash": "dot"}}]
    if line is not None:
        shapes.append({**mark, "x0": line, "x1": line, "line": {"color": VERMILION, "width": 4}})
    return data, axes, shapes
