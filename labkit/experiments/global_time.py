"""Notebook 09, first half: one time for several stations by indications over a radio that loses some (source 2, section 2.3)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, progress
from labkit.figures import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, SMALL, VERMILION, YELLOW, Panel, axis, held, stack
from labkit.network import MODES, Clock, GilbertElliott, Member, Mode, Rule, SyncRun, precision_bound, synchronise

US, MS, S = 1_000, 1_000_000, 1_000_000_000
COLOURS = (INK, BLUE, GREEN, ORANGE, PURPLE, SKY, "#8B5A2B", YELLOW, "#7A5195", GREY)
POINTS = 500  # of a line: more are reduced to the lowest and the highest value of a column
MARKS = 700  # lost indications that are drawn one by one

Drift = Annotated[float, Interval(ge=0, le=100), MultipleOf(0.01), Unit("ppm"), Doc("rate of one station against the other")]
Seed = Annotated[int, Interval(ge=1, le=20), Doc("another draw")]


class ClockSync(Experiment[SyncRun]):
    """How close do clocks stay together over a radio that loses messages?

    A master sends an indication every interval; everybody stamps its reception, and the stamps of the last OD + 1 rounds travel
    with the next one. The slaves' rates lie evenly between plus and minus the rate error; the master's is in the middle.
    """

    slow: ClassVar[bool] = True
    correction: Annotated[Mode, Labels(MODES), Doc("what a slave does with what it learns")] = "rate"
    rate_error: Annotated[int, Interval(ge=0, le=100), Unit("ppm"), Doc("of the fastest and the slowest clock")] = 20
    interval: Annotated[int, Interval(ge=100, le=5000), MultipleOf(100), Unit("ms"), Doc("from indication to indication")] = 1000
    omission_degree: Annotated[int, Interval(ge=1, le=5), Doc("losses in a row that are tolerated (OD)")] = 1
    loss: Annotated[int, Interval(ge=0, le=100), Unit("%"), Doc("share of the indications that a slave does not hear")] = 10
    burst: Annotated[int, Interval(ge=1, le=10), Unit("times"), Doc("length of a run of losses, 1 for independent ones")] = 1
    jitter: Annotated[int, Interval(ge=0, le=50), Unit("us"), Doc("until a reception is noticed, at most")] = 5
    wander: Annotated[int, Interval(ge=0, le=10), Unit("ppm"), Doc("how far a rate walks from its rate error")] = 0
    stations: Annotated[int, Interval(ge=2, le=10), Doc("the master and its slaves")] = 4
    seconds: Annotated[int, Interval(ge=20, le=3600), MultipleOf(20), Unit("s"), Doc("simulated")] = 60
    master_dies: Annotated[
        int, Interval(ge=10, le=3600), MultipleOf(10), Unit("s"), Doc("its last moment; a later one than the end: never")
    ] = 3600
    seed: Seed = 1

    @classmethod
    def strategy(cls) -> Any:
        """Short runs only: the long ones differ in nothing but their time."""
        return (
            super()
            .strategy()
            .map(lambda drawn: drawn.replace(seconds=20 + drawn.seconds % 60, master_dies=10 + drawn.master_dies % 90))
        )

    def rates(self) -> list[float]:
        """Rate errors in ppm, the master's first."""
        return [0.0, *np.linspace(self.rate_error, -self.rate_error, self.stations - 1).round(3).tolist()]

    def rule(self) -> Rule:
        """Interval, omission degree, and what a slave does."""
        return Rule(self.interval * MS, self.omission_degree, self.correction)

    def bound(self) -> float:
        """What analysis says two clocks never differ by, in us, while the assumption holds."""
        return precision_bound(self.rule(), (self.rate_error + self.wander) * 1000, self.jitter * US) / US

    def run(self) -> SyncRun:
        until, dies = self.seconds * S, self.master_dies * S
        clocks = [Clock(ppm, 0, self.wander, 0, [self.seed, i]) for i, ppm in enumerate(self.rates())]
        members = [Member(clocks[0], leaves_ns=dies if dies < until else None), *map(Member, clocks[1:])]
        loss = GilbertElliott.bursts(self.loss / 100, self.burst)
        return synchronise(members, self.rule(), until, loss, jitter_ns=self.jitter * US, seed=self.seed, watch=progress)

    def figure(self, result: SyncRun) -> dict[str, Any]:
        times, apart = result.spread()
        against = [result.against(station) for station in range(self.stations)]
        bound_us = self.bound() if self.claims() else 0.0
        height = held(1.1 * max(bound_us, apart.max() / US), coarse=True)
        ahead = held(1.1 * max(bound_us / 2, *(np.abs(d).max() / US for _, d in against)), coarse=True)
        against += [(np.empty(0), np.empty(0))] * (len(COLOURS) - self.stations)  # always the same number of lines
        lines = [_line(self._named(i), *against[i], COLOURS[i], i < self.stations) for i in range(1, len(COLOURS))]
        bound = {
            "type": "scatter",
            "mode": "lines",
            "x": [0, self.seconds],
            "y": [self.bound() if self.claims() else None] * 2,
            "name": "bound by analysis",
            "line": {"color": GREY, "width": 4, "dash": "dash"},
            "hovertemplate": "bound: %{y:.1f} us<extra></extra>",
        }
        if result.kept():
            remark = ""
        else:
            remark = f"more than OD = {self.omission_degree} lost in a row" if result.master_stays() else "the master dies"
        dies = {"type": "line", "x0": self.master_dies, "x1": self.master_dies, "yref": "y domain", "y0": 0, "y1": 1}
        dies |= {"line": {"color": VERMILION, "width": 2}, "visible": not result.master_stays()}
        return stack(
            Panel(
                lines,
                _fixed("ahead [us]", -ahead, ahead),
                shapes=[dies],
                title="Ahead of the master",
                remark=remark,
                height=1.3,
                left=104,
            ),
            Panel(
                [_line("largest difference", times, apart, INK, False), bound],
                _fixed("apart [us]", 0, height),
                shapes=[dies],
                title="Largest difference of any two",
                left=104,
            ),
            Panel([self._lost(result)], self._rows(), height=0.3 + 0.12 * self.stations, left=104),
            height=428,
            shared=axis("true time [s]", range=[0, self.seconds]),
        )

    def _named(self, station: int) -> str:
        return f"{self.rates()[station]:+g} ppm".replace("+0 ", "0 ") if station < self.stations else ""

    def claims(self) -> bool:
        """Whether there is a bound for this way of correcting."""
        return self.correction in ("jump", "rate")

    def _lost(self, result: SyncRun) -> dict[str, Any]:
        """A mark for each indication lost; none if there are too many to tell apart."""
        found = [(result.sent_ns[n] / S, -i) for i in range(1, self.stations) for n in result.lost(i)]
        x, y = zip(*found, strict=True) if 0 < len(found) <= MARKS else ((), ())
        return {
            "type": "scatter",
            "mode": "markers",
            "x": x,
            "y": y,
            "name": "indication lost",
            "marker": {"symbol": "x", "size": 8, "color": VERMILION},
            "hovertemplate": "lost at %{x:.1f} s<extra></extra>",
        }

    def _rows(self) -> dict[str, Any]:
        """A row for each slave; with many of them only every second one is named."""
        slaves = range(1, self.stations)
        return axis(
            "lost",
            range=[0.4 - self.stations, -0.4],
            tickvals=[-i for i in slaves],
            ticktext=[self._named(i) if self.stations <= 4 or i % 2 else "" for i in slaves],
            tickfont={"size": SMALL},
            showgrid=False,
            fixedrange=True,
        )

    def metrics(self, result: SyncRun) -> list[Metric]:
        gaps = [result.longest_gap(i) for i in range(1, self.stations)]
        precision = result.precision() / US
        claimed = self.claims() and result.kept() and result.settled_ns is not None
        if claimed:
            note = "from when everybody has made its first correction"
        elif not self.claims():
            note = "no bound is claimed for this way of correcting"
        elif not result.master_stays():
            note = f"the bound of {self.bound():.1f} us ends with the master"
        elif result.settled_ns is None:
            note = "somebody never made a correction"
        else:
            note = (
                f"the bound of {self.bound():.1f} us is for at most {self.omission_degree} lost in a row, here were {max(gaps)}"
            )
        back = sum(result.set_back(i) for i in range(1, self.stations))
        return [
            Metric("precision", precision, "us", bound=self.bound() if claimed else None, good=claimed or None, note=note),
            Metric(
                "lost in a row", max(gaps), "indications", good=max(gaps) <= self.omission_degree, note="the most, of any slave"
            ),
            Metric("clock set back", back, "times", good=back == 0),
            Metric("indications", len(result.sent_ns)),
            Metric("corrections", sum(tally.corrected for tally in result.tallies)),
            Metric(
                "nothing in common",
                sum(tally.without_common for tally in result.tallies),
                "indications",
                note="heard, but without a stamp of a round that this slave had heard",
            ),
        ]


def thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line as it is, or where it has many points the first and the last, the lowest and the highest value per column."""
    if len(x) <= POINTS:
        return x, y
    at = np.unique(np.linspace(0, len(x), POINTS // 2, endpoint=False).astype(int))
    both = np.stack([np.minimum.reduceat(y, at), np.maximum.reduceat(y, at)], axis=1)
    return np.repeat(x[at], 2), both.ravel()


def _fixed(title: str, low: float, high: float) -> dict[str, Any]:
    return axis(title, range=[low, high], fixedrange=True)


def _line(name: str, t: np.ndarray, d: np.ndarray, colour: str, shown: bool) -> dict[str, Any]:
    x, y = thinned(t / S, d / US)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "showlegend": shown,
        "line": {"color": colour, "width": 2.5},
        "hovertemplate": f"{name}: %{{y:.1f}} us at %{{x:.1f}} s<extra></extra>",
    }


def check_interval(answer_ms: int) -> Feedback:
    """Exercise: the longest interval, in whole ms, with a bound of at most 100 us; clocks within 30 ppm, OD 2, jitter 5 us."""

    def bound(ms: int) -> int:
        return precision_bound(Rule(ms * MS, 2), 30_000, 5 * US)

    if isinstance(answer_ms, bool) or not isinstance(answer_ms, int) or not 1 <= answer_ms <= 10_000:
        return Feedback(False, "give a whole number of ms from 1 to 10000.")
    found, next_one = bound(answer_ms) / US, bound(answer_ms + 1) / US
    text = f"with {answer_ms} ms the bound is {found:.2f} us"
    if found > 100:
        return Feedback(False, f"{text}.")
    return Feedback(next_one > 100, f"{text}, with {answer_ms + 1} ms {next_one:.2f} us.")


def check_bound_broken(answer: ClockSync) -> Feedback:
    """Exercise: at 5 % loss, 1 in 20 at most, clocks must be found beyond their bound, by bursts alone; the seed may change."""
    asked = ClockSync(loss=5, omission_degree=2, seconds=300)
    if answer != asked.replace(burst=answer.burst, seed=answer.seed):
        return Feedback(False, f"start from {asked.code()} and change burst and seed only.")
    found = answer.run()
    precision, gap = found.precision() / US, max(found.longest_gap(i) for i in range(1, answer.stations))
    text = f"{gap} lost in a row, precision {precision:.1f} us, bound {answer.bound():.1f} us"
    return Feedback(precision > answer.bound(), text + ".")
