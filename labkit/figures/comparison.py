"""Measured numbers beside each other and beside a model's: dumbbells (before, after), rows of factors, stacked costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log10
from typing import Any

from labkit.figures.panel import Panel, stack
from labkit.figures.style import (
    BLUE,
    FONT,
    GREY,
    INK,
    PUBLISHED,
    PUBLISHED_BEFORE,
    SMALL,
    VERMILION,
    Spec,
    axis,
    colours,
    key,
    rows_axis,
)

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
) -> Spec:
    """Panels side by side, each with a row per name and in it a dumbbell per series (upper, lower) from `before` to `after`.

    All have a logarithmic axis `title` from `low` to `high`. The factor before / after stands right of each dumbbell.
    """
    made = [
        Panel(
            [trace for upper in (True, False) for trace in _dumbbells(pairs, upper, series[0] if upper else series[1])],
            rows_axis(dict.fromkeys(p.row for p in pairs)),
            axis(
                title,
                type="log",
                range=[log10(low), log10(high)],
                dtick=1,
                minor={"dtick": "D1", "showgrid": True, "gridcolor": "#f3f5f7"},
            ),
            title=name,
            left=142,
        )
        for name, pairs in panels.items()
    ]
    words = (f"{series[0]} (upper of the two)", INK), (f"{series[1]} (lower)", GREY)
    lines = [key(word, type="scatter", mode="lines", line={"color": colour, "width": 3}) for word, colour in words]
    before = key("caches off", type="scatter", mode="markers", marker=PUBLISHED_BEFORE)
    after = key("caches on", type="scatter", mode="markers", marker=PUBLISHED)
    return stack(made, height=height, keys=[*lines, before, after])


def _dumbbells(pairs: Sequence[Pair], upper: bool, word: str) -> list[Spec]:
    """Lines, points before, points after, factors."""
    place = {row: -i for i, row in enumerate(dict.fromkeys(p.row for p in pairs))}
    colour = colours(place)
    mine = [p for p in pairs if p.upper == upper]
    y = [place[p.row] + (LIFT if upper else -LIFT) for p in mine]
    paint = [colour[p.row] for p in mine]

    def points(values: list[float], state: str, marker: Spec) -> Spec:
        return {
            "type": "scatter",
            "mode": "markers",
            "x": values,
            "y": y,
            "marker": marker,
            "showlegend": False,
            "customdata": [p.row for p in mine],
            "hovertemplate": f"%{{customdata}}, {word}, caches {state}: %{{x}}<extra></extra>",
        }

    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": [v for p in mine for v in (p.before, p.after, None)],
            "y": [v for at in y for v in (at, at, None)],
            "line": {"color": INK if upper else GREY, "width": 3},
            "showlegend": False,
            "hoverinfo": "skip",
        },
        points([p.before for p in mine], "off", {**PUBLISHED_BEFORE, "line": {"width": 2.5, "color": paint}}),
        points([p.after for p in mine], "on", {**PUBLISHED, "color": paint}),
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
            "textfont": {"size": FONT, "color": [VERMILION if p.before < p.after else INK for p in mine]},
        },
    ]


@dataclass(frozen=True)
class Bar:
    """One stacked bar: the parts in the order of the legend, and the published total (None: there is none)."""

    name: str
    parts: Sequence[float]
    published: float | None = None


def stacked(bars: Sequence[Bar], parts: Mapping[str, str], x: Spec, **more: Any) -> Panel:
    """Horizontal stacked bars over the axis `x`; `parts` gives each part its colour. `more`: other attributes of the `Panel`."""
    drawn: list[Spec] = [
        {
            "type": "bar",
            "orientation": "h",
            "x": [b.parts[k] for b in bars],
            "y": [-i for i in range(len(bars))],
            "name": part,
            "width": 0.5,
            "marker": {"color": colour, "line": {"color": "white", "width": 1}},
            "hovertemplate": f"{part}: %{{x:.4g}}<extra></extra>",
        }
        for k, (part, colour) in enumerate(parts.items())
    ]
    told = {-i: b.published for i, b in enumerate(bars) if b.published is not None}
    drawn.append(_published(list(told.values()), list(told)))
    return Panel(drawn, rows_axis((b.name for b in bars), margin=0.55), x, **more)


@dataclass(frozen=True)
class Factor:
    """A row of measured factors, one per recording, and a guess or model value for this row alone (None: none)."""

    row: str
    measured: Sequence[float]
    colour: str
    guess: float | None = None


def factors(rows: Sequence[Factor], x: Spec, guess: str = "", line: float | None = None, **more: Any) -> Panel:
    """A row per task with its measured factors as diamonds and its guess as a bar; a line at 1 and one at the model's value.

    `guess` is what the legend calls the bars. `more` are other attributes of the `Panel`.
    """
    guessed = [(-i, r.guess, r.colour) for i, r in enumerate(rows) if r.guess is not None]
    bars: Spec = {
        "type": "bar",
        "orientation": "h",
        "x": [value for _, value, _ in guessed],
        "y": [at for at, _, _ in guessed],
        "width": 0.4,
        "name": guess,
        "marker": {"color": [colour for _, _, colour in guessed], "opacity": 0.55},
        "showlegend": bool(guess),
        "text": [f"{value:.1f}×" for _, value, _ in guessed],
        "textposition": "inside",
        "insidetextanchor": "middle",
        "constraintext": "none",
        "textangle": 0,
        "textfont": {"size": SMALL, "color": INK},
        "hovertemplate": f"{guess}: %{{x:.2f}}×<extra></extra>",
    }
    measured = [(v, -i) for i, r in enumerate(rows) for v in r.measured]
    marks = [(1.0, GREY, 1.5, "dot"), *([] if line is None else [(line, BLUE, 4, "solid")])]
    shapes = [
        {"type": "line", "yref": "y domain", "x0": at, "x1": at, "y0": 0, "y1": 1, "line": {"color": c, "width": w, "dash": d}}
        for at, c, w, d in marks
    ]
    points = _published([v for v, _ in measured], [at for _, at in measured])
    return Panel([bars, points], rows_axis(r.row for r in rows), x, shapes, **more)


def _published(x: Sequence[float], y: Sequence[float]) -> Spec:
    """Diamonds; the legend has an entry of its own for them."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": y,
        "marker": PUBLISHED,
        "name": "measured (source 1)",
        "showlegend": False,
        "hovertemplate": "measured: %{x:.4g}<extra></extra>",
    }
