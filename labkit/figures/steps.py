"""Numbers that stay until they change, over time: counts, and the priorities of tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.panel import Panel
from labkit.figures.style import INK, Spec, axis, colours
from labkit.trace import Trace
from labkit.trace import priorities as steps_of


@dataclass(frozen=True)
class Steps:
    """A count over time: `time` in ms and the `value` from then on; `colour` as text, `dash` as plotly has it."""

    name: str
    time: np.ndarray
    value: np.ndarray
    colour: str = INK
    dash: str = "solid"


@dataclass(frozen=True)
class Marks:
    """Points beside the steps: times in ms, one height for all or one each, a plotly symbol and a colour."""

    name: str
    time: np.ndarray
    value: float | np.ndarray
    symbol: str
    colour: str


def steps(
    lines: Sequence[Steps], title: str, end: float, marks: Sequence[Marks] = (), top: float | None = None, **more: Any
) -> Panel:
    """Step lines until `end` in ms, and points, over an axis with this title, which ends at `top` if that is given. `more` are
    other attributes of the `Panel`.
    """
    drawn = [_line(s, end) for s in lines] + [_points(m) for m in marks]
    most = max((s.value.max(initial=0) for s in lines), default=0) if top is None else top
    few = {"dtick": 1 if most <= 4 else 2} if most <= 8 else {}  # plotly would draw halves of what is counted
    ends = {"rangemode": "tozero"} if top is None else {"range": [0, top], "fixedrange": True}
    return Panel(drawn, axis(title, **ends, **few), **more)


def priorities(trace: Trace, base: Mapping[str, int], **more: Any) -> Panel:
    """The current priority of each task of `base`, whose base priority it names. `more` are other attributes of the `Panel`.

    Only the lowest and the highest level are labelled: a panel may be so low that others would touch them.
    """
    found, colour, levels = steps_of(trace), colours(base), sorted(set(base.values()))
    drawn = []
    for i, name in enumerate(base):
        mine = found[found[:, 0] == trace.code(name)]
        aside = (i - (len(base) - 1) / 2) * 0.12  # so that equal priorities stay visible side by side
        level = np.repeat(mine[:, 3], 2)
        drawn.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": (mine[:, 1:3].ravel() - trace.start) * (1e3 / trace.hz),
                "y": level + aside,
                "line": {"color": colour[name], "width": 4},
                "showlegend": False,
                "customdata": level,
                "hovertemplate": f"{name}: priority %{{customdata}} at %{{x:.3f}} ms<extra></extra>",
            }
        )
    text = [str(level) if level in (levels[0], levels[-1]) else "" for level in levels]
    ends = [levels[0] - 0.6, levels[-1] + 0.6]
    y = axis("priority", range=ends, tickvals=levels, ticktext=text, fixedrange=True, automargin=False)
    return Panel(drawn, y, **more)


def _line(s: Steps, end: float) -> Spec:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.append(s.time, end),
        "y": np.append(s.value, s.value[-1:] if len(s.value) else 0),
        "name": s.name,
        "line": {"shape": "hv", "color": s.colour, "width": 3, "dash": s.dash},
        "hovertemplate": f"{s.name}: %{{y}} from %{{x:.3f}} ms<extra></extra>",
    }


def _points(m: Marks) -> Spec:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": m.time,
        "y": np.broadcast_to(m.value, np.shape(m.time)),
        "name": m.name,
        "marker": {"symbol": m.symbol, "size": 12, "color": m.colour, "line": {"width": 2, "color": m.colour}},
        "hovertemplate": f"{m.name} at %{{x:.3f}} ms<extra></extra>",
    }
