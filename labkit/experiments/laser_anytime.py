"""Notebook 11: what the stages of the chain have when they are aborted (source 2, section 2.5; the framework of notebook 08)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric
from labkit.experiments.laser_pipeline import HERE, LENGTH, SIDEWAYS, WIDTH, Noise, Rotations, Seed, robots
from labkit.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    VERMILION,
    Panel,
    arc_lines,
    axis,
    drawn,
    edge_lines,
    element_lines,
    from_above,
    outlines,
    scanners,
    spots,
    stack,
    there,
)
from labkit.fusion import (
    NO_ARCS,
    NO_EDGES,
    Chain,
    Contours,
    Points,
    Pose,
    Scanner,
    Straight,
    World,
    arc_quality,
    ball,
    edge_quality,
    element_filter,
    element_quality,
    extract_edges,
    field,
    from_contours,
    object_filter,
    object_quality,
    points,
    robot,
    scan,
    search_arcs,
    within,
)

LOW, HIGH = 0.01, 30.0  # ms, of the time axis
STAGES = {"edges": GREEN, "arcs": VERMILION, "objects": ORANGE, "elements": BLUE}

Given = Annotated[float, Interval(ge=0, le=12), MultipleOf(0.25), Unit("ms")]


@dataclass(frozen=True, eq=False)
class Curve:
    """A stage against its own time: `ready_ns` when each result was there, and its `quality` from 0 to 1."""

    ready_ns: np.ndarray
    quality: np.ndarray

    def at(self, ns: float) -> float:
        """Quality of what is there after that time; 0 before the first result."""
        done = int(np.searchsorted(self.ready_ns, ns, side="right"))
        return float(self.quality[done - 1]) if done else 0.0


@dataclass(frozen=True, eq=False)
class Aborted:
    """The scene, what the chain made of it within the time given, and every stage's curve.

    The curves of objects and elements are those after a contour filter that was not aborted.
    """

    world: World
    chain: Chain
    curves: dict[str, Curve]
    quality: float
    in_full: float


def graded(steps: Iterable[tuple[int, Any]], quality: Callable[[Any], float]) -> Curve:
    """The curve of a stage."""
    costs, grades = zip(*((cost, quality(result)) for cost, result in steps))
    return Curve(np.cumsum(costs), np.array(grades))


def curves_of(seen: Points, world: World) -> tuple[dict[str, Curve], Chain, list[tuple[int, Any]], list[tuple[int, Any]]]:
    """Every stage's curve, the chain in full, and the steps of both halves of the contour filter."""
    edges, arcs = list(extract_edges(seen)), list(search_arcs(seen))
    contours = Contours(seen.station, seen.time_ns, edges[-1][1], arcs[-1][1])
    chain = from_contours(seen, contours)
    curves = {
        "edges": graded(edges, lambda found: edge_quality(seen, world, found)),
        "arcs": graded(arcs, lambda found: arc_quality(seen, world, found)),
        "objects": graded(object_filter(contours), lambda found: object_quality(seen, world, found)),
        "elements": graded(element_filter(chain.objects), lambda found: element_quality(seen, world, found)),
    }
    return curves, chain, edges, arcs


