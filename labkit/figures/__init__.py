"""Pictures: panels, and one way to draw each thing the models show; the style all of them share."""

from labkit.figures.cache_map import cache_map
from labkit.figures.comparison import Bar, Factor, Pair, dumbbells, factors, stacked
from labkit.figures.cursor import cursor, happening
from labkit.figures.curves import Curve, curves
from labkit.figures.gantt import gantt
from labkit.figures.history import History
from labkit.figures.interleaving import Access, Cell, interleaving
from labkit.figures.lanes import Lane, Move, Span, lanes
from labkit.figures.margins import Response, reserve, responses
from labkit.figures.panel import Panel, stack
from labkit.figures.phases import activity_stack, periods_gantt, plan, verdict_grid
from labkit.figures.steps import Marks, Steps, priorities, steps
from labkit.figures.style import (
    BLUE,
    FONT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PALETTE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
    axis,
    colours,
    held,
    key,
)
from labkit.figures.tracks import Dots, Way, ellipse, tracks

__all__ = [
    "BLUE",
    "FONT",
    "GREEN",
    "GREY",
    "INK",
    "ORANGE",
    "PALE",
    "PALETTE",
    "PURPLE",
    "SKY",
    "VERMILION",
    "YELLOW",
    "Access",
    "Bar",
    "Cell",
    "Curve",
    "Dots",
    "Factor",
    "History",
    "Lane",
    "Marks",
    "Move",
    "Pair",
    "Panel",
    "Response",
    "Span",
    "Steps",
    "Way",
    "activity_stack",
    "axis",
    "cache_map",
    "colours",
    "cursor",
    "curves",
    "dumbbells",
    "ellipse",
    "factors",
    "gantt",
    "happening",
    "held",
    "interleaving",
    "key",
    "lanes",
    "periods_gantt",
    "plan",
    "priorities",
    "reserve",
    "responses",
    "stack",
    "stacked",
    "steps",
    "tracks",
    "verdict_grid",
]
