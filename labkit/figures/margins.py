"""What analysis promises beside what happened: responses under their bounds, run times against the time reserved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labkit.figures.panel import Panel, stack
from labkit.figures.style import (
    BLUE,
    BOUND,
    CROSSED,
    DEADLINE,
    FONT,
    INK,
    OUTLINED,
    PUBLISHED,
    VERMILION,
    Spec,
    axis,
    held,
    key,
    pale,
    rows_axis,
)

EXPECTED: Spec = {"color": INK, "width": 3, "dash": "dash"}
EXCEPTIONS: Spec = {"color": BLUE, "pattern": CROSSED, "line": OUTLINED}
PERIOD: Spec = {"color": INK, "width": 4}


@dataclass(frozen=True)
class Response:
    """A task's bound, longest simulated response and deadline, in ms; None where there is no bound."""

    name: str
    bound: float | None
    longest: float
    deadline: float


def responses(rows: Sequence[Response]) -> Spec:
    """A row per task: the bound as a wide pale bar, the simulation as a narrow one inside it, the deadline as a line."""
    at = [-i for i in range(len(rows))]
    bounds = [0 if r.bound is None else r.bound for r in rows]
    most = [max(r.longest, r.deadline, bound) for r, bound in zip(rows, bounds, strict=True)]
    drawn: list[Spec] = [
        _bars(bounds, at, 0.72, BOUND, "bound"),
        _bars(
            [r.longest for r in rows],
            at,
            0.36,
            {"color": [VERMILION if r.longest > r.deadline else BLUE for r in rows], "line": {"width": 0}},
            "longest response",
        ),
        {
            "type": "scatter",
            "mode": "lines",
            "x": [v for r in rows for v in (r.deadline, r.deadline, None)],
            "y": [v for y in at for v in (y - 0.45, y + 0.45, None)],
            "line": DEADLINE,
            "showlegend": False,
            "hoverinfo": "skip",
        },
        _text(most, at, [f"  {r.longest:.1f} of {'no bound' if r.bound is None else f'{r.bound:.1f}'}" for r in rows]),
    ]
    x = axis("response time [ms]", range=[0, held(1.16 * max([125.0, *most]))])
    simulated = key("longest response, simulated", type="bar", marker={"color": BLUE})
    lanes = len(rows) + 1 - len(rows) % 2  # rarely another number, so that the rows keep their place
    y = {**rows_axis(r.name for r in rows), "range": [0.4 - lanes, 0.6]}
    return stack(Panel(drawn, y, x), height=150 + 46 * lanes, keys=("bound by analysis", simulated, "deadline"))


def reserve(
    times: np.ndarray,
    longest: float,
    expected: float,
    published: tuple[float, float],
    needs: Sequence[tuple[str, Sequence[float]]],
    period: float,
    most: float,
    height: int = 440,
) -> Spec:
    """Left: how long the jobs ran, with the expected and the longest time. Right: what each way of planning needs of a period.

    Args:
        times: run times in ms.
        longest, expected: the worst case and the ECET, in ms.
        published: (share, time in ms) of a published quantile, drawn as the point of the rising curve it is.
        needs: (name, (main parts, exception parts)) in ms per period; the same number for every picture.
        period: length of the period in ms.
        most: end of the axis of the needs in ms.
    """
    keys = (
        "published (source 2)",
        key("ECET", type="scatter", mode="lines", line=EXPECTED),
        key("main parts", type="bar", marker={"color": BLUE}),
        "beyond ECET",
        key("exception parts", type="bar", marker=EXCEPTIONS),
        key("period", type="scatter", mode="lines", line=PERIOD),
    )
    return stack([_run_times(times, longest, expected, published), _needs(needs, period, most)], height=height, keys=keys)


def _run_times(times: np.ndarray, longest: float, expected: float, published: tuple[float, float]) -> Panel:
    edges = np.arange(0.0, longest + 5, 5.0)
    count = np.histogram(times, edges)[0] * (100 / len(times))
    middle = (edges[:-1] + edges[1:]) / 2
    steps = np.sort(times)
    drawn: list[Spec] = [
        {
            "type": "bar",
            "x": middle,
            "y": count,
            "width": 5.0,
            "showlegend": False,
            "marker": {"color": [BLUE if m <= expected else pale(BLUE) for m in middle], "line": {"color": "white", "width": 1}},
            "hovertemplate": "about %{x} ms: %{y:.1f} % of the jobs<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": steps,
            "y": np.arange(1, len(steps) + 1) * (100 / len(steps)),
            "line": {"color": INK, "width": 3},
            "showlegend": False,
            "hovertemplate": "%{y:.1f} % run at most %{x:.1f} ms<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": [published[1], longest],
            "y": [100 * published[0], 100],
            "marker": PUBLISHED,
            "showlegend": False,
            "cliponaxis": False,
            "hovertemplate": "published: %{y:.0f} % below %{x:.0f} ms<extra></extra>",
        },
        _line([expected, expected], [0, 100], EXPECTED),
    ]
    x = axis("run time of a contour filter [ms]", range=[0, longest + 5])
    return Panel(drawn, axis("share of the jobs [%]", range=[0, 104]), x, width=1.1)


def _needs(needs: Sequence[tuple[str, Sequence[float]]], period: float, most: float) -> Panel:
    at = [-i for i in range(len(needs))]
    totals = [sum(parts) for _, parts in needs]
    main, exception = zip(*(parts for _, parts in needs), strict=True)
    drawn = [
        _bars(main, at, 0.55, {"color": BLUE}, "main parts"),
        _bars(exception, at, 0.55, EXCEPTIONS, "exception parts") | {"base": main},
        _text(
            [max(total, period) for total in totals],
            at,
            [f"  <b>{total:.0f} ms</b>" for total in totals],
            [VERMILION if total > period else INK for total in totals],
        ),
        _line([period, period], [0.4 - len(needs), 0.8], PERIOD),
    ]
    x = axis("processor time in a period [ms]", range=[0, most])
    y = rows_axis((name for name, _ in needs))
    return Panel(drawn, {**y, "range": [0.4 - len(needs), 0.8]}, x, left=190)


def _bars(length: Sequence[float], at: Sequence[float], width: float, marker: Spec, words: str) -> Spec:
    return {
        "type": "bar",
        "orientation": "h",
        "x": length,
        "y": at,
        "width": width,
        "marker": marker,
        "showlegend": False,
        "hovertemplate": f"{words} %{{x:.2f}} ms<extra></extra>",
    }


def _line(x: Sequence[float], y: Sequence[float], line: Spec) -> Spec:
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": line, "showlegend": False, "hoverinfo": "skip"}


def _text(x: Sequence[float], y: Sequence[float], text: Sequence[str], colour: str | Sequence[str] = INK) -> Spec:
    return {
        "type": "scatter",
        "mode": "text",
        "x": x,
        "y": y,
        "text": text,
        "textposition": "middle right",
        "textfont": {"size": FONT, "color": colour},
        "cliponaxis": False,
        "showlegend": False,
        "hoverinfo": "skip",
    }
