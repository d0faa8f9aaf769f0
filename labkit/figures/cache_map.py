"""A cache as a map, sets across and ways down, above the addresses of the access pattern that made it so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from labkit.cache import History
from labkit.figures.panel import Panel, stack
from labkit.figures.style import BLUE, FONT, GREEN, GREY, INK, PALE, VERMILION, Spec, axis, key

EMPTY, CLEAN, DIRTY = "#f3f5f7", "#BFDDF0", "#F3C969"
STATES = {"empty": EMPTY, "held": CLEAN, "held and dirty": DIRTY}
MOST_LABELS = 16  # sets up to which a cell has room for its address


def sentence(timeline: Mapping[str, np.ndarray], step: int) -> str:
    """What the access that led to `step` did."""
    if step == 0:
        return "Nothing has happened yet: the cache is empty."
    t = {name: column[step - 1] for name, column in timeline.items()}
    text = f"Step {step} of {len(timeline['op'])}: {t['op']} {t['address']:#010x}, "
    if t["bypass"]:
        return text + f"past the cache ({t['bypass']})"
    text += f"set {t['set']}: "
    if t["hit"]:
        return text + f"hit in way {t['way']}"
    text += "miss"
    if t["filled"]:
        text += f", fills way {t['way']}"
    if t["victim"] >= 0:
        text += f", throws out line {t['victim']:#010x}" + (" and writes it back" if t["written_back"] else "")
    return text


#: What an access was -> the symbol and colour of its point.
KINDS = {
    "hit": ("circle", GREEN),
    "miss": ("x", VERMILION),
    "past the cache": ("triangle-up", BLUE),
    "still to come": ("circle", PALE),
}


def cache_map(history: History, step: int, parameter: str = "", height: int = 388) -> Spec:
    """The map after `step` accesses of a history, and below every access, done and still to come; a click on one sets the
    parameter that has this name.
    """
    square: Spec = {"symbol": "square", "size": 14, "line": {"width": 1, "color": GREY}}
    markers = {state: square | {"color": colour} for state, colour in STATES.items()} | {kind: _mark(kind) for kind in KINDS}
    keys = [key(name, type="scatter", mode="markers", marker=marker) for name, marker in markers.items()]
    says, meta = sentence(history.columns, step), {"ended": step >= len(history)}
    return stack(_map(history, step), _accesses(history.columns, step, parameter), height=height, keys=keys, says=says, meta=meta)


def _map(history: History, step: int) -> Panel:
    geometry, timeline = history.geometry, history.columns
    line, dirty = history.contents(step)
    state = np.where(line < 0, 0, 1 + dirty)
    labels = [[f"{value & 0xFFFF:04x}" if value >= 0 else "" for value in row] for row in line.tolist()]
    words, named = list(STATES), geometry.sets <= MOST_LABELS
    hover = [
        [
            f"set {s}, way {w}: {words[state[w, s]]}" + (f", line {line[w, s]:#010x}" if line[w, s] >= 0 else "")
            for s in range(geometry.sets)
        ]
        for w in range(geometry.ways)
    ]
    heat: Spec = {
        "type": "heatmap",
        "z": state,
        "zmin": 0,
        "zmax": 2,
        "colorscale": [[edge, colour] for k, colour in enumerate(STATES.values()) for edge in (k / 3, (k + 1) / 3)],
        "showscale": False,
        "xgap": 2,
        "ygap": 2,
        "text": labels,
        "texttemplate": "%{text}" if named else "",
        "textfont": {"size": FONT},
        "customdata": hover,
        "hovertemplate": "%{customdata}<extra></extra>",
    }
    shapes: list[Spec] = []
    if step and timeline["set"][step - 1] >= 0:
        s, w = int(timeline["set"][step - 1]), int(timeline["way"][step - 1])
        box: Spec = {"type": "rect", "x0": s - 0.5, "x1": s + 0.5, "y0": -0.5, "y1": geometry.ways - 0.5}
        shapes.append({**box, "line": {"color": GREY, "width": 2, "dash": "dot"}})
        if w >= 0:
            colour = GREEN if timeline["hit"][step - 1] else VERMILION
            shapes.append({**box, "y0": w - 0.5, "y1": w + 0.5, "line": {"color": colour, "width": 5}})
    ticks = list(range(0, geometry.sets, max(1, geometry.sets // 16)))
    title = "set (in each cell: last four hex digits of the line's address)" if named else "set"
    x = axis(title, range=[-0.5, geometry.sets - 0.5], tickvals=ticks, showgrid=False, fixedrange=True)
    ways = list(range(geometry.ways))
    y = axis("way", range=[geometry.ways - 0.5, -0.5], tickvals=ways, showgrid=False, fixedrange=True)
    return Panel([heat], y, x, shapes, left=84)


def _mark(kind: str, size: int = 9) -> Spec:
    symbol, colour = KINDS[kind]
    return {"symbol": symbol, "size": size, "color": colour}


def _rung(top: float, first: int, factor: int) -> int:
    """The end of an axis that has to reach `top`: one of few, so that it moves rarely while a pattern grows."""
    return next(end for n in range(40) if (end := first * factor**n) >= top)


def _accesses(timeline: Mapping[str, np.ndarray], step: int, parameter: str) -> Panel:
    number, base = np.arange(1, len(timeline["line"]) + 1), int(timeline["address"].min(initial=2**62))
    offset, done, cached, hit = timeline["address"] - base, number <= step, timeline["bypass"] == "", timeline["hit"]
    chosen = dict(zip(KINDS, (cached & hit & done, cached & ~hit & done, ~cached & done, ~done), strict=True))
    drawn: list[Spec] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": number[some],
            "y": offset[some],
            "name": kind,
            "showlegend": False,
            "marker": _mark(kind, 9 if len(number) <= 300 else 6),
            "customdata": [f"{a:#010x}" for a in timeline["address"][some].tolist()],
            "hovertemplate": f"access %{{x}}, %{{customdata}}: {kind}<extra></extra>",
            **({"meta": {"set": [{parameter: n} for n in number[some].tolist()]}} if parameter else {}),
        }
        for kind, some in chosen.items()
    ]
    top = _rung(int(offset.max(initial=0)), 384, 4)
    now: Spec = {"type": "line", "yref": "y domain", "x0": step + 0.5, "x1": step + 0.5, "y0": 0, "y1": 1}
    title = f"access (addresses counted from {base:#010x})" if len(number) else "access"
    x = axis(title, range=[0, _rung(len(number) + 1, 40, 3)])
    y = axis("address [bytes]", range=[-0.06 * top, 1.06 * top])
    return Panel(drawn, y, x, [{**now, "line": {"color": INK, "width": 1.5}}], left=84)
