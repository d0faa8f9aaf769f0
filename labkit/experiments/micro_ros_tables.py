"""Notebook 06, second half: tables 2 to 10 of source 1 from model runs, beside the published ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from typing_extensions import Doc

from labkit.data import published_table
from labkit.experiment import Experiment, Feedback, Labels, Metric, View, progress
from labkit.figures import ORANGE, SKY, Bar, axis, held, stack, stacked
from labkit.robot import CALLBACKS, COSTS, CPU_HZ, PUBLISHED_NAMES, build, published, robot, simulate
from labkit.trace import statistics

if TYPE_CHECKING:
    import pandas as pd

PLATFORMS = ("micro-ROS", "FreeRTOS")
RATES = ("50|30", "100|50")
PERIODS = {"50|30": (20, 30), "100|50": (10, 20)}  # ms, under micro-ROS
SECONDS = 2  # of each run; the tables' own recordings have 18 to 19
#: What sets a recording's clock: the task or callback at the wheel rate.
CLOCK = {"micro-ROS": "w_ctrl", "FreeRTOS": "hal_fetch"}
#: The same function on both platforms, by the name of table 10.
FUNCTIONS = {
    "odometry": ("odom", "odometry"),
    "pose control": ("p_ctrl", "pose_control"),
    "wheel control": ("w_ctrl", "wheel_ctrl"),
}

Platform = Annotated[Literal["micro-ROS", "FreeRTOS"], Doc("which software runs on the board")]
RateName = Annotated[Literal["50|30", "100|50"], Labels({r: f"{r} Hz" for r in RATES}), Doc("wheel control | pose control")]
Caches = Annotated[bool, Doc("L1 caches on")]


@dataclass(frozen=True)
class Row:
    """A task or callback in one recording: mean of an activation in us, sum in us, activations per second."""

    mean: float
    total: float
    rate: float


@dataclass(frozen=True)
class Table:
    """One recording: its rows by name, and its length in s, by the clock of its fastest task.

    A callback under micro-ROS runs inside `uros`. Whoever adds it to `uros` counts it twice.
    """

    rows: Mapping[str, Row]
    seconds: float

    def doubled(self) -> float:
        """The sum of all rows in us, callbacks included: what the source took for the whole."""
        return sum(row.total for row in self.rows.values())

    def share(self, name: str, of: Literal["recording", "doubled"] = "recording") -> float:
        """Of the length of the recording, or of the doubly counted sum, in %."""
        whole = self.seconds * 1e6 if of == "recording" else self.doubled()
        return 100 * self.rows[name].total / whole


@cache
def printed(platform: str, rates: str, caches: bool) -> Table:
    """Tables 2 to 9 of source 1."""
    fast = int(rates.split("|")[0])
    table = published_table("xu2025_runtime_stats.csv")
    state = "on" if caches else "off"
    rows = table[(table["platform"] == platform) & (table["wheel_hz"] == fast) & (table["caches"] == state)]
    cells = dict(zip(rows["name"], zip(rows["mean_us"].tolist(), rows["sum_us"].tolist(), strict=True), strict=True))
    mean, total = cells[CLOCK[platform]]
    seconds = round(total / mean) / fast
    return Table({name: Row(mean, total, total / mean / seconds) for name, (mean, total) in cells.items()}, seconds)


@cache
def modelled(platform: str, rates: str, caches: bool) -> Table:
    """The same table from a run of the model with tracing; sums for the length of the published recording.

    A stretch in the model's trace ends after the switch to the next task, a published one at the stamp before it.
    """
    seconds = printed(platform, rates, caches).seconds
    if platform == "micro-ROS":
        trace = simulate(robot(*PERIODS[rates], caches, tracing=True), SECONDS).trace
    else:
        board = build(published(rates, caches))
        board.advance(SECONDS * CPU_HZ)
        trace = board.kernel.trace
    found = statistics(trace)
    length = (trace.end - trace.start) / trace.hz
    rows = {}
    for name in printed(platform, rates, caches).rows:
        own = {printed_as: task for task, printed_as in PUBLISHED_NAMES.items()}.get(name, name)
        count, mean = (float(found.at[own, column]) for column in ("count", "mean"))  # type: ignore[arg-type]
        mean -= 0 if name in CALLBACKS else COSTS.switch * 1e6 / CPU_HZ
        rows[name] = Row(mean, mean * count * seconds / length, count / length)
    return Table(rows, seconds)


def cells(platform: str, rates: str, caches: bool) -> pd.DataFrame:
    """Every cell of one table, published and from the model: share of the recording in %, mean and sum in us, deviations in %."""
    import pandas as pd

    told, made = printed(platform, rates, caches), modelled(platform, rates, caches)
    return pd.DataFrame(
        [
            {
                "name": name,
                "share": told.share(name),
                "model share": made.share(name),
                "mean": row.mean,
                "model mean": made.rows[name].mean,
                "mean off by": 100 * (made.rows[name].mean / row.mean - 1),
                "sum": row.total,
                "model sum": made.rows[name].total,
                "sum off by": 100 * (made.rows[name].total / row.total - 1),
            }
            for name, row in told.rows.items()
        ]
    ).set_index("name")


QUANTITIES = {
    "share": "share of the recording [%]",
    "doubled": "share, callbacks counted twice [%]",
    "mean": "mean of an activation [us]",
    "rate": "activations per second",
}


class PublishedTables(Experiment[tuple[Table, Table]]):
    """Who needs the processor? Tables 2 to 9, from the model and as published.

    Bars are the model's, diamonds the source's. Execution times of single jobs are taken from the tables; who preempts whom, how
    often each task runs and what is left for IDLE is not.
    """

    slow: ClassVar[bool] = True

    platform: Platform = "micro-ROS"
    rates: RateName = "100|50"
    caches: Caches = True
    quantity: Annotated[Literal["share", "doubled", "mean", "rate"], Labels(QUANTITIES), View(), Doc("what the bars show")] = (
        "share"
    )

    def run(self) -> tuple[Table, Table]:
        """Published, and from the model."""
        told = printed(self.platform, self.rates, self.caches)
        for _ in progress([0]):
            made = modelled(self.platform, self.rates, self.caches)
        return told, made

    def value(self, table: Table, name: str) -> float:
        """What a bar of the picture shows."""
        if self.quantity in ("share", "doubled"):
            return table.share(name, "recording" if self.quantity == "share" else "doubled")
        return table.rows[name].mean if self.quantity == "mean" else table.rows[name].rate

    def figure(self, result: tuple[Table, Table]) -> dict[str, Any]:
        told, made = result
        bars = [Bar(name, [self.value(made, name)], self.value(told, name)) for name in told.rows]
        x = axis(
            QUANTITIES[self.quantity], type="log", range=[-2.3, 2.1] if "share" in QUANTITIES[self.quantity] else [-0.2, 3.4]
        )
        return stack(
            stacked(bars, {"model": SKY}, x, left=140), height=120 + 40 * len(bars), barmode="stack", keys=["measured (source 1)"]
        )

    def metrics(self, result: tuple[Table, Table]) -> list[Metric]:
        told, made = result
        inside = [name for name in CALLBACKS if name in told.rows]
        off = {name: abs(made.share(name) - told.share(name)) for name in told.rows}
        worst = max(off, key=lambda name: off[name])
        ratio = {
            name: max(made.rows[name].total / row.total, row.total / made.rows[name].total) for name, row in told.rows.items()
        }
        loosest = max(ratio, key=lambda name: ratio[name])
        return [
            Metric("IDLE, share of the recording", made.share("IDLE"), "%", published=round(told.share("IDLE"), 2)),
            Metric(
                "IDLE, share of the double count",
                made.share("IDLE", "doubled"),
                "%",
                published=round(told.share("IDLE", "doubled"), 2),
            ),
            Metric("length of the recording", told.seconds, "s", note="activations of the fastest function times its period"),
            Metric(
                "sum of all rows",
                made.doubled() / 1e6,
                "s",
                published=round(told.doubled() / 1e6, 3),
                note="what the source took for the length",
            ),
            Metric(
                "counted twice",
                sum(made.rows[n].total for n in inside) / 1e3,
                "ms",
                published=round(sum(told.rows[n].total for n in inside) / 1e3, 1),
                note="callbacks that run inside uros",
            ),
            Metric("largest deviation of a share", off[worst], "points", note=f"of {worst}"),
            Metric("largest factor between sums", ratio[loosest], "", note=f"of {loosest}"),
        ]


@dataclass(frozen=True)
class Pair:
    """A function on both platforms."""

    micro: Row
    free: Row

    @property
    def means(self) -> float:
        """Difference of the means in us."""
        return self.micro.mean - self.free.mean

    @property
    def sums(self) -> float:
        """Difference of the sums in us, as table 10 has it."""
        return self.micro.total - self.free.total

    def fair(self) -> float:
        """Difference of the sums in us if micro-ROS had called it as often as FreeRTOS did."""
        return self.means * self.free.total / self.free.mean


class QueueOrMiddleware(Experiment[dict[str, tuple[Pair, Pair]]]):
    """What does it cost to hand a value on: a queue, or a middleware? Table 10, from the model and as published.

    The same three functions on both platforms. The first part of a bar is what the function takes under FreeRTOS, with its copy
    into a queue; the rest is what micro-ROS adds: header, serialising, XRCE, UDP.
    """

    slow: ClassVar[bool] = True

    rates: RateName = "100|50"
    caches: Caches = True
    quantity: Annotated[
        Literal["means", "sums", "fair"],
        Labels(
            {
                "means": "of one activation",
                "sums": "of the recording (table 10)",
                "fair": "of the recording, activations made equal",
            }
        ),
        View(),
        Doc("what is compared"),
    ] = "means"

    def run(self) -> dict[str, tuple[Pair, Pair]]:
        """Function -> published, from the model."""
        tables = {}
        for platform in progress(PLATFORMS):
            tables[platform] = (printed(platform, self.rates, self.caches), modelled(platform, self.rates, self.caches))
        return {
            name: (
                Pair(tables["micro-ROS"][0].rows[micro], tables["FreeRTOS"][0].rows[free]),
                Pair(tables["micro-ROS"][1].rows[micro], tables["FreeRTOS"][1].rows[free]),
            )
            for name, (micro, free) in FUNCTIONS.items()
        }

    def value(self, row: Row, other: Row) -> float:
        """What a bar shows of a row of micro-ROS (`other` is FreeRTOS's) or of FreeRTOS (itself), in us or ms."""
        if self.quantity == "means":
            return row.mean
        return (row.total if self.quantity == "sums" else row.mean * other.total / other.mean) / 1e3

    def figure(self, result: dict[str, tuple[Pair, Pair]]) -> dict[str, Any]:
        bars = []
        for name, (told, made) in result.items():
            micro, free = self.value(made.micro, made.free), self.value(made.free, made.free)
            parts = [min(micro, free), max(micro - free, 0.0)]
            bars.append(Bar(f"{name}, micro-ROS", parts, self.value(told.micro, told.free)))
            bars.append(Bar(f"{name}, FreeRTOS", [free, 0.0], self.value(told.free, told.free)))
        longest = max(max(sum(bar.parts), bar.published or 0) for bar in bars)
        x = axis("mean of an activation [us]" if self.quantity == "means" else "sum [ms]", range=[0, held(1.05 * longest)])
        panel = stacked(bars, {"as under FreeRTOS, queue copy included": SKY, "more under micro-ROS": ORANGE}, x, left=210)
        return stack(panel, height=470, barmode="stack", keys=["measured (source 1)"])

    def metrics(self, result: dict[str, tuple[Pair, Pair]]) -> list[Metric]:
        found = [
            Metric(f"{name}: mean, difference", made.means, "us", published=round(told.means, 2))
            for name, (told, made) in result.items()
        ]
        for name, (told, made) in result.items():
            found.append(Metric(f"{name}: sum, difference", made.sums / 1e3, "ms", published=round(told.sums / 1e3, 3)))
            found.append(
                Metric(
                    f"{name}: the same for equal activations",
                    made.fair() / 1e3,
                    "ms",
                    published=round(told.fair() / 1e3, 3),
                    note=f"published: {told.micro.rate:.1f} per second against {told.free.rate:.1f}",
                )
            )
        return found


# Exercises


def check_fair_sum(milliseconds: float) -> Feedback:
    """Exercise 3: the odometry's sum under micro-ROS at 100|50 Hz with caches, had it run as often as under FreeRTOS."""
    micro, free = (
        printed(platform, "100|50", True).rows[name] for platform, name in zip(PLATFORMS, FUNCTIONS["odometry"], strict=True)
    )
    wanted = micro.mean * free.total / free.mean / 1e3
    if abs(milliseconds - wanted) <= 0.01 * wanted:
        return Feedback(True, f"{wanted:.2f} ms against {free.total / 1e3:.2f} ms: a call of it is cheaper under micro-ROS.")
    if abs(milliseconds - micro.total / 1e3) <= 0.01 * micro.total / 1e3:
        return Feedback(False, "that is the printed sum, of almost twice as many calls.")
    return Feedback(False, "mean under micro-ROS times the activations under FreeRTOS, which are its sum over its mean.")


def check_idle_share(percent: float) -> Feedback:
    """Exercise 4: the idle share of the recording under micro-ROS at 100|50 Hz without caches; the source prints 38.75 %."""
    table = printed("micro-ROS", "100|50", False)
    wanted, doubled = table.share("IDLE"), table.share("IDLE", "doubled")
    if abs(percent - wanted) <= 0.06:
        return Feedback(True, f"{wanted:.2f} % of {table.seconds:.2f} s.")
    if abs(percent - doubled) <= 0.06:
        return Feedback(False, "that is the share of a total in which three callbacks count twice.")
    return Feedback(False, "divide the sum of IDLE by the length of the recording: activations of w_ctrl times 10 ms.")
