"""Notebook 09: how long free-running stations stay coherent (figure 21); what corrections do with an error (5.5 to 5.8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric
from labkit.experiments.global_time import MS, US, Seed
from labkit.experiments.global_time_drift import COLOUR, WCET_NS, Drift, Period, Way, difference_line
from labkit.figures import BLUE, GREY, INK, PALE, Panel, axis, held, stack
from labkit.network import CORRECTIONS, Plan, Starts, centred, largest_shift, period_starts

HOUR = 3_600_000_000_000
ROUNDS, EVENT = 80, 30  # of `PeriodStarts`: periods, and the one in which something goes wrong
PERIOD = 500 * MS
EVENTS = {"none": "nothing goes wrong", "unread": "the thread does not run", "lost": "it reads, but does not shift"}


@dataclass(frozen=True, eq=False)
class Stretches:
    """When two free-running stations are coherent.

    Attributes:
        period, apart: some periods, and how far the stations' nearest starts are apart then, in ns.
        count: periods observed.
        coherent: how many of them were coherent.
        first: how many at the begin, before the first incoherent one.
        cycle_ns: after which time they begin together again; None without drift.
    """

    period: np.ndarray
    apart: np.ndarray
    count: int
    coherent: int
    first: int
    cycle_ns: float | None


class CoherentStretches(Experiment[Stretches]):
    """How long do two quartz clocks stay coherent?

    Two stations begin together, then each goes by its own clock. Their data are coherent while the starts of their periods are no
    further apart than SW (5.1). Coherent and incoherent stretches take turns: figure 21 of source 2.
    """

    drift: Drift = 2.14
    period: Period = 500
    threshold: Annotated[int, Interval(ge=1, le=100), Unit("ms"), Doc("largest difference of coherent data (SW)")] = 20
    hours: Annotated[int, Interval(ge=1, le=200), Unit("h"), Doc("observed")] = 150

    def run(self) -> Stretches:
        period, sw, ppb = self.period * MS, self.threshold * MS, round(self.drift * 1000)
        count = self.hours * HOUR // period
        bends = np.empty(0)
        if ppb:
            half = period / 2 / (period * ppb / 1e9)  # periods until they are half a period apart
            turns = np.arange(1, count / half + 1, 2) * half
            bends = np.concatenate([np.floor(turns), np.floor(turns) + 1])
        some = np.unique(np.concatenate([np.linspace(0, count - 1, 200), bends[bends < count]]).astype(np.int64))
        coherent = coherent_periods(period, ppb, sw, count)
        free = sw * 1_000_000_000 // (period * ppb) + 1 if ppb and 2 * sw < period else count
        cycle = period * 1e9 / ppb if ppb else None
        return Stretches(some, centred(some * period * ppb // 1_000_000_000, period), count, coherent, min(free, count), cycle)

    def figure(self, result: Stretches) -> dict[str, Any]:
        hours = result.period * (self.period * MS / HOUR)
        band = {"type": "rect", "xref": "x domain", "x0": 0, "x1": 1, "y0": -self.threshold, "y1": self.threshold}
        band |= {"fillcolor": PALE, "line": {"width": 0}, "layer": "below"}
        note = {"text": "coherent", "xref": "x domain", "x": 1, "xanchor": "right", "y": 0, "yanchor": "middle"}
        line = {
            "type": "scatter",
            "mode": "lines",
            "x": hours,
            "y": result.apart / MS,
            "name": "difference",
            "line": {"color": BLUE, "width": 2.5},
            "hovertemplate": "%{y:.1f} ms after %{x:.2f} h<extra></extra>",
        }
        height = held(1.02 * max(self.period / 2, self.threshold), coarse=True)
        return stack(
            Panel([line], axis("difference of the starts [ms]", range=[-height, height]), shapes=[band], notes=[note], left=92),
            height=380,
            shared=axis("time since they began together [h]", range=[0, held(self.hours, coarse=True)]),
            legend=False,
        )

    def metrics(self, result: Stretches) -> list[Metric]:
        per_hour = self.period * MS / HOUR
        expected = min(1.0, 2 * self.threshold / self.period)
        return [
            Metric("first stretch", result.first * per_hour, "h", note="until they are further apart than SW for the first time"),
            Metric(
                "coherent", 100 * result.coherent / result.count, "%", note=f"over whole cycles 2 SW / period: {expected:.1%}"
            ),
            Metric(
                "one cycle",
                None if result.cycle_ns is None else result.cycle_ns / HOUR,
                "h",
                note="period / drift, until they begin together again",
            ),
            Metric("drift per period", self.drift * self.period / 1000, "us"),
        ]


def coherent_periods(period_ns: int, ppb: int, sw_ns: int, count: int) -> int:
    """How many of the periods 0 to count - 1 begin no further apart than `sw_ns`, for stations that part by `ppb`."""
    drift = period_ns * ppb  # per period, in 1e-9 ns; whole numbers, so that nothing adds up over a million periods
    if drift == 0 or 2 * sw_ns >= period_ns:
        return count
    giga = 1_000_000_000
    total = 0
    for cycle in range((count - 1) * drift // giga // period_ns + 2):
        centre = cycle * period_ns
        first = max(0, -(-(centre - sw_ns) * giga // drift))
        last = min(count - 1, ((centre + sw_ns + 1) * giga - 1) // drift)
        total += max(0, last - first + 1)
    return total


class PeriodStarts(Experiment[Starts]):
    """What becomes of an error, once it is there?

    Two stations correct the starts of their periods once per period. One begins with a phase error, and from period 30 on some of
    its corrections fail. The dashed line is the largest shift forward that Deadline_C has room for.
    """

    correction: Way = "differences"
    initial: Annotated[float, Interval(ge=0, le=5), MultipleOf(0.1), Unit("ms"), Doc("phase error at the begin")] = 0.4
    event: Annotated[Literal["none", "unread", "lost"], Labels(EVENTS), Doc("what goes wrong in period 30")] = "lost"
    fails: Annotated[int, Interval(ge=1, le=20), Unit("periods"), Doc("in a row in which it goes wrong")] = 10
    drift: Drift = 50.0
    reserve: Annotated[int, Interval(ge=0, le=1900), MultipleOf(10), Unit("us"), Doc("largest shift forward (in Deadline_C)")] = (
        100
    )
    read_error: Annotated[int, Interval(ge=0, le=100), Unit("us"), Doc("of reading the common clock, to either side")] = 5
    seed: Seed = 1

    def run(self) -> Starts:
        ways = list(CORRECTIONS)
        draws = np.random.default_rng(self.seed).uniform(-1, 1, (ROUNDS, 2))
        errors = np.tile(np.rint(draws * self.read_error * US).astype(np.int64), len(ways))
        wrong = np.zeros(errors.shape, bool)
        wrong[EVENT : EVENT + self.fails, 1::2] = True
        plan = Plan(PERIOD, WCET_NS, self.reserve * US)
        rates = np.tile([0, -round(self.drift * 1000)], len(ways))  # a slow clock: its starts come late
        kinds = [way for way in ways for _ in range(2)]
        initial = np.tile([0, round(self.initial * MS)], len(ways))
        failing = {self.event: wrong} if self.event != "none" else {}
        return period_starts(plan, kinds, rates, errors, initial, **failing)

    def column(self) -> int:
        """Of the second station under the chosen correction."""
        return 2 * list(CORRECTIONS).index(self.correction) + 1

    def figure(self, result: Starts) -> dict[str, Any]:
        apart = {way: result.difference(2 * i + 1, 2 * i) / US for i, way in enumerate(CORRECTIONS)}
        tallest = 1000 * self.initial + self.drift * 0.5 * (self.fails + 3) + 4 * self.read_error
        height = held(1.1 * max(tallest, 200.0), coarse=True)
        wanted, made = -result.wanted[:, self.column()] / US, -result.shifted[:, self.column()] / US
        gained = self.drift * PERIOD / 1e12
        far = 1000 * self.initial + gained * (self.fails + 2) if self.correction == "absolute" else gained
        deep = held(1.2 * max(self.reserve, far + 2 * self.read_error, 50.0), coarse=True)
        failing = {"type": "rect", "x0": EVENT - 0.5, "x1": EVENT + self.fails - 0.5, "yref": "y domain", "y0": 0, "y1": 1}
        failing |= {"fillcolor": PALE, "line": {"width": 0}, "layer": "below", "visible": self.event != "none"}
        limit = {"type": "line", "xref": "x domain", "x0": 0, "x1": 1, "y0": self.reserve, "y1": self.reserve}
        limit |= {"line": {"color": INK, "dash": "dash", "width": 2}}
        return stack(
            Panel(
                [difference_line(way, d, way == self.correction) for way, d in apart.items()],
                axis("apart [us]", range=[-0.2 * height, height]),
                shapes=[failing],
                title="Starts of the two stations",
                left=92,
                height=1.4,
            ),
            Panel(
                [_shifts("wanted", wanted, GREY, "circle-open"), _shifts("made", made, COLOUR[self.correction], "circle")],
                axis("forward [us]", range=[-0.5 * deep, deep]),
                shapes=[failing, limit],
                title="Shifts of the second station",
                caption=CORRECTIONS[self.correction],
                left=92,
            ),
            height=480,
            shared=axis("period", range=[-1, ROUNDS + 1]),
        )

    def metrics(self, result: Starts) -> list[Metric]:
        mine = self.column()
        apart = result.difference(mine, mine - 1) / US
        needed = largest_shift(self.correction, PERIOD, round(self.drift * 1000), self.read_error * US) / US
        cut = int(np.sum(result.wanted[:, mine] < -result.plan.shift_ns))
        return [
            Metric("difference at the end", float(apart[-1]), "us"),
            Metric("corrections cut", cut, "", good=cut == 0, note="they wanted to shift further forward than Deadline_C allows"),
            Metric("shift made, largest", float(-result.shifted[:, mine].min() / US), "us", bound=float(self.reserve)),
            Metric("shift wanted, largest", float(-result.wanted[:, mine].min() / US), "us"),
            Metric("shift that drift and readings need", needed, "us", note="largest forward shift when nothing else goes wrong"),
        ]


def _shifts(name: str, shift: np.ndarray, colour: str, symbol: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": np.arange(len(shift)),
        "y": shift,
        "name": name,
        "marker": {"color": colour, "size": 8, "symbol": symbol, "line": {"width": 2, "color": colour}},
        "hovertemplate": f"{name}: %{{y:.1f}} us in period %{{x}}<extra></extra>",
    }


def check_stretch(answer_ppm: float) -> Feedback:
    """Exercise: the largest drift, to 0.01 ppm, at which two stations with 100 ms stay coherent within 10 ms for a day."""

    def hours(hundredths: int) -> float:
        return CoherentStretches(drift=hundredths / 100, period=100, threshold=10, hours=100).measure("first stretch")

    if isinstance(answer_ppm, bool) or not isinstance(answer_ppm, int | float) or not 0.01 <= answer_ppm <= 99:
        return Feedback(False, "give a number of ppm from 0.01 to 99.")
    steps = round(answer_ppm * 100)
    found, more = hours(steps), hours(steps + 1)
    text = f"{steps / 100} ppm: coherent for {found:.2f} h"
    return Feedback(found >= 24 > more, f"{text}, {(steps + 1) / 100} ppm: for {more:.2f} h.")


def check_reserve(answer_us: int) -> Feedback:
    """Exercise: the smallest largest-shift, in steps of 10 us, with which no correction of a station is ever cut.

    500 ms, a clock 100 ppm slow, readings wrong by up to 50 us, correction by differences, nothing else wrong. The check reads as
    wrongly as possible.
    """
    if isinstance(answer_us, bool) or not isinstance(answer_us, int) or not 0 <= answer_us <= 1900:
        return Feedback(False, "give a whole number of us from 0 to 1900.")

    def cut(reserve_us: int) -> int:
        errors = np.array([[-50 * US], [50 * US]] * 20)
        run = period_starts(Plan(PERIOD, WCET_NS, reserve_us * US), "differences", np.array([-100_000]), errors)
        return int(np.sum(run.wanted < -run.plan.shift_ns))

    if cut(answer_us):
        return Feedback(False, f"with {answer_us} us {cut(answer_us)} of 40 corrections are cut.")
    spare = answer_us >= 10 and not cut(answer_us - 10)
    return Feedback(not spare, f"with {answer_us} us none is cut{', and with 10 us less neither' if spare else ''}.")


def check_in_phase(answer: PeriodStarts) -> Feedback:
    """Exercise: the stations of the default setting end in phase, within 20 us, though nothing that went wrong is taken away."""
    asked = PeriodStarts()
    if answer != asked.replace(correction=answer.correction, reserve=answer.reserve):
        return Feedback(False, "change correction and reserve only.")
    end = answer.measure("difference at the end")
    cut = answer.measure("corrections cut")
    text = f"the stations end {end:.1f} us apart, {cut} corrections cut"
    return Feedback(abs(end) <= 20 and cut == 0, f"{text}; at most 20 us and no cut are allowed.")
