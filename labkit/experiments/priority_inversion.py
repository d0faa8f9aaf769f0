"""Notebook 01: a high task waits for a low one while a middle one runs, and what each protocol makes of it (source 1, 2.1.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.figures import Panel, axis, gantt, happening, held, priorities, stack
from labkit.kernel import Kernel, Run
from labkit.scheduler import CriticalSection, PeriodicTask, blocking_bounds
from labkit.trace import runs

PROTOCOLS = {
    "freertos": "mutex, FreeRTOS's inheritance",
    "inheritance": "mutex, textbook inheritance",
    "ceiling": "mutex, immediate priority ceiling",
    "none": "mutex without any protocol",
}
Protocol = Annotated[
    Literal["freertos", "inheritance", "ceiling", "none"],
    Labels(PROTOCOLS),
    Doc("what the lock of the lower timeline does about priorities"),
]

BASE = {"H": 3, "M": 2, "L": 1}
KEYS = ("ready", "waits for lock, queue, signal", "holds lock", "release")
H_BEFORE, H_INSIDE, H_AFTER, L_AFTER = 1, 3, 1, 2  # ms of work before, inside and after the critical section


@dataclass(frozen=True)
class Contest:
    """One run of the three tasks, seen from one of them. Times in ms.

    Attributes:
        run: the simulation.
        task: the one looked at; it has one job.
        end: when that was done, in cycles.
        response: from its release to its end.
        blocked: the part of it in which it did not run. Of the highest task all of that is blocking.
    """

    run: Run
    task: str
    end: int
    response: float
    blocked: float

    @classmethod
    def of(cls, run: Run, task: str, release_ms: int) -> Contest:
        """Read a run that goes on until everybody has ended."""
        trace = run.trace
        code, ms = trace.code(task), trace.hz // 1000
        end = next(time for time, _, who, *_ in trace.rows("done").tolist() if who == code)
        ran = sum(stop - start for who, start, stop in runs(trace).tolist() if who == code)
        response = end - release_ms * ms
        return cls(run, task, end, response / ms, (response - ran) / ms)

    def panels(self, title: str, base: Mapping[str, int], locks: Sequence[str], end: float, words: str) -> tuple[Panel, Panel]:
        """Who ran, above the priorities; `words` stand where the task has ended."""
        rows = gantt(self.run.trace, tuple(base), 0, end, title=title, locks=locks, remarks=[(self.end, self.task, words)])
        return rows, priorities(self.run.trace, base, height=2.1)


class PriorityInversion(Experiment[tuple[Contest, Contest]]):
    """How long does the highest task wait for the lowest?

    L takes a lock; H wants it; M, in the middle, has nothing to do with it. Above: the lock is a binary semaphore.
    Below: a mutex with the protocol chosen. The start values are the scenario recorded from the real kernel.
    """

    hold: Annotated[int, Interval(ge=1, le=15), Unit("ms"), Doc("work of L while it holds the lock")] = 6
    interference: Annotated[int, Interval(ge=0, le=25), Unit("ms"), Doc("work of M, which does not use the lock")] = 10
    release_H: Annotated[int, Interval(ge=0, le=20), Unit("ms"), Doc("when H starts")] = 3
    release_M: Annotated[int, Interval(ge=0, le=20), Unit("ms"), Doc("when M starts")] = 5
    protocol: Protocol = "freertos"
    at: Annotated[int, Interval(ge=0, le=80), Unit("ms"), View(play=True), Doc("a time to look at, in both runs")] = 0

    def simulate(self, protocol: str) -> Run:
        """One run under a protocol; "semaphore" is a binary semaphore, which has no owner and so no protocol."""
        k = Kernel()
        lock = (
            k.binary("S", init=1)
            if protocol == "semaphore"
            else k.mutex("S", protocol, users=("L", "H") if protocol == "ceiling" else ())
        )

        def low(os: Any) -> Any:
            yield os.take(lock)
            yield os.compute(self.hold * os.ms)
            yield os.give(lock)
            yield os.compute(L_AFTER * os.ms)

        def middle(os: Any) -> Any:
            if self.release_M:
                yield os.delay_until(self.release_M)
            yield os.compute(self.interference * os.ms)

        def high(os: Any) -> Any:
            if self.release_H:
                yield os.delay_until(self.release_H)
            yield os.compute(H_BEFORE * os.ms)
            yield os.take(lock)
            yield os.compute(H_INSIDE * os.ms)
            yield os.give(lock)
            yield os.compute(H_AFTER * os.ms)

        for name, body in (("L", low), ("M", middle), ("H", high)):
            k.task(name, body, BASE[name])
        return k.run(until=self.horizon() * k.ms)

    def horizon(self) -> int:
        """Length of the run in ms: whatever the order, everybody has ended."""
        work = H_BEFORE + H_INSIDE + H_AFTER + self.hold + L_AFTER + self.interference
        return max(self.release_H, self.release_M) + work + 2

    def bound(self, protocol: str) -> int:
        """The analytical bound on H's blocking in ms, whatever the releases."""
        never = 10 * self.horizon()  # every task has one job, so its period is longer than anything here
        tasks = [
            PeriodicTask("H", H_BEFORE + H_INSIDE + H_AFTER, never),
            *([PeriodicTask("M", self.interference, never)] if self.interference else []),
            PeriodicTask("L", self.hold + L_AFTER, never),
        ]
        sections = [CriticalSection("H", "S", H_INSIDE), CriticalSection("L", "S", self.hold)]
        bound = blocking_bounds(tasks, sections, "none" if protocol == "semaphore" else protocol)["H"]
        assert bound is not None, "everybody has one job, so there is a bound"
        return bound

    def run(self) -> tuple[Contest, Contest]:
        semaphore, mutex = (Contest.of(self.simulate(p), "H", self.release_H) for p in ("semaphore", self.protocol))
        return semaphore, mutex

    def figure(self, result: tuple[Contest, Contest]) -> dict[str, Any]:
        titles = (
            "Binary semaphore: no owner, no inheritance",
            PROTOCOLS[self.protocol].capitalize().replace("freertos", "FreeRTOS"),
        )
        panels: list[Panel] = []
        for title, contest in zip(titles, result, strict=True):
            words = f"{contest.response:g} ms, {contest.blocked:g} ms blocked"
            panels += contest.panels(title, BASE, ("S",), self.horizon(), words)
        shared = axis("time [ms]", range=[0, held(self.horizon())])
        says = ". ".join(
            f"{name}: {happening(contest.run.trace, tuple(BASE), self.at)}"
            for name, contest in zip(("Semaphore", "Mutex"), result, strict=True)
        )
        return stack(*panels, height=520, shared=shared, keys=KEYS, at=self.at, says=f"At {self.at} ms. {says}.")

    def metrics(self, result: tuple[Contest, Contest]) -> list[Metric]:
        semaphore, mutex = result
        loose, tight = self.bound("semaphore"), self.bound(self.protocol)
        return [
            Metric(
                "H blocked, semaphore",
                semaphore.blocked,
                "ms",
                bound=loose,
                good=semaphore.blocked <= loose,
                note="H waits for L, and L waits for M: the bound is the critical section of L and all the work of M",
            ),
            Metric(
                "H blocked, mutex",
                mutex.blocked,
                "ms",
                bound=tight,
                good=mutex.blocked <= tight,
                note="with a protocol the bound is the longest critical section of a lower task",
            ),
            Metric("saved by the protocol", semaphore.blocked - mutex.blocked, "ms"),
        ]


