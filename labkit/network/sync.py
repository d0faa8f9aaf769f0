r"""Clock synchronisation over a radio that loses messages: indications, reception stamps, correction by rate.

One round, k: the master broadcasts an indication. Everybody, the master too, stamps its reception by the own clock. Indication k
carries the master's stamps of the rounds k-1 to k-OD-1. A slave takes the latest of these for which it has a stamp of its own:
the difference of the two stamps is how far its clock was behind then. It corrects by changing its rate, over 15/16 of the next
interval, so that it is through before the next indication, whatever jitter and rate errors; then it keeps the rate of its local
clock until the next correction. Its virtual clock never jumps and never goes back.

So OD indications lost in a row do no harm but age. After OD + 1 in a row the next one has no round in common with the slave: it
cannot correct then, and runs freely on its last correction until the second indication after the gap (after which the bound below
holds again). A slave that hears nothing keeps its last correction.

Precision: the largest difference of two virtual clocks at one instant. Rho is the largest rate error of all clocks, I the
interval, J the reception jitter, R the reading error.

- What a slave has measured is wrong by at most E = J (1 + rho) + 2 R: both notice the broadcast within J, and both read.
- It ages: at rho against -rho, two clocks part by 2 rho per ns. In the worst case OD indications are lost, one is heard, OD are
  lost again. The one that is heard gives a stamp that is OD + 1 intervals old, and is not replaced before another OD + 1 have
  passed: A = 2 (OD + 1) I / (1 - rho) + J. While it is replaced, old and new are mixed; the share of the old falls faster than
  its age grows, so that no instant is worse.
- Two slaves: each is wrong by its own rate against the master's over its own age. The master's rate counts with opposite signs,
  so both together are off by 2 rho A at most; and each has its own E.

      | V_a - V_b | <= 2 rho A + 2 E     (`precision_bound`)

The choices beside `rate`: `none`; `jump`, the correction at once, which has the same bound (age is all that counts) and makes
clocks jump, back as well; and `drift`, which estimates the rate against the master from the first and the last of the last eight
rounds used, and corrects for it, too: no bound is claimed for that, as it depends on how the rates change.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.3, after M. Mock, R. Frings, E. Nett and
S. Trikaliotis, Continuous clock synchronization in wireless real-time applications (SRDS 2000). This lab's own: the 15/16, that a
correction ends with its interval, and the limit `MOST_SLEW` on how fast a large offset is made up for.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal, get_args

from labkit.checks import shown, whole
from labkit.network.clocks import PPB, Clock, S
from labkit.network.radio import Radio, at
from labkit.network.virtual import VirtualClock

Mode = Literal["none", "jump", "rate", "drift"]
MODES: dict[str, str] = {
    "none": "none",
    "jump": "jump to the master's time",
    "rate": "rate",
    "drift": "rate, with estimated drift",
}
#: Rounds from whose first and last the drift is estimated.
ROUNDS = 8
#: Rounding: each of a handful of whole numbers is wrong by less than 1 ns.
ROUNDING_NS = 8
#: Bytes of an indication: its number, and each stamp with the number of its round.
NUMBER, STAMP = 4, 12
MOST_OD = 100


@dataclass(frozen=True)
class Rule:
    """How clocks are synchronised: how often, how many losses in a row are assumed at most, and what a slave does."""

    interval_ns: int = S
    omission_degree: int = 1
    mode: Mode = "rate"

    def __post_init__(self) -> None:
        object.__setattr__(self, "interval_ns", whole(self.interval_ns, 1000, "the interval in ns", 3600 * S))
        object.__setattr__(self, "omission_degree", whole(self.omission_degree, 1, "the omission degree", MOST_OD))
        if self.mode not in get_args(Mode):
            raise ValueError(f"clocks are corrected by {shown(self.mode)}; there are {', '.join(get_args(Mode))}")

    @property
    def over_ns(self) -> int:
        """How long a correction takes."""
        return self.interval_ns * 15 // 16

    @property
    def bytes(self) -> int:
        """Size of an indication."""
        return NUMBER + STAMP * (self.omission_degree + 1)


@dataclass(frozen=True)
class Indication:
    """The broadcast of a round: its number, and the master's stamps of earlier rounds."""

    round: int
    stamps: tuple[tuple[int, int], ...]


