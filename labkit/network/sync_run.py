"""Clock synchronisation of some stations, simulated, and how far their clocks were apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import simpy

from labkit.checks import whole
from labkit.network.clocks import Clock, S
from labkit.network.loss import Loss
from labkit.network.radio import Counts, Radio, at
from labkit.network.sync import Master, Rule, Slave, Tally, precision_bound
from labkit.network.virtual import VirtualClock

#: Wraps the loop over the parts of a run, given them and their number; `labkit.experiment.progress` fits.
Watch = Callable[[Iterable[int], int], Iterator[int]]
PARTS = 100


@dataclass(frozen=True)
class Member:
    """A station: its clock, and from when to when it takes part, in true time."""

    clock: Clock
    joins_ns: int = 0
    leaves_ns: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "joins_ns", whole(self.joins_ns, 0, "the time at which a station joins, in ns,"))
        if self.leaves_ns is not None:
            least = self.joins_ns + 1
            object.__setattr__(self, "leaves_ns", whole(self.leaves_ns, least, "the time at which a station leaves, in ns,"))


@dataclass(frozen=True, eq=False)
class SyncRun:
    """What happened.

    Attributes:
        members, rule: as given; member 0 is the master.
        virtual: their virtual clocks, in the same order.
        tallies: what each met with.
        counts: of the radio.
        sent_ns: true time of each round's indication.
        until_ns: end of the run, in true time.
        bound_ns: `precision_bound`; None where none is claimed: without synchronisation, and with estimated drift.
    """

    members: Sequence[Member]
    rule: Rule
    virtual: Sequence[VirtualClock]
    tallies: Sequence[Tally]
    counts: Counts
    sent_ns: np.ndarray
    until_ns: int
    bound_ns: int | None
    _lines: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @property
    def settled_ns(self) -> int | None:
        """From when on the bound is to hold: everybody has made its first correction. None if somebody never did."""
        ends = [tally.settled_ns for tally in self.tallies]
        return None if None in ends else max(end for end in ends if end is not None)

    def lost(self, station: int) -> np.ndarray:
        """The rounds that a station lost after the first one it heard; all of them if it heard none."""
        heard, received = self.tallies[station].rounds, len(self.tallies[0].rounds)
        left = self.members[station].leaves_ns
        last = received if left is None else min(received, int(np.searchsorted(self.sent_ns, left)))
        return np.setdiff1d(np.arange(heard[0] if heard else 0, last), heard)

    def longest_gap(self, station: int) -> int:
        """The most indications in a row that a station lost, as `lost` counts them."""
        lost = self.lost(station)
        ends = np.flatnonzero(np.diff(lost, append=-1) != 1)
        return int(np.diff(ends, prepend=-1).max(initial=0))

    def master_stays(self) -> bool:
        """Whether the master took part up to the end."""
        left = self.members[0].leaves_ns
        return left is None or left >= self.until_ns

    def kept(self) -> bool:
        """Whether the assumption behind the bound held: nobody lost more than OD in a row, and the master stayed."""
        gaps = [self.longest_gap(station) for station in range(1, len(self.members))]
        return self.master_stays() and max(gaps) <= self.rule.omission_degree

    def set_back(self, station: int) -> int:
        """How often a virtual clock showed less than 1 ns earlier."""
        times, ahead = self.deviation(station)
        return int(np.sum(np.diff(times + ahead) < 0))

    def against(self, station: int, other: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """How far a virtual clock is ahead of another one: instants, and differences in ns."""
        (mine, ahead), (theirs, less) = self.deviation(station), self.deviation(other)
        times = np.union1d(mine, theirs)
        return times, np.interp(times, mine, ahead) - np.interp(times, theirs, less)

    def deviation(self, station: int) -> tuple[np.ndarray, np.ndarray]:
        """How far a virtual clock is ahead of true time: instants in ns, and deviations in ns; a straight line between them.

        Before a jump there is an instant of its own, 1 ns earlier.
        """
        if station not in self._lines:
            clock = self.virtual[station]
            bends = [bend for bend in clock.bends() if 0 < bend < self.until_ns]
            early = [bend - 1 for bend in bends] if self.rule.mode == "jump" else []
            times = sorted({0, self.until_ns, *bends, *early, *range(0, self.until_ns, S)})  # rates wander by the second
            self._lines[station] = np.array(times), np.array([clock.time(t) - t for t in times])
        return self._lines[station]

    def spread(self, begin_ns: int = 0, end_ns: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The precision over time: instants, and the largest difference between any two stations that take part then, in ns."""
        times, apart = self._spread
        some = (times >= begin_ns) & (times <= (self.until_ns if end_ns is None else end_ns))
        return times[some], apart[some]

    @cached_property
    def _spread(self) -> tuple[np.ndarray, np.ndarray]:
        found = [self.deviation(i) for i in range(len(self.members))]
        times = np.unique(np.concatenate([t for t, _ in found]))
        lines = np.array([np.interp(times, t, d) for t, d in found])
        for line, member in zip(lines, self.members, strict=True):
            left = self.until_ns + 1 if member.leaves_ns is None else member.leaves_ns
            line[(times < member.joins_ns) | (times >= left)] = np.nan
        several = np.sum(~np.isnan(lines), axis=0) > 1
        lines = lines[:, several]
        return times[several], np.nanmax(lines, axis=0) - np.nanmin(lines, axis=0)

    def precision(self, begin_ns: int | None = None, end_ns: int | None = None) -> float:
        """The largest difference from `begin_ns` on (by default: from when all have settled, or else from 0), in ns."""
        _, apart = self.spread(begin_ns if begin_ns is not None else self.settled_ns or 0, end_ns)
        return float(apart.max(initial=0.0))


