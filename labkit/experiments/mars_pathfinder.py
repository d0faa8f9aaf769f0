"""Notebook 01: the priority inversion that reset a spacecraft on Mars (Reeves, "What really happened on Mars", 1997)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Metric, View
from labkit.experiments.contest import KEYS, inversions
from labkit.figures import History, axis, gantt, happening, lock_keys, priorities, stack
from labkit.kernel import Kernel, Run

PATHFINDER = {"bc_sched": 4, "bc_dist": 3, "comm": 2, "ASI_MET": 1}

FRAME, FRAMES = 125, 12  # ms, the 8 Hz cycle of the 1553 bus; cycles simulated
END = FRAMES * FRAME + 20  # ms


@dataclass(frozen=True)
class Flight:
    """Who ran when, the times in ms at which the check failed, and the stretches of priority inversion in cycles."""

    history: History
    resets: list[float]
    wrong: np.ndarray

    @classmethod
    def of(cls, run: Run) -> Flight:
        """Read a run."""
        resets = run.trace.rows("mark")[:, 0] * (1e3 / run.trace.hz)
        return cls(History(run.trace), resets.tolist(), inversions(run.trace, PATHFINDER))


class MarsPathfinder(Experiment[dict[str, Flight]]):
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
    at: Annotated[
        int, Interval(ge=0, le=END), MultipleOf(5), Unit("ms"), View(play=True), Doc("a time to look at, in both runs")
    ] = 0

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

    def run(self) -> dict[str, Flight]:
        return {"off": Flight.of(self.simulate("none")), "on": Flight.of(self.simulate("freertos"))}

    def figure(self, result: dict[str, Flight]) -> dict[str, Any]:
        panels, said = [], []
        for name, title in (("off", "Inheritance off, as flown"), ("on", "Inheritance on, as patched")):
            flight = result[name]
            ms = flight.history.trace.hz // 1000
            verdict = f"first reset at {flight.resets[0]:g} ms" if flight.resets else "no reset"
            alarms = [round(at * ms) for at in flight.resets]
            bands = [(start, end) for start, end in flight.wrong.tolist()]
            panels += [
                gantt(
                    flight.history,
                    tuple(PATHFINDER),
                    0,
                    END,
                    title=f"{title}: {verdict}",
                    locks=("select",),
                    alarms=alarms,
                    bands=bands,
                ),
                priorities(flight.history.trace, PATHFINDER, height=2.2),
            ]
            said.append(f"{name.capitalize()}: {happening(flight.history, tuple(PATHFINDER), self.at)}")
        return stack(
            *panels,
            height=480,
            shared=axis("time [ms]", range=[0, END]),
            keys=(*KEYS, *lock_keys(("select",)), "priority inversion"),
            at=self.at,
            says=f"At {self.at} ms. {'. '.join(said)}.",
        )

    def metrics(self, result: dict[str, Flight]) -> list[Metric]:
        off, on = (result[key].resets for key in ("off", "on"))
        cycles = f"of {FRAMES} cycles"
        return [
            Metric("resets, inheritance off", len(off), cycles, good=not off),
            Metric("resets, inheritance on", len(on), cycles, good=not on),
            Metric("first reset, inheritance off", off[0] if off else None, "ms", note="none happened" if not off else ""),
        ]
