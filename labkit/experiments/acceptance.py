"""Notebook 07: the price of planning with the worst case, what expected times buy, and which sets each test accepts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric, progress
from labkit.experiments.answers import refused
from labkit.figures import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, Curve, axis, curves, reserve, stack
from labkit.phases import BELOW_NS, LONGEST_NS, MS, SHARE, contour_model
from labkit.scheduler import (
    PeriodicTask,
    TaskPair,
    UndecidedError,
    accept_edf,
    accept_hyperbolic,
    accept_liu_layland,
    accept_response_time,
    log_uniform_periods,
    simulate,
    taft_demand_test,
    taft_test,
    uunifast,
)
from labkit.trace import Trace, jobs

US = 1000  # microseconds, the unit of the traces, in a millisecond
WCET, BELOW = LONGEST_NS // MS, BELOW_NS // MS  # ms: the contour filter's longest run, and below which nine of ten runs stay
JOBS = 400  # periods, as many as source 2 recorded
MOST = 1100  # ms: end of the axis of what six filters need


@dataclass(frozen=True)
class Filters:
    """The run times drawn, in ms, shape (filters, jobs), and what EDF and TAFT made of them."""

    times: np.ndarray
    edf: Trace
    taft: Trace


class ExpectedTime(Experiment[Filters]):
    """What does planning with the worst case cost?

    Several contour filters share a processor, all with the same period and released together. Their longest run takes
    140 ms, nine of ten take less than 50 ms. EDF has to reserve the longest time for each; TAFT reserves an expected time
    and an exception part. Both run the same 400 periods.
    """

    headline: ClassVar[tuple[str, ...]] = ("aborted by TAFT", "deadlines missed by EDF", "longer than ECET")

    filters: Annotated[int, Interval(ge=1, le=6), Doc("contour filters on one processor")] = 4
    period: Annotated[int, Interval(ge=150, le=600), MultipleOf(10), Unit("ms"), Doc("period of each filter")] = 200
    ECET: Annotated[int, Interval(ge=5, le=140), Unit("ms"), Doc("expected time reserved for a main part")] = 40
    EP: Annotated[float, Interval(ge=0, le=10), MultipleOf(0.5), Unit("ms"), Doc("longest time of an exception part")] = 0.5
    seed: Annotated[int, Interval(ge=0, le=99), Doc("another draw of the run times")] = 0

    def pairs(self) -> list[TaskPair]:
        """What TAFT plans with, in microseconds."""
        return [TaskPair(f"filter {i + 1}", self.ECET * US, round(self.EP * US), self.period * US) for i in range(self.filters)]

    def tasks(self) -> list[PeriodicTask]:
        """What EDF plans with."""
        return [PeriodicTask(p.name, WCET * US, p.period) for p in self.pairs()]

    def run(self) -> Filters:
        draw = contour_model(below=BELOW * US, longest=WCET * US)
        times = draw(self.filters * JOBS, np.random.default_rng(self.seed)).reshape(self.filters, JOBS)
        given = {p.name: row for p, row in zip(self.pairs(), times, strict=True)}
        until = JOBS * self.period * US
        edf, taft = (
            simulate(self.tasks(), "edf", until, given, 1000 * US),
            simulate(self.pairs(), "taft", until, given, 1000 * US),
        )
        return Filters(times / US, edf, taft)

    def figure(self, result: Filters) -> dict[str, Any]:
        used = result.times.sum(axis=0)
        n = self.filters
        needs = [
            ("planned with C", (n * WCET, 0)),
            ("planned with<br>ECET + EP", (n * self.ECET, n * self.EP)),
            ("asked for,<br>busiest period", (float(used.max()), 0)),
            ("asked for,<br>on average", (float(used.mean()), 0)),
        ]
        return reserve(result.times.ravel(), WCET, self.ECET, (SHARE, BELOW), needs, self.period, MOST)

    def metrics(self, result: Filters) -> list[Metric]:
        total = self.filters * JOBS
        accepted = taft_test(self.pairs()).accepted
        longer = 100 * float((result.times > self.ECET).mean())
        edf, taft, aborts = (
            int(jobs(result.edf).missed.sum()),
            int(jobs(result.taft).missed.sum()),
            100 * len(result.taft.rows("abort")) / total,
        )
        worst = bool(accept_edf(np.full((1, self.filters), WCET), np.full((1, self.filters), self.period))[0])
        return [
            Metric("filters that fit by C", self.period // WCET, good=worst, note="the period over 140 ms"),
            Metric("filters that fit by ECET + EP", int(self.period / (self.ECET + self.EP)), good=accepted),
            Metric("deadlines missed by EDF", edf, f"of {total}", bound=0 if worst else None, good=not edf),
            Metric("deadlines missed by TAFT", taft, f"of {total}", bound=0 if accepted else None, good=not taft),
            Metric("longer than ECET", longer, "%"),
            Metric(
                "aborted by TAFT",
                aborts,
                "%",
                bound=longer if accepted else None,
                note="only main parts that take longer than their ECET",
            ),
            Metric("processor asked for on average", 100 * float(result.times.sum()) / (JOBS * self.period), "%"),
        ]


def check_expected_time(answer: ExpectedTime) -> Feedback:
    """Exercise 3: five filters, accepted by TAFT, at most 2 % aborted, and a period that is at most 210 ms."""
    wrong = refused(answer, ExpectedTime(filters=5), "period", "ECET")
    if wrong:
        return wrong
    verdict = taft_test(answer.pairs())
    if not verdict.accepted:
        return Feedback(False, f"not accepted: {verdict.why}.")
    aborts = answer.measure("aborted by TAFT")
    told = f"accepted, and {aborts:.2f} % of the main parts are aborted with a period of {answer.period} ms"
    if aborts > 2:
        return Feedback(False, f"{told}; at most 2 % are allowed.")
    return Feedback(
        answer.period <= 210, told + (f", where worst cases need {5 * WCET} ms." if answer.period <= 210 else "; 210 ms will do.")
    )


TESTS = {  # colour and dash of each curve
    "RM, Liu-Layland": (ORANGE, "dot"),
    "RM, hyperbolic": (PURPLE, "dash"),
    "RM, exact": (SKY, "solid"),
    "EDF, exact": (BLUE, "solid"),
    "TAFT, safe test": (GREEN, "solid"),
    "TAFT, sum (not safe)": (GREY, "dash"),
}
LOADS = (*range(50, 105, 5), 101, *range(120, 300, 20))  # %: closer together where RM and EDF come to their end

SETS = 1000  # drawn for each load


@dataclass(frozen=True)
class Accepted:
    """Test -> share accepted at each of `LOADS`, in %; and of how many sets TAFT's safe test gave no answer."""

    share: dict[str, list[float]]
    undecided: int