class NestedMutexes(Experiment[dict[str, Contest]]):
    """When does FreeRTOS take an inherited priority back?

    L holds two mutexes, A and B; H wants A only. Above: FreeRTOS, which lets L drop only when it holds no mutex at all.
    Below: textbook inheritance, which drops as soon as nobody waits for what L still holds.
    """

    both: Annotated[int, Interval(ge=1, le=10), Unit("ms"), Doc("work of L while it holds A and B")] = 5
    second: Annotated[int, Interval(ge=1, le=15), Unit("ms"), Doc("work of L between its first and its second give")] = 8
    first_given: Annotated[
        Literal["A", "B"],
        Labels({"A": "A, the one H waits for", "B": "B, which nobody wants"}),
        Doc("which mutex L gives back first"),
    ] = "A"
    release_H: Annotated[int, Interval(ge=0, le=12), Unit("ms"), Doc("when H starts")] = 2
    release_M: Annotated[int, Interval(ge=0, le=12), Unit("ms"), Doc("when M starts")] = 4

    def simulate(self, protocol: str) -> Run:
        """One run under a protocol of `Kernel.mutex`."""
        k = Kernel()
        a, b = k.mutex("A", protocol), k.mutex("B", protocol)
        first, last = (a, b) if self.first_given == "A" else (b, a)

        def low(os: Any) -> Any:
            yield os.take(a)
            yield os.take(b)
            yield os.compute(self.both * os.ms)
            yield os.give(first)
            yield os.compute(self.second * os.ms)
            yield os.give(last)
            yield os.compute(2 * os.ms)

        def middle(os: Any) -> Any:
            if self.release_M:
                yield os.delay_until(self.release_M)
            yield os.compute(4 * os.ms)

        def high(os: Any) -> Any:
            if self.release_H:
                yield os.delay_until(self.release_H)
            yield os.take(a)
            yield os.compute(3 * os.ms)
            yield os.give(a)

        for name, body in (("L", low), ("M", middle), ("H", high)):
            k.task(name, body, BASE[name])
        return k.run(until=self.horizon() * k.ms)

    def horizon(self) -> int:
        """Length of the run in ms: everybody has ended."""
        return max(self.release_H, self.release_M) + self.both + self.second + 2 + 4 + 3 + 1

    def run(self) -> dict[str, Contest]:
        return {p: Contest.of(self.simulate(p), "M", self.release_M) for p in ("freertos", "inheritance")}

    def figure(self, result: dict[str, Contest]) -> dict[str, Any]:
        titles = ("FreeRTOS: L drops at its last give", "Textbook inheritance: L drops when nobody waits")
        panels: list[Panel] = []
        for title, contest in zip(titles, result.values(), strict=True):
            panels += contest.panels(title, BASE, ("A", "B"), self.horizon(), f"responds after {contest.response:g} ms")
        return stack(*panels, height=690, shared=axis("time [ms]", range=[0, self.horizon()]), keys=KEYS)

    def metrics(self, result: dict[str, Contest]) -> list[Metric]:
        ours, textbook = result["freertos"], result["inheritance"]
        high = {p: Contest.of(c.run, "H", self.release_H).response for p, c in result.items()}
        return [
            Metric("response of M, FreeRTOS", ours.response, "ms"),
            Metric("response of M, textbook", textbook.response, "ms"),
            Metric(
                "M delayed by the late drop", ours.response - textbook.response, "ms", good=ours.response <= textbook.response
            ),
            Metric("response of H, FreeRTOS", high["freertos"], "ms"),
            Metric(
                "response of H, textbook",
                high["inheritance"],
                "ms",
                note="H has the same priority as L until L drops: they share the CPU tick by tick",
            ),
        ]


