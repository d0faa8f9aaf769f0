"""Local clocks, in whole nanoseconds: what a quartz makes of true time.

A clock that is said to run `ppm` fast gains that many microseconds in every second of true time. Three things are wrong with it
beside: it starts with an offset; its rate wanders with temperature, here as a random walk in steps of one second that stays
within `wander_ppm` of the nominal rate error; and whoever reads it is wrong by up to `reading_ns` to either side. Readings err,
the clock itself does not: `local` is what it shows, `stamp` what somebody reads. True time is the nanosecond count of the
simulation.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from itertools import islice
from math import isfinite

import numpy as np

from labkit.checks import UNBOUNDED, shown, whole

S = 1_000_000_000
PPB = 1_000_000_000
#: A rate error beyond this is no quartz but a broken one.
MOST_PPM = 1000
#: A step of the wander is at most this share of its range.
STEP = 10


def parts(ppm: float, least: float, what: str) -> int:
    """A rate in ppm as whole parts per billion; ValueError if it is no number from `least` to `MOST_PPM`."""
    if isinstance(ppm, bool) or not isinstance(ppm, int | float | np.number) or not isfinite(ppm) or not least <= ppm <= MOST_PPM:
        raise ValueError(f"{what} is {shown(ppm)} ppm; a number from {least} to {MOST_PPM} is allowed")
    return round(ppm * 1000)


def drawn(seed: list[int], low: int, high: int) -> Iterator[int]:
    """Whole numbers from `low` to `high`, uniform, without end; drawn by the hundred, since single ones cost far more."""
    rng = np.random.default_rng(seed)
    while True:
        yield from rng.integers(low, high, 256, endpoint=True).tolist()


class Clock:
    """A local clock.

    Args:
        ppm: rate error, positive for a clock that is fast; it counts to a thousandth of a ppm.
        offset_ns: what it shows at true time 0.
        wander_ppm: how far the rate may walk from `ppm`.
        reading_ns: largest error of a reading, to either side, uniform.
        seed: of wander and readings; a number or a list of them.

    Attributes:
        worst_ppb: the largest rate error it can ever have, without its sign, in parts per billion.

    Raises:
        ValueError: a rate error beyond `MOST_PPM` or an error below 0; names it and what is allowed.
    """

    def __init__(
        self, ppm: float = 0.0, offset_ns: int = 0, wander_ppm: float = 0.0, reading_ns: int = 0, seed: int | list[int] = 0
    ):
        self._ppb = parts(ppm, -MOST_PPM, "the clock's rate error")
        self._wander = parts(wander_ppm, 0, "the clock's wander")
        self.offset_ns = whole(offset_ns, -UNBOUNDED, "the clock's offset in ns", UNBOUNDED)
        self.reading_ns = whole(reading_ns, 0, "the clock's reading error in ns", S)
        self.worst_ppb = abs(self._ppb) + self._wander
        seeds, step = [seed] if isinstance(seed, int) else list(seed), max(1, self._wander // STEP)
        self._readings = drawn([*seeds, 0], -self.reading_ns, self.reading_ns)
        self._walk = drawn([*seeds, 1], -step, step)
        self._rates = [self._ppb]  # of each second; without wander the first one lasts for ever
        self._starts = [self.offset_ns]  # what the clock shows at the begin of each second

    def rate_ppb(self, now: int) -> int:
        """Its rate error at true time `now`, in parts per billion."""
        return self._rates[self._second(now)]

    def local(self, now: int) -> int:
        """What the clock shows at true time `now` of at least 0; it never goes back."""
        if now >= 0 and not self._wander:  # asked most often
            return self.offset_ns + now + now * self._ppb // PPB
        second = self._second(now)
        since = now - second * S
        return self._starts[second] + since + since * self._rates[second] // PPB

    def when(self, local: int) -> int:
        """The first true time, 0 or later, at which the clock shows `local` or more: how a timer is set on it."""
        while self._wander and self._starts[-1] < local:
            self._extend(len(self._starts) + 64)
        second = max(0, bisect_right(self._starts, local) - 1) if self._wander else 0
        missing = max(0, local - self._starts[second])
        found = second * S - (-missing * PPB // (PPB + self._rates[second]))
        return min(found, (second + 1) * S) if self._wander else found

    def stamp(self, now: int) -> int:
        """A reading of the clock at true time `now`, with its error: two of the same instant may differ."""
        return self.local(now) + (next(self._readings) if self.reading_ns else 0)

    def _second(self, now: int) -> int:
        if now < 0:
            raise ValueError(f"the true time is {shown(now)} ns; a whole number of at least 0 is allowed")
        if not self._wander:
            return 0
        if now // S >= len(self._rates):
            self._extend(now // S + 1)
        return now // S

    def _extend(self, seconds: int) -> None:
        """Let the rate walk on, to at least so many seconds."""
        for step in islice(self._walk, max(64, seconds - len(self._rates))):
            self._starts.append(self._starts[-1] + S + S * self._rates[-1] // PPB)
            self._rates.append(min(max(self._rates[-1] + step, self._ppb - self._wander), self._ppb + self._wander))