def precision_bound(rule: Rule, worst_ppb: int, jitter_ns: int = 0, reading_ns: int = 0) -> int:
    """What two virtual clocks never differ by, in ns, for clocks within `worst_ppb` of true time: see the module.

    Holds for `rate` and `jump`, when every clock has made up for what it was off at the begin, and never more than OD indications
    are lost in a row.

    Raises:
        ValueError: an interval in which a clock corrected by rate could not be made right.
    """
    longest = rule.interval_ns * PPB // (PPB - worst_ppb) + 1
    age = 2 * (rule.omission_degree + 1) * longest + jitter_ns
    error = jitter_ns + jitter_ns * worst_ppb // PPB + 2 * reading_ns + ROUNDING_NS
    bound = -(-2 * worst_ppb * age // PPB) + 2 * error
    room = rule.interval_ns - rule.over_ns
    if jitter_ns + 4 * worst_ppb * rule.interval_ns // PPB > room:
        raise ValueError(
            f"an interval of {rule.interval_ns} ns is too short for a reception jitter of {jitter_ns} ns; "
            f"at least {16 * jitter_ns * PPB // (PPB - 64 * worst_ppb) + 16} ns is allowed"
        )
    if 2 * bound > rule.over_ns:
        raise ValueError(
            f"an interval of {rule.interval_ns} ns is too short to correct {bound} ns by rate; readings, jitter, rate errors and "
            f"omission degree must allow a bound of at most {rule.over_ns // 2} ns"
        )
    return bound


@dataclass
class Tally:
    """What a station met with.

    Attributes:
        rounds: numbers of the indications it heard.
        corrected: corrections it made.
        without_common: indications that had no round in common with it.
        settled_ns: true time of the end of its first correction, with estimated drift of the eighth; None before.
    """

    rounds: list[int] = field(default_factory=list)
    corrected: int = 0
    without_common: int = 0
    settled_ns: int | None = None


class Master:
    """Sends an indication every interval of its own clock; its virtual clock is its local one. `start` it, once."""

    def __init__(self, radio: Radio, station: int, clock: Clock, rule: Rule):
        self.radio, self.station, self.clock, self.rule = radio, station, clock, rule
        self.virtual = VirtualClock(clock)
        self.tally = Tally(settled_ns=0)
        self.on = True
        self.sent: list[int] = []  # true time of each indication
        self._begin = 0
        self._stamps: deque[tuple[int, int]] = deque(maxlen=rule.omission_degree + 1)

    def start(self) -> None:
        """Send the first indication now."""
        self._begin = self.clock.local(int(self.radio.env.now))
        self._send()

    def receive(self, message: Any, sender: int) -> None:
        """Its own indication has been sent."""
        if isinstance(message, Indication) and self.on:
            self.tally.rounds.append(message.round)
            self._stamps.append((message.round, self.clock.stamp(int(self.radio.env.now))))

    def _send(self) -> None:
        if self.on:
            self.radio.send(self.station, Indication(len(self.sent), tuple(self._stamps)), self.rule.bytes, echo=True)
            self.sent.append(int(self.radio.env.now))
            at(self.radio.env, self.clock.when(self._begin + len(self.sent) * self.rule.interval_ns), self._send)


@dataclass
class Slave:
    """Corrects its virtual clock by the master's indications."""

    radio: Radio
    clock: Clock
    rule: Rule
    virtual: VirtualClock = field(init=False)
    tally: Tally = field(default_factory=Tally, init=False)
    on: bool = field(default=True, init=False)
    _stamps: dict[int, int] = field(default_factory=dict, init=False, repr=False)
    _pairs: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=ROUNDS), init=False, repr=False)
    _ends: int | None = field(default=None, init=False, repr=False)  # local time at which the present correction is through

    def __post_init__(self) -> None:
        self.virtual = VirtualClock(self.clock)

    def receive(self, message: Any, sender: int) -> None:
        """An indication; other messages are somebody else's."""
        if not isinstance(message, Indication) or not self.on:
            return
        now, mine = int(self.radio.env.now), self._stamps
        self.tally.rounds.append(message.round)
        common = [(own, stamp) for number, stamp in message.stamps if (own := mine.get(number)) is not None]
        mine[message.round] = self.clock.stamp(now)
        while len(mine) > self.rule.omission_degree + 1:
            del mine[next(iter(mine))]
        if common:
            self._correct(now, *common[-1])
        elif len(self.tally.rounds) > 1:
            self.tally.without_common += 1

    def _correct(self, now: int, own: int, masters: int) -> None:
        local, behind = self.clock.local(now), masters - own
        self.tally.corrected += 1
        self._settle(local)
        if self.rule.mode == "jump":
            self.virtual.jump(local, behind)
            self._ends = local
            return
        self._pairs.append((own, behind))
        slope = Fraction(0)
        if self.rule.mode == "drift" and len(self._pairs) > 1:
            (first, then), (last, lately) = self._pairs[0], self._pairs[-1]
            slope = Fraction(lately - then, max(1, last - first))
        aged = slope.numerator * (local - own) // slope.denominator
        self._ends = self.virtual.steer(local, behind + aged, self.rule.over_ns, slope)

    def _settle(self, local: int) -> None:
        """Note the end of the first correction that counts, if it was through before the next one."""
        counts = self.tally.corrected > (ROUNDS if self.rule.mode == "drift" else 1)
        if self.tally.settled_ns is None and counts and self._ends is not None and self._ends <= local:
            self.tally.settled_ns = self.clock.when(self._ends)
