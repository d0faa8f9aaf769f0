"""Notebook 11: two robots look at one field, at once or not (source 2, figure 42)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.experiments.laser_pipeline import LENGTH, WIDTH, Noise, Rotations, Seed
from labkit.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    Panel,
    drawn,
    element_lines,
    from_above,
    outlines,
    scanners,
    spot_key,
    spots,
    stack,
    there,
)
from labkit.fusion import (
    Elements,
    Points,
    Pose,
    Scanner,
    Straight,
    World,
    ball,
    field,
    fuse_elements,
    fuse_points,
    points,
    robot,
    run_chain,
    scan,
    seen_bodies,
    within,
)

MS = 1_000_000
PLACES = {"A": Pose(0.8, 1.0, 0.5), "B": Pose(6.8, 0.8, 2.4)}  # of the two robots that look
COLOURS = {"A": BLUE, "B": ORANGE}
KEYS = [spot_key(f"points of {name}", colour) for name, colour in COLOURS.items()]
ROLLS_FROM = Pose(3.0, 3.1)

Level = Literal["points", "elements"]


@dataclass(frozen=True, eq=False)
class View:
    """One period of both stations: their points, what each recognises alone, and the fused picture."""

    points: list[Points]
    alone: list[Elements]
    fused: Elements

    def balls(self) -> int:
        """Balls in the fused picture."""
        return len(self.fused.of("ball"))

    def border(self) -> list[float]:
        """Metres of border that A, B and both together know."""
        return [sum(wall.size for wall in found.of("border")) for found in (*self.alone, self.fused)]


@dataclass(frozen=True, eq=False)
class Views:
    """The world and the two ways of looking at it."""

    world: World
    offset: View
    together: View


class FusedViews(Experiment[Views]):
    """Why does one ball look like two?

    Robots A and B scan the field, and their data are fused. Left, B scans later than A by *offset*, as stations do whose periods
    are not coordinated; right, both scan at once. One ball rolls, always.
    """

    level: Annotated[
        Level,
        Labels({"points": "points", "elements": "elements"}),
        Doc("what is fused: scan points, or what each has recognised"),
    ] = "elements"
    offset: Annotated[int, Interval(ge=0, le=320), MultipleOf(20), Unit("ms"), Doc("B scans so much later than A")] = 160
    speed: Annotated[float, Interval(ge=0, le=4), MultipleOf(0.25), Unit("m/s"), Doc("of the ball")] = 2.0
    rotations: Rotations = 2
    noise: Noise = 5
    seed: Seed = 1

    def world(self) -> World:
        """Two robots that look, two in the way, one ball that rolls to the right."""
        others = [robot("R1", Straight(Pose(2.6, 1.6, 0.3))), robot("R2", Straight(Pose(6.2, 2.8, 0.7)))]
        lookers = [robot(name, Straight(place)) for name, place in PLACES.items()]
        return field(LENGTH, WIDTH, [*lookers, ball(Straight(ROLLS_FROM, vx=self.speed)), *others])

    def run(self) -> Views:
        world = self.world()
        return Views(world, self.view(world, self.offset), self.view(world, 0))

    def view(self, world: World, offset_ms: int) -> View:
        """What both see if B scans so much later."""
        scanner, rng = Scanner(1 / self.rotations, noise_m=self.noise / 1000), np.random.default_rng(self.seed)
        seen = [points(scan(world, scanner, name, start * MS, rng)) for name, start in (("A", 0), ("B", offset_ms))]
        alone = [run_chain(one).elements for one in seen]
        if self.level == "elements":
            fused = within(fuse_elements(alone))
        else:
            together = within(fuse_points(seen))
            assert together is not None, "an anytime stage has at least one result"
            fused = run_chain(together).elements
        assert fused is not None
        return View(seen, alone, fused)

    def figure(self, result: Views) -> dict[str, Any]:
        left = self.panel(result, result.offset, 1, f"B {self.offset} ms later")
        right = self.panel(result, result.together, 2, "both at once")
        return stack([left, right], height=430, keys=KEYS)

    def panel(self, result: Views, view: View, place: int, title: str) -> Panel:
        """One of the two ways of looking."""
        times = sorted({one.time_ns for one in view.points})
        scene = outlines(result.world, times[0], without=tuple(PLACES))
        moved = [body.outline(times[-1]) for body in result.world.bodies if body.kind == "ball"]
        first, kinds = place == 1, (("border", GREEN), ("ball", VERMILION), ("robot", PURPLE))
        count = view.balls()
        return from_above(
            [
                there([*scene, *moved], legend=first),
                *(drawn(kind, element_lines(view.fused.of(kind)), colour, showlegend=first) for kind, colour in kinds),  # type: ignore[arg-type]
                *(spots(f"points of {p.station}", p.xy, COLOURS[p.station], 0.08) for p in view.points),
                scanners(tuple(PLACES), [place[:2] for place in PLACES.values()], [INK, INK]),
            ],
            (-0.3, LENGTH + 0.3),
            (-0.3, WIDTH + 0.3),
            place=place,
            title=title,
            caption=f"{count} {'ball' if count == 1 else 'balls'}" if count == 1 else "",
            remark="" if count == 1 else f"{count} balls",
        )

    def metrics(self, result: Views) -> list[Metric]:
        balls, together = result.offset.balls(), result.together.balls()
        seen = [[body.name for body in seen_bodies(result.world, one) if body.kind != "border"] for one in result.together.points]
        border = result.together.border()
        return [
            Metric("balls, B later", balls, good=balls == 1, note="in the fused picture; there is one"),
            Metric("balls, both at once", together, good=together == 1),
            Metric("ball moves meanwhile", self.speed * self.offset / 10, "cm"),
            Metric("seen by A", len(seen[0]), "things", note=", ".join(seen[0])),
            Metric("seen by B", len(seen[1]), "things", note=", ".join(seen[1])),
            Metric("seen by one or both", len({*seen[0], *seen[1]}), "things"),
            Metric("border known to A", border[0], "m"),
            Metric("border known to B", border[1], "m"),
            Metric("border known to both", border[2], "m", note=f"of {2 * (LENGTH + WIDTH):g} m"),
        ]


def check_two_balls(answer: float) -> Feedback:
    """Exercise: the least speed on the slider, in m/s, at which element fusion at an offset of 160 ms shows two balls."""
    least = next(speed / 4 for speed in range(17) if FusedViews(speed=speed / 4).run().offset.balls() == 2)
    if not isinstance(answer, int | float) or abs(answer - least) > 0.01:
        return Feedback(
            False, "not the least one; elements nearer than 25 cm are taken for one: how far does the ball roll in 160 ms?"
        )
    return Feedback(True, f"at {least:g} m/s the ball rolls {16 * least:.0f} cm, and two that are 25 cm apart are two")
