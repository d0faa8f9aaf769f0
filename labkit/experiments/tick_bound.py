"""Notebook 05: how fast a tick may be. Source 1 sees no theoretical bound; what a tick costs is one (see its errata)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric
from labkit.figures import BLUE, GREY, VERMILION, Curve, axis, curves, stack
from labkit.kernel import Costs, Kernel
from labkit.robot import CPU_HZ, PERIODIC, OnBlocks, Rates, build, execution, published
from labkit.trace import overheads, runs

TICKS = (1000, 2000, 5000, 8000, 10_000, 16_000, 20_000, 24_000, 30_000, 36_000, 50_000, 100_000)  # Hz; all divide the clock
SPAN = CPU_HZ // 250  # cycles simulated for each point, 4 ms: the four tasks repeat after two ticks


@dataclass(frozen=True)
class Load:
    """Shares of the processor over tick rates `TICKS`, 0 to 1: by analysis and as simulated; None: does not run at all."""

    ticks: list[float]
    control: list[float]
    simulated_ticks: list[float | None]
    simulated: list[float | None]


class TickBound(Experiment[Load]):
    """Is there no upper bound for the tick rate?

    The kernel alone takes cost x rate of the processor. With the control tasks at the tick rate (odometry and pose control at
    half of it) their times and a switch for each job come on top. Dotted: analysis. Points: the model, 4 ms for each.
    """

    tick: Annotated[int, Interval(ge=20, le=2000), MultipleOf(20), Unit("cycles"), Doc("what a tick interrupt costs")] = 200
    switch: Annotated[int, Interval(ge=0, le=1000), MultipleOf(10), Unit("cycles"), Doc("what a switch of tasks costs")] = 150
    caches: Annotated[bool, Doc("published execution times with the L1 caches on, or off")] = True

    def per_tick(self) -> float:
        """Cycles of a tick with all that it brings: its own, two jobs and half of two more, a switch to each and one to IDLE."""
        work = execution(self.caches)
        jobs = sum((work[task] + self.switch) / period for task, period in zip(PERIODIC, (1, 1, 2, 2), strict=True))
        return self.tick + jobs + self.switch

    def bounds(self) -> tuple[float, float]:
        """The tick rates in Hz at which ticks alone, and ticks with the control tasks, fill the processor."""
        return CPU_HZ / self.tick, CPU_HZ / self.per_tick()

    def run(self) -> Load:
        costs = Costs(tick=self.tick, switch=self.switch)
        empty, full = [], []
        for hz in TICKS:
            possible = self.tick + self.switch < CPU_HZ // hz
            empty.append(self._ticks_only(hz, costs) if possible else None)
            full.append(self._with_control(hz, costs) if possible else None)
        return Load([self.tick * hz / CPU_HZ for hz in TICKS], [self.per_tick() * hz / CPU_HZ for hz in TICKS], empty, full)

    def _ticks_only(self, hz: int, costs: Costs) -> float:
        k = Kernel(CPU_HZ, hz, costs=costs)
        k.advance(SPAN)
        spent = overheads(k.trace)
        return float((spent[:, 2] - spent[:, 1]).sum() / SPAN)

    def _with_control(self, hz: int, costs: Costs) -> float:
        firmware = replace(published("10000|5000", self.caches, tracing=False), rates=Rates(hz, 1, 2), costs=costs)
        k = build(firmware, OnBlocks()).kernel
        k.advance(SPAN)
        ran = runs(k.trace)
        idle = ran[ran[:, 0] == k.trace.code("IDLE")]
        return 1 - float((idle[:, 2] - idle[:, 1]).sum() / SPAN)

    def figure(self, result: Load) -> dict[str, Any]:
        def percent(values: list[Any]) -> list[float | None]:
            return [None if v is None else 100 * v for v in values]

        fine = np.geomspace(TICKS[0], TICKS[-1], 60).tolist()
        drawn = [
            Curve("ticks alone, analysis", fine, [100 * self.tick * hz / CPU_HZ for hz in fine], GREY, "dot"),
            Curve("ticks alone, simulated", TICKS, percent(result.simulated_ticks), GREY),
            Curve("with the control tasks, analysis", fine, [100 * self.per_tick() * hz / CPU_HZ for hz in fine], BLUE, "dot"),
            Curve("with the control tasks, simulated", TICKS, percent(result.simulated), BLUE),
        ]
        full = {
            "type": "line",
            "xref": "x domain",
            "x0": 0,
            "x1": 1,
            "y0": 100,
            "y1": 100,
            "line": {"color": VERMILION, "width": 2},
        }
        x = axis("tick rate [Hz]", type="log", range=[2.95, 5.05], tickvals=[1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000])
        return stack(curves(drawn, x, axis("processor taken [%]", range=[0, 130]), shapes=[full]), height=460)

    def metrics(self, result: Load) -> list[Metric]:
        alone, control = self.bounds()
        at = TICKS.index(10_000)
        return [
            Metric("bound, ticks alone", round(alone), "Hz", note="cost of a tick x rate < 1"),
            Metric(
                "bound, with the control tasks", round(control), "Hz", note="above it the wheel control falls behind for ever"
            ),
            Metric("ticks alone at 1 kHz", 100 * result.ticks[0], "%"),
            Metric("ticks alone at 10 kHz", 100 * result.ticks[at], "%"),
            Metric("with the control tasks at 10 kHz", 100 * min(result.control[at], 1.0), "%", good=result.control[at] < 1),
        ]


def check_tick_bound(hz: float, experiment: TickBound | None = None) -> Feedback:
    """Exercise: the highest tick rate at which the control tasks can still run at every tick."""
    bound = (experiment or TickBound(caches=False)).bounds()[1]
    if abs(hz - bound) <= 0.02 * bound:
        return Feedback(
            True, f"the bound is {bound:,.0f} Hz; a real tick has to divide the clock and to leave room for the tracer"
        )
    side = "the processor would be overloaded" if hz > bound else "there is still room"
    return Feedback(False, f"at {hz:,.0f} Hz {side}; add up the cycles of one tick")
