"""Notebook 02: what the caches brought in the published recordings (source 1, tables 2 to 10), and what a timing model says."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.cache import Cost, Timing, Work, run_cost, wait_states
from labkit.data import published
from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.figures import (
    BLUE,
    FONT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    SKY,
    VERMILION,
    Bar,
    Curve,
    Factor,
    Pair,
    axis,
    colours,
    curves,
    dumbbells,
    factors,
    key,
    stack,
    stacked,
)

PLATFORMS = ("micro-ROS", "FreeRTOS")
RATES = ("50|30", "100|50")
MHZ = 1_000_000
CLOCK = 216  # MHz, of the board of source 1
PARTS = {"compute": SKY, "waiting for code": VERMILION, "waiting for data": ORANGE, "no cache can change": PALE}


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
        return stack(factors(rows, x, guess="your guess"), height=390, keys=["measured (source 1)"])

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

    Each row is a task, each line one pair of recordings: open without caches, filled with both caches on.
    """

    quantity: Annotated[
        Literal["mean", "share"],
        Labels({"mean": "mean duration of one activation", "share": "share of all time"}),
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
        return dumbbells(result, series, title, low, high, height=660)

    def metrics(self, result: dict[str, list[Pair]]) -> list[Metric]:
        return [
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


# Timing: one program, priced

INSTRUCTIONS = 100_000  # of the program that TimingModel prices
DATA_PER_INSTRUCTION = 0.3  # loads and stores, an assumption
WORDS_PER_LINE = 8  # loads and stores that one line of data serves

Clock = Annotated[
    int, Interval(ge=27, le=216), MultipleOf(27), Unit("MHz"), Doc("CPU clock; each 27 MHz add one flash wait state")
]
PerInstruction = Annotated[
    float, Interval(ge=0.5, le=2), MultipleOf(0.1), Unit("cycles"), Doc("cycles per instruction when nothing is waited for")
]
Overhead = Annotated[
    int, Interval(ge=0, le=5), Unit("cycles"), Doc("what the bus adds to every read of the flash; 1 to 3 are likely")
]
UncachedData = Annotated[int, Interval(ge=1, le=20), Unit("cycles"), Doc("stall of a load or store without data cache")]
DataFill = Annotated[int, Interval(ge=0, le=40), Unit("cycles"), Doc("penalty: stall of a data-cache miss")]
Coldness = Annotated[
    int, Interval(ge=0, le=100), Unit("%"), Doc("share of a job's lines that are no longer in the caches when it begins")
]


def program(instructions: int, coldness: int, passes: int = 1, fetches_per_100: int = 48, insensitive: int = 0) -> Work:
    """A job that runs through its code `passes` times; the share `coldness` [%] of its lines must be fetched anew."""
    fetches, data = instructions * fetches_per_100 // 100, round(instructions * DATA_PER_INSTRUCTION)
    share = coldness / 100 / passes
    return Work(
        instructions,
        fetches,
        data,
        code_fills=round(share * fetches / 4),
        data_fills=round(share * data / WORDS_PER_LINE),
        insensitive=insensitive,
    )


def parts(cost: Cost, unit: float) -> list[float]:
    """The parts of a cost in the order of PARTS, in units of `unit` cycles."""
    return [cost.compute / unit, cost.code / unit, cost.data / unit, cost.insensitive / unit]


class TimingModel(Experiment[tuple[Cost, Cost]]):
    """Which prices make a task three times faster?

    One job of a program, priced without and with caches. Only the wait states are known (RM0410); every other slider is an
    assumption. The thick line is the model's speed-up, the diamonds are the robot's tasks.
    """

    clock: Clock = 216
    per_instruction: PerInstruction = 1.0
    overhead: Overhead = 2
    uncached_data: UncachedData = 6
    data_fill: DataFill = 12
    coldness: Coldness = 60
    passes: Annotated[int, Interval(ge=1, le=20), Doc("how often a job runs through its code: 1 is straight on, 20 a loop")] = 1
    fetches_per_100: Annotated[int, Interval(ge=41, le=56), Unit("reads"), Doc("64-bit reads of code per 100 instructions")] = 48
    insensitive: Annotated[
        int, Interval(ge=0, le=300), MultipleOf(10), Unit("%"), Doc("time no cache changes, in % of the pure computing")
    ] = 0

    def run(self) -> tuple[Cost, Cost]:
        """Costs without and with caches."""
        timing = Timing(
            hz=self.clock * MHZ,
            per_instruction=self.per_instruction,
            overhead=self.overhead,
            uncached_data=self.uncached_data,
            data_fill=self.data_fill,
        )
        work = program(
            INSTRUCTIONS,
            self.coldness,
            self.passes,
            self.fetches_per_100,
            round(INSTRUCTIONS * self.per_instruction * self.insensitive / 100),
        )
        return run_cost(work, timing, icache=False, dcache=False), run_cost(work, timing)

    def figure(self, result: tuple[Cost, Cost]) -> dict[str, Any]:
        off, on = result
        bars = [Bar("caches off", parts(off, INSTRUCTIONS)), Bar("caches on", parts(on, INSTRUCTIONS))]
        cycles = axis("cycles per instruction", range=[0, 1.05 * max(off.total, on.total) / INSTRUCTIONS])
        rows = [
            Factor(f"{name}, {platform}", [measured_factor(platform, name, rates) for rates in RATES], INK)
            for platform, name in (*[key for key in CLAIMS if key[1] != "IDLE"], ("micro-ROS", "EthIf"), ("micro-ROS", "EthLink"))
        ]
        factor = off.total / on.total
        ratio = axis("time without caches / time with caches", range=[0, max(8.2, factor * 1.05)])
        panels = [stacked(bars, PARTS, cycles), factors(rows, ratio, line=factor, left=220)]
        return stack(panels, height=460, barmode="stack", keys=["measured (source 1)"])

    def metrics(self, result: tuple[Cost, Cost]) -> list[Metric]:
        off, on = result
        control = [measured_factor(platform, name, rates) for platform, name in CLAIMS if name != "IDLE" for rates in RATES]
        factor = off.total / on.total
        return [
            Metric("wait states of the flash", wait_states(self.clock * MHZ), "cycles", note="RM0410, 2.7 to 3.6 V"),
            Metric("without caches", off.total / INSTRUCTIONS, "cycles/instr."),
            Metric("with caches", on.total / INSTRUCTIONS, "cycles/instr."),
            Metric("speed-up", factor, "×"),
            Metric(
                "measured rows within 10 %",
                sum(abs(factor / m - 1) <= 0.1 for m in control),
                f"of {len(control)}",
                note="control tasks on both platforms, both rates; no single program is all of them",
            ),
        ]


@dataclass(frozen=True)
class Explanation:
    """A program that takes the measured times, as far as that is possible.

    Attributes:
        work: of `JOBS` jobs. off, on: its costs at 216 MHz. target: the measured cycles of `JOBS` jobs without and with caches.
        balance: cycles no cache changes that the two equations ask for; below 0 there is no such program.
        slopes: (wait states, cycles of a job without, with caches) at every 27 MHz.
        warm: the same of the program that explains the times with caches that are never cold.
    """

    work: Work
    off: Cost
    on: Cost
    target: tuple[float, float]
    balance: float
    slopes: list[tuple[int, float, float]]
    warm: list[tuple[int, float, float]]


JOBS = 1000
CONTROL = {
    "wheel_ctrl": "FreeRTOS",
    "odometry": "FreeRTOS",
    "pose_control": "FreeRTOS",
    "w_ctrl": "micro-ROS",
    "odom": "micro-ROS",
    "p_ctrl": "micro-ROS",
}


class Explanations(Experiment[Explanation]):
    """How many different programs explain one measurement?

    For the prices and the coldness you choose, the two measured times give two equations. They are solved for the number of
    instructions and for the time that no cache changes. If that comes out negative, the choice is refuted; else it fits exactly.
    Right: the same program at other clocks, which nobody measured. Grey: the explanation with caches that are never cold.
    """

    task: Annotated[
        Literal["wheel_ctrl", "odometry", "pose_control", "w_ctrl", "odom", "p_ctrl"],
        Labels({name: f"{name}, {platform}" for name, platform in CONTROL.items()}),
        Doc("measured at 100|50 Hz"),
    ] = "wheel_ctrl"
    coldness: Coldness = 40
    per_instruction: PerInstruction = 1.0
    overhead: Overhead = 2
    uncached_data: UncachedData = 6
    data_fill: DataFill = 12

    def timing(self, clock: int = CLOCK) -> Timing:
        return Timing(
            hz=clock * MHZ,
            per_instruction=self.per_instruction,
            overhead=self.overhead,
            uncached_data=self.uncached_data,
            data_fill=self.data_fill,
        )

    def solved(self, coldness: int) -> tuple[Work, float]:
        """The program that takes the measured times with such caches, and the balance of the two equations."""
        target_off, target_on = self.target()
        unit = program(10**6, coldness)  # what one instruction costs, to six digits
        off, on = (run_cost(unit, self.timing(), icache=caches, dcache=caches).total / 10**6 for caches in (False, True))
        saved = max(off - on, 1e-3)  # caches that cost more than they save explain nothing; the balance is then far below 0
        instructions = round((target_off - target_on) / saved)
        balance = target_on - on * instructions
        return program(instructions, coldness, insensitive=max(0, round(balance))), balance

    def target(self) -> tuple[float, float]:
        """The measured cycles of `JOBS` jobs without and with caches."""
        off, on = (recordings()[CONTROL[self.task], "100|50", caches][self.task].mean for caches in ("off", "on"))
        return off * CLOCK * JOBS, on * CLOCK * JOBS

    def slopes(self, work: Work) -> list[tuple[int, float, float]]:
        """(wait states, cycles of a job without, with caches) at every 27 MHz."""
        found = []
        for clock in range(27, CLOCK + 1, 27):
            off, on = (run_cost(work, self.timing(clock), icache=caches, dcache=caches).total / JOBS for caches in (False, True))
            found.append((wait_states(clock * MHZ), off, on))
        return found

    def run(self) -> Explanation:
        (work, balance), (warm, _) = self.solved(self.coldness), self.solved(0)
        off, on = (run_cost(work, self.timing(), icache=caches, dcache=caches) for caches in (False, True))
        return Explanation(work, off, on, self.target(), balance, self.slopes(work), self.slopes(warm))

    def figure(self, result: Explanation) -> dict[str, Any]:
        us = CLOCK * JOBS  # cycles of JOBS jobs in a microsecond of one
        bars = [
            Bar("caches off", parts(result.off, us), result.target[0] / us),
            Bar("caches on", parts(result.on, us), result.target[1] / us),
        ]
        at = [s[0] for s in result.slopes]
        lines = [
            Curve("caches off, never cold", at, [s[1] for s in result.warm], GREY, "dash"),
            Curve("caches on, never cold", at, [s[2] for s in result.warm], GREY, "dash"),
            Curve("caches off", at, [s[1] for s in result.slopes], BLUE),
            Curve("caches on", at, [s[2] for s in result.slopes], GREEN),
        ]
        notes = [
            {
                "text": f"<b> {line.name}</b>",
                "x": 7.2,
                "y": line.y[-1],
                "xanchor": "left",
                "font": {"color": line.colour, "size": FONT},
            }
            for line in lines[2:]
        ]
        warm = key("caches never cold", type="scatter", mode="lines", line={"color": GREY, "width": 3, "dash": "dash"})
        time = axis("time of one job at 216 MHz [us]", range=[0, 1.1 * max(result.target[0], result.off.total) / us])
        panels = [
            stacked(bars, PARTS, time),
            curves(
                lines,
                axis("flash wait states (216 MHz needs 7)", range=[-0.3, 10.4], tickvals=at),
                axis("cycles of one job", rangemode="tozero"),
                points=[(7, t / JOBS) for t in result.target],
                legend=False,
                notes=notes,
                left=110,
            ),
        ]
        return stack(panels, height=450, barmode="stack", keys=["measured (source 1)", warm])

    def metrics(self, result: Explanation) -> list[Metric]:
        work, possible = result.work, result.balance >= 0
        return [
            Metric(
                "explains both times", possible, good=possible, note="if not, the time no cache changes would have to be negative"
            ),
            Metric(
                "instructions of a job", round(work.instructions / JOBS), "", note="follows from the difference of the two times"
            ),
            Metric("time no cache changes", result.balance / JOBS / CLOCK, "us", good=possible),
            Metric("slope, caches off", work.fetches / JOBS, "cycles/wait state", note="the code reads of a job, F"),
            Metric("slope, caches on", work.code_fills / JOBS, "cycles/wait state", note="the line fills of a job, M_I"),
        ]


# Exercises: each asks the tables or the model


def check_wrong_total(table: int) -> Feedback:
    """Clue 1: the table whose printed total is not the sum of its rows."""
    with open(published("xu2025_stated_totals.csv"), newline="", encoding="utf-8") as file:
        stated = {int(r["thesis_table"]): (r, int(r["stated_sum_us"])) for r in csv.DictReader(file)}
    if table not in stated:
        return Feedback(False, f"there are tables {min(stated)} to {max(stated)}.")
    r, printed = stated[table]
    added = sum(row.total for row in recordings()[r["platform"], f"{r['wheel_hz']}|{r['pose_hz']}", r["caches"]].values())
    return Feedback(added != printed, f"table {table} prints {printed} us, its rows add up to {added} us.")


def check_idle_formula(formula: Any) -> Feedback:
    """Clue 2: a function of the idle sums (off, on) that gives the printed 14.88 %."""
    off, on = (recordings()["FreeRTOS", "100|50", caches]["IDLE"].total for caches in ("off", "on"))
    value = formula(off, on)
    return Feedback(
        round(value, 2) == CLAIMS["FreeRTOS", "IDLE"],
        f"your formula gives {value:.2f} %, the text prints {CLAIMS['FreeRTOS', 'IDLE']} %.",
    )


def check_sample_difference(platform: str, rates: str) -> Feedback:
    """Clue 3: the pair of recordings whose printed totals differ by 349.045 ms."""
    if platform not in PLATFORMS or rates not in RATES:
        return Feedback(False, f"choose a platform of {', '.join(PLATFORMS)} and rates of {', '.join(RATES)}.")
    off, on = (sum(row.total for row in recordings()[platform, rates, caches].values()) for caches in ("off", "on"))
    return Feedback(
        abs(on - off) == 349_045, f"the two recordings of {platform} at {rates} Hz differ by {abs(on - off) / 1000:.3f} ms."
    )


def check_coldest(answer: Explanations) -> Feedback:
    """Exercise 4: the largest coldness that still explains the task, at the prices given."""
    possible = answer.run().balance >= 0
    if not possible:
        return Feedback(False, f"{answer.coldness} % is too cold: the time no cache changes would have to be negative.")
    colder = answer.coldness < 100 and answer.replace(coldness=answer.coldness + 1).run().balance >= 0
    return Feedback(
        not colder,
        f"{answer.coldness} % explains both times"
        + (", but one percent more does as well." if colder else ", and one percent more does not."),
    )
