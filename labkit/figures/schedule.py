"""Schedules of periodic jobs, one panel per policy: who ran, in which part, what was aborted, which deadline was missed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.style import BLUE, GREY, INK, LEGEND, VERMILION, axis, colours, layout
from labkit.trace import Jobs, Trace, jobs
from labkit.trace.jobs import owners

BAR, THIN = 0.56, 0.1  # heights in a row of height 1: a slice, the wait of an unfinished job
EXCEPTION = {
    "pattern": {"shape": "x", "fillmode": "overlay", "fgcolor": "white", "fgopacity": 1, "size": 7, "solidity": 0.3},
    "line": {"color": INK, "width": 1.5},
}
RELEASE = {"symbol": "triangle-up", "size": 11, "color": INK}
DEADLINE = {"color": INK, "width": 2}
ABORT = {"symbol": "octagon", "size": 13, "color": "white", "line": {"color": INK, "width": 3}}
MISS = {"symbol": "x", "size": 15, "color": VERMILION, "line": {"color": "white", "width": 1.5}}


@dataclass(frozen=True)
class Panel:
    """One schedule, its title, and a remark to stand behind the title in the colour of an alarm."""

    title: str
    trace: Trace
    remark: str = ""


def schedule(
    panels: Sequence[Panel], deadlines: Mapping[str, int], end: float, height: int = 560, pairs: bool = True
) -> dict[str, Any]:
    """Panels one above the other on one time axis.

    Args:
        panels: traces of `labkit.scheduler.periodic.simulate`.
        deadlines: task -> relative deadline in units of the trace, in the order of the rows from top to bottom; a task
            that is not in a trace has an empty row.
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
            "",
            domain=[top - share + 0.05 * share, top - 0.17 * share],
            range=[-0.5, len(tasks) - 0.4],
            tickvals=list(row.values()),
            ticktext=[f"<b>{name}</b>" for name in row],
            showgrid=False,
            fixedrange=True,
            automargin=False,
        )
        data += _traces(panel.trace, row, deadlines, end, f"y{suffix}")
        remark = f'   <span style="color:{VERMILION}">{panel.remark}</span>' if panel.remark else ""
        notes.append(
            {
                "text": f"<b>{panel.title}</b>{remark}",
                "xref": "paper",
                "yref": "paper",
                "x": 0,
                "y": top - 0.17 * share,
                "yanchor": "bottom",
                "xanchor": "left",
                "showarrow": False,
                "font": {"size": 17},
            }
        )
    data += _legend(pairs)
    return {
        "data": data,
        "layout": layout(
            height,
            **axes,
            xaxis=axis("time [ms]", range=[0, end], anchor=f"y{len(panels) if len(panels) > 1 else ''}", automargin=False),
            barmode="overlay",
            annotations=notes,
            legend=LEGEND,
            margin={"l": 104, "r": 16, "t": 34, "b": 58},
        ),
    }


def pale(colour: str) -> str:
    """A colour "#rrggbb" mixed with white; not transparent, since a line lies under the bars."""
    return "#" + "".join(f"{255 - round(0.45 * (255 - int(colour[i : i + 2], 16))):02x}" for i in (1, 3, 5))


def _ms(trace: Trace, time: Any) -> Any:
    return time * (1e3 / trace.hz)


def _legend(pairs: bool) -> list[dict[str, Any]]:
    """Entries of their own: plotly leaves out those of traces that happen to be empty."""

    def entry(kind: str, name: str, show: bool = True, **more: Any) -> dict[str, Any]:
        return {"type": kind, "x": [None], "y": [None], "name": name, "showlegend": show, **more}

    return [
        entry("scatter", "release", mode="markers", marker=RELEASE),
        entry("scatter", "deadline", mode="lines", line=DEADLINE),
        entry("scatter", "deadline missed", mode="markers", marker=MISS),
        entry("bar", "beyond expected time", pairs, marker={"color": pale(BLUE)}),
        entry("scatter", "main part aborted", pairs, mode="markers", marker=ABORT),
        entry("bar", "exception part", pairs, marker={"color": BLUE} | EXCEPTION),
    ]


