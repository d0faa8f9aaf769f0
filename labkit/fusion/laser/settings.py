"""What the stages are told: thresholds, what is known of the elements, and what a step costs."""

from __future__ import annotations

from dataclasses import dataclass, fields

from labkit.fusion.laser.world import BALL_RADIUS, ROBOT_SIDE

#: Modelled time of one visit to one point, in ns. An assumption: with it, edges take about the 4 ms that source 2 expects of them
#: (table 5). Arcs take far less than its 30 ms, since most of their work here is left out early; real time is less still.
VISIT_NS = 2_000


@dataclass(frozen=True)
class Settings:
    """Thresholds of the chain, in m.

    Attributes:
        gap: points further apart than this, beyond what the beams' angle explains, belong to different things.
        split: an edge has no point further away than this.
        arc: root mean square distance of an arc's points, at most.
        join: ends of edges, and groups of different stations, that are as near as this belong together.
        ball: radius of the ball; robot: side of a robot.
        border: an edge at least as long is a border.
        merge: elements of one kind from several stations that are as near as this are one.
    """

    gap: float = 0.05
    split: float = 0.03
    arc: float = 0.016
    join: float = 0.12
    ball: float = BALL_RADIUS
    robot: float = ROBOT_SIDE
    border: float = 1.0
    merge: float = 0.25

    def __post_init__(self) -> None:
        for field in fields(self):
            if not 0 < getattr(self, field.name) < 100:
                raise ValueError(
                    f"the setting {field.name} is {getattr(self, field.name)!r}; a length above 0 and below 100 m is allowed"
                )
