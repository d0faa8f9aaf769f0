"""A cache as a map, sets across and ways down, above the addresses of the access pattern that made it so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from labkit.cache.geometry import Geometry
from labkit.figures.style import BLUE, GREEN, GREY, INK, LEGEND, PALE, VERMILION, axis, layout

EMPTY, CLEAN, DIRTY = "#f3f5f7", "#BFDDF0", "#F3C969"
STATES = {"empty": EMPTY, "held": CLEAN, "held and dirty": DIRTY}
MOST_LABELS = 16  # sets up to which a cell has room for its address


def contents(timeline: Mapping[str, np.ndarray], step: int, geometry: Geometry) -> tuple[np.ndarray, np.ndarray]:
    """Line address (-1: empty) and dirtiness (0 or 1) of each (way, set) after the first `step` records of a write-back cache."""
    shape = (geometry.ways, geometry.sets)
    line, filled, stored = np.full(shape, -1, np.int64), np.full(shape, -1), np.full(shape, -1)
    at = np.flatnonzero(timeline["way"][:step] >= 0)
    way, index = timeline["way"][at], timeline["set"][at]
    line[way, index] = timeline["line"][at]  # of several records of one cell the last one stays
    fills, stores = timeline["filled"][at], (timeline["op"][at] != "read") & ~timeline["to_memory"][at]
    filled[way[fills], index[fills]] = at[fills]
    stored[way[stores], index[stores]] = at[stores]
    return line, ((line >= 0) & (stored >= filled)).astype(int)


def sentence(timeline: Mapping[str, np.ndarray], step: int) -> str:
    """What the access that led to `step` did."""
    if step == 0:
        return "Nothing has happened yet: the cache is empty."
    t = {name: column[step - 1] for name, column in timeline.items()}
    text = f"Step {step}: {t['op']} {t['address']:#010x}, "
    if t["bypass"]:
        return text + f"past the cache ({t['bypass']})"
    text += f"set {t['set']}: "
    if t["hit"]:
        return text + f"<b>hit</b> in way {t['way']}"
    text += "<b>miss</b>"
    if t["filled"]:
        text += f", fills way {t['way']}"
    if t["victim"] >= 0:
        text += f", throws out line {t['victim']:#010x}" + (" and writes it back" if t["written_back"] else "")
    return text


def cache_map(timeline: Mapping[str, np.ndarray], step: int, geometry: Geometry, height: int = 560) -> dict[str, Any]:
    """The map after `step` records of `timeline` (a fold of `labkit.cache`), and below every access, done and still to come."""
    line, dirty = contents(timeline, step, geometry)
    state = np.where(line < 0, 0, 1 + dirty)
    labels = [[f"{value & 0xFFFF:04x}" if value >= 0 else "" for value in row] for row in line.tolist()]
    words = list(STATES)
    hover = [
        [
            f"set {s}, way {w}: {words[state[w, s]]}" + (f", line {line[w, s]:#010x}" if line[w, s] >= 0 else "")
            for s in range(geometry.sets)
        ]
        for w in range(geometry.ways)
    ]
    scale = [[edge, colour] for k, colour in enumerate(STATES.values()) for edge in (k / 3, (k + 1) / 3)]
    data: list[dict[str, Any]] = [
        {
            "type": "heatmap",
            "z": state,
            "zmin": 0,
            "zmax": 2,
            "colorscale": scale,
            "showscale": False,
            "xgap": 2,
            "ygap": 2,
            "text": labels,
            "texttemplate": "%{text}" if geometry.sets <= MOST_LABELS else "",
            "customdata": hover,
            "hovertemplate": "%{customdata}<extra></extra>",
            "xaxis": "x",
            "yaxis": "y",
        }
    ]
    for name, colour in STATES.items():
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [None],
                "y": [None],
                "name": name,
                "legendrank": 1,
                "marker": {"symbol": "square", "size": 14, "color": colour, "line": {"width": 1, "color": GREY}},
            }
        )

    number, base = np.arange(1, len(timeline["line"]) + 1), int(timeline["address"].min(initial=2**62))
    offset, done = timeline["address"] - base, number <= step
    cached = timeline["bypass"] == ""
    kinds = {
        "hit": (cached & timeline["hit"] & done, "circle", GREEN),
        "miss": (cached & ~timeline["hit"] & done, "x", VERMILION),
        "past the cache": (~cached & done, "triangle-up", BLUE),
        "still to come": (~done, "circle", PALE),
    }
    for name, (chosen, symbol, colour) in kinds.items():
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": number[chosen],
                "y": offset[chosen],
                "name": name,
                "xaxis": "x2",
                "yaxis": "y2",
                "marker": {"symbol": symbol, "size": 9 if len(number) <= 300 else 6, "color": colour},
                "customdata": [f"{a:#010x}" for a in timeline["address"][chosen].tolist()],
                "hovertemplate": f"access %{{x}}, %{{customdata}}: {name}<extra></extra>",
            }
        )

    shapes = [
        {
            "type": "line",
            "xref": "x2",
            "yref": "y2 domain",
            "x0": step + 0.5,
            "x1": step + 0.5,
            "y0": 0,
            "y1": 1,
            "line": {"color": INK, "width": 1.5},
        }
    ]
    if step and timeline["set"][step - 1] >= 0:
        s, w = int(timeline["set"][step - 1]), int(timeline["way"][step - 1])
        box = {"type": "rect", "xref": "x", "yref": "y", "x0": s - 0.5, "x1": s + 0.5, "y0": -0.5, "y1": geometry.ways - 0.5}
        shapes.append({**box, "line": {"color": GREY, "width": 2, "dash": "dot"}})
        if w >= 0:
            colour = GREEN if timeline["hit"][step - 1] else VERMILION
            shapes.append({**box, "y0": w - 0.5, "y1": w + 0.5, "line": {"color": colour, "width": 5}})
    every = max(1, geometry.sets // 16)
    top = max(int(offset.max(initial=0)), 1)
    return {
        "data": data,
        "layout": layout(
            height,
            shapes=shapes,
            margin={"l": 84, "r": 16, "t": 64, "b": 48},
            legend=LEGEND,
            annotations=[
                {
                    "text": sentence(timeline, step),
                    "xref": "paper",
                    "yref": "paper",
                    "x": 0,
                    "y": 1.015,
                    "xanchor": "left",
                    "yanchor": "bottom",
                    "showarrow": False,
                    "font": {"size": 17},
                }
            ],
            xaxis=axis(
                "set" + (" (in each cell: last four hex digits of the line's address)" if geometry.sets <= MOST_LABELS else ""),
                anchor="y",
                range=[-0.5, geometry.sets - 0.5],
                tickvals=list(range(0, geometry.sets, every)),
                showgrid=False,
                fixedrange=True,
            ),
            yaxis=axis(
                "way",
                anchor="x",
                domain=[0.56, 1],
                range=[geometry.ways - 0.5, -0.5],
                tickvals=list(range(geometry.ways)),
                showgrid=False,
                fixedrange=True,
            ),
            xaxis2=axis(
                f"access (addresses counted from {base:#010x})" if len(number) else "access",
                anchor="y2",
                range=[0, len(number) + 1],
            ),
            yaxis2=axis("address [bytes]", anchor="x2", domain=[0, 0.38], range=[-0.06 * top, 1.06 * top]),
        ),
    }