class AnytimeStages(Experiment[Aborted]):
    """What is a contour filter worth that was stopped halfway?

    Both halves have a result at once and improve it until they are through or aborted. Right: quality against the time of each
    stage. Times are modelled, 2 us per visit to a point.
    """

    edges_time: Annotated[Given, Doc("after which edge extraction is aborted")] = 1.75
    arcs_time: Annotated[Given, Doc("after which the arc search is aborted")] = 1.0
    rotations: Rotations = 2
    noise: Noise = 5
    touching: Annotated[bool, Doc("the ball lies at a robot: it is found only by the long search")] = False
    seed: Seed = 1

    def world(self) -> World:
        """The scene of `LaserPipeline`, with the ball in front of the scanner or at robot R1."""
        place = Pose(2.22, 1.14) if self.touching else Pose(HERE.x + 2, HERE.y + SIDEWAYS)
        return field(LENGTH, WIDTH, [robot("A", Straight(HERE)), ball(Straight(place)), *robots()])

    def run(self) -> Aborted:
        world = self.world()
        scanner = Scanner(1 / self.rotations, noise_m=self.noise / 1000)
        seen = points(scan(world, scanner, "A", 0, np.random.default_rng(self.seed)))
        curves, in_full, edges, arcs = curves_of(seen, world)
        contours = Contours(
            seen.station,
            seen.time_ns,
            within(iter(edges), round(self.edges_time * 1e6)) or NO_EDGES,
            within(iter(arcs), round(self.arcs_time * 1e6)) or NO_ARCS,
        )
        chain = from_contours(seen, contours)
        return Aborted(
            world, chain, curves, element_quality(seen, world, chain.elements), element_quality(seen, world, in_full.elements)
        )

    def figure(self, result: Aborted) -> dict[str, Any]:
        chain = result.chain
        known = [element for element in chain.elements.elements if element.kind != "border"]
        above = from_above(
            [
                there(outlines(result.world, chain.points.time_ns, without=("A",))),
                spots("points", chain.points.xy, INK, 0.06),
                drawn("elements", element_lines(known), STAGES["elements"], 3, showlegend=False),
                drawn("edges", edge_lines(chain.contours.edges), GREEN),
                drawn("arcs", arc_lines(chain.contours.arcs), VERMILION),
                scanners("A", [HERE[:2]], [INK]),
            ],
            (-0.3, LENGTH + 0.3),
            (-0.3, WIDTH + 0.3),
            title="after the abort",
            width=1.3,
        )
        given = {"edges": self.edges_time, "arcs": self.arcs_time}
        x = axis("time of the stage [ms]", type="log", range=[np.log10(LOW), np.log10(HIGH)], tickvals=[0.01, 0.1, 1, 10])
        quality = Panel(
            [*(_steps(name, curve) for name, curve in result.curves.items()), _marks(result, given)],
            axis("quality", range=[-0.04, 1.06]),
            x,
            title="quality",
            caption="○ aborted here",
            left=70,
        )
        return stack([above, quality], height=450)

    def metrics(self, result: Aborted) -> list[Metric]:
        edges, arcs = result.curves["edges"], result.curves["arcs"]
        return [
            Metric("elements, aborted", result.quality, note="ball and robots, each worth less the further off it is"),
            Metric("elements, in full", result.in_full),
            Metric("contour time saved", self.saved(result), "%", note="of both halves together"),
            Metric("edges at the abort", edges.at(self.edges_time * 1e6), note="share of the points on straight things"),
            Metric("arcs at the abort", arcs.at(self.arcs_time * 1e6)),
            Metric("edges in full after", edges.ready_ns[-1] / 1e6, "ms"),
            Metric("arcs in full after", arcs.ready_ns[-1] / 1e6, "ms"),
        ]

    def saved(self, result: Aborted) -> float:
        """Share of the contour filter's modelled time that the aborts save, in %."""
        full = [result.curves[name].ready_ns[-1] / 1e6 for name in ("edges", "arcs")]
        used = min(self.edges_time, full[0]) + min(self.arcs_time, full[1])
        return float(100 * (1 - used / sum(full)))


def _steps(name: str, curve: Curve) -> dict[str, Any]:
    """A stair from the first result on, to the right edge."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.append(curve.ready_ns / 1e6, HIGH),
        "y": np.append(curve.quality, curve.quality[-1]),
        "name": name,
        "showlegend": name in ("objects", "elements"),
        "line": {"color": STAGES[name], "width": 3, "shape": "hv"},
        "hovertemplate": f"{name}: %{{y:.2f}} after %{{x:.2f}} ms<extra></extra>",
    }


def _marks(result: Aborted, given: dict[str, float]) -> dict[str, Any]:
    """Where the two halves were aborted."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [max(ms, LOW) for ms in given.values()],
        "y": [result.curves[name].at(ms * 1e6) for name, ms in given.items()],
        "marker": {"symbol": "circle-open", "size": 16, "color": [STAGES[name] for name in given], "line": {"width": 4}},
        "showlegend": False,
        "hovertemplate": "aborted after %{x:.2f} ms: %{y:.2f}<extra></extra>",
    }


def check_shortest_time(answer: float) -> Feedback:
    """Exercise: the shortest time on the slider for the edges after which the elements are as good as in full, within 0.05.

    The arcs have all their time.
    """
    start = AnytimeStages(arcs_time=12.0)
    full = start.run().in_full
    enough = next(ms / 4 for ms in range(49) if start.replace(edges_time=ms / 4).run().quality >= full - 0.05)
    if not isinstance(answer, int | float) or abs(answer - enough) > 0.01:
        return Feedback(False, f"with that the elements are not yet, or were before, within 0.05 of {full:.2f}; move edges_time")
    return Feedback(True, f"after {enough:g} ms the elements are as good as in full, within 0.05")
