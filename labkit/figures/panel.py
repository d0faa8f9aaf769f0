"""Drawing areas and how they become one picture. Nothing else of the lab numbers axes or computes a domain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labkit.figures.cursor import cursor
from labkit.figures.style import FONT, LEGEND, LEGEND_ASIDE, TITLE, VERMILION, Spec, key, layout

#: Width in px for which room between panels side by side is measured: a page gives a picture 1100 to 1560 px, and text that is
#: enlarged for a lecture needs room, too.
WIDTH = 1050
TITLED, NAMED, BARE, GAP = 30, 58, 34, 12  # px: a title above; below: an axis with a title, one without, none at all
LEGEND_BAND, TOP, RIGHT = 34, 16, 20  # a legend of two lines fits above the titles, too


@dataclass(frozen=True)
class Panel:
    """One drawing area.

    Attributes:
        traces: plotly traces; those that name no axes are drawn on this panel's.
        x, y: its axes (`style.axis`); no `x` in a picture whose panels share one.
        shapes, notes: plotly's shapes and annotations. Their references "x", "y", "x domain", "y domain" mean this panel's axes
            ("x" and "y" where none is given), "paper" the whole picture.
        title: text above its left edge. caption: plain text behind it. remark: text behind both, in the colour of an alarm.
        above: room in px above it, where a title is not all.
        height, width: share of the picture relative to the panels above and below, or beside it.
        left: room in px left of it, for the text of its y axis.
    """

    traces: Sequence[Spec]
    y: Spec
    x: Spec | None = None
    shapes: Sequence[Spec] = ()
    notes: Sequence[Spec] = ()
    title: str = ""
    caption: str = ""
    remark: str = ""
    above: int = 0
    height: float = 1.0
    width: float = 1.0
    left: int = 74


@dataclass
class _Picture:
    """What has been collected so far."""

    data: list[Spec] = field(default_factory=list)
    axes: Spec = field(default_factory=dict)
    shapes: list[Spec] = field(default_factory=list)
    notes: list[Spec] = field(default_factory=list)


def stack(
    *rows: Panel | Sequence[Panel],
    height: int,
    shared: Spec | None = None,
    keys: Sequence[str | Spec] = (),
    legend: bool = True,
    aside: int = 0,
    bottom: int = NAMED,
    at: float | None = None,
    says: str | None = None,
    **more: Any,
) -> Spec:
    """Rows of panels as a plotly figure, a dict with `data` and `layout`.

    Args:
        rows: from top to bottom; a row of several panels has them side by side.
        height: of the whole picture in px.
        shared: the x axis of all panels, drawn below the lowest; they have none of their own then.
        keys: entries of the legend beside those of the traces: names of `style.KEYS`, or traces made by `style.key`.
        legend: whether there is one; it has a band of its own at the upper edge.
        aside: width in px of a legend at the right edge instead, for what is stacked: its order is that of the layers.
        bottom: room in px below the lowest row, for its axis.
        at: where a time cursor stands, through all panels that share their axis.
        says: a sentence that a bench shows above the picture: what happens there.
        more: other settings of plotly's layout.
    Raises:
        ValueError: a panel has an x axis of its own beside the shared one, or there is no x axis for it.
    """
    grid = [[row] if isinstance(row, Panel) else list(row) for row in rows]
    if any((panel.x is None) == (shared is None) for row in grid for panel in row):
        raise ValueError("either every panel has an x axis of its own, or all share one")
    top = (LEGEND_BAND if legend and not aside else 0) + TOP + _above(grid[0])
    left = max(row[0].left for row in grid)
    below = [_below(row) for row in grid[:-1]]
    used = sum(below) + sum(_above(row) for row in grid[1:])
    room = height - top - bottom
    unit = (room - used) / sum(row[0].height for row in grid) / room  # share of the plot area for a panel of height 1
    made = _Picture()
    edge = 1.0
    for i, row in enumerate(grid):
        if i:
            edge -= (below[i - 1] + _above(row)) / room
        bounds = max(0.0, edge - unit * row[0].height), edge
        edge = bounds[0]
        for panel, across in zip(row, _columns(row, left), strict=True):
            _place(made, panel, bounds, across, shared)
    meta = {} if says is None else {"says": says}
    if at is not None:
        end = (shared or {}).get("range", (at, at))[1]
        made.shapes.append(cursor(min(at, end)))
        meta["ended"] = at >= end
    entries = [key(entry) if isinstance(entry, str) else entry for entry in keys]
    return {
        "data": [*made.data, *entries],
        "layout": layout(
            height,
            **{
                **made.axes,
                "shapes": made.shapes,
                "annotations": made.notes,
                "margin": {"l": left, "r": aside or RIGHT, "t": top, "b": bottom},
                "legend": LEGEND_ASIDE if aside else LEGEND,
                "showlegend": legend,
                **more,
                "meta": {**meta, **more.get("meta", {})},
            },
        ),
    }


def _above(row: Sequence[Panel]) -> int:
    return max(panel.above or (TITLED if panel.title or panel.caption or panel.remark else 0) for panel in row)


def _below(row: Sequence[Panel]) -> int:
    """Room below a row that is not the lowest, for its own axis where it has one and for what comes next."""
    own = [panel.x for panel in row if panel.x is not None and panel.x.get("visible", True)]
    return GAP + (0 if not own else NAMED if any(x["title"]["text"] for x in own) else BARE)


def _columns(row: Sequence[Panel], left: int) -> list[tuple[float, float]]:
    """Domains of panels side by side: each but the first has its `left` free beside it."""
    room = WIDTH - left - RIGHT
    gaps = [0.0, *(panel.left / room for panel in row[1:])]
    unit = (1 - sum(gaps)) / sum(panel.width for panel in row)
    found, edge = [], 0.0
    for panel, gap in zip(row, gaps, strict=True):
        edge += gap
        found.append((edge, min(1.0, edge + unit * panel.width)))
        edge = found[-1][1]
    return found


def _place(made: _Picture, panel: Panel, down: tuple[float, float], across: tuple[float, float], shared: Spec | None) -> None:
    """Give a panel its axes and take over what it draws. A shared axis stands below the panel placed last."""
    n = 1 + sum(key.startswith("yaxis") for key in made.axes)
    x, y = _name("x", 1 if panel.x is None else n), _name("y", n)
    made.axes[x.replace("x", "xaxis")] = {**(panel.x or shared or {}), "anchor": y, "domain": list(across)}
    made.axes[y.replace("y", "yaxis")] = {**panel.y, "anchor": x, "domain": list(down)}
    made.data += [{"xaxis": x, "yaxis": y, **trace} for trace in panel.traces]
    made.shapes += [_referred(shape, x, y) for shape in panel.shapes]
    made.notes += [{"font": {"size": FONT}, "showarrow": False, **_referred(note, x, y)} for note in panel.notes]
    words = [
        panel.title and f"<b>{panel.title}</b>",
        panel.caption,
        panel.remark and f'<span style="color:{VERMILION}">{panel.remark}</span>',
    ]
    if any(words):
        made.notes.append(
            {
                "text": "   ".join(filter(None, words)),
                "xref": "paper",
                "yref": "paper",
                "x": across[0],
                "y": down[1],
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": TITLE},
            }
        )


def _name(letter: str, n: int) -> str:
    return letter if n == 1 else f"{letter}{n}"


def _referred(thing: Mapping[str, Any], x: str, y: str) -> Spec:
    """A shape or annotation whose references name the panel's axes."""
    names = {"x": x, "y": y, "x domain": f"{x} domain", "y domain": f"{y} domain", "paper": "paper"}
    return {**thing, "xref": names[thing.get("xref", "x")], "yref": names[thing.get("yref", "y")]}
