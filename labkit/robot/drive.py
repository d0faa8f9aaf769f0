"""A drive: an operator steers, frames cross a radio link, the board drives, and what it believes is compared with where it is.

What runs in a process of its own is one: operator and radio link are a SimPy process, because they wait, are late and lose
frames by themselves. Kernel and plant are not: the kernel is taken along from one such event to the next, and the plant by
whoever reads an encoder or sets a motor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from labkit.robot.control import Velocity
from labkit.robot.firmware import Board, Firmware, build
from labkit.robot.mecanum import Wheels, moved
from labkit.robot.plant import Plant
from labkit.robot.rates import CPU_HZ
from labkit.trace import Trace

FRAMES = 20  # velocity frames per second
SAMPLES = 100  # points of the recorded path per second

Course = Literal["straight", "square", "circle", "sideways"]
COURSES: dict[str, str] = {
    "straight": "straight ahead",
    "square": "a square without turning",
    "circle": "an arc to the left",
    "sideways": "sideways, turning",
}


def steered(course: str, at: float, length: float) -> Velocity:
    """What the operator asks for at a time, of a course of so many seconds: mm/s and rad/s. The last tenth stands still."""
    go = 0.9 * length
    if at >= go:
        return (0.0, 0.0, 0.0)
    if course == "straight":
        return (300.0, 0.0, 0.0)
    if course == "square":
        return ((200.0, 0.0, 0.0), (0.0, 200.0, 0.0), (-200.0, 0.0, 0.0), (0.0, -200.0, 0.0))[int(4 * at / go)]
    if course == "circle":
        return (250.0, 0.0, 1.2)
    return (0.0, 200.0, 0.4)


@dataclass(frozen=True)
class Drive:
    """What came of a drive.

    Attributes:
        time: of the samples in s, shape (n,).
        real, believed, wanted: poses (x, y, heading), shape (n, 3): of the body, of the odometry, and of a robot that follows the
            operator at once.
        way, seen: lengths of the real path and of the odometry's, in mm.
        late: calls of delay_until that found their next period over, by task.
        trace: of the kernel.
    """

    time: np.ndarray
    real: np.ndarray
    believed: np.ndarray
    wanted: np.ndarray
    way: float
    seen: float
    late: dict[str, int]
    trace: Trace

    def path_error(self) -> np.ndarray:
        """Distance between the body and where the operator wanted it, per sample in mm."""
        return np.hypot(*(self.real - self.wanted)[:, :2].T)

    def odometry_error(self) -> np.ndarray:
        """Distance between the body and where the odometry believes it, per sample in mm."""
        return np.hypot(*(self.real - self.believed)[:, :2].T)

    def share_seen(self) -> float:
        """How much of the way the odometry has seen; 1 is all."""
        return self.seen / self.way if self.way else 1.0


def drive(
    firmware: Firmware,
    course: Course = "straight",
    seconds: float = 5.0,
    *,
    lag: float = 0.05,
    gains: Wheels = (1.0, 1.0, 1.0, 1.0),
    loss: float = 0.0,
    seed: int = 0,
    watch: Callable[[Iterable[int], int], Iterable[int]] = lambda samples, total: samples,
) -> Drive:
    """Drive a course and record it.

    Args:
        lag, gains: of the motors, see `Plant`.
        loss: share of the frames that the radio loses, drawn with `seed`. The operator repeats the wish in every frame.
        watch: wraps the loop over samples, given them and their number; `labkit.experiment.progress` fits.
    Raises:
        ValueError: an unknown course, no time, or a share that is none.
    """
    if course not in COURSES:
        raise ValueError(f"course {course!r}; there are {', '.join(COURSES)}")
    if seconds <= 0 or not 0 <= loss <= 1:
        raise ValueError(
            f"a drive of {seconds} s with {loss} of the frames lost; more than 0 s and a share of 0 to 1 are allowed"
        )
    import simpy

    board = build(firmware, Plant(CPU_HZ, lag, gains))
    world = simpy.Environment()
    world.process(_operator(world, board, course, seconds, np.random.default_rng(seed), loss))
    total = max(1, round(seconds * SAMPLES))
    rows, ideal, step = [], (0.0, 0.0, 0.0), CPU_HZ // SAMPLES
    for sample in watch(range(1, total + 1), total):
        end = sample * step
        while world.peek() < end:
            board.advance(int(world.peek()))
            world.step()
        board.advance(end)
        vx, vy, omega = steered(course, (sample - 1) / SAMPLES, seconds)
        ideal = moved(ideal, vx / SAMPLES, vy / SAMPLES, omega / SAMPLES)
        rows.append((sample / SAMPLES, *board.plant.pose, *board.pose, *ideal))
    table = np.array(rows)
    plant, trace = board.plant, board.kernel.trace
    return Drive(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7:], plant.way, board.seen, dict(board.late), trace)


def _operator(world: Any, board: Board, course: str, seconds: float, rng: np.random.Generator, loss: float) -> Any:
    """A SimPy process: a frame every 50 ms, which arrives or not."""
    while True:
        wish = steered(course, world.now / CPU_HZ, seconds)
        if rng.random() >= loss:
            board.command(wish)
        yield world.timeout(CPU_HZ // FRAMES)


def motors(spread: float) -> Wheels:
    """Gains of four motors that differ by `spread` (0.02: 2 %) between the fastest and the slowest."""
    return 1.0, 1 - spread, 1 - spread / 3, 1 - 2 * spread / 3
