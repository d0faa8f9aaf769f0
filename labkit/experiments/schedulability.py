"""Notebook 07: one task set under RM, EDF and TAFT; bounds beside simulations; a pair that the plain sum lets starve."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.checks import shown
from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import refused
from labkit.figures import History, Panel, Response, axis, gantt, happening, responses, stack
from labkit.phases import BELOW_NS, LONGEST_NS, contour_model
from labkit.scheduler import (
    PeriodicTask,
    TaskPair,
    edf_response_times,
    edf_utilization_test,
    hyperbolic_test,
    liu_layland_test,
    log_uniform_periods,
    rate_monotonic,
    response_time_test,
    response_times,
    simulate,
    taft_test,
    taft_utilization,
    utilization,
    uunifast,
)
from labkit.trace import Trace, jobs

MS = 1000  # units of all traces here: microseconds
HZ = 1000 * MS
HORIZON, SHOWN = 2000, 42  # ms simulated, ms in the picture
EXCEPTION, T3 = 500, 20  # us: each exception part; ms: period of task 3
TASKS = ("task 1", "task 2", "task 3")
KEYS = ("ready", "release", "deadline", "missed", "beyond ECET", "aborted", "exception part")

Work = Annotated[
    Literal["worst", "filter", "uniform"],
    Labels({"worst": "every job takes C", "filter": "random, 90 % below 0.36 C", "uniform": "random, evenly up to C"}),
    Doc("how long the jobs take, the same for all policies"),
]
Share = Annotated[
    int, Interval(ge=20, le=100), MultipleOf(10), Unit("%"), Doc("expected time (ECET) of each main part as a share of its C")
]


def draw(work: str, wcet: int, jobs: int, rng: np.random.Generator) -> np.ndarray:
    """Execution times of `jobs` jobs, at most `wcet`."""
    if work == "worst":
        return np.full(jobs, wcet)
    if work == "uniform":
        return rng.integers(1, wcet, jobs, endpoint=True)
    return contour_model(below=wcet * BELOW_NS / LONGEST_NS, longest=wcet)(jobs, rng)


def count(trace: Trace, *kinds: str) -> int:
    """Number of rows of these kinds."""
    return len(trace.rows(*kinds))


def misses(trace: Trace) -> int:
    """Number of deadlines missed."""
    return int(jobs(trace).missed.sum())


class Schedules(Experiment[dict[str, History]]):
    """Which deadlines does a task set meet under RM, EDF and TAFT?

    Two tasks, or three of which the last has a period of 20 ms; deadlines at the end of the period, all released at 0. RM and EDF
    know C; TAFT knows the expected time ECET and an exception part of 0.5 ms, with which it replaces a main part that takes too
    long. All three get the same jobs. The start values are Buttazzo's set (2,5)(4,7).
    """

    headline: ClassVar[tuple[str, ...]] = ("who meets all deadlines", "accepted by analysis", "worst-case utilisation")

    C1: Annotated[int, Interval(ge=1, le=4), Unit("ms"), Doc("longest execution time of task 1")] = 2
    T1: Annotated[int, Interval(ge=5, le=12), Unit("ms"), Doc("period of task 1")] = 5
    C2: Annotated[int, Interval(ge=1, le=5), Unit("ms"), Doc("longest execution time of task 2")] = 4
    T2: Annotated[int, Interval(ge=7, le=20), Unit("ms"), Doc("period of task 2")] = 7
    C3: Annotated[int, Interval(ge=0, le=6), Unit("ms"), Doc("longest execution time of a third task; 0: there is none")] = 0
    ECET: Share = 50
    work: Work = "worst"
    at: Annotated[int, Interval(ge=0, le=SHOWN), Unit("ms"), View(play=True), Doc("a time to look at, under all policies")] = 0

    def tasks(self) -> list[PeriodicTask]:
        """What RM and EDF plan with, in microseconds."""
        rows = zip(TASKS, (self.C1, self.C2, self.C3), (self.T1, self.T2, T3), strict=True)
        return [PeriodicTask(name, c * MS, t * MS) for name, c, t in rows if c]

    def pairs(self) -> list[TaskPair]:
        """What TAFT plans with."""
        return [TaskPair(t.name, t.wcet * self.ECET // 100, EXCEPTION, t.period) for t in self.tasks()]

    def run(self) -> dict[str, History]:
        rng = np.random.default_rng(0)
        tasks = self.tasks()
        times = {t.name: draw(self.work, t.wcet, -(-HORIZON * MS // t.period), rng) for t in tasks}
        return {
            policy: History(simulate(self.pairs() if policy == "taft" else tasks, policy, HORIZON * MS, times, HZ))
            for policy in ("rm", "edf", "taft")
        }

    def figure(self, result: dict[str, History]) -> dict[str, Any]:
        titles = {
            "rm": "Rate monotonic: the shorter period first",
            "edf": "EDF: the earlier deadline first",
            "taft": "TAFT: expected times first, exception parts in time",
        }
        panels = [self._lanes(h, title=titles[policy], remark=self._first_miss(h)) for policy, h in result.items()]
        names = [task.name for task in self.tasks()]
        says = ". ".join(f"{policy.upper()}: {happening(history, names, self.at)}" for policy, history in result.items())
        return stack(
            *panels,
            height=440,
            shared=axis("time [ms]", range=[0, SHOWN]),
            keys=KEYS,
            at=self.at,
            says=f"At {self.at} ms. {says}.",
        )

    def _lanes(self, history: History, **more: Any) -> Panel:
        """One policy; a task that there is not has no lane."""
        lanes = len(self.tasks())
        panel = gantt(history, TASKS, 0, SHOWN, pairs=True, **more)
        return replace(panel, y={**panel.y, "range": [0.5 - lanes, 0.5]}, height=lanes)

    @staticmethod
    def _first_miss(history: History) -> str:
        if not len(history.misses):
            return ""
        task, _, deadline = history.misses[np.argmin(history.misses[:, 2])].tolist()
        return f"{history.trace.names[task]} misses its deadline at {deadline / MS:g} ms"

    def metrics(self, result: dict[str, History]) -> list[Metric]:
        tasks, pairs = self.tasks(), self.pairs()
        verdicts = {"RM": response_time_test(rate_monotonic(tasks)), "EDF": edf_utilization_test(tasks), "TAFT": taft_test(pairs)}
        found = [
            Metric("worst-case utilisation", 100 * float(utilization(tasks)), "%", note="sum of C / T"),
            Metric("expected utilisation", 100 * float(taft_utilization(pairs)), "%", note="sum of (ECET + EP) / T"),
        ]
        for (name, verdict), history in zip(verdicts.items(), result.values(), strict=True):
            missed = len(history.misses)
            found.append(
                Metric(
                    f"{name} missed in {HORIZON // 1000} s",
                    missed,
                    "deadlines",
                    good=not missed,
                    bound=0 if verdict.accepted else None,
                    note=f"analysis: {'accepted' if verdict.accepted else 'not accepted'}, {verdict.why}",
                )
            )
        taft = result["taft"].trace
        aborts = 100 * count(taft, "abort") / count(taft, "release")
        accepted = ", ".join(name for name, verdict in verdicts.items() if verdict.accepted)
        return [
            *found,
            Metric("TAFT aborted", aborts, "% of main parts"),
            Metric("accepted by analysis", accepted or "none"),
            Metric("who meets all deadlines", self._without_miss(result)),
        ]

    @staticmethod
    def _without_miss(result: dict[str, History]) -> str:
        return ", ".join(policy.upper() for policy, history in result.items() if not len(history.misses)) or "none"


@dataclass(frozen=True)
class Bounded:
    """A random task set with, per task in the same order, its bound (None: there is none) and its longest simulated response."""

    tasks: list[PeriodicTask]
    bound: list[int | None]
    longest: list[int]


class ResponseBounds(Experiment[Bounded]):
    """How close does a simulation come to what analysis promises?

    A random set of tasks (UUniFast, periods of 10 to 100 ms), simulated over ten of its longest periods, and the bound on each
    response time: of fixed-priority analysis for RM, of Spuri's for EDF.
    """

    policy: Annotated[Literal["rm", "edf"], Labels({"rm": "rate monotonic", "edf": "EDF"}), Doc("who runs first")] = "rm"
    tasks: Annotated[int, Interval(ge=2, le=7), Doc("number of tasks")] = 5
    utilization: Annotated[int, Interval(ge=30, le=95), MultipleOf(5), Unit("%"), Doc("sum of C / T")] = 75
    start: Annotated[
        Literal["together", "spread"], Labels({"together": "all at 0", "spread": "at random"}), Doc("first releases")
    ] = "together"
    least: Annotated[
        int, Interval(ge=10, le=100), MultipleOf(10), Unit("% of C"), Doc("the shortest a job takes; the longest is C")
    ] = 100
    seed: Annotated[int, Interval(ge=0, le=99), Doc("another task set, other times")] = 0

    def run(self) -> Bounded:
        rng = np.random.default_rng(self.seed)
        periods = log_uniform_periods(self.tasks, 1, 10, 100, rng)[0] * MS
        wcets = np.floor(uunifast(self.tasks, self.utilization / 100, 1, rng)[0] * periods).astype(np.int64).clip(1)
        offsets = (rng.random(self.tasks) * periods).astype(np.int64) * (self.start == "spread")
        order = np.argsort(periods, kind="stable")
        tasks = [
            PeriodicTask(f"{i}", int(wcets[k]), int(periods[k]), offset=int(offsets[k])) for i, k in enumerate(order, start=1)
        ]
        until = 10 * int(periods.max())
        times = {
            t.name: rng.integers(-(-t.wcet * self.least // 100), t.wcet, until // t.period + 1, endpoint=True) for t in tasks
        }
        bound = response_times(tasks) if self.policy == "rm" else edf_response_times(tasks)
        found = jobs(simulate(tasks, self.policy, until, times, HZ))
        longest = [int(found.response[found.task == i].max(initial=0)) for i in range(len(tasks))]
        return Bounded(tasks, [bound[t.name] for t in tasks], longest)

    def figure(self, result: Bounded) -> dict[str, Any]:
        rows = [
            Response(f"T = {t.period / MS:g} ms", None if bound is None else bound / MS, longest / MS, t.deadline / MS)
            for t, bound, longest in zip(result.tasks, result.bound, result.longest, strict=True)
        ]
        return responses(rows)

    def metrics(self, result: Bounded) -> list[Metric]:
        ratios = [100 * longest / bound for bound, longest in zip(result.bound, result.longest, strict=True) if bound]
        late = sum(b is None or b > t.deadline for t, b in zip(result.tasks, result.bound, strict=True))
        return [
            Metric("closest to its bound", max(ratios) if ratios else None, "%", bound=100 if ratios else None),
            Metric("furthest from its bound", min(ratios) if ratios else None, "%", bound=100 if ratios else None),
            Metric("tasks whose bound is late", late, good=not late, note="bound above the deadline, or none"),
            Metric(
                "tasks late in the simulation",
                sum(r > t.deadline for t, r in zip(result.tasks, result.longest, strict=True)),
                bound=late,
            ),
        ]


class StarvedPair(Experiment[Trace]):
    """Is a sum of (ECET + EP) / T up to 1 enough for TAFT?

    Two task pairs whose main parts never come to an end by themselves, so that every job is aborted and every exception part runs
    where it was planned. With the start values the sum is 0.945, and yet a main part gets nothing at all.
    """

    ECET1: Annotated[int, Interval(ge=1, le=3), Unit("ms"), Doc("expected time of task 1")] = 1
    EP1: Annotated[int, Interval(ge=0, le=2), Unit("ms"), Doc("exception part of task 1")] = 1
    T1: Annotated[int, Interval(ge=5, le=12), Unit("ms"), Doc("period of task 1")] = 5
    ECET2: Annotated[int, Interval(ge=1, le=4), Unit("ms"), Doc("expected time of task 2")] = 1
    EP2: Annotated[int, Interval(ge=0, le=6), Unit("ms"), Doc("exception part of task 2")] = 5
    T2: Annotated[int, Interval(ge=10, le=30), Unit("ms"), Doc("period of task 2")] = 11
    at: Annotated[int, Interval(ge=0, le=SHOWN), Unit("ms"), View(play=True), Doc("a time to look at")] = 0

    def pairs(self) -> list[TaskPair]:
        """The two pairs, in ms."""
        return [TaskPair("task 1", self.ECET1, self.EP1, self.T1), TaskPair("task 2", self.ECET2, self.EP2, self.T2)]

    def run(self) -> Trace:
        until = 2 * self.T1 * self.T2  # every position of the periods to each other, twice
        return simulate(self.pairs(), "taft", until, {"task 1": [until], "task 2": [until]})

    def shares(self, trace: Trace) -> list[tuple[int, str, int]]:
        """(abort, task, main time granted until then) of every job aborted, in ms."""
        table = jobs(trace)
        aborted = np.flatnonzero(table.abort >= 0)
        found = zip(table.abort[aborted].tolist(), table.task[aborted].tolist(), table.main[aborted].tolist(), strict=True)
        return sorted((time, trace.names[task], main) for time, task, main in found)

    def starved(self, trace: Trace) -> list[tuple[int, str, int]]:
        """Those of them with less than their expected time."""
        ecet = {p.name: p.ecet for p in self.pairs()}
        return [(time, name, got) for time, name, got in self.shares(trace) if got < ecet[name]]

    def figure(self, result: Trace) -> dict[str, Any]:
        hungry = self.starved(result)
        ecet = {p.name: p.ecet for p in self.pairs()}
        time, name, got = hungry[0] if hungry else (0, "", 0)
        remark = f"{name}, aborted at {time} ms, had {got} of its {ecet[name]} ms" if hungry else ""
        title = "TAFT when every main part takes too long"
        panel = gantt(result, ("task 1", "task 2"), 0, SHOWN, title=title, remark=remark, pairs=True)
        return stack(
            panel,
            height=330,
            shared=axis("time [ms]", range=[0, SHOWN]),
            keys=KEYS,
            at=self.at,
            says=f"At {self.at} ms. {happening(result, TASKS[:2], self.at)}.",
        )

    def metrics(self, result: Trace) -> list[Metric]:
        pairs, verdict = self.pairs(), taft_test(self.pairs())
        used, hungry = float(taft_utilization(pairs)), self.starved(result)
        missed = misses(result)
        return [
            Metric("sum of (ECET + EP) / T", used, good=used <= 1, note="necessary; not sufficient"),
            Metric("accepted by the safe test", verdict.accepted, good=verdict.accepted, note=f"{verdict.test}: {verdict.why}"),
            Metric(
                "main parts short of their ECET",
                len(hungry),
                f"of {count(result, 'abort')}",
                good=not hungry,
                bound=0 if verdict.accepted else None,
            ),
            Metric("deadlines missed", missed, good=not missed, bound=0 if verdict.accepted else None),
        ]


def check_rm_misses(answer: Schedules) -> Feedback:
    """Exercise 1: RM misses, EDF does not, with a worst-case utilisation of at most 92 %."""
    wrong = refused(answer, Schedules(), "C1", "T1", "C2", "T2", "C3", "ECET")
    if wrong:
        return wrong
    load, result = 100 * float(utilization(answer.tasks())), answer.run()
    rm, edf = (len(result[policy].misses) for policy in ("rm", "edf"))
    told = f"utilisation {load:.1f} %, {rm} misses under RM, {edf} under EDF"
    if edf or not rm:
        return Feedback(False, f"{told}; RM is to miss and EDF not.")
    return Feedback(load <= 92, f"{told}{'' if load <= 92 else '; find a set of at most 92 %'}.")


def check_beyond_the_bounds(tasks: Iterable[PeriodicTask]) -> Feedback:
    """Exercise 2: three tasks with a utilisation of at least 97 % that neither bound accepts and RM schedules."""
    given = list(tasks) if isinstance(tasks, Iterable) else [tasks]
    if not all(isinstance(task, PeriodicTask) for task in given):
        return Feedback(False, f'the answer is {shown(tasks)}; give a list of tasks like [PeriodicTask("a", 2, 5), ...].')
    if len({task.name for task in given}) < len(given):
        return Feedback(False, "two tasks have the same name.")
    tasks = rate_monotonic(given)
    load = 100 * float(utilization(tasks))
    if len(tasks) != 3 or load < 97:
        return Feedback(False, f"{len(tasks)} tasks with a utilisation of {load:.1f} %; give three with 97 % or more.")
    accepting = [v.test for v in (liu_layland_test(tasks), hyperbolic_test(tasks)) if v.accepted]
    if accepting:
        return Feedback(False, f"{' and '.join(accepting)} accept it.")
    exact = response_time_test(tasks)
    return Feedback(
        exact.accepted,
        f"{load:.1f} %; both bounds reject it, and exact analysis {'accepts it' if exact.accepted else 'too'}: {exact.why}.",
    )


def check_fed_pair(answer: StarvedPair) -> Feedback:
    """Exercise 4: the longest exception part of task 2 with which nobody starves, all else as given."""
    wrong = refused(answer, StarvedPair(), "EP2")
    if wrong:
        return wrong
    hungry = len(answer.starved(answer.run()))
    if hungry or not taft_test(answer.pairs()).accepted:
        return Feedback(
            False, f"with an exception part of {answer.EP2} ms {hungry} main parts get less than their expected time."
        )
    longer = next((StarvedPair(EP2=ms) for ms in [answer.EP2 + 1] if ms <= 6), None)
    more = longer is not None and taft_test(longer.pairs()).accepted
    return Feedback(not more, f"{answer.EP2} ms is safe{', but so is 1 ms more' if more else ', and 1 ms more is not'}.")
