"""Notebook 01: a high task waits for a low one while a middle one runs, and what each protocol makes of it (source 1, 2.1.1)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import refused
from labkit.experiments.contest import KEYS, Contest, inversions
from labkit.figures import Panel, axis, held, lock_keys, stack
from labkit.kernel import Kernel, Run
from labkit.scheduler import CriticalSection, PeriodicTask, blocking_bounds

PROTOCOLS = {
    "freertos": "FreeRTOS's inheritance",
    "inheritance": "textbook inheritance",
    "ceiling": "immediate ceiling",
    "none": "no protocol",
}
Protocol = Annotated[
    Literal["freertos", "inheritance", "ceiling", "none"],
    Labels(PROTOCOLS),
    Doc("what the lock of the lower timeline does about priorities"),
]

BASE = {"H": 3, "M": 2, "L": 1}
H_BEFORE, H_INSIDE, H_AFTER, L_AFTER = 1, 3, 1, 2  # ms of work before, inside and after the critical section


class PriorityInversion(Experiment[tuple[Contest, Contest]]):
    """How long does the highest task wait for the lowest?

    L takes a lock; H wants it; M, in the middle, has nothing to do with it. Above: the lock is a binary semaphore.
    Below: a mutex with the protocol chosen. The start values are the scenario recorded from the real kernel.
    """

    headline: ClassVar[tuple[str, ...]] = ("H blocked, semaphore", "H blocked, mutex", "M runs while H waits, semaphore")

    hold: Annotated[int, Interval(ge=1, le=15), Unit("ms"), Doc("work of L while it holds the lock")] = 6
    interference: Annotated[int, Interval(ge=0, le=25), Unit("ms"), Doc("work of M, which does not use the lock")] = 10
    release_H: Annotated[int, Interval(ge=0, le=20), Unit("ms"), Doc("when H starts")] = 3
    release_M: Annotated[int, Interval(ge=0, le=20), Unit("ms"), Doc("when M starts")] = 5
    protocol: Protocol = "freertos"
    at: Annotated[int, Interval(ge=0, le=70), Unit("ms"), View(play=True), Doc("a time to look at, in both runs")] = 0

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
        semaphore, mutex = self.simulate("semaphore"), self.simulate(self.protocol)
        return self.seen_from_high(semaphore), self.seen_from_high(mutex)

    def seen_from_high(self, run: Run) -> Contest:
        """How long H waited in a run, and when its priority and M's were turned round."""
        return Contest.of(run, "H", self.release_H, inversions(run.trace, BASE))

    def figure(self, result: tuple[Contest, Contest]) -> dict[str, Any]:
        titles = ("Binary semaphore: no owner, no inheritance", f"Mutex: {PROTOCOLS[self.protocol]}")
        panels: list[Panel] = []
        for title, contest in zip(titles, result, strict=True):
            words = f"{contest.response:g} ms, {contest.blocked:g} ms blocked"
            panels += contest.panels(title, BASE, ("S",), self.horizon(), words)
        says = ". ".join(
            f"{name}: {contest.doing(BASE, self.at)}" for name, contest in zip(("Semaphore", "Mutex"), result, strict=True)
        )
        return stack(
            *panels,
            height=480,
            shared=axis("time [ms]", range=[0, held(self.horizon())]),
            keys=(*KEYS, *lock_keys(("S",)), "priority inversion"),
            at=self.at,
            says=f"At {self.at} ms. {says}.",
        )

    def metrics(self, result: tuple[Contest, Contest]) -> list[Metric]:
        found = []
        kept = {
            "semaphore": "the bound is the critical section of L and all the work of M",
            "mutex": "with a protocol the bound is the longest critical section of a lower task",
        }
        for lock, contest, protocol in zip(kept, result, ("semaphore", self.protocol), strict=True):
            fine = not contest.wrong_ms  # within its bound or not: H must never wait while M runs
            found.append(
                Metric(f"H blocked, {lock}", contest.blocked, "ms", bound=self.bound(protocol), good=fine, note=kept[lock])
            )
        semaphore, mutex = result
        found += [
            Metric(f"M runs while H waits, {lock}", contest.wrong_ms, "ms", good=not contest.wrong_ms, note="priority inversion")
            for lock, contest in zip(kept, result, strict=True)
        ]
        return [*found, Metric("saved by the protocol", semaphore.blocked - mutex.blocked, "ms")]


# Exercises: each asks the model


def check_harmless_inversion(answer: PriorityInversion) -> Feedback:
    """Exercise 1: H and M compete with L, and still the semaphore costs H nothing. The releases only are to be moved."""
    wrong = refused(answer, PriorityInversion(), "release_H", "release_M")
    if wrong:
        return wrong
    semaphore, _ = answer.run()
    trace = semaphore.run.trace
    ms = trace.hz // 1000
    taken = next(time for time, _, who, *_ in trace.rows("take").tolist() if trace.names[who] == "L") / ms
    ended = max(time for time, _, who, *_ in trace.rows("done").tolist() if trace.names[who] != "H") / ms
    if not taken < answer.release_H < ended:
        return Feedback(
            False,
            f"H starts at {answer.release_H} ms, L takes the lock at {taken:g} ms, and L and M are through at {ended:g} ms; "
            "let H start between these.",
        )
    return Feedback(semaphore.blocked == 0, f"with the semaphore H is blocked for {semaphore.blocked:g} ms; it should be 0.")


def check_bound_reached(answer: PriorityInversion) -> Feedback:
    """Exercise 2: releases at which the blocking under FreeRTOS's mutex is within 1 ms of its bound."""
    wrong = refused(answer, PriorityInversion(), "release_H", "release_M")
    if wrong:
        return wrong
    blocked, bound = answer.run()[1].blocked, answer.bound("freertos")
    return Feedback(
        bound - blocked <= 1, f"H is blocked for {blocked:g} ms, the bound is {bound} ms; at most 1 ms may be missing."
    )
