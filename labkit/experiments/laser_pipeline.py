"""Notebook 11: from laser points to elements, one scan, stage by stage (source 2, section 2.5 and figure 38)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import example
from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    arc_lines,
    disc_lines,
    drawn,
    edge_lines,
    element_lines,
    enlarged,
    from_above,
    outlines,
    polygon_lines,
    scanners,
    spot_key,
    spots,
    stack,
    there,
)
from labkit.fusion import (
    BALL_RADIUS,
    SECOND,
    Body,
    Chain,
    Contours,
    Element,
    Pose,
    Scanner,
    Settings,
    Straight,
    World,
    ball,
    extract_edges,
    field,
    from_contours,
    points,
    read_scans,
    robot,
    run_chain,
    scan,
    search_arcs,
    seen_bodies,
)

LENGTH, WIDTH = 8.0, 5.0  # m, of the field
HERE = Pose(0.5, 2.5)  # where scanner A stands
SIDEWAYS = 0.30  # m that the ball lies left of the scanner's axis
ROTATIONS = {"odd rotations": BLUE, "even rotations": ORANGE}
AROUND = 32  # cm shown on each side of the ball's first place

Rotations = Annotated[
    Literal[1, 2, 4],
    Labels({1: "1: every 1°", 2: "2: every 0.5°", 4: "4: every 0.25°"}),
    Doc("of the mirror per scan: each measures once per degree, shifted against the others"),
]
Noise = Annotated[int, Interval(ge=0, le=40), Unit("mm"), Doc("standard deviation of a distance; LMS 200: 5 mm")]
Seed = Annotated[int, Interval(ge=1, le=20), Doc("another draw of the noise")]
Stage = Literal["points", "contours", "objects", "elements"]


def robots() -> list[Body]:
    """Three robots that stand about."""
    places = {"R1": (2.6, 1.0, 0.4), "R2": (4.4, 4.0, 0.9), "R3": (6.0, 1.5, 0.2)}
    return [robot(name, Straight(Pose(*place))) for name, place in places.items()]


@dataclass(frozen=True, eq=False)
class Seen:
    """One scan and what the chain made of it.

    Attributes:
        world: with its time, as the scanner found it. rotation: in which rotation each point was measured.
        chain: the formats. contour_ns: modelled times of edges and arcs. link_ns: time on the serial link.
    """

    world: World
    chain: Chain
    rotation: np.ndarray
    contour_ns: tuple[int, int]
    link_ns: int

    @property
    def time_ns(self) -> int:
        return self.chain.points.time_ns

    def ball(self) -> tuple[float, float]:
        """Where the ball is at the time of the scan."""
        x, y, _ = self.world.bodies[self.world.index("ball")].motion.at(self.time_ns).tolist()
        return x, y

    def ball_error(self) -> float | None:
        """Distance in mm of the ball that was found nearest to it; None if none is within its radius."""
        x, y = self.ball()
        off = [float(np.hypot(e.x - x, e.y - y)) for e in self.chain.elements.of("ball")]
        return 1000 * min(off) if off and min(off) < BALL_RADIUS else None


class LaserPipeline(Experiment[Seen]):
    """How do 361 distances become a ball, robots and a border?

    Scanner A looks along the field. Step through the four formats with *stage*; the picture on the right shows the ball.
    """

    stage: Annotated[Stage, View(), Doc("the format that is drawn")] = "points"
    rotations: Rotations = 2
    noise: Noise = 5
    distance: Annotated[float, Interval(ge=0.5, le=7), MultipleOf(0.25), Unit("m"), Doc("from the scanner to the ball")] = 2.0
    speed: Annotated[float, Interval(ge=0, le=5), MultipleOf(0.25), Unit("m/s"), Doc("of the ball, away from the scanner")] = 0.0
    gap: Annotated[
        int, Interval(ge=1, le=40), Unit("cm"), Doc("points further apart than this, beyond the beams' spread, are two things")
    ] = 5
    split: Annotated[int, Interval(ge=1, le=30), Unit("cm"), Doc("an edge with a point further away than this is split")] = 3
    seed: Seed = 1

    def world(self) -> World:
        """Border, scanner A, ball and three robots."""
        rolling = ball(Straight(Pose(HERE.x + self.distance, HERE.y + SIDEWAYS), vx=self.speed))
        return field(LENGTH, WIDTH, [robot("A", Straight(HERE)), rolling, *robots()])

    def run(self) -> Seen:
        world, scanner = self.world(), Scanner(1 / self.rotations, noise_m=self.noise / 1000)
        settings = Settings(gap=self.gap / 100, split=self.split / 100)
        taken = scan(world, scanner, "A", 0, np.random.default_rng(self.seed))
        seen = points(taken)
        edges, arcs = list(extract_edges(seen, settings)), list(search_arcs(seen, settings))
        chain = from_contours(seen, Contours(seen.station, seen.time_ns, edges[-1][1], arcs[-1][1]), settings)
        spent = sum(cost for cost, _ in edges), sum(cost for cost, _ in arcs)
        back = np.isfinite(taken.ranges) & (taken.ranges > 0)
        return Seen(world, chain, scanner.rotation()[back], spent, scanner.link_ns)

    def figure(self, result: Seen) -> dict[str, Any]:
        chain, world = result.chain, result.world
        lines = layers(chain, self.stage)
        pale = self.stage != "points"
        x, y = HERE.x + self.distance, HERE.y + SIDEWAYS
        scene = outlines(world, result.time_ns, without=("A",))
        (xy,), odd = enlarged([chain.points.xy], x, y), result.rotation % 2 == 1
        whole = from_above(
            [
                there(scene),
                spots("points", chain.points.xy, INK, 0.06 if pale else 0.09),
                *shapes(lines),
                scanners("A", [HERE[:2]], [INK]),
            ],
            (-0.3, LENGTH + 0.3),
            (-0.3, WIDTH + 0.3),
            title=self.stage,
            caption=counted(chain, self.stage),
            width=1.75,
        )
        beside = from_above(
            [
                there(enlarged(scene, x, y), legend=False),
                *(spots(name, xy[odd == second], colour, 1.6) for second, (name, colour) in enumerate(ROTATIONS.items())),
                *shapes([enlarged(some, x, y) for some in lines], legend=False),
            ],
            (-AROUND, AROUND),
            (-AROUND, AROUND),
            place=2,
            unit="cm",
            title="the ball",
            caption="from its first place",
        )
        return stack([whole, beside], height=470, keys=[spot_key(*rotation) for rotation in ROTATIONS.items()])

    def metrics(self, result: Seen) -> list[Metric]:
        chain = result.chain
        there_are = sum(body.kind != "border" for body in seen_bodies(result.world, chain.points))
        error = result.ball_error()
        edges_ns, arcs_ns = result.contour_ns
        return [
            Metric(
                "ball off",
                error,
                "mm",
                good=error is not None and error < 20,
                note="" if error is not None else "no ball is found where it is",
            ),
            Metric("balls found", len(chain.elements.of("ball")), good=len(chain.elements.of("ball")) == 1),
            Metric("robots found", len(chain.elements.of("robot")), note=f"{there_are} balls and robots have four points"),
            Metric("points", len(chain.points.xy)),
            Metric(
                "points on the ball",
                int((chain.points.seen == result.world.index("ball")).sum()),
                note="mixed pixels not counted",
            ),
            Metric("edges", len(chain.contours.edges)),
            Metric("objects", len(chain.objects.polygons) + len(chain.objects.discs)),
            Metric("edge extraction", edges_ns / 1e6, "ms", note="modelled: 2 us per visit to a point; source 2 expects 4 ms"),
            Metric("arc search", arcs_ns / 1e6, "ms", note="modelled; source 2 expects 30 ms"),
            Metric("scan on the link", result.link_ns / 1e6, "ms", note="at 38 400 baud"),
        ]


def layers(chain: Chain, stage: str) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Lines of what is straight, what is round, and robots, in the format of that stage."""
    elements = chain.elements
    match stage:
        case "contours":
            return edge_lines(chain.contours.edges), arc_lines(chain.contours.arcs), []
        case "objects":
            return polygon_lines(chain.objects), disc_lines(chain.objects), []
        case "elements":
            return element_lines(elements.of("border")), element_lines(elements.of("ball")), element_lines(elements.of("robot"))
    return [], [], []


