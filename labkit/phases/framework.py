"""A framework for chains of anytime phases, in simulated time: units with pairs of functions, and the organiser that runs them.

A user's phase is a `Unit` with one or more parts. The main function of a part is a generator: it takes the phase's input and
yields `(time_ns, result)`, meaning that it computed for so long and that this result is the best so far. It may be aborted at any
yield; the result that counts is the last one whose time had passed by then. After an abort the exception function, if there is
one, gets that result (or None) and returns what is to be used instead.

    smooth = Unit("smooth")

    @smooth.part(ecet_ns=3_000_000, wcet_ep_ns=100_000)
    def main(points):
        for n in range(1, 20):
            yield 400_000, moving_average(points, n)

    @smooth.last_action
    def publish(unit, results):
        unit.make_output_available(results["main"])

Rules, from the source unless marked *:
- Parts of a unit run in the same window under TAFT; time one does not use goes to the others.
- The part that finishes last, in its main or its exception part, runs `last_action`, exactly once per period in which the unit
  had input. Its time belongs to that of the exception part (*: it takes none of its own here).
- A successor has input in a period only if its predecessor called `make_output_available` in that period; otherwise none of its
  parts is activated. The first unit gets what the organiser is fed.
- The organiser takes the units in order, checks 4.14 (with a reserve 5.6), computes the windows by 4.18 (5.7), starts and stops.
  It starts at a multiple of the period (5.2).
- * Main functions are run in zero real time; a step whose time has not passed at the abort is not seen by anybody, so a main
  function must give its results by yielding and not by writing them elsewhere. The generator is closed at the abort.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 6.1. For several stations: `distributed`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from labkit.checks import whole
from labkit.phases.windows import Part, Window, windows
from labkit.scheduler import EP, PRIORITY, Outcome, Releases, TaskPair, run_pairs, trace_of
from labkit.trace import Trace

Main = Callable[[Any], Generator[tuple[int, Any], None, None]]

#: More steps than this within one window are taken for a main part that does not end.
MAX_STEPS = 1_000_000


@dataclass(frozen=True)
class FunctionPair:
    """A main part and its exception part with their times in ns; `exception` takes the last result and returns the one to use."""

    name: str
    main: Main
    exception: Callable[[Any], Any] | None
    ecet_ns: int
    wcet_ep_ns: int


class Unit:
    """One phase: parts, a last action, and an output. See the module for a unit in ten lines."""

    def __init__(self, name: str):
        self.name = name
        self.parts: list[FunctionPair] = []
        self._last_action: Callable[[Unit, dict[str, Any]], None] | None = None
        self._output: tuple[Any] | None = None

    def add(
        self, main: Main, ecet_ns: int, wcet_ep_ns: int, exception: Callable[[Any], Any] | None = None, name: str | None = None
    ) -> None:
        """Add a part; its name is that of the main function if none is given. ValueError if the unit has one of that name."""
        name = name or main.__name__
        if any(part.name == name for part in self.parts):
            raise ValueError(f"unit {self.name!r} has two parts called {name!r}")
        Part(self.name, name, ecet_ns, wcet_ep_ns)  # its checks
        self.parts.append(FunctionPair(name, main, exception, ecet_ns, wcet_ep_ns))

    def part(self, ecet_ns: int, wcet_ep_ns: int, exception: Callable[[Any], Any] | None = None) -> Callable[[Main], Main]:
        """Decorator: the function is the main part of a new part."""

        def add(main: Main) -> Main:
            self.add(main, ecet_ns, wcet_ep_ns, exception)
            return main

        return add

    def last_action(self, action: Callable[[Unit, dict[str, Any]], None]) -> Callable[[Unit, dict[str, Any]], None]:
        """Decorator: `action(unit, results)` runs when all parts have finished; `results` maps part names to results or None."""
        self._last_action = action
        return action

    def make_output_available(self, output: Any) -> None:
        """Hand `output` to the next unit of the chain, in this period only."""
        self._output = (output,)


@dataclass(frozen=True)
class Activation:
    """One unit in one period: when its last part finished and which, what each part delivered, and which parts were aborted."""

    period: int
    unit: str
    finished_ns: int
    last: str
    results: dict[str, Any]
    aborted: tuple[str, ...]


@dataclass(eq=False)
class Organiser:
    """Runs a chain of units in simulated time.

    `windows` and `start_ns` are set by `start`; `activations` grows with `run`, in order of time.
    """

    units: list[Unit]
    period_ns: int
    reserve_ns: int = 0
    windows: list[Window] = field(default_factory=list, init=False)
    start_ns: int = field(default=0, init=False)
    periods: int = field(default=0, init=False)
    running: bool = field(default=False, init=False)
    activations: list[Activation] = field(default_factory=list, init=False)
    _record: list[tuple[int, Releases, Outcome]] = field(default_factory=list, init=False, repr=False)

    def start(self, now_ns: int = 0) -> list[Window]:
        """Check 4.14 (5.6), partition the period by 4.18 (5.7), and start at the next multiple of the period after `now_ns`.

        That is one period later if `now_ns` is a multiple itself (5.2). The trace counts from this start.

        Raises:
            ValueError: already running, a unit without parts, a negative time, or a period that is too short; names the unit and
                the missing ns.
        """
        if self.running:
            raise ValueError("the organiser is running already; stop it first")
        bare = next((unit for unit in self.units if not unit.parts), None)
        if bare is not None:
            raise ValueError(f"unit {bare.name!r} has no parts; it needs at least one")
        self.windows = windows(self._chain(), self.period_ns, self.reserve_ns)
        now_ns = whole(now_ns, 0, "the time of the start in ns")
        self.start_ns = now_ns + self.period_ns - now_ns % self.period_ns
        self.periods, self.running, self.activations, self._record = 0, True, [], []
        return self.windows

    def run(self, inputs: Iterable[Any]) -> list[Activation]:
        """One period for each input; None stands for no data. Returns the activations of these periods.

        Raises:
            ValueError: not started, or a main part that yields anything but (time of at least 1 ns, result), or too many steps.
        """
        if not self.running:
            raise ValueError("the organiser is not running; start it first")
        before = len(self.activations)
        for data in inputs:
            for index in range(len(self.units)):
                data = self.run_unit(index, data)
            self.end_period()
        return self.activations[before:]

    def run_unit(self, index: int, data: Any) -> Any:
        """Run one unit of the chain in its window of this period, for whoever has something to do between two of them.

        Returns what it makes available, None if that is nothing; it is not activated if `data` is None.
        """
        unit = self.units[index]
        unit._output = None
        if data is not None:
            self._activate(unit, self.windows[index], sum(len(before.parts) for before in self.units[:index]), data)
        return unit._output[0] if unit._output is not None else None

    def end_period(self) -> None:
        """All units of this period have run."""
        self.periods += 1

    def stop(self) -> None:
        """Stop; the record stays."""
        self.running = False

    def trace(self) -> Trace:
        """All that ran so far, from the start, in ns; names are those of the parts, then each with `.ep` behind it."""
        names = [part.name for part in self._chain()]
        empty = np.empty(0, np.int64)
        offset, jobs, outcomes = 0, [], []
        for begin, some, outcome in self._record:
            moved = [np.where(at >= 0, at + begin, -1) for at in (outcome.completed, outcome.aborted, outcome.recovered)]
            jobs.append(Releases(some.task, some.number, some.release + begin, some.deadline + begin, some.time))
            outcomes.append(Outcome(outcome.job + offset, outcome.part, outcome.start + begin, outcome.end + begin, *moved))
            offset += len(some)

        def joined(records: list, fields: Iterable[str]) -> list[np.ndarray]:
            return [np.concatenate([getattr(record, name) for record in records]) if records else empty for name in fields]

        every = Outcome(*joined(outcomes, Outcome.__dataclass_fields__))
        made = Releases(*joined(jobs, Releases.__dataclass_fields__))
        return trace_of(
            made, every, names, PRIORITY[every.part], max(1, self.periods) * self.period_ns, 1_000_000_000, exceptions=True
        )

    def _chain(self) -> list[Part]:
        return [Part(unit.name, part.name, part.ecet_ns, part.wcet_ep_ns) for unit in self.units for part in unit.parts]

    def _activate(self, unit: Unit, window: Window, first: int, data: Any) -> None:
        length = window.deadline_ns
        steps = [_steps(unit, part, data, length - part.wcet_ep_ns) for part in unit.parts]
        pairs = [TaskPair(part.name, part.ecet_ns, part.wcet_ep_ns, length) for part in unit.parts]
        count = len(pairs)
        zero, index = np.zeros(count, np.int64), np.arange(count)
        need = np.array([times[-1] if times else 1 for times, _ in steps], dtype=np.int64)
        jobs, outcome = run_pairs(pairs, Releases(index, zero, zero, zero + length, need), length)
        granted = np.zeros(count, np.int64)
        np.add.at(granted, outcome.job, np.where(outcome.part < EP, outcome.end - outcome.start, 0))
        results = {}
        for part, (times, values), time, fell in zip(unit.parts, steps, granted, outcome.aborted, strict=True):
            done = int(np.searchsorted(times, time, side="right"))
            results[part.name] = values[done - 1] if done else None
            if fell >= 0 and part.exception is not None:
                results[part.name] = part.exception(results[part.name])
        ends = np.maximum(outcome.completed, outcome.recovered)
        last = int(np.lexsort((index, ends))[-1])
        begin = self.periods * self.period_ns + window.release_ns
        aborted = tuple(part.name for part, fell in zip(unit.parts, outcome.aborted, strict=True) if fell >= 0)
        self._record.append(
            (begin, Releases(jobs.task + first, jobs.number + self.periods, jobs.release, jobs.deadline, jobs.time), outcome)
        )
        self.activations.append(
            Activation(self.periods, unit.name, self.start_ns + begin + int(ends[last]), unit.parts[last].name, results, aborted)
        )
        if unit._last_action is not None:
            unit._last_action(unit, results)


def _steps(unit: Unit, part: FunctionPair, data: Any, most: int) -> tuple[list[int], list[Any]]:
    """Run a main part until it ends or has used more than `most`; cumulative times and results of its steps. It is closed then.

    A main part that ends without a step takes 1 ns.
    """
    times: list[int] = []
    values: list[Any] = []
    used = 0
    where = f"unit {unit.name!r}, part {part.name!r}"
    steps = part.main(data)
    if not hasattr(steps, "send"):
        raise ValueError(f"{where}: the main part is no generator; it must yield (time in ns, result)")
    for step in steps:
        if not (isinstance(step, tuple) and len(step) == 2 and isinstance(step[0], int | np.integer) and step[0] >= 1):
            raise ValueError(f"{where}: the main part yields {step!r}; it must yield (time of at least 1 ns, result)")
        used += int(step[0])
        times.append(used)
        values.append(step[1])
        if used > most:
            steps.close()
            break
        if len(times) >= MAX_STEPS:
            raise ValueError(f"{where}: the main part makes more than {MAX_STEPS} steps within its window")
    return times, values
