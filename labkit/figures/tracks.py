"""Moving elements seen from above: what was measured, which way they took, and how sure a filter is, as ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labkit.figures.panel import Panel
from labkit.figures.style import Spec

#: An ellipse holds the element with this probability; corners of the line that draws it.
SHARE, CORNERS = 0.95, 33


@dataclass(frozen=True, eq=False)
class Dots:
    """Places, complex, in m, such as measured ones; `legend`: whether they have an entry there."""

    name: str
    places: np.ndarray
    colour: str
    symbol: str = "circle"
    size: int = 9
    legend: bool = True


@dataclass(frozen=True, eq=False)
class Way:
    """A way through places, complex, in m; `covariances` (k, 2, 2) in m^2 draw an ellipse around each."""

    name: str
    places: np.ndarray
    colour: str
    dash: str = "solid"
    width: int = 3
    covariances: np.ndarray | None = None
    marks: bool = False


def ellipse(centre: complex, covariance: np.ndarray, share: float = SHARE) -> np.ndarray:
    """The line, complex, shape (CORNERS,), within which a normal distribution with that mean and covariance has `share`."""
    values, vectors = np.linalg.eigh(covariance)
    radius = math.sqrt(-2 * math.log1p(-share))  # two dimensions
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    around = vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * radius * np.stack([np.cos(angle), np.sin(angle)]))
    return centre + around[0] + 1j * around[1]


def tracks(ways: Sequence[Way], dots: Sequence[Dots], x: Spec, y: Spec, **more: object) -> Panel:
    """Ways under dots, seen from above, at the same scale in both directions; the ranges of the axes stay what they are.

    `more` are other attributes of the `Panel`.
    """
    drawn: list[Spec] = [_ellipses(way) for way in ways if way.covariances is not None]
    drawn += [_line(way) for way in ways]
    drawn += [_dots(some) for some in dots]
    x, y = {**x, "constrain": "domain", "constraintoward": "left"}, {**y, "constrain": "domain", "scaleanchor": "x"}
    return Panel(drawn, y, x, **more)  # type: ignore[arg-type]


def _ellipses(way: Way) -> Spec:
    assert way.covariances is not None
    lines = [np.append(ellipse(p, P), np.nan) for p, P in zip(way.places, way.covariances)]
    line = np.concatenate(lines) if lines else np.empty(0, complex)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": line.real,
        "y": np.where(np.isnan(line.real), np.nan, line.imag),
        "fill": "toself",
        "fillcolor": _shade(way.colour, 0.18),
        "line": {"color": way.colour, "width": 1},
        "name": way.name,
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _line(way: Way) -> Spec:
    return {
        "type": "scatter",
        "mode": "lines+markers" if way.marks else "lines",
        "x": way.places.real,
        "y": way.places.imag,
        "name": way.name,
        "line": {"color": way.colour, "width": way.width, "dash": way.dash},
        "marker": {"size": 7, "color": way.colour},
        "hovertemplate": f"{way.name}: %{{x:.3f}}, %{{y:.3f}} m<extra></extra>",
    }


def _dots(dots: Dots) -> Spec:
    filled = not dots.symbol.endswith(("-open", "-thin"))  # with a white rim, so that dots over a line stand apart
    return {
        "type": "scatter",
        "mode": "markers",
        "x": dots.places.real,
        "y": dots.places.imag,
        "name": dots.name,
        "marker": {
            "color": dots.colour,
            "symbol": dots.symbol,
            "size": dots.size,
            "line": {"width": 1, "color": "white"} if filled else {"width": 3, "color": dots.colour},
        },
        "showlegend": dots.legend,
        "hovertemplate": f"{dots.name}: %{{x:.3f}}, %{{y:.3f}} m<extra></extra>",
    }


def _shade(colour: str, opacity: float) -> str:
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},{opacity})"
