"""Who ran when, and under it counts that go up and down with it: items in a queue, events raised and served."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.style import GREY, INK, axis, layout
from labkit.figures.timeline import bars_of
from labkit.trace import Trace


@dataclass(frozen=True)
class Steps:
    """A count over time: `time` in ms and the `value` from then on; `colour` as text, `dash` as plotly has it."""

    name: str
    time: np.ndarray
    value: np.ndarray
    colour: str = INK
    dash: str = "solid"


def activity(
    trace: Trace,
    tasks: Sequence[str],
    steps: Sequence[Steps],
    counts: str,
    end: float,
    height: int = 480,
    marks: Mapping[str, tuple[np.ndarray, float | np.ndarray, str, str]] | None = None,
) -> dict[str, Any]:
    """Rows of `tasks` (running, ready, waiting) above a panel of step lines whose axis is titled `counts`.

    `marks` are points in the lower panel: name -> (times in ms, heights, plotly symbol, colour). `end` is the end of the time axis in ms.
    """
    lower = 0.94 - 0.2 * len(tasks)  # share of the picture left for the counts
    row = {name: float(len(tasks) - 1 - i) for i, name in enumerate(tasks)}
    data = bars_of(trace, row, (), "y", legend=True, waiting="waits")
    for s in steps:
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": np.append(s.time, end),
                "y": np.append(s.value, s.value[-1:] if len(s.value) else 0),
                "yaxis": "y2",
                "name": s.name,
                "line": {"shape": "hv", "color": s.colour, "width": 3, "dash": s.dash},
                "hovertemplate": f"{s.name}: %{{y}} from %{{x:.3f}} ms<extra></extra>",
            }
        )
    for name, (x, y, symbol, colour) in (marks or {}).items():
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": x,
                "y": np.broadcast_to(y, np.shape(x)),
                "yaxis": "y2",
                "name": name,
                "marker": {"symbol": symbol, "size": 12, "color": colour, "line": {"width": 2, "color": colour}},
                "hovertemplate": f"{name} at %{{x:.3f}} ms<extra></extra>",
            }
        )
    return {
        "data": data,
        "layout": layout(
            height,
            barmode="overlay",
            margin={"l": 64, "r": 16, "t": 46, "b": 52},
            xaxis=axis("time [ms]", range=[0, end], anchor="y2"),
            yaxis=axis(
                "",
                domain=[lower + 0.06, 1],
                range=[-0.6, len(tasks) - 0.4],
                tickvals=list(row.values()),
                ticktext=[f"<b>{name}</b>" for name in row],
                showgrid=False,
                fixedrange=True,
            ),
            yaxis2=axis(counts, domain=[0, lower], rangemode="tozero", gridcolor="#e6e9ec", linecolor=GREY),
        ),
    }
