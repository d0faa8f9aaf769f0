"""Notebook 13: one fast object, seen at once or not, fused at the level of points and of contours (source 2, figure 42)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric
from labkit.experiments.laser_pipeline import Rotations, Seed
from labkit.experiments.laser_views import COLOURS, KEYS, PLACES, ROLLS_FROM, FusedViews
from labkit.figures import (
    GREEN,
    INK,
    VERMILION,
    Panel,
    arc_lines,
    drawn,
    edge_lines,
    element_lines,
    from_above,
    outlines,
    spots,
    stack,
    there,
)
from labkit.fusion import Contours, Fusion, Level, Points, Scanner, World, fuse_levels, points, scan

MS = 1_000_000
EARLY: tuple[Level, Level] = ("points", "contours")
BEFORE, BEHIND, BESIDE = 0.4, 1.6, 0.25  # m that are shown before, behind and beside the ball's first place


@dataclass(frozen=True, eq=False)
class Look:
    """What both stations measured, B so much later, and what became of it at the two levels."""

    points: list[Points]
    fusions: dict[Level, Fusion]

    def balls(self, level: Level) -> int:
        """Balls in the fused picture."""
        return len(self.fusions[level].elements.of("ball"))


@dataclass(frozen=True, eq=False)
class Looks:
    """The world, and both ways to look at it."""

    world: World
    later: Look
    at_once: Look


class OneFastObject(Experiment[Looks]):
    """What do points and contours make of one fast ball?

    Two robots look at a ball that rolls to the right. Left, B looks later by *offset*, as it happens when periods are not
    coordinated; right, both look at once. Above, their points are fused; below, their contours.
    """

    headline: ClassVar[tuple[str, ...]] = ("points, B later", "contours, B later", "rolls meanwhile")
    speed: Annotated[float, Interval(ge=0, le=4), MultipleOf(0.25), Unit("m/s"), Doc("of the ball")] = 2.0
    offset: Annotated[int, Interval(ge=0, le=320), MultipleOf(20), Unit("ms"), Doc("B looks so much later than A")] = 160
    rotations: Rotations = 2
    seed: Seed = 1

    def run(self) -> Looks:
        world = FusedViews(speed=self.speed).world()
        return Looks(world, self.look(world, self.offset), self.look(world, 0))

    def look(self, world: World, offset_ms: int) -> Look:
        """Both stations, B so much later."""
        scanner, rng = Scanner(1 / self.rotations), np.random.default_rng(self.seed)
        seen = [points(scan(world, scanner, name, start * MS, rng)) for name, start in zip(PLACES, (0, offset_ms), strict=True)]
        return Look(seen, fuse_levels(seen, levels=EARLY))

    def figure(self, result: Looks) -> dict[str, Any]:
        ways = {f"B {self.offset} ms later": result.later, "both at once": result.at_once}
        panels = [
            self.panel(result, look, level, 1 + i, way)
            for i, (level, (way, look)) in enumerate((level, way) for level in EARLY for way in ways.items())
        ]
        return stack(panels[:2], panels[2:], height=480, keys=KEYS)

    def panel(self, result: Looks, look: Look, level: Level, place: int, way: str) -> Panel:
        """One level, one way to look."""
        fused, balls = look.fusions[level], look.balls(level)
        ball = result.world.bodies[result.world.index("ball")]
        first = place == 1
        contours = fused.fused if isinstance(fused.fused, Contours) else None
        edges, arcs = (edge_lines(contours.edges), arc_lines(contours.arcs)) if contours else ([], [])
        known = element_lines(fused.elements.of("ball"))
        moved = [ball.outline(one.time_ns) for one in look.points]
        words = f"{balls} ball{'s' * (balls != 1)}"
        return from_above(
            [
                there([*moved, *outlines(result.world, look.points[0].time_ns, without=("ball", *PLACES))], legend=first),
                drawn("fused edge", edges, GREEN, 6, showlegend=first),
                drawn("fused arc", arcs, INK, 6, showlegend=first),
                drawn("ball in the picture", known, VERMILION, 3, showlegend=first),
                *(spots(f"points of {one.station}", one.xy, COLOURS[one.station], 0.024) for one in look.points),
            ],
            (ROLLS_FROM.x - BEFORE, ROLLS_FROM.x + BEHIND),
            (ROLLS_FROM.y - BESIDE, ROLLS_FROM.y + BESIDE),
            place=place,
            title=f"{level}, {way}",
            caption=words if balls == 1 else "",
            remark="" if balls == 1 else words,
        )

    def metrics(self, result: Looks) -> list[Metric]:
        counts = {
            f"{level}, {way}": look.balls(level)
            for level in EARLY
            for way, look in (("B later", result.later), ("at once", result.at_once))
        }
        return [
            *(
                Metric(name, balls, "balls", good=balls == 1, note="in the picture; there is one")
                for name, balls in counts.items()
            ),
            Metric("rolls meanwhile", self.speed * self.offset / 10, "cm", note="what is nearer than 25 cm is taken for one"),
        ]
