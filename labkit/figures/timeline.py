"""Who ran, who waited for which lock, who held it and at which priority: one panel per trace, one above the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from labkit.figures.style import GREY, INK, SKY, VERMILION, YELLOW, axis, colours, layout
from labkit.trace import Trace
from labkit.trace.folds import holds, priorities, ready, runs, waits

BAR, THIN, STRIP = 0.6, 0.12, 0.36  # heights in a row: a run, readiness, the strip of one lock below it
LOCK_COLOURS = (YELLOW, SKY, "#F4B6C2", "#B8E0B0")


@dataclass(frozen=True)
class Panel:
    """One timeline of the figure.

    Attributes:
        title: what this trace is, shown above it.
        trace: a kernel trace.
        remark: (time, task, text): a text to the right of that time in the row of that task.
        alarms: times to mark across all rows.
    """

    title: str
    trace: Trace
    remark: tuple[int, str, str] | None = None
    alarms: Sequence[int] = field(default=())


def timeline(
    panels: Sequence[Panel],
    tasks: Sequence[str],
    base: Mapping[str, int],
    end: float,
    locks: Sequence[str] = (),
    height: int = 540,
) -> dict[str, Any]:
    """Panels of rows: running (solid), ready (thin), waiting for a lock (hatched), holding it (strip below), and the priorities.

    `tasks` are the rows from top to bottom, `base` their base priorities, `end` the end of the time axis in ms. The number
    and order of plotly traces depends on the number of panels and tasks only.
    """
    pitch = 0.85 + STRIP * len(locks)
    row = {name: (len(tasks) - 1 - i) * pitch for i, name in enumerate(tasks)}
    levels = sorted(set(base.values()))
    share = 1 / len(panels)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    notes: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    for i, panel in enumerate(panels):
        low, top = 1 - (i + 1) * share, 1 - i * share
        gantt, steps = (f"y{n}" if n > 1 else "y" for n in (2 * i + 1, 2 * i + 2))
        axes[gantt.replace("y", "yaxis")] = axis(
            "",
            domain=[low + 0.33 * share, top - 0.1 * share],
            range=[-0.4 - STRIP * len(locks), row[tasks[0]] + 0.45],
            tickvals=list(row.values()),
            ticktext=[f"<b>{name}</b>" for name in row],
            showgrid=False,
            fixedrange=True,
            automargin=False,
        )
        axes[steps.replace("y", "yaxis")] = axis(
            "priority",
            domain=[low + 0.06 * share, low + 0.29 * share],
            range=[levels[0] - 0.6, levels[-1] + 0.6],
            tickvals=levels,
            fixedrange=True,
            automargin=False,
        )
        data += bars_of(panel.trace, row, locks, gantt, legend=i == 0)
        data += _steps(panel.trace, tasks, steps)
        notes.append(
            {
                "text": f"<b>{panel.title}</b>",
                "xref": "paper",
                "yref": "paper",
                "x": 0,
                "y": top,
                "yanchor": "top",
                "xanchor": "left",
                "showarrow": False,
                "font": {"size": 17},
            }
        )
        if panel.remark is not None:
            time, name, text = panel.remark
            notes.append(
                {
                    "text": f"  {text}",
                    "x": _ms(panel.trace, time),
                    "xref": "x",
                    "xanchor": "left",
                    "y": row[name],
                    "yref": gantt,
                    "showarrow": False,
                    "bgcolor": "rgba(255,255,255,0.85)",
                }
            )
        shapes += [
            {
                "type": "line",
                "xref": "x",
                "x0": _ms(panel.trace, at),
                "x1": _ms(panel.trace, at),
                "yref": f"{gantt} domain",
                "y0": 0,
                "y1": 1,
                "line": {"color": VERMILION, "width": 3, "dash": "dot"},
            }
            for at in panel.alarms
        ]
    return {
        "data": data,
        "layout": layout(
            height,
            **axes,
            xaxis=axis("time [ms]", range=[0, end], anchor=f"y{2 * len(panels)}", automargin=False),
            barmode="overlay",
            annotations=notes,
            shapes=shapes,
            margin={"l": max(70, 26 + 10 * max(map(len, tasks))), "r": 16, "t": 32, "b": 58},
            legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1, "xanchor": "right"},
        ),
    }


def _ms(trace: Trace, time: Any) -> Any:
    return (time - trace.start) * (1e3 / trace.hz)


def bars_of(
    trace: Trace, row: Mapping[str, float], locks: Sequence[str], yaxis: str, legend: bool, waiting: str = "waits for lock"
) -> list[dict[str, Any]]:
    """The five plotly traces of a Gantt chart: ready, waiting, running, holding a lock, releases; `row` gives the height of each task."""
    names = np.array(trace.names, dtype=object)
    colour = colours(row)
    wide = _ms(trace, trace.end) / 25  # a bar with room for a name

    def bars(intervals: np.ndarray, height: float, place: Callable[..., list[float]], label: str, **more: Any) -> dict[str, Any]:
        kept = intervals[np.isin(intervals[:, 0], [i for i, name in enumerate(names) if name in row])]
        who, what = names[kept[:, 0]], names[kept[:, 1]] if kept.shape[1] == 4 else [""] * len(kept)
        start, end = _ms(trace, kept[:, -2]), _ms(trace, kept[:, -1])
        made = {
            "type": "bar",
            "orientation": "h",
            "base": start,
            "x": end - start,
            "y": place(who, what),
            "width": height,
            "yaxis": yaxis,
            "name": label,
            "legendgroup": label,
            "showlegend": legend,
            "text": [o if length > wide else "" for o, length in zip(what, end - start, strict=True)],
            "textposition": "none",
            "customdata": [f"{n} {label} {o}".strip() for n, o in zip(who, what, strict=True)],
            "hovertemplate": "%{customdata}<br>from %{base:.3f} ms for %{x:.3f} ms<extra></extra>",
        }
        more = {key: value(who, what) if callable(value) else value for key, value in more.items()}
        return made | more

    def middle(who: Sequence[str], what: Sequence[str]) -> list[float]:
        return [row[n] for n in who]

    def strip(who: Sequence[str], what: Sequence[str]) -> list[float]:
        return [
            row[n] - BAR / 2 - STRIP * (locks.index(o) + 0.5) if o in locks else row[n] for n, o in zip(who, what, strict=True)
        ]

    releases = trace.rows("release")
    releases = releases[[names[t] in row for t in releases[:, 2]]] if len(releases) else releases
    return [
        bars(ready(trace), THIN, middle, "ready, not running", marker={"color": GREY}),
        bars(
            waits(trace),
            BAR,
            middle,
            waiting,
            marker={
                "color": "rgba(255,255,255,0)",
                "line": {"color": GREY, "width": 1.5},
                "pattern": {"shape": "/", "fgcolor": GREY, "size": 7, "solidity": 0.25},
            },
        ),
        bars(
            runs(trace),
            BAR,
            middle,
            "runs",
            showlegend=False,
            marker=lambda who, _: {"color": [colour[n] for n in who], "line": {"width": 0}},
        ),
        bars(
            holds(trace),
            0.85 * STRIP,
            strip,
            "holds lock",
            showlegend=legend and bool(locks),
            textposition="inside",
            insidetextanchor="middle",
            constraintext="none",
            textangle=0,
            textfont={"size": 12, "color": INK},
            marker=lambda _, what: {
                "color": [LOCK_COLOURS[locks.index(o) % len(LOCK_COLOURS)] if o in locks else YELLOW for o in what],
                "line": {"color": INK, "width": 1},
            },
        ),
        {
            "type": "scatter",
            "mode": "markers",
            "x": _ms(trace, releases[:, 4]),
            "y": [row[names[t]] - BAR / 2 for t in releases[:, 2]],
            "marker": {"symbol": "triangle-up", "size": 11, "color": INK},
            "yaxis": yaxis,
            "cliponaxis": False,
            "name": "release",
            "legendgroup": "release",
            "showlegend": legend,
            "hovertemplate": "release %{x:.3f} ms<extra></extra>",
        },
    ]


def _steps(trace: Trace, tasks: Sequence[str], yaxis: str) -> list[dict[str, Any]]:
    steps, colour = priorities(trace), colours(tasks)
    made = []
    for i, name in enumerate(tasks):
        mine = steps[steps[:, 0] == trace.code(name)]
        offset = (i - (len(tasks) - 1) / 2) * 0.12  # so that equal priorities stay visible side by side
        made.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": _ms(trace, mine[:, 1:3]).ravel(),
                "y": np.repeat(mine[:, 3], 2) + offset,
                "yaxis": yaxis,
                "name": name,
                "line": {"color": colour[name], "width": 4},
                "showlegend": False,
                "customdata": np.repeat(mine[:, 3], 2),
                "hovertemplate": f"{name}: priority %{{customdata}} at %{{x:.3f}} ms<extra></extra>",
            }
        )
    return made
