"""Swim lanes of bytes: one column per byte, one lane per place that may hold a copy of it, and what moved between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.panel import Panel, stack
from labkit.figures.style import BLUE, FONT, GREY, INK, ORANGE, PALE, SMALL, Spec, axis, key

PITCH, TALL = 1.75, 1.0  # distance of two lanes and height of a cell
WARNED = 34  # px, room for the warning above the lanes
PALE_SKY, DARK = "#b3ddf5", "#b64700"

#: State of a cell -> its colour, the colour of its text, and what the legend says (None: no entry). Light, middle and dark,
#: so that they differ without colour as well.
STATES: dict[str, tuple[str, str, str | None]] = {
    "absent": ("white", INK, None),
    "plain": ("#f0f2f4", INK, None),
    "newest": (PALE_SKY, INK, "up to date"),
    "dirty": (ORANGE, INK, "up to date in a dirty line"),
    "stale": (DARK, "white", "stale"),
}
_SYMBOLS = {"up": ("triangle-up", INK), "down": ("triangle-down", INK), "dropped": ("x-thin", GREY), "lost": ("x-thin", DARK)}


@dataclass(frozen=True)
class Lane:
    """One place: a text and a state (of `STATES`) per column, columns (start, stop) framed as dirty, a note shown across it."""

    name: str
    text: Sequence[str]
    state: Sequence[str]
    dirty: Sequence[tuple[int, int]] = ()
    note: str = ""


@dataclass(frozen=True)
class Move:
    """What happened to a byte: it went "up" or "down" between `lane` and the one below, or was "dropped" or "lost" in `lane`."""

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


def lanes(
    places: Sequence[Lane],
    address: int,
    line: int,
    *,
    spans: Sequence[Span] = (),
    moves: Sequence[Move] = (),
    says: str = "",
    remark: str = "",
    stages: Sequence[str] = (),
    stage: int = 0,
    alarms: Sequence[int] = (),
    height: int = 450,
) -> Spec:
    """Lanes from top to bottom under a strip of stages, of which `stage` is the one shown and `alarms` are those that failed.

    `address` is that of the first column and `line` the bytes per cache line. `says` is what happens, a sentence above the
    picture, and `remark` (drawn as a warning) what is wrong with it. A click on a stage sets the parameter `step`. Traces are
    always the same: stages, cells, moves, one per legend entry.
    """
    level = [PITCH * (len(places) - 1 - i) for i in range(len(places))]
    told = {
        "text": f"<span style='color:{DARK}'><b>✗ {remark}</b></span>" if remark else "",
        "x": 0,
        "xref": "x domain",
        "xanchor": "left",
        "y": 1,
        "yref": "y domain",
        "yanchor": "bottom",
    }
    shapes, notes = _frames(places, level, address, line, spans)
    rows = 1 + max((span.row for span in spans), default=0)
    names = [f"<b>{lane.name}</b>" for lane in places]
    y = axis(
        "",
        range=[-1.1, level[0] + TALL / 2 + 0.3 + 0.72 * rows],
        tickvals=level,
        ticktext=names,
        ticks="",
        showgrid=False,
        showline=False,
    )
    bytes_ = Panel(
        [_cells(places, level, address), _moves(moves, level)],
        {**y, "fixedrange": True},
        _hidden(-0.15, len(places[0].text) + 0.15),
        shapes,
        [told, *notes],
        above=WARNED,
        height=7.5,
        left=92,
    )
    strip = Panel([_strip(stages, stage, alarms)], _hidden(0, 1), _hidden(0, max(1, len(stages))), left=92)
    square: Spec = {"symbol": "square", "size": 15, "line": {"color": GREY, "width": 1}}
    keys = [key(n, type="scatter", mode="markers", marker=square | {"color": c}) for c, _, n in STATES.values() if n]
    ended = {"ended": stage == len(stages) - 1}
    return stack(strip, bytes_, height=height, keys=keys, bottom=14, dragmode=False, says=says, meta=ended)


def _hidden(low: float, high: float) -> Spec:
    return {"range": [low, high], "visible": False, "fixedrange": True}


def _frames(
    places: Sequence[Lane], level: Sequence[float], address: int, line: int, spans: Sequence[Span]
) -> tuple[list[Spec], list[Spec]]:
    """Shapes and notes: edges and addresses of the cache lines, dirty lines, named spans above the lanes."""
    columns, top = len(places[0].text), level[0] + TALL / 2
    starts = [c for c in range(columns) if not c or (address + c) % line == 0]
    notes = [
        _line_name(start, stop, columns, (address + start) & -line)
        for start, stop in zip(starts, [*starts[1:], columns], strict=True)
    ]
    shapes = [_shape("line", (c, c), (-TALL / 2 - 0.15, top + 0.15), color=INK, width=2, dash="dash") for c in starts[1:]]
    for lane, y in zip(places, level, strict=True):
        for start, stop in lane.dirty:
            shapes.append(_shape("rect", (start, stop), (y - TALL / 2 - 0.04, y + TALL / 2 + 0.04), color=INK, width=3))
            above = y + TALL / 2 + 0.07
            notes.append(_text("<b>dirty line</b>", start, above, xanchor="left", yanchor="bottom", bgcolor="white"))
        if lane.note:
            notes.append(_text(lane.note, columns / 2, y, bgcolor="white", borderpad=4))
    for span in spans:
        low = top + 0.22 + 0.72 * span.row
        box = _shape("rect", (span.start, span.stop), (low, low + 0.6), color="white", width=2)
        shapes.append(box | {"fillcolor": span.colour})
        notes.append(_text(span.name, (span.start + span.stop) / 2, low + 0.3))
    return shapes, notes


def _line_name(start: int, stop: int, columns: int, address: int) -> Spec:
    """The address of a cache line under its columns; at the window's edge where they are too few for it."""
    narrow = stop - start < columns / 5
    x, anchor = ((start, "left") if not start else (stop, "right")) if narrow else ((start + stop) / 2, "center")
    return _text(f"line at 0x{address:08X}", x, -TALL / 2 - 0.15, xanchor=anchor, yanchor="top")


