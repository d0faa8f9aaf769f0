"""What all pictures share: one colour per task, fonts, axes with units. Colours: Okabe and Ito, safe for the colour-blind."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any
from zlib import crc32

Spec = dict[str, Any]  # a part of a plotly figure, as plotly.js takes it

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW, TEAL = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#F0E442",
    "#0F4C5C",
)
INK, GREY, PALE, GRID = "#1f2328", "#8c959f", "#d8dee4", "#e6e9ec"
#: Of what is named. Vermilion is not among them: it says that something went wrong, and nothing else in a schedule may.
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, SKY, TEAL, "#7A5195", "#8B5A2B", "#4D7C0F", "#B03060")

#: Tasks that appear in more than one notebook keep their colour in all of them.
TASK_COLOURS = {
    "H": "#7A5195",
    "M": ORANGE,
    "L": BLUE,
    "IDLE": PALE,
    "kernel": GREY,
    "task 1": BLUE,
    "task 2": ORANGE,
    "task 3": GREEN,
    "bc_sched": "#4D7C0F",
    "bc_dist": GREEN,
    "comm": ORANGE,
    "ASI_MET": BLUE,
    "wheel_ctrl": BLUE,
    "w_ctrl": BLUE,
    "odometry": GREEN,
    "odom": GREEN,
    "pose_ctrl": ORANGE,
    "pose_control": ORANGE,
    "p_ctrl": ORANGE,
    "hal_fetch": PURPLE,
    "tsink": SKY,
    "profile": TEAL,
    "recv_vel": "#7A5195",
    "uros": "#8B5A2B",
    "LMSInput": SKY,
    "LMSContourFilter": ORANGE,
    "LMSContourFilter.arcs": ORANGE,
    "LMSContourFilter.edges": "#B8860B",
    "LMSCommunication": PURPLE,
    "LMSContourFusion": BLUE,
    "LMSObjectFilter": GREEN,
    "LMSElementFilter": "#4D7C0F",
    "LMSElementFusion": "#7A5195",
    "LMSOutput": GREY,
    "EthIf": "#4D7C0F",
    "EthLink": "#B03060",
    "tcpip_thread": "#7A5195",
    "Tmr Svc": GREY,
}

#: Sizes of text in px: everything; a panel's title; what has little room. The page scales them for a lecture.
FONT, TITLE, SMALL = 15, 17, 13

#: How every picture marks a number that a source printed (or that follows from two of them): a dark diamond.
PUBLISHED: Spec = {"symbol": "diamond", "size": 14, "color": INK, "line": {"width": 1.5, "color": "white"}}
#: The same for the one of a pair that is "before": open.
PUBLISHED_BEFORE: Spec = {"symbol": "diamond", "size": 13, "color": "white", "line": {"width": 2.5, "color": INK}}
#: What analysis says is never exceeded: a wide pale bar behind what happened.
BOUND: Spec = {"color": PALE, "line": {"color": GREY, "width": 1.5}}

#: How every picture of a schedule marks what happens to a job.
RELEASE: Spec = {"symbol": "triangle-up", "size": 11, "color": INK}
DEADLINE: Spec = {"color": INK, "width": 2}
ABORT: Spec = {"symbol": "octagon", "size": 13, "color": "white", "line": {"color": INK, "width": 3}}
MISS: Spec = {"symbol": "x", "size": 15, "color": VERMILION, "line": {"color": "white", "width": 1.5}}
#: And how the bars of a task differ: an exception part is crossed, a wait hatched, a task that is only ready a thin line.
CROSSED: Spec = {"shape": "x", "fillmode": "overlay", "fgcolor": "white", "fgopacity": 1, "size": 7, "solidity": 0.3}
OUTLINED: Spec = {"color": INK, "width": 1.5}
WAITS: Spec = {
    "color": "rgba(255,255,255,0)",
    "line": {"color": GREY, "width": 1.5},
    "pattern": {"shape": "/", "fgcolor": GREY, "size": 7, "solidity": 0.25},
}
READY: Spec = {"color": GREY, "line": {"width": 0}}
#: A stretch of time in which a rule is broken, behind the rows: one runs that the most urgent should not have to wait for.
INVERTED: Spec = {"color": "#F7C9A9", "line": {"width": 0}}
LOCKS = (YELLOW, SKY, "#F4B6C2", "#B8E0B0")  # the strip of the first, second, ... lock

#: A legend at the upper edge. It hangs on the container, because plotly forgets to lift it when it was drawn narrow first.
LEGEND: Spec = {
    "orientation": "h",
    "yref": "container",
    "y": 1.0,
    "yanchor": "top",
    "x": 1,
    "xanchor": "right",
    "traceorder": "normal",
}
#: One at the right edge, beside layers that are stacked from the bottom.
LEGEND_ASIDE: Spec = {"x": 1.01, "xanchor": "left", "y": 1, "yanchor": "top", "traceorder": "reversed"}


def pale(colour: str) -> str:
    """A colour "#rrggbb" mixed with white; not transparent, since lines lie under the bars."""
    return "#" + "".join(f"{255 - round(0.45 * (255 - int(colour[i : i + 2], 16))):02x}" for i in (1, 3, 5))


#: Legend entry -> how it is drawn, for everything that means the same in all pictures.
KEYS: dict[str, Spec] = {
    "ready": {"type": "bar", "marker": READY},
    "waits for lock, queue, signal": {"type": "bar", "marker": WAITS},
    "beyond ECET": {"type": "bar", "marker": {"color": pale(BLUE)}},
    "exception part": {"type": "bar", "marker": {"color": BLUE, "pattern": CROSSED, "line": OUTLINED}},
    "priority inversion": {"type": "bar", "marker": INVERTED},
    "raised for nobody": {"type": "bar", "marker": INVERTED},
    "everybody else is held": {"type": "bar", "marker": INVERTED},
    "release": {"type": "scatter", "mode": "markers", "marker": RELEASE},
    "deadline": {"type": "scatter", "mode": "lines", "line": DEADLINE},
    "missed": {"type": "scatter", "mode": "markers", "marker": MISS},
    "aborted": {"type": "scatter", "mode": "markers", "marker": ABORT},
    "bound by analysis": {"type": "bar", "marker": BOUND},
    "measured (source 1)": {"type": "scatter", "mode": "markers", "marker": PUBLISHED},
    "published (source 2)": {"type": "scatter", "mode": "markers", "marker": PUBLISHED},
}


def key(name: str, **drawn: Any) -> Spec:
    """A trace that is only an entry of the legend: one of `KEYS`, or as given. Plotly leaves out those of empty traces."""
    return {"x": [None], "y": [None], "hoverinfo": "skip", "name": name, **(drawn or KEYS[name])}


def colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each name: the fixed one where the lab has one, else one that depends on the name only, unless it is taken."""
    chosen: dict[str, str] = {}
    for name in names:
        if name in TASK_COLOURS:
            chosen[name] = TASK_COLOURS[name]
            continue
        first = crc32(name.encode()) % len(PALETTE)
        order = [PALETTE[(first + i) % len(PALETTE)] for i in range(len(PALETTE))]
        chosen[name] = next((c for c in order if c not in chosen.values()), order[0])
    return chosen


