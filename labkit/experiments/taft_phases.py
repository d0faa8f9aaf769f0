"""Notebook 08: a chain of sensor-processing phases in every period, under TAFT (source 2, sections 4 and 7.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.data import published_table
from labkit.experiment import Experiment, Feedback, Metric, View
from labkit.experiments.answers import refused
from labkit.figures import BLUE, ORANGE, activity_stack, periods_gantt, plan, stack, verdict_grid
from labkit.phases import (
    CONTOUR,
    DESIGNS,
    MS,
    DesignRun,
    Experiment1,
    Part,
    Window,
    contour_model,
    experiment_1,
    laser_chain,
    laser_load,
    phase_times,
    phases_of,
    run_design,
    windows,
)
from labkit.trace import Trace

PERIODS, SHOWN = 60, 2  # of the six designs: periods run under the same load, periods drawn
LONGEST_PERIOD = 130  # ms, of experiment 1 with the longest expected time there is
GUARANTEES = ("G1 periodic", "G2 in time", "G3 complete", "G4 in order")
KEYS = ("ready", "release", "deadline", "missed", "beyond ECET", "aborted", "exception part")

ArcsEcet = Annotated[
    int, Interval(ge=5, le=60), Unit("ms"), Doc("expected time (ECET) of the contour filter's arc search; source 2: 30 ms")
]
Ninety = Annotated[
    int,
    Interval(ge=15, le=100),
    MultipleOf(5),
    Unit("ms"),
    Doc("90 % of the contour filter's run times are below this; source 2: 50 ms"),
]


@cache
def published_ends() -> tuple[int, ...]:
    """Ends of the windows as printed in table 5 of source 2, in ns from the start of the period."""
    return tuple(published_table("diplom_table5_windows.csv")["deadline_from_period_start_ns"].tolist()[:-1])


@cache
def published_lengths() -> tuple[int, ...]:
    """Lengths of the windows as printed in the same table, in ns."""
    return tuple(published_table("diplom_table5_windows.csv")["deadline_ns"].tolist())


class PhaseWindows(Experiment[list[Window] | str]):
    """Where does each phase get its window?

    Every phase gets a share of the period in proportion to what it expects, expected time plus exception part (4.12, 4.18); the
    end of the period is kept for clock correction (5.7). Start values: table 5 of source 2.
    """

    period: Annotated[int, Interval(ge=60, le=200), Unit("ms"), Doc("period of the chain")] = 100
    reserve: Annotated[
        int, Interval(ge=0, le=10), Unit("ms"), Doc("kept at the end of the period for clock correction (Deadline_C)")
    ] = 2
    arcs_ecet: ArcsEcet = 30
    comm_ecet: Annotated[int, Interval(ge=5, le=60), Unit("ms"), Doc("expected time of the communication; source 2: 35 ms")] = 35

    def chain(self) -> list[Part]:
        """The chain of table 5 with these expected times."""
        return [
            Part(p.phase, p.part, self.comm_ecet * MS, p.wcet_ep_ns) if p.phase == "LMSCommunication" else p
            for p in laser_chain(self.arcs_ecet * MS)
        ]

    def run(self) -> list[Window] | str:
        """The windows, or the sentence that says what is missing."""
        try:
            return windows(self.chain(), self.period * MS, self.reserve * MS)
        except ValueError as error:
            return str(error)

    def figure(self, result: list[Window] | str) -> dict[str, Any]:
        demands = {phase: sum(p.demand_ns for p in parts) for phase, parts in phases_of(self.chain()).items()}
        made = [] if isinstance(result, str) else result
        return plan(demands, made, published_ends(), self.period, self.reserve)

    def metrics(self, result: list[Window] | str) -> list[Metric]:
        demand = sum(p.demand_ns for p in self.chain())
        spare = (self.period - self.reserve) * MS - demand
        fits = not isinstance(result, str)
        communication = None if isinstance(result, str) else result[2].deadline_ns
        printed = published_lengths()[2]
        same = self == PhaseWindows()
        return [
            Metric("demand of all phases", demand / MS, "ms"),
            Metric("spare", spare / MS, "ms", good=fits, note="period less reserve less demand, (5.6)" if fits else str(result)),
            Metric(
                "window per expected time",
                (self.period - self.reserve) * MS / demand if fits else None,
                "",
                note="every window is this much longer than what it must hold",
            ),
            Metric(
                "window of the communication",
                communication,
                "ns",
                published=printed if same else None,
                note="two digits of the printed value are swapped, 36 554 792 for 36 554 729" if same else "",
            ),
        ]


@dataclass(frozen=True, eq=False)
class Designs:
    """The six designs under one load; of a design without a plan the sentence why, of one without windows an empty list."""

    chain: list[Part]
    runs: dict[str, DesignRun | str]
    windows: dict[str, list[Window]]


class SixDesigns(Experiment[Designs]):
    """Which way of scheduling a chain of phases keeps all four promises?

    G1: the chain starts in every period; G2: it has ended by the period's end; G3: every phase gets at least its expected time;
    G4: the phases keep their order. All designs get the same random run times over 60 periods; each verdict is read from the
    trace.
    """

    design: Annotated[
        Literal["edf thread", "taft thread", "taft thread, wcet", "taft phases", "taft releases", "taft windows"],
        View(),
        Doc("the design drawn on the right"),
    ] = "taft releases"
    period_shown: Annotated[int, Interval(ge=0, le=PERIODS - 1), View(play=True), Doc("first of the two periods drawn")] = 8
    period: Annotated[int, Interval(ge=90, le=250), MultipleOf(5), Unit("ms"), Doc("period of the chain")] = 100
    arcs_ecet: ArcsEcet = 30
    p90_run_time: Ninety = 50
    seed: Annotated[int, Interval(ge=1, le=20), Doc("another draw of run times")] = 16

    def run(self) -> Designs:
        chain = laser_chain(self.arcs_ecet * MS)
        load = laser_load(chain, PERIODS, contour_model(below=self.p90_run_time * MS), True, self.seed)
        runs: dict[str, DesignRun | str] = {}
        for design in DESIGNS:
            try:
                runs[design] = run_design(chain, design, load, self.period * MS, 2 * MS)
            except ValueError as error:
                runs[design] = str(error)
        made: dict[str, list[Window]] = {design: [] for design in DESIGNS}
        for design in DESIGNS[4:]:  # those that give every phase a window
            if isinstance(runs[design], DesignRun):
                made[design] = windows(chain, self.period * MS, 2 * MS if design == "taft windows" else 0)
        return Designs(chain, runs, made)

    def figure(self, result: Designs) -> dict[str, Any]:
        told = [r.guarantees if isinstance(r, DesignRun) else None for r in result.runs.values()]
        kept = [[g.kept for g in four] if four else [None] * 4 for four in told]
        first = [[g.period for g in four] if four else [None] * 4 for four in told]
        run = result.runs[self.design]
        if isinstance(run, DesignRun):
            trace, begin = run.trace, min(self.period_shown, PERIODS - SHOWN)
            title = f"{self.design}, periods {begin} and {begin + 1}"
        else:
            trace, begin, title = Trace.from_rows((), (), 10**9, end=0), 0, f"{self.design}: no plan"
        gantt = periods_gantt(
            trace,
            [p.name for p in result.chain],
            self.period * MS,
            range(begin, begin + SHOWN),
            result.windows[self.design],
            {p.name: p.phase for p in result.chain},
            title=title,
        )
        says = f"{self.design}: no plan, {run}." if isinstance(run, str) else self._says(run, begin)
        return stack([verdict_grid(DESIGNS, self.design, kept, first), gantt], height=460, keys=KEYS, says=says)

    def _says(self, run: DesignRun, begin: int) -> str:
        """What happens in the two periods shown."""
        length = self.period * MS
        aborts = [time // length for time, *_ in run.trace.rows("abort").tolist()]
        broken = {g.period: f"{g.name} is broken here for the first time" for g in run.guarantees if not g.kept}
        told = []
        for k in range(begin, begin + SHOWN):
            words = [f"{aborts.count(k)} aborted"] if k in aborts else []
            told.append(f"period {k}: {', '.join([*words, *([broken[k]] if k in broken else [])]) or 'nothing is cut short'}")
        return "; ".join(told) + "."

    def metrics(self, result: Designs) -> list[Metric]:
        run = result.runs[self.design]
        if isinstance(run, str):
            found = [Metric("plan accepted", False, good=False, note=run)]
            return found + [Metric(word, None, note="no plan") for word in (*GUARANTEES, "aborts")]
        cards = [Metric("plan accepted", run.verdict.accepted, good=run.verdict.accepted, note=run.verdict.why)]
        cards += [
            Metric(word, "kept" if g.kept else f"broken in {g.period}", good=g.kept, note=g.why)
            for word, g in zip(GUARANTEES, run.guarantees, strict=True)
        ]
        return [*cards, Metric("aborts", len(run.trace.rows("abort")), "", note=f"in {PERIODS} periods")]


class Timeliness(Experiment[Experiment1]):
    """Does the chain stay in time although the contour filter often does not?

    Experiment 1 of source 2: 400 periods of 100 ms, a new scan every 200 ms. The longest run of the contour filter took 140 ms,
    more than the whole period. A period longer than 100 ms is taken where the expected times alone need it.
    """

    headline: ClassVar[tuple[str, ...]] = ("contour filter aborted", "deadlines missed", "least left before a deadline")

    arcs_ecet: ArcsEcet = 30
    p90_run_time: Ninety = 50
    scan_again: Annotated[
        bool, Doc("in a period without a new scan the filter works on the old one again (the source does not say)")
    ] = True
    seed: Annotated[int, Interval(ge=1, le=20), Doc("another draw of run times: another station, another day")] = 1

    def run(self) -> Experiment1:
        return experiment_1(
            contour=contour_model(below=self.p90_run_time * MS),
            reprocess=self.scan_again,
            seed=self.seed,
            arcs_ecet_ns=self.arcs_ecet * MS,
            period_ns=self.period() * MS,
        )

    def period(self) -> int:
        """Period of the chain in ms."""
        return max(100, 70 + self.arcs_ecet)

    def figure(self, result: Experiment1) -> dict[str, Any]:
        chain, times = result.chain, result.times
        granted = {p.name: times.main[:, i] / MS for i, p in enumerate(chain)}
        mine = np.array([p.phase == CONTOUR for p in chain])
        aborted = np.flatnonzero((times.aborted[:, mine] >= 0).any(axis=1))
        title = f"{result.aborted_periods} of {len(times.main)} periods with an abort, {result.missed} late"
        left = self.margins(result)
        groups = {f"left: contour filter {ORANGE}": left[CONTOUR], f"left: other phases {BLUE}": left["others"]}
        exceptions = times.exception.sum(axis=1) / MS
        return activity_stack(granted, exceptions, aborted, groups, self.period(), LONGEST_PERIOD, title)

    @staticmethod
    def margins(result: Experiment1) -> dict[str, np.ndarray]:
        """What was left between the end of each job, exception parts included, and its deadline, in ms: of the contour filter's
        parts, and of all others. A job that was late has less than 0.
        """
        trace, table = result.run.trace, result.jobs
        ended = (table.completion >= 0) & (table.job < len(result.times.main))
        mine = np.isin(table.task, [trace.code(p.name) for p in result.chain if p.phase == CONTOUR])
        left = (table.deadline - table.completion) * (1e3 / trace.hz)
        return {CONTOUR: left[ended & mine], "others": left[ended & ~mine]}

    def metrics(self, result: Experiment1) -> list[Metric]:
        needed = result.load[:, 1:3].sum() / MS
        given = result.times.main[:, 1:3].sum() / MS
        least = float(min(left.min(initial=self.period()) for left in self.margins(result).values()))
        return [
            Metric(
                "contour filter aborted",
                result.aborted_periods,
                "periods",
                published=121,
                note="station 1 of the source: 121 of 400, station 2: 123; the count depends on what the source does not say",
            ),
            Metric("deadlines missed", result.missed, "", published=0, good=result.missed == 0),
            Metric("least left before a deadline", least, "ms", good=least >= 0, note="of all jobs, exception parts included"),
            Metric("aborts of other phases", result.other_aborts, "", good=result.other_aborts == 0),
            Metric("contour time granted", 100 * given / needed, "% of needed"),
            Metric("processor used", 100 * (result.times.main.sum() + result.times.exception.sum()) / result.run.trace.end, "%"),
        ]


# Exercises: each asks the model


def check_period(period_ms: int) -> Feedback:
    """Exercise 1: the shortest whole period for the chain of table 5 with 2 ms for the clock."""

    def fits(ms: int) -> bool:
        return not isinstance(PhaseWindows(period=ms).run(), str)

    if not isinstance(period_ms, int) or not 60 <= period_ms <= 200:
        return Feedback(False, "give a whole number of ms between 60 and 200.")
    if not fits(period_ms):
        return Feedback(False, str(PhaseWindows(period=period_ms).run()) + ".")
    return Feedback(
        not fits(period_ms - 1), f"{period_ms} ms fits{'' if not fits(period_ms - 1) else ', and so does 1 ms less'}."
    )


def check_few_aborts(answer: Timeliness | None) -> Feedback:
    """Exercise 2: at most 20 aborted periods at the source's run times in a period of 100 ms; None: there is no such answer."""

    def aborted(ecet: int) -> int:
        return Timeliness(arcs_ecet=ecet).run().aborted_periods

    longest = max(ms for ms in range(5, 61) if not isinstance(PhaseWindows(arcs_ecet=ms).run(), str))
    if answer is None:
        least = min(aborted(ms) for ms in range(longest - 3, longest + 1))
        return Feedback(
            least > 20, f"the longest expected time that fits is {longest} ms, and the fewest aborted periods are {least}."
        )
    wrong = refused(answer, Timeliness(), "arcs_ecet")
    if wrong:
        return wrong
    if answer.arcs_ecet > longest:
        return Feedback(
            False, f"an expected time of {answer.arcs_ecet} ms does not fit into 100 ms; {longest} ms is the longest."
        )
    count = aborted(answer.arcs_ecet)
    return Feedback(count <= 20, f"{count} aborted periods; at most 20 are allowed.")


def check_chain(chain: list[Part], period_ms: int, seed: int = 1) -> Feedback:
    """Exercise 3: your own chain, run for 300 periods with every main part between half and twice its expected time."""
    try:
        windows(chain, period_ms * MS)
    except ValueError as error:
        return Feedback(False, f"{error}.")
    rng = np.random.default_rng(seed)
    load = np.stack([rng.integers(p.ecet_ns // 2, 2 * p.ecet_ns, 300) for p in chain], axis=1)
    run = run_design(chain, "taft windows", load, period_ms * MS)
    times = phase_times(run.trace, len(chain), 300, period_ms * MS)
    broken = [g.why for g in run.guarantees if not g.kept]
    share = (times.aborted >= 0).mean()
    use = 100 * (times.main.sum() + times.exception.sum()) / run.trace.end
    return Feedback(
        not broken and len(phases_of(chain)) >= 3,
        f"{len(phases_of(chain))} phases, {100 * share:.0f} % of all main parts aborted, processor "
        f"used to {use:.0f} %, " + (f"broken: {broken[0]}." if broken else "all four guarantees kept."),
    )
