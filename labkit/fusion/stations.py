"""Two stations that look at one element, not at the same time: experiment 3 of source 2, with many runs at once.

Station A looks at the beginning of every period, station B `offset` later. Both put the time of the look on what they send; B's
clock may be wrong. Places are complex numbers in m; arrays have the shape (runs, looks).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from labkit.fusion.kalman import MOTIONS, Model, State

Course = Literal["straight", "circle", "turn"]

#: How an element moves; angles of travel as in figure 45 of source 2, where it goes up to the right.
COURSES: dict[Course, str] = {"straight": "straight on", "circle": "in a circle of 1 m", "turn": "around a corner"}
HEADING = np.exp(1j * np.arctan2(0.8, 1.3))
RADIUS = 1.0


def place(course: Course, speed: float, times: Any, corner: float = 3.0) -> np.ndarray:
    """Where the element is, in m, at times in s; `speed` in m/s. Around a corner: at the time `corner` it turns by 90 degrees."""
    t = np.asarray(times, float)
    if course == "circle":
        return RADIUS * 1j * (1 - np.exp(1j * speed / RADIUS * t)) * HEADING
    ahead = np.minimum(t, corner) + 1j * np.maximum(t - corner, 0) if course == "turn" else t
    return speed * ahead * HEADING


@dataclass(frozen=True, eq=False)
class Looks:
    """What the stations sent.

    Attributes:
        stamps: the times on it in s, ascending; shape (looks,).
        times: when it was measured really.
        station: 0 for A, 1 for B; shape (looks,).
        z: measured places, shape (runs, looks). truth: real ones, shape (looks,).
    """

    stamps: np.ndarray
    times: np.ndarray
    station: np.ndarray
    z: np.ndarray
    truth: np.ndarray


@dataclass(frozen=True)
class Stations:
    """The setting.

    Attributes:
        speed: of the element, m/s. course: how it moves.
        period, offset: in s; 0 <= offset < period. At offset 0 both look at the same time.
        sigma: standard deviation of a measurement per axis, in m.
        clock_error: how much B's clock is ahead, in s; less than the offset and the rest of the period.
    """

    speed: float
    course: Course = "straight"
    period: float = 0.330
    offset: float = 0.160
    sigma: float = 0.03
    clock_error: float = 0.0

    def look(self, runs: int, periods: int, seed: int) -> Looks:
        """Measurements of so many periods in so many runs, in order of the stamps."""
        begin = self.period * np.arange(periods)
        times = np.stack([begin, begin + self.offset], axis=-1).ravel()
        station = np.tile([0, 1], periods)
        stamps = times + self.clock_error * station
        order = np.argsort(stamps, kind="stable")
        times, station, stamps = times[order], station[order], stamps[order]
        truth = place(self.course, self.speed, times)
        noise = np.random.default_rng(seed).normal(scale=self.sigma, size=(2, runs, len(times)))
        return Looks(stamps, times, station, truth + noise[0] + 1j * noise[1], truth)


def averages(looks: Looks) -> tuple[np.ndarray, np.ndarray]:
    """The mean of A's and B's places of each period, as if they were of one time, and where the element is at the later look."""
    a, b = (looks.z[:, looks.station == s] for s in (0, 1))
    later = np.where(looks.times[looks.station == 1] >= looks.times[looks.station == 0], 1, 0)
    truth = np.where(later, looks.truth[looks.station == 1], looks.truth[looks.station == 0])
    return (a + b) / 2, truth


def fuse(model: Model, q: float, looks: Looks, sigma: float, stamps: np.ndarray | None = None) -> list[State]:
    """The fast state of all runs after each look; the filter believes `stamps`, or those on the looks, and R = sigma^2 I."""
    motion = MOTIONS[model]
    states = [motion.start(looks.z[:, 0], sigma**2)]
    for i, dt in enumerate(np.diff(looks.stamps if stamps is None else stamps).tolist(), 1):
        states.append(motion.update(motion.predict(states[-1], dt, q), looks.z[:, i], sigma**2))
    return states
