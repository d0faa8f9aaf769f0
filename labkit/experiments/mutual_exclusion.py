"""Notebook 01: critical section, suspended scheduler or mutex, and whom each of them keeps waiting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View
from labkit.experiments.contest import KEYS, Contest
from labkit.figures import INK, Panel, axis, gantt, held, key, lock_keys, stack
from labkit.kernel import Kernel, Run
from labkit.scheduler import CriticalSection, HeldSection, PeriodicTask, blocking_bounds, response_times

#: How the data are kept for one task alone, as the metrics call it, and as the picture does.
WAYS = {
    "critical section": "Critical section: ticks, interrupts and switches are held",
    "suspended": "Suspended scheduler: ticks and switches are held, interrupts are not",
    "mutex": "Mutex: only who wants the data is held",
}
BASE = {"H": 3, "S": 2, "L": 1}
L_BEFORE, L_AFTER, H_WORK, S_INSIDE = 500, 1000, 1000, 1000  # us

COMES: dict[str, Any] = {"symbol": "triangle-down", "size": 13, "color": INK}
SERVED: dict[str, Any] = {"symbol": "triangle-down-open", "size": 13, "color": INK, "line": {"width": 2.5}}


@dataclass(frozen=True)
class Way:
    """What one way to exclude the others has led to; times in ms, stretches in cycles.

    Attributes:
        high: the run, seen from H, which has nothing to do with the data, from the interrupt for it.
        sharing: the same, seen from S, which wants them, from its release.
        handled: when the interrupt was let in.
        lost: ticks that the kernel never counted.
    """

    high: Contest
    sharing: Contest
    handled: float
    lost: int


class MutualExclusion(Experiment[dict[str, Way]]):
    """Who waits while one task has the data for itself?

    L and S use the same data, H does not: it waits for a device's interrupt. Three times the same tasks: L and S exclude each
    other by a critical section, by suspending the scheduler, and by a mutex that inherits. The kernel itself takes no time.
    """

    headline: ClassVar[tuple[str, ...]] = tuple(f"H waits, {way}" for way in WAYS)

    section: Annotated[int, Interval(ge=1, le=9), Unit("ms"), Doc("work of L while it has the data for itself")] = 5
    interrupt: Annotated[int, Interval(ge=0, le=10), Unit("ms"), Doc("when the device interrupts for H")] = 2
    release_S: Annotated[int, Interval(ge=0, le=8), Unit("ms"), Doc("when S is released by a tick")] = 4
    at: Annotated[int, Interval(ge=0, le=22), Unit("ms"), View(play=True), Doc("a time to look at, in all runs")] = 0

    def simulate(self, way: str) -> Run:
        """One run, in which the data are kept in one of the WAYS."""
        k = Kernel()
        lock, signal = k.mutex("data"), k.binary("signal")

        def alone(os: Any, cycles: int) -> Any:
            yield {"critical section": os.enter_critical(), "suspended": os.suspend_all(), "mutex": os.take(lock)}[way]
            yield os.compute(cycles)
            yield {"critical section": os.exit_critical(), "suspended": os.resume_all(), "mutex": os.give(lock)}[way]

        def low(os: Any) -> Any:
            yield os.compute(L_BEFORE * os.us)
            yield from alone(os, self.section * os.ms)
            yield os.compute(L_AFTER * os.us)

        def sharing(os: Any) -> Any:
            if self.release_S:
                yield os.delay_until(self.release_S)
            yield from alone(os, S_INSIDE * os.us)

        def high(os: Any) -> Any:
            yield os.take(signal)
            yield os.compute(H_WORK * os.us)

        for name, body in (("L", low), ("S", sharing), ("H", high)):
            k.task(name, body, BASE[name])
        k.interrupt(self.interrupt * k.ms, lambda isr: isr.give(signal))
        return k.run(until=self.horizon() * k.ms)

    def horizon(self) -> int:
        """Length of the run in ms: whatever the way, everybody has ended, S after the ticks that L's section has cost it."""
        return max(self.interrupt, self.release_S) + self.section + 3

    def bounds(self, way: str) -> tuple[int, int | None]:
        """The most that H and S can wait in ms, whatever the releases; None for S where lost ticks put its release off."""
        never = 1_000_000  # us: every task has one job
        work = {"H": H_WORK, "S": S_INSIDE, "L": L_BEFORE + self.section * 1000 + L_AFTER}
        tasks = [PeriodicTask(name, wcet, never) for name, wcet in work.items()]
        inside = {"S": S_INSIDE, "L": self.section * 1000}
        masked = [HeldSection(name, length) for name, length in inside.items()] if way != "mutex" else []
        locked = [CriticalSection(name, "data", length) for name, length in inside.items()] if way == "mutex" else []
        blocking = blocking_bounds(tasks, locked, "freertos", masked)
        waits = {
            name: None if response is None else (response - work[name]) // 1000
            for name, response in response_times(tasks, blocking=blocking).items()
        }
        assert waits["H"] is not None, "everybody has one job, so there is a bound"
        return waits["H"], None if way == "critical section" else waits["S"]

    def run(self) -> dict[str, Way]:
        return {way: self.seen(self.simulate(way)) for way in WAYS}

    def seen(self, run: Run) -> Way:
        """Who waited how long in a run, and when nobody but the one with the data could run."""
        trace = run.trace
        edges = trace.rows("enter_critical", "exit_critical", "suspend_all", "resume_all")[:, 0]
        alone = edges.reshape(-1, 2)  # no two of them overlap: nobody runs who could begin another
        high, sharing = (
            Contest.of(run, "H", self.interrupt, alone),
            Contest.of(run, "S", self.release_S, np.empty((0, 2), np.int64)),
        )
        handled = trace.rows("isr")[0, 0] * 1e3 / trace.hz
        return Way(high, sharing, float(handled), len(trace.rows("tick_lost")))

    def figure(self, result: dict[str, Way]) -> dict[str, Any]:
        panels = [self.panel(title, result[way]) for way, title in WAYS.items()]
        says = ". ".join(f"{way.capitalize()}: {seen.high.doing(BASE, self.at)}" for way, seen in result.items())
        return stack(
            *panels,
            height=480,
            shared=axis("time [ms]", range=[0, self.end()]),
            keys=(
                *KEYS[:2],
                "everybody else is held",
                *lock_keys(("data",)),
                key("interrupt comes", type="scatter", mode="markers", marker=COMES),
                key("is let in", type="scatter", mode="markers", marker=SERVED),
            ),
            at=self.at,
            says=f"At {self.at} ms. {says}.",
        )

    def end(self) -> float:
        """Of the time axis, in ms: behind the end of S there is room for what is said of it."""
        return held(1.2 * self.horizon())

    def panel(self, title: str, seen: Way) -> Panel:
        """Who ran, and the interrupt above the row of H."""
        found = seen.high
        remarks = [(who.end, who.task, f"{who.task} has waited {who.blocked:g} ms") for who in (found, seen.sharing)]
        bands = [(start, stop) for start, stop in found.wrong.tolist()]
        rows = gantt(found.history, tuple(BASE), 0, self.end(), title=title, locks=("data",), remarks=remarks, bands=bands)
        comes, let_in = (
            {
                "type": "scatter",
                "mode": "markers",
                "x": np.array([time]),
                "y": np.array([0.3]),
                "marker": marker,
                "cliponaxis": False,
                "showlegend": False,
                "hovertemplate": f"the interrupt for H {words} at %{{x:g}} ms<extra></extra>",
            }
            for time, marker, words in ((self.interrupt, COMES, "comes"), (seen.handled, SERVED, "is let in"))
        )
        return replace(rows, traces=[*rows.traces, comes, let_in])

    def metrics(self, result: dict[str, Way]) -> list[Metric]:
        whose: Mapping[str, list[Metric]] = {"H": [], "S": []}
        for way, seen in result.items():
            high, sharing = self.bounds(way)
            note = "H does not use the data; the longest section of a lower task"
            whose["H"].append(
                Metric(f"H waits, {way}", seen.high.blocked, "ms", bound=high, good=not seen.high.blocked, note=note)
            )
            note = "no bound: ticks are lost, and S is released by one" if sharing is None else "for L and for H"
            whose["S"].append(Metric(f"S waits, {way}", seen.sharing.blocked, "ms", bound=sharing, note=note))
        kept = [Metric(f"interrupt held, {way}", seen.handled - self.interrupt, "ms") for way, seen in result.items()]
        lost = result["critical section"].lost
        return [
            *whose["H"],
            *whose["S"],
            *kept,
            Metric("ticks lost, critical section", lost, "ticks", good=not lost, note="the hardware remembers one, not more"),
        ]