def shapes(lines: Sequence[list[np.ndarray]], legend: bool = True) -> list[dict[str, Any]]:
    """The three layers as traces."""
    straight, rounded, others = lines
    corner: dict[str, Any] = {"mode": "lines+markers", "marker": {"size": 9, "symbol": "circle-open", "line": {"width": 2}}}
    return [
        drawn("straight", straight, GREEN, showlegend=legend, **corner),
        drawn("round", rounded, VERMILION, showlegend=legend),
        drawn("robot", others, PURPLE, showlegend=legend),
    ]


def counted(chain: Chain, stage: str) -> str:
    """What there is in a format, in words."""
    contours, objects, elements = chain.contours, chain.objects, chain.elements
    match stage:
        case "contours":
            counts = {"edge": len(contours.edges), "arc": len(contours.arcs)}
        case "objects":
            counts = {"polygon": len(objects.polygons), "disc": len(objects.discs)}
        case "elements":
            counts = {"wall": len(elements.of("border")), "ball": len(elements.of("ball")), "robot": len(elements.of("robot"))}
        case _:
            counts = {"point": len(chain.points.xy)}
    return ", ".join(f"{count} {thing if count == 1 else f'{thing}s'}" for thing, count in counts.items())


# Exercises: each asks the model


def check_fast_ball(answer: LaserPipeline) -> Feedback:
    """Exercise: at 3 m/s or more, the ball is found within 5 cm of its place, and no second one."""
    if not isinstance(answer, LaserPipeline) or answer.speed < 3:
        return Feedback(False, "keep the ball at 3 m/s or more: LaserPipeline(speed=3.0, ...)")
    result = answer.run()
    error, claimed = result.ball_error(), len(result.chain.elements.of("ball"))
    if error is None or error > 50 or claimed != 1:
        apart = 1000 * answer.speed * 0.01332
        hint = f"two rotations of the mirror see this one {apart:.0f} mm apart; how many do you need?"
        return Feedback(False, f"{claimed} balls are found; {hint}")
    return Feedback(True, f"found, {error:.0f} mm off")


def check_rolling(answer: float) -> Feedback:
    """Exercise: the speed in m/s, within 10 %, of the ball in the sample scans of `data/examples/scans.csv`."""
    scans, _ = read_scans(example("scans.csv"), range_m=6.0)
    elements = [run_chain(points(one)).elements for one in scans]
    balls = [(found.time_ns, found.of("ball")[0]) for found in elements if found.of("ball")]
    rolls = speed_of(balls)
    if not isinstance(answer, int | float) or not abs(answer / rolls - 1) <= 0.1:
        return Feedback(
            False, "not within 10 %; where is the ball in the first scan, where in the last, and how much later is that?"
        )
    return Feedback(True, f"{rolls:.2f} m/s, from {len(balls)} places of the ball in {len(scans)} scans")


def speed_of(balls: list[tuple[int, Element]]) -> float:
    """Speed in m/s that fits places at times in ns best, by least squares."""
    t = np.array([time_ns for time_ns, _ in balls]) / SECOND
    fits = [np.polyfit(t, [getattr(e, name) for _, e in balls], 1)[0] for name in ("x", "y")]
    return float(np.hypot(*fits))