FRAME, FRAMES = 125, 12  # ms, the 8 Hz cycle of the 1553 bus; cycles simulated
END = FRAMES * FRAME + 20  # ms


class MarsPathfinder(Experiment[dict[str, Run]]):
    """Why did the lander keep resetting itself on Mars?

    Every 125 ms `bc_sched` sets up the next bus cycle and checks that `bc_dist` has distributed the data of the last one; if
    not, the spacecraft resets. `bc_dist` and the low weather task `ASI_MET` share a mutex inside select(); communication runs in
    between. Above: inheritance off, as flown. Below: on, as patched in July 1997. The order of the tasks, the 8 Hz cycle and
    the cause are Reeves's ("What really happened on Mars", 1997); the durations are not published and are parameters here.
    """

    weather_hold: Annotated[int, Interval(ge=1, le=30), Unit("ms"), Doc("time ASI_MET holds the mutex")] = 10
    comm_work: Annotated[int, Interval(ge=0, le=120), Unit("ms"), Doc("work of the communication task in each of its jobs")] = 50
    comm_period: Annotated[int, Interval(ge=200, le=700), Unit("ms"), Doc("period of the communication task")] = 255
    weather_period: Annotated[int, Interval(ge=150, le=700), Unit("ms"), Doc("period of the weather task")] = 170

    def simulate(self, protocol: str) -> Run:
        """Twelve bus cycles; `mark` rows of bc_sched are the resets it would have made."""
        k = Kernel()
        pipe = k.mutex("select", protocol)
        done = {"cycle": 0}

        def bc_sched(os: Any) -> Any:
            for cycle in range(1, FRAMES + 1):
                yield os.compute(2 * os.ms)
                yield os.delay_until(FRAME)
                if done["cycle"] < cycle:
                    yield os.mark(cycle)
                    done["cycle"] = cycle  # the model goes on as if nothing had happened, to count the next one

        def bc_dist(os: Any) -> Any:
            yield os.delay_until(60)  # the bus is busy with the transfers in the first half of the cycle
            while True:
                yield os.compute(4 * os.ms)
                yield os.take(pipe)
                yield os.compute(5 * os.ms)
                yield os.give(pipe)
                yield os.compute(4 * os.ms)
                done["cycle"] += 1
                yield os.delay_until(FRAME)

        def comm(os: Any) -> Any:
            yield os.delay_until(52)
            while True:
                yield os.compute(self.comm_work * os.ms)
                yield os.delay_until(self.comm_period)

        def asi_met(os: Any) -> Any:
            yield os.delay_until(48)
            while True:
                yield os.take(pipe)
                yield os.compute(self.weather_hold * os.ms)
                yield os.give(pipe)
                yield os.compute(3 * os.ms)
                yield os.delay_until(self.weather_period)

        for name, body in (("ASI_MET", asi_met), ("comm", comm), ("bc_dist", bc_dist), ("bc_sched", bc_sched)):
            k.task(name, body, PATHFINDER[name])
        return k.run(until=END * k.ms)

    def run(self) -> dict[str, Run]:
        return {"off": self.simulate("none"), "on": self.simulate("freertos")}

    @staticmethod
    def resets(run: Run) -> list[float]:
        """Times in ms at which the check failed."""
        return (run.trace.rows("mark")[:, 0] * (1e3 / run.trace.hz)).tolist()

    def figure(self, result: dict[str, Run]) -> dict[str, Any]:
        panels = []
        for title, run in (("Inheritance off, as flown", result["off"]), ("Inheritance on, as patched", result["on"])):
            resets = run.trace.rows("mark")[:, 0].tolist()
            verdict = f"first reset at {self.resets(run)[0]:g} ms" if resets else "no reset"
            rows = gantt(run.trace, tuple(PATHFINDER), 0, END, title=f"{title}: {verdict}", locks=("select",), alarms=resets)
            panels += [rows, priorities(run.trace, PATHFINDER, height=2.6)]
        return stack(*panels, height=720, shared=axis("time [ms]", range=[0, END]), keys=KEYS)

    def metrics(self, result: dict[str, Run]) -> list[Metric]:
        off, on = (self.resets(result[key]) for key in ("off", "on"))
        cycles = f"of {FRAMES} cycles"
        return [
            Metric("resets, inheritance off", len(off), cycles, good=not off),
            Metric("resets, inheritance on", len(on), cycles, good=not on),
            Metric("first reset, inheritance off", off[0] if off else None, "ms", note="none happened" if not off else ""),
        ]


