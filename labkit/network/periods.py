"""Period synchronisation: stations that start their periods together, each scheduled by a local clock that drifts (5.2 to 5.8).

Begin: at the next multiple of the period, GT_start = GT_now + Period - GT_now mod Period (5.2), on the local clock
LT_start = LT_now + Period - GT_now mod Period (5.3). If `now` is a multiple itself, that is one period ahead.

Then, at the end of every period, a correction thread reads both clocks at once, g_i and l_i, and adds C_i to all release times of
the next period:

- `differences`: C_i = (l_i - l_{i-1}) - (g_i - g_{i-1}) (5.5), from the second activation on; the first has no pair before it.
- `absolute`, this lab's alternative: C_i brings the next start to a multiple of the period by the clock as read.

What each makes of an error, for a station whose readings are wrong by e_i (`phase` shows all of it):

- A reading error. The sum of (5.5) telescopes: after correction i the phase is off by e_1 - e_i, whatever was read in between;
  nothing adds up. By absolute phase it is off by -e_i.
- A phase error at the begin: (5.5) keeps it for ever, as it sees differences only. It also keeps what the clock gained before it
  sees any: on the way to the first start, for (5.3) ignores rates, and in the first period. By absolute phase all of that goes
  with the first correction.
- A shift that was lost, as the thread had read but was aborted before it shifted, or as the shift was cut: (5.5) keeps that, too.
- A correction thread that did not run at all: nothing is lost, if C_i is taken against the last pair that was *read*, as the sum
  telescopes over the gap, and if the larger shift that follows is not cut.

A shift forward, C_i < 0, takes time from the period. The thread reserves it: its window at the period's end, Deadline_C, is its
own WCET plus the largest forward shift (5.6 to 5.8; the windows of the phases are `labkit.phases.windows` with that reserve). A
shift beyond is cut to it here. `largest_shift` says how much is needed.

Stations are columns of arrays: all at once, period by period. True time and global clock are the same here, so an error of the
global clock is one of `errors`. The local clock has a constant rate.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 5.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np

from labkit.checks import shown, whole
from labkit.network.clocks import MOST_PPM, PPB, S
from labkit.trace import CODE, Trace

Correction = Literal["none", "differences", "absolute"]
CORRECTIONS: dict[Correction, str] = {"none": "none", "differences": "by differences (5.5)", "absolute": "by absolute phase"}


@dataclass(frozen=True)
class Plan:
    """The period, and what its correction thread may take, in ns: its own worst case and the largest shift forward."""

    period_ns: int
    wcet_ns: int = 100_000
    shift_ns: int = 1_900_000

    def __post_init__(self) -> None:
        period = whole(self.period_ns, 1000, "the period in ns", 1000 * S)
        wcet = whole(self.wcet_ns, 0, "the correction thread's WCET in ns")
        shift = whole(self.shift_ns, 0, "the largest forward shift in ns")
        if wcet + shift > period // 2:
            raise ValueError(f"Deadline_C is {wcet + shift} ns; at most half the period, {period // 2} ns, is allowed")

    @property
    def reserve_ns(self) -> int:
        """Deadline_C: the window of the correction thread, at the end of the period."""
        return self.wcet_ns + self.shift_ns


def start_at(global_now: int, local_now: int, period_ns: int) -> tuple[int, int]:
    """The start of the first period by the global clock (5.2) and by the local one (5.3), for a pair read at once."""
    wait = whole(period_ns, 1, "the period in ns") - global_now % period_ns
    return global_now + wait, local_now + wait


def largest_shift(correction: Correction, period_ns: int, worst_ppb: int, reading_ns: int, unread: int = 0) -> int:
    """The most that a correction has to shift, in ns, when up to `unread` of them in a row did not run; for (5.6).

    By differences: two readings that are wrong by `reading_ns` each, to opposite sides, and what a clock within `worst_ppb` of
    true time gains between them, in a period or several, themselves lengthened by a correction. By absolute phase one period
    more at first, as (5.3) takes no account of the rate on the way to the start. No other phase error at the begin.
    """
    if correction == "none":
        return 0
    between = (unread + 1 + (correction == "absolute")) * period_ns + 2 * reading_ns
    between += between * worst_ppb // (PPB - worst_ppb) + 1
    return 2 * reading_ns + between * worst_ppb // (PPB - worst_ppb) + 2


@dataclass(frozen=True, eq=False)
class Starts:
    """The periods of some stations.

    Attributes:
        plan: as given.
        local, true: starts of the periods by the station's own clock and in true time, int64 ns of shape (periods + 1, stations).
        wanted, shifted: what each correction computed, and what was added to the releases, of shape (periods, stations).
    """

    plan: Plan
    local: np.ndarray
    true: np.ndarray
    wanted: np.ndarray
    shifted: np.ndarray

    def phase(self) -> np.ndarray:
        """How late each start is, against the nearest multiple of the period, in ns; shape as `true`."""
        return centred(self.true, self.plan.period_ns)

    def difference(self, one: int = 1, other: int = 0) -> np.ndarray:
        """How much later a station starts its n-th period than another one, in ns."""
        return self.true[:, one] - self.true[:, other]

    def trace(self, station: int, windows: list[tuple[str, int, int]]) -> Trace:
        """One station's windows on its own clock, each used to its end, and after them the correction thread.

        `windows` are (name, release, deadline), relative to the start, as `labkit.phases.windows` makes them with the plan's
        reserve. The thread runs for its WCET; its deadline is the start of the next period.
        """
        rows = []
        names = [*(name for name, *_ in windows), "correction"]
        begins, last = self.local[:, station].tolist(), self.plan.period_ns - self.plan.reserve_ns
        for job, (start, then) in enumerate(pairwise(begins)):
            spans = [
                (start + release, start + release + deadline, start + release + deadline) for _, release, deadline in windows
            ]
            spans.append((start + last, start + last + self.plan.wcet_ns, then))
            for task, (begin, end, deadline) in enumerate(spans):
                rows += [(begin, CODE["release"], task, -1, begin, job), (begin, CODE["deadline"], task, -1, deadline, job)]
                rows += [(begin, CODE["switch"], task, -1, 0, 0), (end, CODE["complete"], task, -1, deadline, job)]
                rows += [(end, CODE["switch"], -1, task, 0, 0)]
        rows.sort(key=lambda row: row[0])  # stable: a window that ends comes before the one that begins there
        return Trace.from_rows(rows, names, S, start=begins[0], end=max(begins[-1], rows[-1][0]), closed=True)


def centred(time: np.ndarray, period_ns: int) -> np.ndarray:
    """How far a time lies behind the nearest multiple of the period, from -period/2 on and below period/2."""
    half = period_ns // 2
    return (time + half) % period_ns - half


def period_starts(
    plan: Plan,
    correction: Correction | list[Correction],
    ppb: np.ndarray,
    errors: np.ndarray,
    initial_ns: np.ndarray | int = 0,
    unread: np.ndarray | None = None,
    lost: np.ndarray | None = None,
) -> Starts:
    """The starts of all periods of all stations.

    Args:
        correction: of all stations or of each.
        ppb: rate error of each local clock, whole parts per billion, shape (stations,).
        errors: of the reading in each period, ns, shape (periods, stations).
        initial_ns: phase error at the begin, of all or of each.
        unread: where the correction thread did not run, bool of the shape of `errors`.
        lost: where it read, but did not shift.
    Raises:
        ValueError: an unknown correction, shapes that do not fit, or a rate error beyond `MOST_PPM`.
    """
    ppb, errors = np.asarray(ppb, np.int64), np.asarray(errors, np.int64)
    kinds = [correction] * len(ppb) if isinstance(correction, str) else list(correction)
    unknown = next((kind for kind in kinds if kind not in get_args(Correction)), None)
    if unknown is not None:
        raise ValueError(f"periods are corrected by {shown(unknown)}; there are {', '.join(get_args(Correction))}")
    if ppb.ndim != 1 or errors.ndim != 2 or not len(errors) or errors.shape[1] != len(ppb) or len(kinds) != len(ppb):
        raise ValueError(
            f"{len(kinds)} corrections, rates {ppb.shape}, errors {errors.shape}; errors (periods, stations) must fit"
        )
    if np.abs(ppb).max(initial=0) > MOST_PPM * 1000:
        raise ValueError(f"a local clock is off by {np.abs(ppb).max() / 1000} ppm; at most {MOST_PPM} is allowed")
    period, reserve, half = plan.period_ns, plan.reserve_ns, plan.period_ns // 2
    if (len(errors) + 2) * period * max(1, int(np.abs(ppb).max(initial=0))) >= 1 << 62:
        raise ValueError(f"{len(errors)} periods of {period} ns are too long for whole numbers of 64 bits; fewer are allowed")
    runs, makes = ~_mask(unread, errors), ~_mask(lost, errors)
    initial = np.broadcast_to(initial_ns, ppb.shape).tolist()

    local = np.empty((len(errors) + 1, len(ppb)), np.int64)
    wanted, shifted = np.zeros((2, *errors.shape), np.int64)
    for station, (kind, rate) in enumerate(zip(kinds, ppb.tolist(), strict=True)):  # whole numbers: arrays so narrow are slower
        start = period + initial[station]  # (5.3) at 0, a multiple: one period ahead
        begins, ahead = [start], None  # ahead: l - g of the last pair that was read
        columns = (column[:, station].tolist() for column in (errors, runs, makes))
        for i, (error, read, makes_it) in enumerate(zip(*columns, strict=True)):
            shift = 0
            if read and kind != "none":
                now = start + period - reserve
                gap = -(-now * rate // (PPB + rate)) - error  # l_i - g_i
                if kind == "absolute":
                    shift = half - (now - gap + reserve + half) % period  # how early the next start is, as far as one knows
                else:
                    shift = 0 if ahead is None else gap - ahead  # no pair before the first one
                ahead, wanted[i, station] = gap, shift
            if makes_it:
                shifted[i, station] = shift = max(shift, -plan.shift_ns)
                start += shift
            start += period
            begins.append(start)
        local[:, station] = begins
    return Starts(plan, local, local - _gained(local, ppb), wanted, shifted)


def _mask(where: np.ndarray | None, errors: np.ndarray) -> np.ndarray:
    return np.zeros(errors.shape, bool) if where is None else np.asarray(where, bool)


def _gained(local: np.ndarray, ppb: np.ndarray) -> np.ndarray:
    """How far a clock with this rate error, right at 0, is ahead of true time when it shows `local`."""
    return -(-local * ppb // (PPB + ppb))
