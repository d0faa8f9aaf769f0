"""Notebook 05, second half: what rate, load and a mailbox make of the way the robot drives (S7)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, progress
from labkit.figures import BLUE, GREY, VERMILION, Curve, Panel, axis, curves, held, stack
from labkit.robot import CHANNELS, COURSES, PERIODIC, RATES, Channel, Course, Drive, Firmware, drive, motors, published

SLOW_RATES = {name: f"{name} Hz" for name in ("50|30", "100|50", "1000")}
SECONDS = 5
POINTS = 400  # of a path in a picture

Work = Annotated[int, Interval(ge=1, le=200), Unit("times"), Doc("execution times, as multiples of the published means")]
PoseGain = Annotated[float, Interval(ge=0, le=40), Unit("times"), Doc("gains of the pose controller, 1 is the firmware's")]
CourseChoice = Annotated[Course, Labels(COURSES), Doc("what the operator steers")]
ChannelChoice = Annotated[Channel, Labels(CHANNELS), Doc("how the encoder's readings get to the odometry")]


def loaded(firmware: Firmware, times: int) -> Firmware:
    """The same firmware with all jobs longer."""
    return replace(firmware, work={task: cycles * times for task, cycles in firmware.work.items()})


class RobotPath(Experiment[Drive]):
    """Where is the robot, and where does it believe it is?

    An operator steers for five seconds; the four motors are not equal. The odometry adds what the encoder task sends it. As
    published the difference since the last reading overwrites a mailbox, and the controllers are off.
    """

    slow: ClassVar[bool] = True
    rates: Annotated[Literal["50|30", "100|50", "1000"], Labels(SLOW_RATES), Doc("rate of wheel control | of pose control")] = (
        "50|30"
    )
    channel: ChannelChoice = "overwrite"
    course: CourseChoice = "circle"
    pose_control: Annotated[bool, Doc("the pose controller; off in the measured branch")] = False
    pose_gain: PoseGain = 20.0
    wheel_control: Annotated[bool, Doc("the wheel-speed controller; off in the measured branch")] = False
    spread: Annotated[float, Interval(ge=0, le=0.1), MultipleOf(0.01), Doc("how far the motors differ")] = 0.04
    work: Work = 1

    def run(self) -> Drive:
        firmware = published(
            self.rates,
            tracing=False,
            channel=self.channel,
            pose_control=self.pose_control,
            pose_gain=self.pose_gain,
            wheel_control=self.wheel_control,
        )
        return drive(loaded(firmware, self.work), self.course, SECONDS, gains=motors(self.spread), watch=progress)

    def figure(self, result: Drive) -> dict[str, Any]:
        some = np.linspace(0, len(result.time) - 1, min(POINTS, len(result.time))).astype(int)
        paths = (
            ("wanted", result.wanted, GREY, "dot"),
            ("real", result.real, BLUE, "solid"),
            ("believed", result.believed, VERMILION, "dash"),
        )
        seen_from_above = [_line(name, path[some, 0], path[some, 1], colour, dash) for name, path, colour, dash in paths]
        errors = [
            _line("off the wanted path", result.time[some], result.path_error()[some], BLUE, "solid"),
            _line("odometry off the robot", result.time[some], result.odometry_error()[some], VERMILION, "dash"),
        ]
        across, along = (_extent(path[:, k] for _, path, _, _ in paths) for k in (0, 1))
        most = held(1.05 * max(float(result.path_error().max()), float(result.odometry_error().max())), coarse=True)
        return stack(
            [
                Panel(
                    seen_from_above,
                    axis("y [mm]", scaleanchor="x", range=along),
                    axis("x [mm]", range=across),
                    title="From above",
                ),
                Panel(errors, axis("error [mm]", range=[0, most]), axis("time [s]", range=[0, SECONDS]), title="Errors", left=90),
            ],
            height=480,
        )

    def metrics(self, result: Drive) -> list[Metric]:
        fast, slow = RATES[self.rates].fast, RATES[self.rates].slow
        late = sum(result.late.values())
        return [
            Metric(
                "way seen by the odometry",
                100 * result.share_seen(),
                "%",
                good=result.share_seen() > 0.98,
                note=f"the encoder is read every {fast} ticks, the odometry runs every {slow}",
            ),
            Metric("path error, largest", float(result.path_error().max()), "mm"),
            Metric("path error at the end", float(result.path_error()[-1]), "mm"),
            Metric("odometry error at the end", float(result.odometry_error()[-1]), "mm"),
            Metric("late jobs", late, good=late == 0, note=f"of {', '.join(PERIODIC)}"),
        ]


def _extent(values: Iterable[np.ndarray]) -> list[float]:
    """A range that holds all of them, of two round numbers."""
    found = np.concatenate(list(values))
    return [-held(max(-float(found.min()), 100.0), coarse=True), held(max(float(found.max()), 100.0), coarse=True)]


def _line(name: str, x: np.ndarray, y: np.ndarray, colour: str, dash: str) -> dict[str, Any]:
    line = {"color": colour, "width": 3, "dash": dash}
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "line": line,
        "hovertemplate": f"{name}: %{{y:.1f}}<extra></extra>",
    }


@dataclass(frozen=True)
class AtRates:
    """At each of `RATES`: the largest path error in mm, and the share of jobs that were late in %."""

    error: list[float]
    late: list[float]


class PathAgainstRate(Experiment[AtRates]):
    """Does a faster controller drive better?

    The same course at the five rates of source 1, with a sound odometry and the pose controller on. The board of source 1 is far
    from its limit; with longer jobs there is a best rate.
    """

    slow: ClassVar[bool] = True
    work: Work = 30
    caches: Annotated[bool, Doc("published execution times with the L1 caches on, or off")] = True
    course: CourseChoice = "circle"
    seconds: Annotated[int, Interval(ge=1, le=5), Unit("s"), Doc("length of the drive")] = 1
    pose_gain: PoseGain = 20.0

    @classmethod
    def strategy(cls) -> Any:
        """Short drives only: the long ones differ in nothing but their time."""
        return super().strategy().map(lambda drawn: drawn.replace(seconds=1))

    def run(self) -> AtRates:
        error, late = [], []
        for name in progress(list(RATES)):
            firmware = published(
                name, self.caches, tracing=False, channel="accumulate", pose_control=True, pose_gain=self.pose_gain
            )
            found = drive(loaded(firmware, self.work), self.course, self.seconds, gains=motors(0.04))
            error.append(float(found.path_error().max()))
            late.append(100 * sum(found.late.values()) / max(1, int(found.trace.of("complete").sum())))
        return AtRates(error, late)

    def figure(self, result: AtRates) -> dict[str, Any]:
        hertz = [RATES[name].hertz("wheel_ctrl") for name in RATES]
        x = axis("rate of wheel control [Hz]", type="log", range=[1.6, 4.1], tickvals=hertz, ticktext=list(RATES))
        error = Curve("largest path error", hertz, result.error, BLUE)
        late = Curve("late jobs", hertz, result.late, VERMILION, "dash")
        return stack(
            curves([error], x, axis("path error [mm]", range=[0, held(1.05 * max(result.error), coarse=True)])),
            curves([late], x, axis("late jobs [%]", range=[-5, 105])),
            height=480,
        )

    def metrics(self, result: AtRates) -> list[Metric]:
        names = list(RATES)
        best = min(range(len(names)), key=result.error.__getitem__)
        return [
            Metric("best of the five rates", names[best], "Hz", note="with the smallest path error"),
            Metric("path error, 50|30", result.error[0], "mm"),
            Metric("path error, best rate", result.error[best], "mm"),
            Metric("path error, 10000|5000", result.error[-1], "mm"),
            Metric("late jobs, 10000|5000", result.late[-1], "%", good=result.late[-1] == 0),
        ]


def check_whole_way(answer: RobotPath) -> Feedback:
    """Exercise: at 50|30 or 100|50 the odometry sees the whole way."""
    if answer.rates == "1000":
        return Feedback(False, "at equal rates the defect hides; keep 50|30 or 100|50 Hz")
    found = answer.run()
    share = 100 * found.share_seen()
    if not 98 < share < 102:
        return Feedback(False, f"the odometry sees {share:.0f} % of the way; what becomes of a difference that nobody has read?")
    return Feedback(
        True, f"the odometry sees {share:.1f} % of the way and ends {found.odometry_error()[-1]:.1f} mm beside the robot"
    )