PATHFINDER = {"bc_sched": 4, "bc_dist": 3, "comm": 2, "ASI_MET": 1}


# Exercises: each asks the model


def check_harmless_inversion(answer: PriorityInversion) -> Feedback:
    """Exercise 1: releases at which the semaphore costs H nothing, with 10 ms or more of M and L holding 6 ms or more."""
    if answer.interference < 10 or answer.hold < 6:
        return Feedback(
            False, "keep hold at 6 ms or more and interference at 10 ms or more; only the releases are yours to move."
        )
    blocked = answer.run()[0].blocked
    return Feedback(blocked == 0, f"with the semaphore H is blocked for {blocked:g} ms; it should be 0.")


def check_bound_reached(answer: PriorityInversion) -> Feedback:
    """Exercise 2: a setting in which the measured blocking under FreeRTOS's mutex is within 1 ms of its bound."""
    if answer.protocol != "freertos":
        return Feedback(False, "choose protocol='freertos'.")
    blocked, bound = answer.run()[1].blocked, answer.bound("freertos")
    return Feedback(
        bound - blocked <= 1, f"H is blocked for {blocked:g} ms, the bound is {bound} ms; at most 1 ms may be missing."
    )


def check_prompt_middle(answer: NestedMutexes) -> Feedback:
    """Exercise 3: keep L's work, but let M answer under FreeRTOS as early as under the textbook's protocol."""
    start = NestedMutexes()
    if (answer.both, answer.second, answer.release_H, answer.release_M) != (
        start.both,
        start.second,
        start.release_H,
        start.release_M,
    ):
        return Feedback(False, "change the order of the gives only; work and releases stay as they are.")
    late = answer.measure("M delayed by the late drop")
    return Feedback(late <= 0, f"the late drop costs M {late:g} ms.")
