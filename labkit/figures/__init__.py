"""Pictures: panels, and one way to draw each thing the models show; the style all of them share."""

from labkit.figures.cache_map import cache_map
from labkit.figures.comparison import Bar, Factor, Pair, dumbbells, factors, stacked
from labkit.figures.cursor import cursor, happening
from labkit.figures.curves import Curve, curves
from labkit.figures.field import (
    arc_lines,
    circle,
    disc_lines,
    dots,
    drawn,
    edge_lines,
    element_lines,
    enlarged,
    from_above,
    outlines,
    polygon_lines,
    scanners,
    there,
)
from labkit.figures.gantt import gantt, lock_keys
from labkit.figures.history import History
from labkit.figures.interleaving import Access, Cell, interleaving
from labkit.figures.lanes import Lane, Move, Span, lanes
from labkit.figures.lengths import lengths
from labkit.figures.margins import Response, reserve, responses
from labkit.figures.panel import Panel, stack
from labkit.figures.phases import activity_stack, periods_gantt, plan, verdict_grid
from labkit.figures.sequence import Hop, sequence
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
    "Hop",
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
    "arc_lines",
    "axis",
    "cache_map",
    "circle",
    "colours",
    "cursor",
    "curves",
    "disc_lines",
    "dots",
    "drawn",
    "dumbbells",
    "edge_lines",
    "element_lines",
    "ellipse",
    "enlarged",
    "factors",
    "from_above",
    "gantt",
    "happening",
    "held",
    "interleaving",
    "key",
    "lanes",
    "lengths",
    "lock_keys",
    "outlines",
    "periods_gantt",
    "plan",
    "polygon_lines",
    "priorities",
    "reserve",
    "responses",
    "scanners",
    "sequence",
    "stack",
    "stacked",
    "steps",
    "there",
    "tracks",
    "verdict_grid",
]
