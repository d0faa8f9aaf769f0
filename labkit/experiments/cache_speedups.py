"""Notebook 02: what the caches brought in the published recordings (source 1, tables 2 to 10)."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.checks import shown
from labkit.data import published
from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import called
from labkit.figures import Factor, Pair, axis, colours, dumbbells, factors, stack

PLATFORMS = ("micro-ROS", "FreeRTOS")
RATES = ("50|30", "100|50")


@dataclass(frozen=True)
class Row:
    """One task in one recording: mean duration of an activation and sum in us, share of all in %."""

    mean: float
    total: int
    share: float


@cache
def recordings() -> dict[tuple[str, str, str], dict[str, Row]]:
    """(platform, rates, caches) -> task -> its row, as printed: source 1, tables 2 to 9."""
    found: dict[tuple[str, str, str], dict[str, Row]] = {}
    with open(published("xu2025_runtime_stats.csv"), newline="", encoding="utf-8") as file:
        for r in csv.DictReader(file):
            rows = found.setdefault((r["platform"], f"{r['wheel_hz']}|{r['pose_hz']}", r["caches"]), {})
            rows[r["name"]] = Row(float(r["mean_us"]), int(r["sum_us"]), float(r["share_pct"]))
    return found


def measured_factor(platform: str, name: str, rates: str) -> float:
    """Mean duration of an activation without caches over that with both."""
    off, on = (recordings()[platform, rates, caches][name].mean for caches in ("off", "on"))
    return off / on


#: What the text of source 1 (5.2.2 and 5.3.2) says of the sums at 100|50 Hz, caches on against off, in %.
CLAIMS = {
    ("micro-ROS", "odom"): -62.64,
    ("micro-ROS", "p_ctrl"): -76.51,
    ("micro-ROS", "w_ctrl"): -66.06,
    ("micro-ROS", "IDLE"): 98.35,
    ("FreeRTOS", "odometry"): -72.04,
    ("FreeRTOS", "pose_control"): -70.43,
    ("FreeRTOS", "wheel_ctrl"): -72.17,
    ("FreeRTOS", "IDLE"): 14.88,
}


def change(platform: str, name: str, rates: str = "100|50") -> float:
    """Change of a task's sum from caches off to on, in %."""
    off, on = (recordings()[platform, rates, caches][name].total for caches in ("off", "on"))
    return 100 * (on / off - 1)


def change_of_one(platform: str, name: str, rates: str = "100|50") -> float:
    """Change of the mean duration of one activation from caches off to on, in %."""
    return 100 * (1 / measured_factor(platform, name, rates) - 1)


GUESSED = {
    "wheel_ctrl": ("FreeRTOS", "wheel_ctrl"),
    "odometry": ("FreeRTOS", "odometry"),
    "pose_ctrl": ("FreeRTOS", "pose_control"),
    "pose_micro_ROS": ("micro-ROS", "p_ctrl"),
    "link_check": ("micro-ROS", "EthLink"),
}
Guess = Annotated[float, Interval(ge=0.5, le=10), MultipleOf(0.5), Unit("×"), View()]


class SpeedupGuess(Experiment[dict[str, tuple[float, ...]]]):
    """How many times faster does each task of the robot get when both caches go on?

    One slider per task; `reveal` shows the factors of both recordings (50|30 and 100|50 Hz). `link_check` is EthLink, which asks
    the network chip over a slow serial bus whether the cable is plugged in.
    """

    wheel_ctrl: Annotated[Guess, Doc("your guess for the wheel controller under FreeRTOS")] = 1.0
    odometry: Annotated[Guess, Doc("your guess for the odometry under FreeRTOS")] = 1.0
    pose_ctrl: Annotated[Guess, Doc("your guess for the pose controller under FreeRTOS")] = 1.0
    pose_micro_ROS: Annotated[Guess, Doc("your guess for the same controller as a callback under micro-ROS")] = 1.0
    link_check: Annotated[Guess, Doc("your guess for the task that asks the network chip for its link")] = 1.0
    reveal: Annotated[bool, View(), Doc("show what was measured")] = False

    def run(self) -> dict[str, tuple[float, ...]]:
        """Measured factors of each task, one per pair of recordings."""
        return {key: tuple(measured_factor(*row, rates) for rates in RATES) for key, row in GUESSED.items()}

    def figure(self, result: dict[str, tuple[float, ...]]) -> dict[str, Any]:
        colour = colours(name for _, name in GUESSED.values())
        rows = [
            Factor(
                key.replace("pose_micro_ROS", "pose_ctrl, micro-ROS"),
                result[key] if self.reveal else (),
                colour[name],
                getattr(self, key),
            )
            for key, (_, name) in GUESSED.items()
        ]
        x = axis("time without caches / time with caches", range=[0, 10.2])
        return stack(factors(rows, x, guess="your guess"), height=380, keys=["measured (source 1)"])

    def metrics(self, result: dict[str, tuple[float, ...]]) -> list[Metric]:
        found = []
        for task, values in result.items():
            guess, value = getattr(self, task), sum(values) / len(values)
            found.append(
                Metric(
                    task.replace("_", " "),
                    guess,
                    "×",
                    published=round(value, 2) if self.reveal else None,
                    good=max(guess / value, value / guess) <= 1.25 if self.reveal else None,
                    note="your guess; good within a quarter of the mean of the two recordings",
                )
            )
        return found


