"""What all pictures share: one colour per task, fonts, axes with units. Colours: Okabe and Ito, safe for the colour-blind."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from zlib import crc32

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#F0E442",
)
INK, GREY, PALE = "#1f2328", "#8c959f", "#d8dee4"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, "#7A5195", "#8B5A2B", "#4D7C0F", "#B03060")

#: Tasks that appear in more than one notebook keep their colour in all of them.
TASK_COLOURS = {
    "H": VERMILION,
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
    "profile": VERMILION,
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

#: How every picture marks a number that a source printed (or that follows from two of them): a dark diamond.
PUBLISHED = {"symbol": "diamond", "size": 14, "color": INK, "line": {"width": 1.5, "color": "white"}}
#: The same for the one of a pair that is "before": open.
PUBLISHED_BEFORE = {"symbol": "diamond", "size": 13, "color": "white", "line": {"width": 2.5, "color": INK}}

#: A wide legend in one line at the upper edge. It hangs on the container, because plotly forgets to lift it when it was drawn narrow first.
LEGEND = {"orientation": "h", "yref": "container", "y": 1.0, "yanchor": "top", "x": 1, "xanchor": "right", "traceorder": "normal"}


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


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis with a title that names its unit, light grid, no zero line."""
    return {
        "title": {"text": title, "standoff": 8},
        "gridcolor": "#e6e9ec",
        "zeroline": False,
        "linecolor": GREY,
        "ticks": "outside",
        "automargin": True,
    } | more


def layout(height: int, **more: Any) -> dict[str, Any]:
    """The layout every figure of the lab starts from; `height` in pixels."""
    return {
        "height": height,
        "autosize": True,
        "template": "none",
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": "Open Sans, Segoe UI, Arial, sans-serif", "color": INK},
        "margin": {"l": 70, "r": 20, "t": 40, "b": 50},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1, "xanchor": "right"},
        "uirevision": "keep",
        "hovermode": "closest",
    } | more
