"""Swim lanes of bytes: one column per byte, one lane per place that may hold a copy of it, and what moved between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.style import BLUE, GREY, INK, ORANGE, PALE, VERMILION, layout

PITCH, TALL = 1.75, 1.0  # distance of two lanes and height of a cell
PALE_SKY = "#b3ddf5"

#: State of a cell -> its colour, the colour of its text, and what the legend says (None: no entry). Light, middle and dark,
#: so that they differ without colour as well.
STATES: dict[str, tuple[str, str, str | None]] = {
    "absent": ("white", INK, None),
    "plain": ("#f0f2f4", INK, None),
    "newest": (PALE_SKY, INK, "up to date"),
    "dirty": (ORANGE, INK, "up to date in a dirty line"),
    "stale": ("#b64700", "white", "stale"),
}
_SYMBOLS = {"up": ("triangle-up", INK), "down": ("triangle-down", INK), "dropped": ("x-thin", GREY), "lost": ("x-thin", VERMILION)}


@dataclass(frozen=True)
class Lane:
    """One place: a text and a state (of `STATES`) per column, columns (start, stop) to frame as dirty, and a note shown across it."""

    name: str
    text: Sequence[str]
    state: Sequence[str]
    dirty: Sequence[tuple[int, int]] = ()
    note: str = ""


@dataclass(frozen=True)
class Move:
    """Something that happened to a byte: it went "up" or "down" between `lane` and the one below, or was "dropped" or "lost" in it."""

    column: int
    lane: int
    kind: str


@dataclass(frozen=True)
class Span:
    """A named range of columns above the lanes; `row` 0 is the lower of the two rows."""

    name: str
    start: int
    stop: int
    row: int = 0
    colour: str = PALE


def lanes(places: Sequence[Lane], address: int, line: int, *, spans: Sequence[Span] = (), moves: Sequence[Move] = (),
          headline: str = "", remark: str = "", stages: Sequence[str] = (), stage: int = 0, alarms: Sequence[int] = (),
          height: int = 600) -> dict[str, Any]:
    """Lanes from top to bottom under a strip of stages, of which `stage` is the one shown and `alarms` are those that failed.

    `address` is that of the first column and `line` the bytes per cache line. `headline` says in one line what happens,
    `remark` (drawn as a warning) what is wrong with it. Always one bar trace of stages, one of cells, one scatter of moves, one per legend entry.
    """
    columns = len(places[0].text)
    level = [PITCH * (len(places) - 1 - i) for i in range(len(places))]
    top = level[0] + TALL / 2
    starts = [c for c in range(columns) if not c or (address + c) % line == 0]
    middles = [(a + b) / 2 for a, b in zip(starts, [*starts[1:], columns])]
    notes = [{"text": f"<b>{headline}</b>" + (f"<br><span style='color:{VERMILION}'><b>✗ {remark}</b></span>" if remark else ""),
              "xref": "paper", "yref": "paper", "x": 0, "y": 0.865, "xanchor": "left", "yanchor": "top", "align": "left", "showarrow": False}]
    shapes = [_line(c, c, -TALL / 2 - 0.15, top + 0.15, INK, 2, "dash") for c in starts[1:]]
    for lane, y in zip(places, level):
        for start, stop in lane.dirty:
            shapes.append(_box(start, stop, y - TALL / 2 - 0.04, y + TALL / 2 + 0.04, "rgba(0,0,0,0)", ORANGE, 4))
            notes.append(_text("dirty line", start, y + TALL / 2 + 0.04, xanchor="left", yanchor="bottom"))
        if lane.note:
            notes.append(_text(lane.note, columns / 2, y))
    for span in spans:
        low = top + 0.22 + 0.72 * span.row
        shapes.append(_box(span.start, span.stop, low, low + 0.6, span.colour, "white", 2))
        notes.append(_text(span.name, (span.start + span.stop) / 2, low + 0.3))
    rows = 1 + max((span.row for span in spans), default=0)
    data = [_strip(stages, stage, alarms), _cells(places, level, address), _moves(moves, level)]
    data += [{"type": "scatter", "mode": "markers", "x": [None], "y": [None], "name": name, "hoverinfo": "skip",
              "marker": {"symbol": "square", "size": 15, "color": colour, "line": {"color": GREY, "width": 1}}}
             for colour, _, name in STATES.values() if name]
    return {"data": data, "layout": layout(
        height, annotations=notes, shapes=shapes, dragmode=False, barmode="overlay", margin={"l": 92, "r": 12, "t": 6, "b": 62},
        xaxis={"range": [-0.15, columns + 0.15], "tickvals": middles, "fixedrange": True, "showgrid": False, "zeroline": False, "anchor": "y",
               "ticktext": [f"line at {(address + c) & -line:#010x}" for c in starts], "ticks": ""},
        yaxis={"range": [-0.75, top + 0.3 + 0.72 * rows], "domain": [0, 0.75], "tickvals": level, "fixedrange": True, "showgrid": False,
               "zeroline": False, "ticktext": [f"<b>{lane.name}</b>" for lane in places], "ticks": ""},
        xaxis2={"range": [0, max(1, len(stages))], "visible": False, "fixedrange": True, "anchor": "y2"},
        yaxis2={"range": [0, 1], "domain": [0.885, 1], "visible": False, "fixedrange": True, "anchor": "x2"},
        legend={"orientation": "h", "y": -0.075, "yanchor": "top", "x": 1, "xanchor": "right"})}


def _strip(stages: Sequence[str], stage: int, alarms: Sequence[int]) -> dict[str, Any]:
    """The stages as a row of boxes: done, shown, still to come; those that fail carry a cross."""
    n = range(len(stages))
    return {"type": "bar", "x": [i + 0.5 for i in n], "y": [1] * len(stages), "width": 0.96, "xaxis": "x2", "yaxis": "y2", "showlegend": False,
            "text": [f"<b>{'✗ ' if i in alarms else ''}{name}</b>" if i == stage else f"{'✗ ' if i in alarms else ''}{name}" for i, name in enumerate(stages)],
            "textposition": "inside", "insidetextanchor": "middle", "constraintext": "none", "textangle": 0, "hoverinfo": "skip",
            "insidetextfont": {"color": ["white" if i == stage else VERMILION if i in alarms else INK for i in n]},
            "marker": {"color": [BLUE if i == stage else PALE if i < stage else "white" for i in n],
                       "line": {"width": 2, "color": [VERMILION if i in alarms else PALE for i in n]}}}


def _cells(places: Sequence[Lane], level: Sequence[float], address: int) -> dict[str, Any]:
    cells = [(c, y, lane.name, text, state) for lane, y in zip(places, level)
             for c, (text, state) in enumerate(zip(lane.text, lane.state, strict=True))]
    return {"type": "bar", "x": [c + 0.5 for c, *_ in cells], "base": [y - TALL / 2 for _, y, *_ in cells], "y": [TALL] * len(cells),
            "width": 0.94, "text": [text for *_, text, _ in cells], "textposition": "inside", "insidetextanchor": "middle",
            "constraintext": "none", "textangle": 0, "insidetextfont": {"color": [STATES[state][1] for *_, state in cells]},
            "marker": {"color": [STATES[state][0] for *_, state in cells], "line": {"width": 1, "color": PALE}}, "showlegend": False,
            "customdata": [f"{name}, {address + c:#010x}<br>" + (f"{text}  {STATES[state][2] or ''}" if text else "not held")
                           for c, _, name, text, state in cells],
            "hovertemplate": "%{customdata}<extra></extra>"}


def _moves(moves: Sequence[Move], level: Sequence[float]) -> dict[str, Any]:
    between = [level[m.lane] - (PITCH / 2 if m.kind in ("up", "down") else 0) for m in moves]
    return {"type": "scatter", "mode": "markers", "x": [m.column + 0.5 for m in moves], "y": between, "showlegend": False, "hoverinfo": "skip",
            "marker": {"symbol": [_SYMBOLS[m.kind][0] for m in moves], "color": [_SYMBOLS[m.kind][1] for m in moves], "size": 11,
                       "line": {"width": 2, "color": [_SYMBOLS[m.kind][1] for m in moves]}}}


def _text(text: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    return {"text": text, "x": x, "y": y, "xref": "x", "yref": "y", "showarrow": False} | more


def _line(x0: float, x1: float, y0: float, y1: float, colour: str, width: int, dash: str) -> dict[str, Any]:
    return {"type": "line", "x0": x0, "x1": x1, "y0": y0, "y1": y1, "xref": "x", "yref": "y", "line": {"color": colour, "width": width, "dash": dash}}


def _box(x0: float, x1: float, y0: float, y1: float, fill: str, colour: str, width: int) -> dict[str, Any]:
    return {"type": "rect", "x0": x0, "x1": x1, "y0": y0, "y1": y1, "xref": "x", "yref": "y", "fillcolor": fill, "line": {"color": colour, "width": width}}
