"""A sequence diagram: participants side by side, time downwards, one transmission per row, and what each of them knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from labkit.figures.panel import Panel, stack
from labkit.figures.style import BLUE, FONT, GREEN, GREY, INK, PALE, PURPLE, SKY, SMALL, VERMILION, Spec, axis, key

ROWS = 15  # that fit into the picture; it scrolls with the step shown
HEIGHT = 430
WORDS = 58  # letters beside a row, at most
TEXT_ROOM = 2.2  # lanes

#: What a participant knows -> how its line is drawn, in the order of the legend.
STATES: Mapping[str, tuple[str, int, str]] = {
    "nothing": (PALE, 4, "solid"),
    "holds it and waits": (SKY, 11, "solid"),
    "accepted, delivered": (GREEN, 11, "solid"),
    "has left the group": (VERMILION, 5, "dot"),
}
#: What a transmission carries -> colour and width of its arrow.
CARRIES: Mapping[str, tuple[str, float]] = {"the packet": (BLUE, 4), "the verdict": (PURPLE, 4), "": (GREY, 1.5)}


@dataclass(frozen=True)
class Hop:
    """One transmission: its slot, the lane it starts from, those it gets to and those it does not, what it carries, a text."""

    slot: int
    sender: int
    heard: tuple[int, ...]
    lost: tuple[int, ...]
    carries: str
    text: str


def sequence(lanes: Sequence[str], hops: Sequence[Hop], states: Sequence[Sequence[str]], step: int, says: str) -> Spec:
    """The first `step` transmissions; the picture scrolls with them.

    Args:
        lanes: names from left to right.
        hops: the whole story. states: of each lane (`STATES`) at the begin and after each transmission.
        step: how many have happened. says: the sentence above the picture.
    """
    done = hops[:step]
    last = max(ROWS, step)
    first = last - ROWS
    traces = [_line(name, lanes, states, step) for name in STATES]
    traces += [_arrows(what, done) for what in CARRIES]
    traces += [_ends("gets there", done, lost=False), _ends("lost", done, lost=True), _texts(done, len(lanes))]
    x = axis(
        "",
        range=[-0.35, len(lanes) - 1 + TEXT_ROOM],
        tickvals=list(range(len(lanes))),
        ticktext=[f"<b>{name}</b>" for name in lanes],
        side="top",
        ticks="",
        showgrid=False,
        fixedrange=True,
        tickfont={"size": FONT},
    )
    begins = {hop.slot: row for row, hop in reversed(list(enumerate(hops, 1))) if first < row <= last}
    y = axis(
        "",
        range=[last + 0.7, first + 0.3],
        tickvals=list(begins.values()),
        ticktext=[f"slot {slot}" for slot in begins],
        showgrid=False,
        fixedrange=True,
    )
    keys = [key(name, type="scatter", mode="lines", line=_pen(name)) for name in list(STATES)[1:]]
    for what in list(CARRIES)[:2]:
        colour, width = CARRIES[what]
        keys.append(key(f"carries {what}", type="scatter", mode="lines", line={"color": colour, "width": width}))
    keys.append(key("lost", type="scatter", mode="markers", marker=_mark("x", VERMILION)))
    meta = {"says": says, "ended": step >= len(hops)}
    return stack(Panel(traces, y, x, above=34, left=70), height=HEIGHT, keys=keys, bottom=14, meta=meta)


def _pen(name: str) -> Spec:
    colour, width, dash = STATES[name]
    return {"color": colour, "width": width, "dash": dash}


def _mark(symbol: str, colour: str) -> Spec:
    return {"symbol": symbol, "size": 12, "color": colour, "opacity": 1}


def _line(name: str, lanes: Sequence[str], states: Sequence[Sequence[str]], step: int) -> Spec:
    """The stretches of all lanes in this state, from the row of the transmission that caused it to that which ends it."""
    x: list[float | None] = []
    y: list[float | None] = []
    for lane in range(len(lanes)):
        begin: int | None = None
        for row in range(step + 2):
            here = row <= step and states[row][lane] == name
            if here and begin is None:
                begin = row
            if not here and begin is not None:
                x += [lane, lane, None]
                y += [begin, min(row, step + 0.4), None]
                begin = None
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "line": _pen(name),
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _arrows(what: str, hops: Sequence[Hop]) -> Spec:
    colour, width = CARRIES[what]
    mine = [(row, hop) for row, hop in enumerate(hops, 1) if hop.carries == what]
    ends = [(row, hop.sender, max((*hop.heard, *hop.lost), key=lambda lane: abs(lane - hop.sender))) for row, hop in mine]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [lane for _, sender, end in ends for lane in (sender, end, None)],
        "y": [at for row, _, _ in ends for at in (row, row, None)],
        "name": f"carries {what}",
        "line": {"color": colour, "width": width},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _ends(name: str, hops: Sequence[Hop], lost: bool) -> Spec:
    """An arrow head at each lane that hears it, a cross at each that does not."""
    ends = [(row, hop.sender, lane, hop.text) for row, hop in enumerate(hops, 1) for lane in (hop.lost if lost else hop.heard)]
    symbols = "x" if lost else ["triangle-right" if lane > sender else "triangle-left" for _, sender, lane, _ in ends]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [lane + (0 if lost else 0.07 if lane < sender else -0.07) for _, sender, lane, _ in ends],
        "y": [row for row, _, _, _ in ends],
        "name": name,
        "marker": {"symbol": symbols, "size": 12, "color": VERMILION if lost else INK, "opacity": 1},
        "hovertext": [text for _, _, _, text in ends],
        "hoverinfo": "text",
        "showlegend": False,
        "meta": {"set": [{"step": row} for row, _, _, _ in ends]},
    }


def _texts(hops: Sequence[Hop], lanes: int) -> Spec:
    words = [hop.text[:WORDS] for hop in hops]
    return {
        "type": "scatter",
        "mode": "text",
        "x": [lanes - 0.75] * len(hops),
        "y": list(range(1, len(hops) + 1)),
        "text": [f"<b>{text}</b>" if row == len(hops) else text for row, text in enumerate(words, 1)],
        "textposition": "middle right",
        "textfont": {"size": SMALL, "color": [VERMILION if hop.lost else INK for hop in hops]},
        "hoverinfo": "skip",
        "showlegend": False,
    }