class AcceptanceCurves(Experiment[Accepted]):
    """Which share of random task sets does each test accept?

    UUniFast sets with log-uniform periods; the axis is the utilisation by worst-case times. TAFT plans the same tasks with
    ECET + EP; its test is the slow one, so that it gets only the first of the 1000 sets of each point. Where it gives up,
    within a hair of a sum of 1, the set is counted as undecided and not as accepted.
    """

    slow: ClassVar[bool] = True
    headline: ClassVar[tuple[str, ...]] = ("half: RM, exact", "half: EDF, exact", "half: TAFT, safe test")

    tasks: Annotated[int, Interval(ge=2, le=6), Doc("tasks in a set")] = 4
    ECET: Annotated[int, Interval(ge=10, le=100), MultipleOf(5), Unit("% of C"), Doc("expected time of a main part")] = 35
    EP: Annotated[int, Interval(ge=0, le=30), Unit("% of C"), Doc("exception part")] = 5
    spread: Annotated[int, Interval(ge=1, le=50), Doc("longest period over the shortest")] = 10
    sets: Annotated[int, Interval(ge=20, le=60), MultipleOf(20), Doc("task sets of each point that TAFT's tests get")] = 40
    seed: Annotated[int, Interval(ge=0, le=99), Doc("other task sets")] = 0

    def run(self) -> Accepted:
        rng = np.random.default_rng(self.seed)
        share: dict[str, list[float]] = {name: [] for name in TESTS}
        asked: list[tuple[int, list[TaskPair]]] = []  # what is left to the safe test, by point of the curve
        for point, load in enumerate(LOADS):
            periods = log_uniform_periods(self.tasks, SETS, 10_000, 10_000 * self.spread, rng)
            wcets = np.floor(uunifast(self.tasks, load / 100, SETS, rng) * periods).astype(np.int64).clip(1)
            few, theirs = wcets[: self.sets], periods[: self.sets]
            ecets, exceptions = (few * self.ECET // 100).clip(1), few * self.EP // 100
            plain = accept_edf(ecets + exceptions, theirs) & np.all(ecets + exceptions <= theirs, axis=1)
            accepted = {
                "RM, Liu-Layland": accept_liu_layland(wcets, periods),
                "RM, hyperbolic": accept_hyperbolic(wcets, periods),
                "RM, exact": accept_response_time(wcets, periods),
                "EDF, exact": accept_edf(wcets, periods),
                "TAFT, sum (not safe)": plain,
            }
            for name, which in accepted.items():
                share[name].append(100 * float(np.mean(which)))
            for row in np.stack([ecets, exceptions, theirs], axis=2)[plain].tolist():
                asked.append((point, [TaskPair(f"t{i}", *times) for i, times in enumerate(row)]))
        safe, undecided = [0] * len(LOADS), 0
        for point, pairs in progress(asked):
            try:
                safe[point] += taft_demand_test(pairs).accepted
            except UndecidedError:
                undecided += 1
        share["TAFT, safe test"] = [100 * count / self.sets for count in safe]
        return Accepted(share, undecided)

    def figure(self, result: Accepted) -> dict[str, Any]:
        lines = [Curve(name, LOADS, result.share[name], colour, dash) for name, (colour, dash) in TESTS.items()]
        x = axis("utilisation by worst-case times [%]", range=[46, 284], dtick=20, tick0=60)
        whole = {
            "type": "line",
            "x0": 100,
            "x1": 100,
            "yref": "y domain",
            "y0": 0,
            "y1": 1,
            "line": {"color": INK, "width": 1.5, "dash": "dot"},
        }
        return stack(curves(lines, x, axis("accepted sets [%]", range=[-3, 106]), shapes=[whole]), height=460)

    def metrics(self, result: Accepted) -> list[Metric]:
        note = "utilisation up to which at least half of the sets are accepted"
        undecided = "sets for which the safe test gave up; not counted as accepted"
        return [
            *(Metric(f"half: {name}", half(result.share[name]), "%", note=note) for name in TESTS),
            Metric("undecided", result.undecided, f"of {len(LOADS) * self.sets}", note=undecided),
        ]


def half(accepted: list[float]) -> int | None:
    """The highest load of `LOADS` before the curve first falls below a half; None if it begins below."""
    below = next((i for i, share in enumerate(accepted) if share < 50), len(accepted))
    return LOADS[below - 1] if below else None