def synchronise(
    members: Sequence[Member],
    rule: Rule,
    until_ns: int,
    loss: Loss | None = None,
    delay_ns: int = 500_000,
    jitter_ns: int = 0,
    seed: int = 0,
    watch: Watch | None = None,
) -> SyncRun:
    """Run some stations, of which the first is the master, on a radio of their own.

    Args:
        loss, delay_ns, jitter_ns, seed: of the radio.
        watch: for whoever shows how far the run is.
    Raises:
        ValueError: fewer than two stations, no time, a delay of half an interval or more, or an interval that is too short (see
            `precision_bound`).
    """
    if len(members) < 2:
        raise ValueError(f"{len(members)} station; at least a master and a slave are needed")
    whole(until_ns, 1, "the length of the run in ns")
    whole(delay_ns, 0, "the radio's delay in ns", rule.interval_ns // 2)
    worst, reading = max(m.clock.worst_ppb for m in members), max(m.clock.reading_ns for m in members)
    bound = precision_bound(rule, worst, jitter_ns, reading) if rule.mode in ("jump", "rate") else None
    env = simpy.Environment()
    radio = Radio(env, loss, delay_ns, jitter_ns, seed=seed)
    master = Master(radio, 0, members[0].clock, rule)
    stations: list[Master | Slave] = [master, *(Slave(radio, member.clock, rule) for member in members[1:])]
    for number in reversed(range(len(members) if rule.mode != "none" else 0)):  # who joins with the master hears its first word
        _take_part(radio, number, members[number], stations[number])
    for part in watch(range(1, PARTS + 1), PARTS) if watch else (PARTS,):
        end = until_ns * part // PARTS
        if end > env.now:
            env.run(until=end)
    virtual, tallies = [station.virtual for station in stations], [station.tally for station in stations]
    return SyncRun(members, rule, virtual, tallies, radio.counts, np.array(master.sent, np.int64), until_ns, bound)


def _take_part(radio: Radio, number: int, member: Member, station: Master | Slave) -> None:
    def join() -> None:
        radio.attach(number, station.receive)
        if isinstance(station, Master):
            station.start()

    def leave() -> None:
        station.on = False
        radio.detach(number)

    at(radio.env, member.joins_ns, join)
    if member.leaves_ns is not None:
        at(radio.env, member.leaves_ns, leave)