def _strip(stages: Sequence[str], stage: int, alarms: Sequence[int]) -> Spec:
    """The stages as a row of boxes: done, shown, still to come; those that fail carry a cross."""
    n = range(len(stages))
    crossed = [("✗ " if i in alarms else "") + name for i, name in enumerate(stages)]
    return {
        "type": "bar",
        "x": [i + 0.5 for i in n],
        "y": [1] * len(stages),
        "width": 0.96,
        "showlegend": False,
        "text": [f"<b>{name}</b>" if i == stage else name for i, name in enumerate(crossed)],
        "textposition": "inside",
        "insidetextanchor": "middle",
        "constraintext": "none",
        "textangle": 0,
        "hoverinfo": "none",
        "meta": {"set": [{"step": i} for i in n]},
        "insidetextfont": {"size": SMALL, "color": ["white" if i == stage else DARK if i in alarms else INK for i in n]},
        "marker": {
            "color": [BLUE if i == stage else PALE if i < stage else "white" for i in n],
            "line": {"width": 2, "color": [DARK if i in alarms else PALE for i in n]},
        },
    }


def _cells(places: Sequence[Lane], level: Sequence[float], address: int) -> Spec:
    cells = [
        (c, y, lane.name, text, state)
        for lane, y in zip(places, level, strict=True)
        for c, (text, state) in enumerate(zip(lane.text, lane.state, strict=True))
    ]
    return {
        "type": "bar",
        "x": [c + 0.5 for c, *_ in cells],
        "base": [y - TALL / 2 for _, y, *_ in cells],
        "y": [TALL] * len(cells),
        "width": 0.94,
        "showlegend": False,
        "text": [text for *_, text, _ in cells],
        "textposition": "inside",
        "insidetextanchor": "middle",
        "constraintext": "none",
        "textangle": 0,
        "insidetextfont": {"size": FONT, "color": [STATES[state][1] for *_, state in cells]},
        "marker": {"color": [STATES[state][0] for *_, state in cells], "line": {"width": 1, "color": PALE}},
        "customdata": [
            f"{name}, 0x{address + c:08X}<br>" + (f"{text}  {STATES[state][2] or ''}" if text else "not held")
            for c, _, name, text, state in cells
        ],
        "hovertemplate": "%{customdata}<extra></extra>",
    }


def _moves(moves: Sequence[Move], level: Sequence[float]) -> Spec:
    between = [level[m.lane] - (PITCH / 2 if m.kind in ("up", "down") else 0) for m in moves]
    colour = [_SYMBOLS[m.kind][1] for m in moves]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [m.column + 0.5 for m in moves],
        "y": between,
        "showlegend": False,
        "hoverinfo": "skip",
        "marker": {
            "symbol": [_SYMBOLS[m.kind][0] for m in moves],
            "color": colour,
            "size": 11,
            "line": {"width": 2, "color": colour},
        },
    }


def _text(text: str, x: float, y: float, **more: Any) -> Spec:
    return {"text": text, "x": x, "y": y} | more


def _shape(kind: str, x: tuple[float, float], y: tuple[float, float], **line: Any) -> Spec:
    return {"type": kind, "x0": x[0], "x1": x[1], "y0": y[0], "y1": y[1], "line": line}