def _traces(trace: Trace, row: Mapping[str, float], deadlines: Mapping[str, int], end: float, yaxis: str) -> list[dict[str, Any]]:
    limit = end * trace.hz / 1e3
    of, exception = owners(trace)
    owner = [trace.names[task] for task in of.tolist()]
    colour = colours(row)
    switch = trace.rows("switch")
    task, start, level = switch[:, 2], switch[:, 0], switch[:, 4]
    stop = np.append(start[1:], trace.end)
    taft = exception.any()

    def bars(kept: np.ndarray, label: str, shade: Callable[[str], str] = str, **marker: Any) -> dict[str, Any]:
        kept = kept & (task >= 0) & (stop > start) & (start < limit)
        who = [owner[t] for t in task[kept].tolist()]
        return {
            "type": "bar",
            "orientation": "h",
            "base": _ms(trace, start[kept]),
            "x": _ms(trace, stop[kept] - start[kept]),
            "width": BAR,
            "y": [row[name] for name in who],
            "yaxis": yaxis,
            "showlegend": False,
            "customdata": who,
            "marker": {"color": [shade(colour[name]) for name in who], "line": {"width": 0}, **marker},
            "hovertemplate": f"%{{customdata}}{label}<br>from %{{base:.3f}} ms for %{{x:.3f}} ms<extra></extra>",
        }

    def marks(time: np.ndarray, task: np.ndarray, job: np.ndarray, marker: dict[str, Any], label: str) -> dict[str, Any]:
        shown = (time >= 0) & (time <= limit)
        return {
            "type": "scatter",
            "mode": "markers",
            "x": _ms(trace, time[shown]),
            "y": [row[owner[t]] for t in task[shown].tolist()],
            "yaxis": yaxis,
            "marker": marker,
            "cliponaxis": False,
            "showlegend": False,
            "customdata": job[shown],
            "hovertemplate": f"{label}: job %{{customdata}} at %{{x:.3f}} ms<extra></extra>",
        }

    table = jobs(trace)
    releases = trace.rows("release")
    releases = releases[releases[:, 0] <= limit]
    names = [owner[t] for t in releases[:, 2].tolist()]
    at = np.array([row[name] for name in names])
    due = releases[:, 4] + np.array([deadlines[name] for name in names], dtype=np.int64)
    shown = due <= limit
    ran = exception[task] & (task >= 0)
    return [
        _waiting(trace, table, row, limit, yaxis),
        bars(~ran & ~(taft & (level == 0)), ""),
        bars(~ran & taft & (level == 0), ", beyond its expected time", pale),
        bars(ran, ", exception part", **EXCEPTION),
        {
            "type": "scatter",
            "mode": "lines",
            "x": _gaps(_ms(trace, due[shown]), _ms(trace, due[shown])),
            "y": _gaps(at[shown] - 0.46, at[shown] + 0.42),
            "yaxis": yaxis,
            "line": DEADLINE,
            "showlegend": False,
            "hoverinfo": "skip",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": _ms(trace, releases[:, 0]),
            "y": at - 0.36,
            "marker": RELEASE,
            "yaxis": yaxis,
            "cliponaxis": False,
            "showlegend": False,
            "hovertemplate": "release %{x:.3f} ms<extra></extra>",
        },
        marks(table.abort, table.task, table.job, ABORT, "main part aborted"),
        marks(np.where(table.missed, table.deadline, -1), table.task, table.job, MISS, "deadline missed"),
    ]


def _waiting(trace: Trace, table: Jobs, row: Mapping[str, float], limit: float, yaxis: str) -> dict[str, Any]:
    """A thin bar from the release of each job to its end, under the slices: where only it is seen, the job waits.

    A job that is not complete in the picture waits to its end; one whose exception part came too late is dropped when it is due.
    """
    begun = (table.release >= 0) & (table.release < limit)
    last = min(int(limit), trace.end)
    dropped = (table.abort >= 0) & table.missed
    release, ended = table.release[begun], np.where(dropped, table.deadline, table.completion)[begun]
    end = np.where((ended >= 0) & (ended <= limit), ended, last)
    return {
        "type": "bar",
        "orientation": "h",
        "base": _ms(trace, release),
        "x": _ms(trace, end - release),
        "y": [row[trace.names[task]] for task in table.task[begun].tolist()],
        "width": THIN,
        "yaxis": yaxis,
        "marker": {"color": GREY, "line": {"width": 0}},
        "name": "released, waits",
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _gaps(low: Sequence[float], high: Sequence[float]) -> np.ndarray:
    """low, high, nan for each: many separate lines in one trace."""
    return np.stack([low, high, np.full(len(low), np.nan)], axis=1).ravel()
