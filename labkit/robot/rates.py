"""How often the tasks of the robot run, and how long each job takes: both from what source 1 publishes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from labkit.data import published_table

CPU_HZ = 216_000_000
PERIODIC = ("hal_fetch", "wheel_ctrl", "odometry", "pose_ctrl")

#: Task -> name in the published tables and listings, where that differs.
PUBLISHED_NAMES = {"pose_ctrl": "pose_control"}


@dataclass(frozen=True)
class Rates:
    """A tick, and the periods in ticks of the fast tasks (encoder fetch, wheel control) and the slow ones (odometry, pose)."""

    tick_hz: int
    fast: int
    slow: int

    def period(self, task: str) -> int:
        """Period of a periodic task in ticks."""
        return self.fast if task in ("hal_fetch", "wheel_ctrl") else self.slow

    def seconds(self, task: str) -> float:
        """The same in s."""
        return self.period(task) / self.tick_hz

    def hertz(self, task: str) -> float:
        return self.tick_hz / self.period(task)


#: The rates of source 1, by name. "30 Hz" has a period of whole milliseconds; 200 and 500 us need a tick of 100 us.
RATES: dict[str, Rates] = {
    "50|30": Rates(1000, 20, 33),
    "100|50": Rates(1000, 10, 20),
    "1000": Rates(1000, 1, 1),
    "5000|2000": Rates(10_000, 2, 5),
    "10000|5000": Rates(10_000, 1, 2),
}


def rates(fast_hz: int, slow_hz: int, tick_hz: int) -> Rates:
    """Rates of the fast and slow tasks under a tick. Raises ValueError for one that is no whole number of ticks."""
    for hz in (fast_hz, slow_hz):
        if hz < 1 or tick_hz % hz:
            raise ValueError(
                f"a task at {hz} Hz under a tick of {tick_hz} Hz; allowed are rates that divide the tick, "
                "because a delay counts whole ticks"
            )
    return Rates(tick_hz, tick_hz // fast_hz, tick_hz // slow_hz)


@cache
def _means(caches: bool, recording: str) -> dict[str, tuple[float, float]]:
    """Name -> (mean duration, sum) in us, of the FreeRTOS recording at "50|30" or "100|50" Hz."""
    fast = int(recording.split("|")[0])
    table = published_table("xu2025_runtime_stats.csv")
    rows = table[
        (table["platform"] == "FreeRTOS") & (table["wheel_hz"] == fast) & (table["caches"] == ("on" if caches else "off"))
    ]
    return dict(zip(rows["name"], zip(rows["mean_us"].tolist(), rows["sum_us"].tolist(), strict=True), strict=True))


def execution(caches: bool, recording: str = "100|50") -> dict[str, int]:
    """Execution time of one job of each task in cycles: the published mean (source 1, tables 6 to 9).

    For `tsink` that is one look at the ring. A mean of `profile` says nothing, since its work is what the others make it: see
    `stamp_line`. `recv_vel` did not run in the recordings; it gets the time of `hal_fetch`.
    """
    means = _means(caches, recording)
    found = {task: means[PUBLISHED_NAMES.get(task, task)][0] for task in (*PERIODIC, "tsink")}
    found["recv_vel"] = found["hal_fetch"]
    return {task: round(mean * CPU_HZ / 1e6) for task, mean in found.items()}


def stamp_line(caches: bool, recording: str = "100|50") -> int:
    """Cycles that `profile` needs for the line of one stamp: its published sum over the stamps of the recording.

    Every stretch of the table has two stamps, and its number is sum / mean.
    """
    means = _means(caches, recording)
    stretches = sum(total / mean for mean, total in means.values())
    return round(means["profile"][1] * CPU_HZ / 1e6 / (2 * stretches))