class PublishedSpeedups(Experiment[dict[str, list[Pair]]]):
    """What did the caches bring? All of tables 2 to 9 as one picture.

    Each row is a task, each line one pair of recordings: open without caches, filled with both caches on. The cards compare what
    the text says of the sums at 100|50 Hz.
    """

    headline: ClassVar[tuple[str, ...]] = ("printed and recomputed alike", "IDLE, FreeRTOS", "largest gap to one activation")

    quantity: Annotated[
        Literal["mean", "share"],
        Labels({"mean": "mean of one activation", "share": "share of all time"}),
        Doc("what the rows show"),
    ] = "mean"
    tasks: Annotated[
        Literal["control", "all"], Labels({"control": "control software only", "all": "every task, idle too"}), Doc("which rows")
    ] = "all"

    def run(self) -> dict[str, list[Pair]]:
        result: dict[str, list[Pair]] = {}
        for platform in PLATFORMS:
            names = list(recordings()[platform, RATES[0], "off"])
            if self.tasks == "control":
                names = [
                    n for n in names if n in ("odom", "p_ctrl", "w_ctrl", "odometry", "pose_control", "wheel_ctrl", "hal_fetch")
                ]
            result[platform] = [
                Pair(name, before, after, rates == RATES[0])
                for name in names
                for rates in RATES
                for before, after in [[getattr(recordings()[platform, rates, c][name], self.quantity) for c in ("off", "on")]]
            ]
        return result

    def figure(self, result: dict[str, list[Pair]]) -> dict[str, Any]:
        title, low, high = ("mean duration [us]", 2, 5000) if self.quantity == "mean" else ("share of all time [%]", 0.01, 400)
        series = (f"{RATES[0]} Hz", f"{RATES[1]} Hz")
        return dumbbells(result, series, title, low, high, height=520)

    def metrics(self, result: dict[str, list[Pair]]) -> list[Metric]:
        found = [
            Metric(
                f"{name}, {platform}",
                round(change(platform, name), 2),
                "%",
                published=printed,
                good=abs(change(platform, name) - printed) <= 0.005 + 1e-9,
                note="change of the sum at 100|50 Hz, caches on against off: from the table, and as the text prints it",
            )
            for (platform, name), printed in CLAIMS.items()
        ]
        right = sum(bool(metric.good) for metric in found)
        apart = max(abs(change(*row) - change_of_one(*row)) for row in CLAIMS if row[1] != "IDLE")
        note = "of a control function: its sum also changes because the recordings have unequal numbers of activations"
        return [
            Metric("printed and recomputed alike", right, f"of {len(found)}", good=right == len(found)),
            *found,
            Metric("largest gap to one activation", round(apart, 2), "points", note=note),
        ]


# Exercises: each asks the tables


def check_wrong_total(table: Any) -> Feedback:
    """Clue 1: the table whose printed total is not the sum of its rows."""
    if type(table) is not int:
        return Feedback(False, f"the answer is {shown(table)}; it has to be the number of a table, like 2.")
    with open(published("xu2025_stated_totals.csv"), newline="", encoding="utf-8") as file:
        stated = {int(r["thesis_table"]): (r, int(r["stated_sum_us"])) for r in csv.DictReader(file)}
    if table not in stated:
        return Feedback(False, f"there are tables {min(stated)} to {max(stated)}.")
    r, printed = stated[table]
    added = sum(row.total for row in recordings()[r["platform"], f"{r['wheel_hz']}|{r['pose_hz']}", r["caches"]].values())
    return Feedback(added != printed, f"table {table} prints {printed} us, its rows add up to {added} us.")


def check_idle_formula(formula: Any) -> Feedback:
    """Clue 2: a function of the idle sums (off, on) that gives the printed 14.88 %, and 0 where nothing changes."""
    off, on = (recordings()["FreeRTOS", "100|50", caches]["IDLE"].total for caches in ("off", "on"))
    printed, values = CLAIMS["FreeRTOS", "IDLE"], []
    for sums in ((off, on), (off, off), (2 * off, 2 * on)):  # the others unmask a constant
        value = called(formula, "lambda off, on: 100 * (on - off) / off", *sums)
        if isinstance(value, Feedback):
            return value
        if isinstance(value, bool) or not isinstance(value, int | float):
            return Feedback(False, f"your formula returns {shown(value)}; it has to be a number, in percent.")
        values.append(round(value, 2))
    if values[1] or values[2] != values[0]:
        return Feedback(
            False,
            f"your formula gives {values[0]:.2f} %, but {values[1]:.2f} % for equal sums and {values[2]:.2f} % for both doubled; "
            "a change in percent is 0 for equal sums and does not depend on their size.",
        )
    return Feedback(values[0] == printed, f"your formula gives {values[0]:.2f} %, the text prints {printed} %.")


def check_sample_difference(platform: str, rates: str) -> Feedback:
    """Clue 3: the pair of recordings whose printed totals differ by 349.045 ms."""
    if platform not in PLATFORMS or rates not in RATES:
        return Feedback(False, f"choose a platform of {', '.join(PLATFORMS)} and rates of {', '.join(RATES)}.")
    off, on = (sum(row.total for row in recordings()[platform, rates, caches].values()) for caches in ("off", "on"))
    return Feedback(
        abs(on - off) == 349_045, f"the two sums of {platform} at {rates} Hz differ by {abs(on - off) / 1000:.3f} ms."
    )
