"""Notebook 13: where in the chain a team fuses its data, what that costs, and what it is worth (source 2, sections 2.5, 6.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View
from labkit.experiments.laser_pipeline import LENGTH, WIDTH, Rotations, Seed
from labkit.figures import (
    BLUE,
    FONT,
    GREEN,
    INK,
    ORANGE,
    PALETTE,
    PURPLE,
    SKY,
    VERMILION,
    Panel,
    axis,
    dots,
    drawn,
    element_lines,
    from_above,
    held,
    outlines,
    scanners,
    spots,
    stack,
    there,
)
from labkit.fusion import (
    LEVELS,
    Fusion,
    Judged,
    Level,
    Points,
    Pose,
    Scanner,
    Straight,
    World,
    ball,
    field,
    fuse_levels,
    judged,
    points,
    robot,
    scan,
)

MS = 1_000_000
CORNERS = {"A": Pose(0.8, 0.9, 0.6), "B": Pose(7.1, 0.8, 2.4), "C": Pose(6.9, 4.2, 3.9), "D": Pose(0.9, 4.1, -0.7)}
ROBOTS = 3  # that do not look
STATION = {"A": BLUE, "B": ORANGE, "C": PALETTE[4], "D": PALETTE[7]}
NOISE_M = 0.005  # of a distance: LMS 200
NOTHING = np.empty((0, 2))
APART = 1.0  # m between the middles of any two of them, at least


def scene(stations: int, speed: float, seed: int) -> World:
    """A field with robots that look, three that do not, and a ball that rolls somewhere: places are drawn."""
    rng = np.random.default_rng([seed, 13])
    taken = [place[:2] for place in CORNERS.values()]
    while len(taken) < len(CORNERS) + ROBOTS + 1:
        place = rng.uniform([1.6, 0.7], [LENGTH - 1.6, WIDTH - 0.7])
        if min(np.hypot(*(place - np.array(other))) for other in taken) > APART:
            taken.append((float(place[0]), float(place[1])))
    *others, (x, y) = taken[len(CORNERS) :]
    turns, way = rng.uniform(0, np.pi / 2, ROBOTS), rng.uniform(-np.pi, np.pi)
    lookers = [robot(name, Straight(pose)) for name, pose in list(CORNERS.items())[:stations]]
    standing = [
        robot(f"R{i + 1}", Straight(Pose(*place, turn))) for i, (place, turn) in enumerate(zip(others, turns, strict=True))
    ]
    rolling = ball(Straight(Pose(x, y), speed * float(np.cos(way)), speed * float(np.sin(way))))
    return field(LENGTH, WIDTH, [*lookers, rolling, *standing])


def looks(world: World, stations: int, offset_ms: int, rotations: int, lost_mm: int, seed: int) -> list[Points]:
    """What the stations measure, each `offset_ms` later than the one before, each wrong about where it stands by about `lost_mm`
    per axis.
    """
    scanner, rng = Scanner(1 / rotations, noise_m=NOISE_M), np.random.default_rng(seed)
    seen = []
    for i, name in enumerate(list(CORNERS)[:stations]):
        taken = scan(world, scanner, name, i * offset_ms * MS, rng)
        dx, dy = (rng.normal(size=2) * lost_mm / 1000).tolist()
        pose = Pose(taken.pose.x + dx, taken.pose.y + dy, taken.pose.heading)
        seen.append(points(replace(taken, pose=pose)))
    return seen


@dataclass(frozen=True, eq=False)
class Team:
    """One period of a team: the world, what each station measured, and what came of it at each level."""

    world: World
    points: list[Points]
    fusions: dict[Level, Fusion]
    verdicts: dict[Level, Judged]


class FusionLevels(Experiment[Team]):
    """Where in the chain should a team fuse its data?

    Robots in the corners look at a field with three more robots and a ball, all drawn anew with every *seed*. They fuse points,
    contours, objects or elements: click a bar, or choose a *level*.
    """

    headline: ClassVar[tuple[str, ...]] = ("OSPA", "ghosts", "sent by a station")
    level: Annotated[Level, View(), Doc("what is fused, and shown")] = "contours"
    stations: Annotated[int, Interval(ge=2, le=4), Doc("robots that look: A, B, C, D")] = 2
    offset: Annotated[int, Interval(ge=0, le=160), MultipleOf(20), Unit("ms"), Doc("each later than the one before")] = 0
    speed: Annotated[float, Interval(ge=0, le=4), MultipleOf(0.25), Unit("m/s"), Doc("of the ball")] = 1.0
    pose_error: Annotated[int, Interval(ge=0, le=100), MultipleOf(5), Unit("mm"), Doc("of a robot's own place, per axis")] = 0
    rotations: Rotations = 2
    seed: Seed = 3

    def run(self) -> Team:
        world = scene(self.stations, self.speed, self.seed)
        seen = looks(world, self.stations, self.offset, self.rotations, self.pose_error, self.seed)
        fusions = fuse_levels(seen)
        return Team(world, seen, fusions, {level: judged(world, seen, one.elements) for level, one in fusions.items()})

    def figure(self, result: Team) -> dict[str, Any]:
        fusions = result.fusions.values()
        bars = {
            "sent [bytes]": ([mean(one.sent_bytes) for one in fusions], ".0f", round(1.35 * 2 * (180 * self.rotations + 1), -1)),
            "work [ms]": ([one.station_ns / MS for one in fusions], ".1f", None),
            "OSPA [cm]": ([100 * one.ospa for one in result.verdicts.values()], ".1f", None),
        }
        panels = [
            self.bars(name, values, shape, top or held(1.35 * max(values)), first=not i)
            for i, (name, (values, shape, top)) in enumerate(bars.items())
        ]
        return stack([self.field(result), *panels], height=430)

    def field(self, result: Team) -> Panel:
        """The field, and what is known of it at the level."""
        known, verdict = result.fusions[self.level].elements, result.verdicts[self.level]
        names, xy = list(CORNERS)[: self.stations], {p.station: p.xy for p in result.points}
        time_ns = [one.time_ns for one in result.points]
        scene = outlines(result.world, known.time_ns)
        missed = [result.world.bodies[result.world.index(name)].motion.at(known.time_ns)[:2] for name in verdict.missed]
        kinds = (("border", GREEN), ("ball", VERMILION), ("robot", PURPLE))
        wrong = {"size": 22, "symbol": "x-thin", "color": INK, "line": {"width": 4, "color": INK}}
        lost = {"size": 30, "symbol": "circle-open", "color": INK, "line": {"width": 3, "color": INK}}
        spread = f"{(max(time_ns) - min(time_ns)) / MS:.0f} ms from the first look to the last" if self.offset else "all at once"
        return from_above(
            [
                there(scene),
                *(spots(f"points of {name}", xy.get(name, NOTHING), colour, 0.07) for name, colour in STATION.items()),
                *(drawn(kind, element_lines(known.of(kind)), colour) for kind, colour in kinds),  # type: ignore[arg-type]
                dots("ghost", np.array([(e.x, e.y) for e in verdict.ghosts]).reshape(-1, 2), INK, 22, marker=wrong),
                dots("missed", np.array(missed).reshape(-1, 2), INK, 30, marker=lost),
                scanners(names, [CORNERS[name][:2] for name in names], [STATION[name] for name in names]),
            ],
            (-0.7, LENGTH + 0.7),
            (-0.7, WIDTH + 0.7),
            title=f"{self.level} fused",
            caption=spread,
            width=2.1,
        )

    def bars(self, name: str, values: list[float], shape: str, end: float, first: bool) -> Panel:
        """One number at all levels, that of the level shown in colour."""
        names = [f"<b>{level}</b>" for level in LEVELS] if first else [""] * len(LEVELS)
        trace = {
            "type": "bar",
            "orientation": "h",
            "x": values,
            "y": [-i for i in range(len(LEVELS))],
            "width": 0.6,
            "marker": {"color": [BLUE if level == self.level else SKY for level in LEVELS]},
            "text": [f"{value:{shape}}" for value in values],
            "textposition": "outside",
            "textfont": {"size": FONT, "color": INK},
            "cliponaxis": False,
            "showlegend": False,
            "hovertemplate": f"%{{x:{shape}}}<extra>{name}</extra>",
            "meta": {"set": [{"level": level} for level in LEVELS]},
        }
        up = axis("", range=[0.6 - len(LEVELS), 0.6], tickvals=[-i for i in range(len(LEVELS))], ticktext=names, showgrid=False)
        return Panel([trace], up, axis(name, range=[0, end], nticks=3), width=0.7, left=96 if first else 22)

    def metrics(self, result: Team) -> list[Metric]:
        one, verdict = result.fusions[self.level], result.verdicts[self.level]
        ghosts, missed = (len(some) for some in (verdict.ghosts, verdict.missed))
        off, of = (1000 * verdict.error, "of what is known") if np.isfinite(verdict.error) else (None, "nothing is known")
        return [
            Metric("OSPA", 100 * verdict.ospa, "cm", note="distance of the picture from the world, cut off at 50 cm"),
            Metric("ghosts", ghosts, good=ghosts == 0, note="elements with nothing there"),
            Metric("sent by a station", round(mean(one.sent_bytes)), "bytes", note="the mean of all"),
            Metric("missed", missed, good=missed == 0, note=", ".join(verdict.missed) or f"all {verdict.things} are known"),
            Metric("error of place", off, "mm", note=f"root mean square, {of}"),
            Metric("completeness", 100 * verdict.completeness, "%"),
            Metric("before it sends", max(one.before_ns) / MS, "ms", note="modelled: 2 us per visit to a point, edge or element"),
            Metric("fusion", one.fusion_ns / MS, "ms"),
            Metric("after the fusion", one.after_ns / MS, "ms"),
        ]


def mean(values: tuple[int, ...]) -> float:
    """Of a few numbers."""
    return sum(values) / len(values)


@dataclass(frozen=True)
class Means:
    """Over many scenes: OSPA and error of place in cm, ghosts and missed things per picture, bytes sent, work in ms."""

    ospa: float
    error: float
    ghosts: float
    missed: float
    sent: float
    work: float


def over_scenes(experiment: FusionLevels, seeds: int = 20) -> dict[Level, Means]:
    """What each level costs and is worth in the mean over as many scenes."""
    teams = [experiment.replace(seed=seed).run() for seed in range(1, seeds + 1)]
    found = {}
    for level in LEVELS:
        verdicts, fusions = ([getattr(team, kind)[level] for team in teams] for kind in ("verdicts", "fusions"))
        rows = [
            (100 * v.ospa, 100 * v.error, len(v.ghosts), len(v.missed), mean(f.sent_bytes), f.station_ns / MS)
            for v, f in zip(verdicts, fusions, strict=True)
        ]
        found[level] = Means(*np.nanmean(rows, axis=0).tolist())
    return found
