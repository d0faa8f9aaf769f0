"""A history of accesses to shared memory: a lane per thread, time downwards, and the memory as it is after the step shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from labkit.figures.panel import Panel, stack
from labkit.figures.style import (
    BLUE,
    FONT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    SMALL,
    TITLE,
    VERMILION,
    YELLOW,
    Spec,
    axis,
)

ROWS = 15  # steps that fit into the picture; it scrolls with the step shown
HEIGHT = 465
TEXT_ROOM = 0.42  # right of the last lane, for its text
WORDS = 44  # letters of a step's text, at most
LANES = {"consumer": ORANGE, "DMA": PURPLE, "tick": GREY}
PRODUCERS = (BLUE, GREEN, SKY)
SYMBOLS = {"read": "circle-open", "wake": "triangle-down", "assert": "x"}


@dataclass(frozen=True)
class Access:
    """One step of a history.

    Attributes:
        who: its lane.
        kind: "read", "write", ...: reads are open circles, what changes something is filled.
        text: what stands beside the mark.
        source: number of the step, from 1, that wrote what is read; None or 0 if there is none.
    """

    who: str
    kind: str
    text: str
    source: int | None = None


@dataclass(frozen=True)
class Cell:
    """A variable of the memory: its value as text, whether it waits to be sent, whether the step shown accesses it, and
    a remark beside it."""

    name: str
    value: str
    filled: bool = False
    touched: bool = False
    remark: str = ""


def interleaving(
    lanes: Sequence[str],
    accesses: Sequence[Access],
    step: int,
    memory: Sequence[Cell],
    sentence: str,
    remark: str = "",
    failing: bool = False,
    title: str = "",
) -> Spec:
    """Lanes with the first `step` accesses drawn and the others pale, beside the memory after that step.

    Args:
        lanes: names from left to right.
        accesses: the whole history.
        step: how many of them have happened.
        memory: from top to bottom.
        sentence: what the last of them does. remark: a line below that.
        failing: whether the last of them is the failure; the remark has the colour of an alarm then.
        title: what is shown, above all.
    """
    last = max(ROWS, min(step, len(accesses)))
    where = {name: i for i, name in enumerate(lanes)}
    colour = {name: LANES.get(name, PRODUCERS[i % len(PRODUCERS)]) for i, name in enumerate(lanes)}
    done = accesses[:step]
    arrows = [(where[accesses[a.source - 1].who], a.source, where[a.who], n) for n, a in enumerate(done, 1) if a.source]
    now = [arrow for arrow in arrows if arrow[3] == step]
    traces = [
        _arrows("read from", [a for a in arrows if a not in now], GREY, 1.5),
        _arrows("read from, this step", now, VERMILION, 3),
        _marks("to come", accesses[step:], step + 1, where, dict.fromkeys(lanes, PALE), GREY),
        _marks("done", done, 1, where, colour, INK),
        {
            "type": "scatter",
            "mode": "markers",
            "x": [where[done[-1].who]] if failing else [],
            "y": [step] if failing else [],
            "name": "failure",
            "marker": {"symbol": "circle-open", "size": 24, "color": VERMILION, "line": {"width": 4}},
            "hoverinfo": "skip",
        },
    ]
    x = axis(
        "",
        range=[-0.25, len(lanes) - 1 + (len(lanes) - 0.75) * TEXT_ROOM],
        tickvals=list(range(len(lanes))),
        ticktext=[f"<b>{name}</b>" for name in lanes],
        side="top",
        ticks="",
        fixedrange=True,
        gridcolor=PALE,
        tickfont={"size": FONT},
    )
    y = axis("step", range=[last + 0.7, last - ROWS + 0.3], dtick=1, fixedrange=True, showgrid=False)
    notes = [_line(title, 82, INK), _line(f"<b>{sentence}</b>", 56, INK), _line(remark, 30, VERMILION if failing else INK)]
    picture = Panel(traces, y, x, notes=notes, above=122, width=2.7)
    return stack([picture, _memory(memory, step)], height=HEIGHT, legend=False, bottom=20)


def _line(text: str, above: int, colour: str) -> Spec:
    """A line of text so many px above the lanes, as wide as it is."""
    place = {"xref": "x domain", "x": 0, "xanchor": "left", "yref": "y domain", "y": 1, "yanchor": "bottom", "yshift": above}
    return {"text": text, "font": {"size": TITLE, "color": colour}, **place}


def _arrows(name: str, arrows: Sequence[tuple[int, int, int, int]], colour: str, width: float) -> Spec:
    """From the write to the read: lines of two points with a head on the second."""
    x, y, size = [], [], []
    for from_lane, source, to_lane, number in arrows:
        x += [from_lane, to_lane, None]
        y += [source, number, None]
        size += [0, 13, 0]
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": x,
        "y": y,
        "name": name,
        "line": {"color": colour, "width": width},
        "marker": {"symbol": "arrow", "angleref": "previous", "size": size, "color": colour, "standoff": 7, "opacity": 1},
        "hoverinfo": "skip",
    }


def _marks(
    name: str, accesses: Sequence[Access], first: int, where: Mapping[str, int], colour: Mapping[str, str], ink: str
) -> Spec:
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": [where[a.who] for a in accesses],
        "y": list(range(first, first + len(accesses))),
        "text": [f"  {a.text[:WORDS]}" for a in accesses],
        "textposition": "middle right",
        "textfont": {"size": SMALL, "color": ink},
        "name": name,
        "marker": {
            "symbol": [SYMBOLS.get(a.kind, "circle") for a in accesses],
            "size": 12,
            "color": [colour[a.who] for a in accesses],
            "line": {"width": 2.5, "color": [colour[a.who] for a in accesses]},
        },
        "hovertext": [f"step {n}: {a.who} {a.text}" for n, a in enumerate(accesses, first)],
        "hoverinfo": "text",
        "meta": {"set": [{"step": n} for n in range(first, first + len(accesses))]},
    }


def _memory(cells: Sequence[Cell], step: int) -> Panel:
    """A column of boxes; what waits to be sent is yellow, what the step accesses has a frame."""
    shapes: list[dict[str, Any]] = [
        {
            "type": "rect",
            "layer": "below",
            "x0": 0,
            "x1": 1,
            "y0": i + 0.08,
            "y1": i + 0.92,
            "fillcolor": YELLOW if cell.filled else "white",
            "line": {"color": VERMILION if cell.touched else GREY, "width": 4 if cell.touched else 1.5},
        }
        for i, cell in enumerate(cells)
    ]
    text = {
        "type": "scatter",
        "mode": "text",
        "x": [0.5] * len(cells),
        "y": [i + 0.5 for i in range(len(cells))],
        "text": [cell.value for cell in cells],
        "textfont": {"size": FONT},
        "showlegend": False,
        "hoverinfo": "skip",
    }
    beside = {
        **text,
        "x": [1.04] * len(cells),
        "text": [cell.remark for cell in cells],
        "textposition": "middle right",
        "textfont": {"size": SMALL, "color": INK},
    }
    y = axis(
        "",
        range=[max(len(cells), 8), 0],
        tickvals=[i + 0.5 for i in range(len(cells))],
        ticktext=[cell.name for cell in cells],
        showgrid=False,
        ticks="",
        fixedrange=True,
    )
    x = axis("", range=[0, 2.0], visible=False, fixedrange=True)
    return Panel([text, beside], y, x, shapes=shapes, title=f"Memory after step {step}", left=96)