def axis(title: str, **more: Any) -> Spec:
    """An axis with a title that names its unit, light grid, no zero line."""
    return {
        "title": {"text": title, "standoff": 8},
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": GREY,
        "ticks": "outside",
        "automargin": True,
        "ticklabeloverflow": "allow",  # else plotly measures every label at every step
    } | more


def held(top: float, *, coarse: bool = False) -> float:
    """The end of an axis that has to reach `top`: one of a few round numbers, so that it rarely moves while a slider does.
    `coarse` has three of them between 1 and 10, for what grows a hundredfold along a slider.
    """
    if top <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(top) + 1e-9)
    return next(
        round(step * power, 9)
        for step in ((1, 2, 5, 10) if coarse else (1, 1.5, 2, 3, 4, 5, 6, 8, 10))
        if step * power >= top * (1 - 1e-9)
    )


def rows_axis(names: Iterable[str], margin: float = 0.6, **more: Any) -> Spec:
    """A y axis with a row per name, the first at the top: names[i] stands at height -i."""
    ticks = [f"<b>{name}</b>" for name in names]
    return axis(
        "",
        range=[1 - len(ticks) - margin, margin],
        tickvals=[-i for i in range(len(ticks))],
        ticktext=ticks,
        showgrid=False,
        fixedrange=True,
        **more,
    )


def layout(height: int, **more: Any) -> Spec:
    """The layout every figure of the lab starts from; `height` in px. The page sets the width and scales the text."""
    return {
        "height": height,
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": "Open Sans, Segoe UI, Arial, sans-serif", "color": INK},
        "uirevision": "keep",
        "barmode": "overlay",
        "hovermode": "closest",
        **more,
    }
