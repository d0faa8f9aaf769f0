"""Notebook 02: what a timing model says of the published recordings: one program priced, and programs that explain a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.cache import Cost, Timing, Work, run_cost, wait_states
from labkit.experiment import Experiment, Feedback, Group, Labels, Metric
from labkit.experiments.answers import refused
from labkit.experiments.cache_speedups import CLAIMS, RATES, measured_factor, recordings
from labkit.figures import (
    BLUE,
    FONT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    Bar,
    Curve,
    Factor,
    axis,
    curves,
    factors,
    held,
    key,
    stack,
    stacked,
)

MHZ = 1_000_000
CLOCK = 216  # MHz, of the board of source 1
PARTS = {"compute": SKY, "waiting for code": PURPLE, "waiting for data": ORANGE, "no cache can change": PALE}
INSTRUCTIONS = 100_000  # of the program that TimingModel prices
FETCHES_PER_100 = 48  # 64-bit reads of code per 100 instructions, an assumption: Thumb-2 instructions have 16 or 32 bits
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


def program(instructions: int, coldness: int, passes: int = 1, insensitive: int = 0) -> Work:
    """A job that runs through its code `passes` times; the share `coldness` [%] of its lines must be fetched anew."""
    fetches, data = instructions * FETCHES_PER_100 // 100, round(instructions * DATA_PER_INSTRUCTION)
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

    One job of a program, priced without and with caches. First the sliders of the program, then those of the board. Only the wait
    states are known (RM0410); every other one is an assumption. The thick line is the model's speed-up, the diamonds are the
    robot's tasks.
    """

    coldness: Annotated[Coldness, Group("the program")] = 60
    passes: Annotated[int, Interval(ge=1, le=20), Doc("how often a job runs through its code: 1 is straight on, 20 a loop")] = 1
    insensitive: Annotated[
        int, Interval(ge=0, le=300), MultipleOf(10), Unit("%"), Doc("time no cache changes, in % of the pure computing")
    ] = 0
    clock: Annotated[Clock, Group("the board")] = 216
    per_instruction: PerInstruction = 1.0
    overhead: Overhead = 2
    uncached_data: UncachedData = 6
    data_fill: DataFill = 12

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
            INSTRUCTIONS, self.coldness, self.passes, round(INSTRUCTIONS * self.per_instruction * self.insensitive / 100)
        )
        return run_cost(work, timing, icache=False, dcache=False), run_cost(work, timing)

    def figure(self, result: tuple[Cost, Cost]) -> dict[str, Any]:
        off, on = result
        bars = [Bar("caches off", parts(off, INSTRUCTIONS)), Bar("caches on", parts(on, INSTRUCTIONS))]
        cycles = axis("cycles per instruction", range=[0, held(1.05 * max(off.total, on.total) / INSTRUCTIONS)])
        rows = [
            Factor(f"{name}, {platform}", [measured_factor(platform, name, rates) for rates in RATES], INK)
            for platform, name in (*[key for key in CLAIMS if key[1] != "IDLE"], ("micro-ROS", "EthIf"), ("micro-ROS", "EthLink"))
        ]
        factor = off.total / on.total
        ratio = axis("time without caches / time with caches", range=[0, max(8, held(factor * 1.02))])
        panels = [stacked(bars, PARTS, cycles), factors(rows, ratio, line=factor, left=220)]
        return stack(panels, height=410, barmode="stack", keys=["measured (source 1)"])

    def without_effect(self) -> Mapping[str, str]:
        return {} if self.coldness else dict.fromkeys(("passes", "data_fill"), "with coldness above 0")

    def metrics(self, result: tuple[Cost, Cost]) -> list[Metric]:
        off, on = result
        control = [measured_factor(platform, name, rates) for platform, name in CLAIMS if name != "IDLE" for rates in RATES]
        factor = off.total / on.total
        return [
            Metric("speed-up", factor, "×"),
            Metric("without caches", off.total / INSTRUCTIONS, "cycles/instr."),
            Metric("with caches", on.total / INSTRUCTIONS, "cycles/instr."),
            Metric("wait states of the flash", wait_states(self.clock * MHZ), "cycles", note="RM0410, 2.7 to 3.6 V"),
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
        # A choice that is refused takes longer than was measured; however long, the picture stays with the task.
        time = axis("time of one job at 216 MHz [us]", range=[0, held(1.1 * result.target[0] / us)])
        panels = [
            stacked(bars, PARTS, time),
            curves(
                lines,
                axis("flash wait states (216 MHz needs 7)", range=[-0.3, 10.4], tickvals=at),
                axis("cycles of one job", range=[0, held(1.1 * result.target[0] / JOBS)]),
                points=[(7, t / JOBS) for t in result.target],
                legend=False,
                notes=notes,
                left=110,
            ),
        ]
        return stack(panels, height=440, barmode="stack", keys=["measured (source 1)", warm])

    def without_effect(self) -> Mapping[str, str]:
        return {} if self.coldness else {"data_fill": "with coldness above 0"}

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


def check_coldest(answer: Explanations) -> Feedback:
    """Exercise 4: the largest coldness that still explains the pose controller, at the prices of the bench."""
    wrong = refused(answer, Explanations(task="pose_control"), "coldness")
    if wrong:
        return wrong
    possible = answer.run().balance >= 0
    if not possible:
        return Feedback(False, f"{answer.coldness} % is too cold: the time no cache changes would have to be negative.")
    colder = answer.coldness < 100 and answer.replace(coldness=answer.coldness + 1).run().balance >= 0
    return Feedback(
        not colder,
        f"{answer.coldness} % explains both times"
        + (", but one percent more does as well." if colder else ", and one percent more does not."),
    )
