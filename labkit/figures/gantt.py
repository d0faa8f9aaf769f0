"""Who ran when: one way to draw the trace of any scheduler, from three jobs to a million slices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labkit.figures.history import BEYOND, EXCEPTION, MAIN, History
from labkit.figures.outline import CROSS, outline
from labkit.figures.panel import WIDTH, Panel
from labkit.figures.style import (
    ABORT,
    CROSSED,
    DEADLINE,
    FONT,
    INK,
    INVERTED,
    LOCKS,
    MISS,
    OUTLINED,
    READY,
    RELEASE,
    VERMILION,
    WAITS,
    Spec,
    axis,
    colours,
    key,
    pale,
)
from labkit.trace import Trace

BAR, THIN, STRIP = 0.6, 0.11, 0.36  # heights, in rows: a run, readiness, the strip of one lock below
MOST = 2000  # marks in one Gantt; with more of them plotly needs longer than a picture may take
COLUMNS = 700  # of the busy share: one for about four pixels, with what goes beyond the window on either side

#: Columns of each kind of interval or event, for where there is none.
WIDTHS = {"runs": 5, "ready": 3, "waits": 4, "holds": 4, "release": 3, "deadline": 3}

Table = np.ndarray  # int64, shape (n, m): the task's index first; of an interval start and end last


@dataclass(frozen=True)
class _View:
    """The window drawn, from `low` to `high` in units of the trace, the row of each task (its index in the trace), and the time
    in ms that a pixel shows, about.
    """

    history: History
    low: int
    high: int
    rows: Mapping[int, int]
    pitch: float
    pixel: float

    def ms(self, time: Any) -> Any:
        return (time - self.history.trace.start) * (1e3 / self.history.trace.hz)

    def row(self, task: Table) -> Table:
        """The number of the row of each task, from 0 at the top."""
        table = np.zeros(len(self.history.trace.names), np.int64)
        table[list(self.rows)] = list(self.rows.values())
        return table[task]

    def height(self, task: Table) -> np.ndarray:
        return -self.pitch * self.row(task)

    def intervals(self, table: Table) -> Table:
        """Those in the window and in a row, of a table in order of starts."""
        some = table[: int(np.searchsorted(table[:, -2], self.high))]
        return some[np.isin(some[:, 0], list(self.rows)) & (some[:, -1] > self.low)]

    def events(self, table: Table) -> Table:
        """Those in the window and in a row."""
        time = table[:, -1]
        return table[(time >= self.low) & (time <= self.high) & np.isin(table[:, 0], list(self.rows))]

    def slices(self, table: Table) -> Table:
        """Like `intervals`, of slices that do not overlap: found without a look at all of them."""
        return self.intervals(table[int(np.searchsorted(table[:, -1], self.low, side="right")) :])


def gantt(
    trace: Trace | History,
    tasks: Sequence[str],
    start: float,
    end: float,
    *,
    locks: Sequence[str] = (),
    pairs: bool = False,
    remarks: Sequence[tuple[int, str, str]] = (),
    alarms: Sequence[int] = (),
    bands: Sequence[tuple[int, int]] = (),
    labels: Mapping[str, str] | None = None,
    **more: Any,
) -> Panel:
    """A row per task: running, ready, waiting, what becomes of its jobs, and a strip below it for each lock it holds.

    More than `MOST` marks are not drawn one by one: each row then shows as a filled curve which share of the time its task ran.
    The number and order of traces depends on `tasks`, `locks` and `pairs` only.

    Args:
        trace: of any scheduler of the lab; a `History` of it where more than one window is drawn.
        tasks: the rows from top to bottom. One that is not in the trace has an empty row.
        start, end: the time axis in ms from the start of the trace. What is drawn goes half as far again on either side.
        locks: those that get a strip.
        pairs: whether the tasks have exception parts, so that aborts and what is beyond the expected time are drawn.
        remarks: (time, task, text): a text to the right of that time, in units of the trace, in the row of that task.
        alarms: times, in units of the trace, to mark across all rows.
        bands: stretches of time, in units of the trace, in which something is wrong: shaded across all rows.
        labels: what the axis calls a task, where that is not its name.
        more: other attributes of the `Panel`.
    """
    history = trace if isinstance(trace, History) else History(trace)
    trace = history.trace
    pitch = 1 + STRIP * len(locks)
    height = {name: -i * pitch for i, name in enumerate(tasks)}
    text = [(labels or {}).get(name, name) for name in tasks]
    unit, pad = trace.hz / 1e3, (end - start) / 2
    low, high = (trace.start + int(at * unit) for at in (start - pad, end + pad))
    rows = {trace.names.index(name): i for i, name in enumerate(tasks) if name in trace.names}
    view = _View(history, max(low, trace.start), min(high, trace.end), rows, pitch, (end - start) / WIDTH)
    axis_y = axis(
        "",
        range=[0.5 - len(tasks) * pitch, 0.5],
        tickvals=list(height.values()),
        ticktext=[f"<b>{name}</b>" for name in text],
        showgrid=False,
        fixedrange=True,
        automargin=False,
    )
    known = {
        "notes": [_remark(view.ms(at), height[name], words) for at, name, words in remarks],
        "shapes": [_band(*map(view.ms, band)) for band in bands] + [_alarm(view.ms(at)) for at in alarms],
        "left": max(70, 26 + 11 * max(map(len, text))),
        "height": pitch * len(tasks),
    }
    return Panel(_traces(view, tasks, locks, pairs), axis_y, **{**known, **more})


def _traces(view: _View, tasks: Sequence[str], locks: Sequence[str], pairs: bool) -> list[Spec]:
    paint, exact = list(colours(tasks).values()), _exact(view)
    found = _crowded(view) if exact is None else exact
    waits, runs = found["waits"], found["runs"]
    names = np.array([*view.history.trace.names, "a notification"], dtype=object)
    drawn = _shares(view, tasks, paint, dense=exact is None)
    drawn.append(_bars(view, waits, BAR, WAITS, "waits for %{customdata}", names[waits[:, 1]].tolist()))
    plain = [_readiness(view, found["ready"]), _runs(view, runs, MAIN, paint, "")]
    if pairs:
        plain.append(_runs(view, runs, BEYOND, [pale(colour) for colour in paint], ", beyond its expected time"))
    drawn.append(_together(plain))
    if pairs:
        drawn.append(_runs(view, runs, EXCEPTION, paint, ", exception part", CROSSED, line=OUTLINED))
    drawn += [_strip(view, found["holds"], lock, i) for i, lock in enumerate(locks)]
    drawn.append(_deadlines(view, found["deadline"]))
    drawn.append(_marks(view, found["release"], RELEASE, "release", 0.03 - BAR / 2))
    if pairs:
        drawn.append(_marks(view, found["abort"], ABORT, "main part aborted"))
    return [*drawn, (_marks if exact else _crosses)(view, found["miss"], MISS, "deadline missed")]


def _exact(view: _View) -> dict[str, Table] | None:
    """All there is to draw in the window, by name; None if that is more than `MOST` marks."""
    history = view.history
    if history.occupancy.count(view.low, view.high) > MOST // 4:  # a job makes four marks or so: the rest need not be looked for
        return None
    part = history.part(view.rows, view.low, view.high)
    found = {
        "runs": view.slices(part.runs),
        "ready": view.intervals(part.ready),
        "waits": view.intervals(part.waits),
        "holds": view.intervals(history.holds),
        "release": view.events(history.releases),
        "deadline": view.events(history.deadlines),
        "abort": view.events(history.aborts),
        "miss": view.events(history.misses),
    }
    return found if sum(map(len, found.values())) <= MOST else None


def _crowded(view: _View) -> dict[str, Table]:
    """What is drawn beside curves: what went wrong, of each task once per column, of as many columns as there may be marks."""
    columns = MOST // (2 * max(len(view.rows), 1))
    width = max(view.high - view.low, 1)
    found = {name: np.empty((0, n), np.int64) for name, n in WIDTHS.items()}
    for name, events in (("abort", view.events(view.history.aborts)), ("miss", view.events(view.history.misses))):
        at = (events[:, -1] - view.low) * columns // width
        _, first = np.unique(events[:, 0] * (columns + 1) + at, return_index=True)
        found[name] = events[first]
    return found


def _shares(view: _View, tasks: Sequence[str], paint: Sequence[str], dense: bool) -> list[Spec]:
    """The share of the time that each task runs, as a curve filled down to the foot of its row; empty where bars are drawn."""
    edges = np.linspace(view.low, view.high, COLUMNS + 1)
    shares = view.history.shares(edges) if dense else np.empty((0, 0))
    row_of = {row: task for task, row in view.rows.items()}
    drawn = []
    for row in range(len(tasks)):
        known = dense and row in row_of
        curve = np.concatenate([[0], shares[row_of[row]], [0]]) if known else np.empty(0)
        drawn.append(
            {
                "type": "scatter",
                "mode": "none",
                "x": view.ms(np.append(edges[0], edges)) if known else np.empty(0),
                "y": -view.pitch * row - BAR / 2 + BAR * curve,
                "line": {"shape": "hv"},
                "fill": "toself",
                "fillcolor": paint[row],
                "showlegend": False,
                "hoverinfo": "skip",
            }
        )
    return drawn


def _bars(view: _View, table: Table, width: float, marker: Spec, words: str, told: Any = None, below: float = 0.0) -> Spec:
    """A bar per interval. Hovering over it says the name that the axis has at its height."""
    start = view.ms(table[:, -2])
    return {
        "type": "bar",
        "orientation": "h",
        "base": start,
        "x": view.ms(table[:, -1]) - start,
        "y": view.height(table[:, 0]) - below,
        "width": width,
        "marker": marker,
        "showlegend": False,
        "customdata": told,
        "hovertemplate": f"{'' if below else '%{y} '}{words}<br>from %{{base:.3f}} ms for %{{x:.3f}} ms<extra></extra>",
    }


def _readiness(view: _View, ready: Table) -> Spec:
    """A thin bar for each time that a task is only ready."""
    marker = {**READY, "color": [READY["color"]] * len(ready)}
    return _bars(view, ready, THIN, marker, "%{customdata}", ["ready"] * len(ready))


def _together(kinds: Sequence[Spec]) -> Spec:
    """Bars that differ in width and colour only, as one trace: each trace takes plotly a millisecond, however few its bars."""
    marker = {**kinds[0]["marker"], "color": [colour for kind in kinds for colour in kind["marker"]["color"]]}
    return {
        **kinds[0],
        **{name: np.concatenate([kind[name] for kind in kinds]) for name in ("base", "x", "y")},
        "width": np.repeat([kind["width"] for kind in kinds], [len(kind["x"]) for kind in kinds]),
        "marker": marker,
        "customdata": [told for kind in kinds for told in kind["customdata"]],
    }


def _runs(
    view: _View, runs: Table, kind: int, paint: Sequence[str], words: str, pattern: Spec | None = None, **marker: Any
) -> Spec:
    """The runs of one kind in the colours of their tasks. Plotly warns of every bar, slowly, whose colour is a number, and of
    many colours under an overlaid pattern.
    """
    runs = runs[runs[:, 1] == kind]
    colour = [paint[row] for row in view.row(runs[:, 0]).tolist()]
    made = {"color": colour, "line": {"width": 0}, **marker}
    if pattern:
        made["pattern"] = {**pattern, "fillmode": "replace", "bgcolor": colour}
    told = [(f"job {job}" if job >= 0 else "runs") + words for job in runs[:, 2].tolist()]
    return _bars(view, runs, BAR, made, "%{customdata}", told)


def _strip(view: _View, holds: Table, lock: str, i: int) -> Spec:
    """Who holds a lock when, below the rows."""
    names = view.history.trace.names
    some = holds[holds[:, 1] == (names.index(lock) if lock in names else -1)]
    return _bars(view, some, 0.85 * STRIP, _lock(i), f"holds {lock}", below=BAR / 2 + STRIP * (i + 0.5))


def lock_keys(locks: Sequence[str]) -> list[Spec]:
    """Entries of the legend for the strips of these locks."""
    return [key(f"holds {lock}", type="bar", marker=_lock(i)) for i, lock in enumerate(locks)]


def _lock(i: int) -> Spec:
    return {"color": LOCKS[i % len(LOCKS)], "line": {"color": INK, "width": 1}}


def _marks(view: _View, table: Table, marker: Spec, words: str, raised: float = 0.0) -> Spec:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": view.ms(table[:, -1]),
        "y": view.height(table[:, 0]) + raised,
        "marker": marker,
        "cliponaxis": False,
        "showlegend": False,
        "customdata": table[:, 1],
        "hovertemplate": f"{words}: job %{{customdata}} at %{{x:.3f}} ms<extra></extra>",
    }


def _crosses(view: _View, table: Table, marker: Spec, words: str) -> Spec:
    """Crosses as one filled outline: hundreds of them cost plotly as much as one."""
    at = view.ms(table[:, -1])
    x, y, which = outline(CROSS, at, view.height(table[:, 0]), marker["size"] / 2 * view.pixel, BAR / 3)
    return {
        "type": "scatter",
        "mode": "none",
        "fill": "toself",
        "fillcolor": marker["color"],
        "x": x,
        "y": y,
        "showlegend": False,
        "hoveron": "points",
        "customdata": np.stack([table[which, 1], at[which]], axis=1),
        "hovertemplate": f"{words}: job %{{customdata[0]}} at %{{customdata[1]:.3f}} ms<extra></extra>",
    }


def _deadlines(view: _View, table: Table) -> Spec:
    """A line across the row for each, all of them in one trace with gaps."""
    x, y, gap = view.ms(table[:, -1]), view.height(table[:, 0]), np.full(len(table), np.nan)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.stack([x, x, gap], axis=1).ravel(),
        "y": np.stack([y - 0.44, y + 0.42, gap], axis=1).ravel(),
        "line": DEADLINE,
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _remark(at: float, height: float, words: str) -> Spec:
    return {
        "text": f"  {words}",
        "x": at,
        "y": height,
        "xanchor": "left",
        "bgcolor": "rgba(255,255,255,0.85)",
        "font": {"size": FONT},
    }


def _alarm(at: float) -> Spec:
    line = {"color": VERMILION, "width": 3, "dash": "dot"}
    return {"type": "line", "yref": "y domain", "x0": at, "x1": at, "y0": 0, "y1": 1, "line": line}


def _band(start: float, end: float) -> Spec:
    fill = {"fillcolor": INVERTED["color"], "line": {"width": 0}, "layer": "below"}
    return {"type": "rect", "yref": "y domain", "x0": start, "x1": end, "y0": 0, "y1": 1, **fill}
