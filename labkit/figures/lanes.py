"""Swim lanes of bytes: one column per byte, one lane per place that may hold a copy of it, and what moved between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.style import BLUE, GREY, INK, ORANGE, PALE, layout

PITCH, TALL = 1.75, 1.0  # distance of two lanes and height of a cell
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
    headline: str = "",
    remark: str = "",
    stages: Sequence[str] = (),
    stage: int = 0,
    alarms: Sequence[int] = (),
    height: int = 530,
) -> dict[str, Any]:
    """Lanes from top to bottom under a strip of stages, of which `stage` is the one shown and `alarms` are those that failed.

    `address` is that of the first column and `line` the bytes per cache line. `headline` says in one line what happens,
    `remark` (drawn as a warning) what is wrong with it. Traces are always the same: stages, cells, moves, one per legend entry.
    """
    columns = len(places[0].text)
    level = [PITCH * (len(places) - 1 - i) for i in range(len(places))]
    top = level[0] + TALL / 2
    starts = [c for c in range(columns) if not c or (address + c) % line == 0]
    warning = f"<br><span style='color:{DARK}'><b>✗ {remark}</b></span>" if remark else ""
    notes = [
        {
            "text": f"<b>{headline}</b>{warning}",
            "xref": "paper",
            "yref": "paper",
            "x": 0,
            "y": 0.865,
            "xanchor": "left",
            "yanchor": "top",
            "align": "left",
            "showarrow": False,
        }
    ]
    notes += [_line_name(start, stop, columns, (address + start) & -line) for start, stop in zip(starts, [*starts[1:], columns])]
    shapes = [_shape("line", (c, c), (-TALL / 2 - 0.15, top + 0.15), color=INK, width=2, dash="dash") for c in starts[1:]]
    for lane, y in zip(places, level):
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
    rows = 1 + max((span.row for span in spans), default=0)
    data = [_strip(stages, stage, alarms), _cells(places, level, address), _moves(moves, level)]
    data += [
        {
            "type": "scatter",
            "mode": "markers",
            "x": [None],
            "y": [None],
            "name": name,
            "hoverinfo": "skip",
            "marker": {"symbol": "square", "size": 15, "color": colour, "line": {"color": GREY, "width": 1}},
        }
        for colour, _, name in STATES.values()
        if name
    ]
    return {
        "data": data,
        "layout": layout(
            height,
            annotations=notes,
            shapes=shapes,
            dragmode=False,
            barmode="overlay",
            margin={"l": 92, "r": 12, "t": 6, "b": 40},
            xaxis={"range": [-0.15, columns + 0.15], "visible": False, "fixedrange": True, "anchor": "y"},
            yaxis={
                "range": [-1.1, top + 0.3 + 0.72 * rows],
                "domain": [0, 0.76],
                "tickvals": level,
                "fixedrange": True,
                "showgrid": False,
                "zeroline": False,
                "ticktext": [f"<b>{lane.name}</b>" for lane in places],
                "ticks": "",
                "automargin": True,
            },
            xaxis2={"range": [0, max(1, len(stages))], "visible": False, "fixedrange": True, "anchor": "y2"},
            yaxis2={"range": [0, 1], "domain": [0.885, 1], "visible": False, "fixedrange": True, "anchor": "x2"},
            legend={"orientation": "h", "y": -0.02, "yanchor": "top", "x": 1, "xanchor": "right"},
        ),
    }


def _line_name(start: int, stop: int, columns: int, address: int) -> dict[str, Any]:
    """The address of a cache line under its columns; at the window's edge where they are too few for it."""
    narrow = stop - start < columns / 5
    x, anchor = ((start, "left") if not start else (stop, "right")) if narrow else ((start + stop) / 2, "center")
    return _text(f"line at 0x{address:08X}", x, -TALL / 2 - 0.15, xanchor=anchor, yanchor="top")


def _strip(stages: Sequence[str], stage: int, alarms: Sequence[int]) -> dict[str, Any]:
    """The stages as a row of boxes: done, shown, still to come; those that fail carry a cross."""
    n = range(len(stages))
    crossed = [("✗ " if i in alarms else "") + name for i, name in enumerate(stages)]
    return {
        "type": "bar",
        "x": [i + 0.5 for i in n],
        "y": [1] * len(stages),
        "width": 0.96,
        "xaxis": "x2",
        "yaxis": "y2",
        "showlegend": False,
        "text": [f"<b>{name}</b>" if i == stage else name for i, name in enumerate(crossed)],
        "textposition": "inside",
        "insidetextanchor": "middle",
        "constraintext": "none",
        "textangle": 0,
        "hoverinfo": "skip",
        "insidetextfont": {"color": ["white" if i == stage else DARK if i in alarms else INK for i in n]},
        "marker": {
            "color": [BLUE if i == stage else PALE if i < stage else "white" for i in n],
            "line": {"width": 2, "color": [DARK if i in alarms else PALE for i in n]},
        },
    }


def _cells(places: Sequence[Lane], level: Sequence[float], address: int) -> dict[str, Any]:
    cells = [
        (c, y, lane.name, text, state)
        for lane, y in zip(places, level)
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
        "insidetextfont": {"color": [STATES[state][1] for *_, state in cells]},
        "marker": {"color": [STATES[state][0] for *_, state in cells], "line": {"width": 1, "color": PALE}},
        "customdata": [
            f"{name}, 0x{address + c:08X}<br>" + (f"{text}  {STATES[state][2] or ''}" if text else "not held")
            for c, _, name, text, state in cells
        ],
        "hovertemplate": "%{customdata}<extra></extra>",
    }


def _moves(moves: Sequence[Move], level: Sequence[float]) -> dict[str, Any]:
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


def _text(text: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    return {"text": text, "x": x, "y": y, "xref": "x", "yref": "y", "showarrow": False} | more


def _shape(kind: str, x: tuple[float, float], y: tuple[float, float], **line: Any) -> dict[str, Any]:
    return {"type": kind, "x0": x[0], "x1": x[1], "y0": y[0], "y1": y[1], "xref": "x", "yref": "y", "line": line}
