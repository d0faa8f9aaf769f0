"""A virtual clock: a local clock plus a correction that changes steadily, in whole nanoseconds."""

from __future__ import annotations

from bisect import bisect_right
from fractions import Fraction

from labkit.network.clocks import Clock

#: By this part of a local nanosecond, at most, the virtual clock is moved per nanosecond: it runs at half speed at least.
MOST_SLEW = Fraction(1, 2)


class VirtualClock:
    """What a station takes for the common time: its local clock plus a correction, a line in pieces over local time.

    It begins as the local clock. `steer` never makes it jump or go back; `jump` does both.
    """

    def __init__(self, clock: Clock):
        self.clock = clock
        self._starts = [clock.local(0)]
        self._lines: list[tuple[int, int, int]] = [(0, 0, 1)]  # correction at the start, gained per length

    def time(self, now: int) -> int:
        """What it shows at true time `now`."""
        local = self.clock.local(now)
        return local + self.correction(local)

    def correction(self, local: int) -> int:
        """What is added when the local clock shows `local`."""
        piece = max(0, bisect_right(self._starts, local) - 1)
        begin, gained, length = self._lines[piece]
        return begin + (local - self._starts[piece]) * gained // length

    def jump(self, local: int, correction: int) -> None:
        """From local time `local` on, the correction is this one."""
        self._piece(local, correction, 0, 1)

    def steer(self, local: int, aim: int, over: int, slope: Fraction = Fraction(0)) -> int:
        """From local time `local` on, move the correction steadily to what it is to be, then let it run on with `slope`.

        Args:
            aim: the correction that would be right at `local`; it changes with `slope`.
            over: how long the move takes, in local ns, or longer if that would be more than `MOST_SLEW`.
        Returns:
            The local time at which the move ends.
        """
        begin = self.correction(local)
        end = aim + slope.numerator * over // slope.denominator
        needed = abs(end - begin) * MOST_SLEW.denominator // MOST_SLEW.numerator
        if needed > over:
            over, end = needed, aim + slope.numerator * needed // slope.denominator
        self._piece(local, begin, end - begin, over)
        self._piece(local + over, end, slope.numerator, slope.denominator)
        return local + over

    def bends(self) -> list[int]:
        """The true times at which the correction changes its course, in order."""
        return [self.clock.when(start) for start in self._starts]

    def _piece(self, local: int, begin: int, gained: int, length: int) -> None:
        while self._starts and self._starts[-1] >= local:  # a course that was planned and is not taken
            self._starts.pop()
            self._lines.pop()
        self._starts.append(local)
        self._lines.append((begin, gained, length))
