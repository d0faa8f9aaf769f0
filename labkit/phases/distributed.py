"""Several stations, each with a chain of anytime phases of its own, on one radio: communication, fusion, and what is coherent.

Every station runs the same chain (`framework`). At its communication unit it sends its data object, with its timestamp, to all;
at its fusion unit it reads the data objects that have come, numbers 1, 2, ... for the stations, and writes number 0. Stations
start their periods as `labkit.network.period_starts` says: together, kept together by a correction, or as it happens.

- A data object travels with group communication (`labkit.network.GroupMail`): all stations get it or none, within a bound. If
  that fits into the window of the communication unit, and stations start together, every fusion has the data of all.
- `request_data` asks another station to send its last data object once more.
- A unit in `skip` hands its input on, in no time: to look at what the stage before makes.
- Data are coherent if their timestamps differ by at most SW, which is at least the largest error of a timestamp plus the largest
  reaction of a sensor (5.1).
- * Parts of a chain compute in zero real time (`framework`): what arrives while a unit runs is seen by the next one.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), sections 5.1 and 6.1; * is this model's.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from labkit.network import GroupMail, Starts
from labkit.phases.framework import Organiser, Unit
from labkit.phases.windows import Window

_STAMP = struct.Struct(">cq")  # kind, timestamp
_DATA, _REQUEST = b"D", b"R"
#: Bytes that a message has beside its payload.
OVERHEAD = _STAMP.size


@dataclass(frozen=True)
class DataObject:
    """What a station knows, and when it was measured, in ns of the global clock."""

    station: int
    timestamp_ns: int
    payload: bytes


class CommunicationUnit(Unit):
    """Sends the station's data object to all, and hands it on. It belongs to a `Team`, which connects it."""

    def __init__(self, name: str, ecet_ns: int, wcet_ep_ns: int):
        super().__init__(name)
        self.arrived: dict[int, DataObject] = {}
        self.mine: DataObject | None = None
        self._post: Callable[[bytes], None] = lambda data: None

        def send(data: DataObject) -> Generator[tuple[int, DataObject], None, None]:
            self.send(data)
            yield ecet_ns, data

        self.add(send, ecet_ns, wcet_ep_ns)
        self.last_action(lambda unit, results: unit.make_output_available(self.mine))

    def connect(self, post: Callable[[bytes], None]) -> None:
        """How it gets something to all stations."""
        self._post = post

    def send(self, data: DataObject) -> None:
        """Send a data object to all."""
        self.mine = data
        self._post(_STAMP.pack(_DATA, data.timestamp_ns) + data.payload)

    def request_data(self, station: int) -> None:
        """Ask a station for its last data object."""
        self._post(_STAMP.pack(_REQUEST, station))

    def receive(self, source: int, message: bytes, me: int) -> None:
        """A message has come: keep the newest data object of each station, and answer a request for one's own."""
        kind, number = _STAMP.unpack_from(message)
        if kind == _REQUEST:
            if number == me and self.mine is not None and source != me:
                self.send(self.mine)
        elif source not in self.arrived or self.arrived[source].timestamp_ns <= number:
            self.arrived[source] = DataObject(source, number, message[OVERHEAD:])


class FusionUnit(Unit):
    """Reads all data objects, its own and those that have come, and writes number 0; `fuse` makes it of them.

    Attributes:
        objects: number -> data object; station i has number i + 1.
    """

    def __init__(
        self,
        name: str,
        communication: CommunicationUnit,
        fuse: Callable[[Mapping[int, DataObject]], Any],
        ecet_ns: int,
        wcet_ep_ns: int,
    ):
        super().__init__(name)
        self.objects: dict[int, Any] = {}

        def read(mine: DataObject) -> Generator[tuple[int, Any], None, None]:
            self.objects = {data.station + 1: data for data in (*communication.arrived.values(), mine)}
            yield ecet_ns, fuse(dict(self.objects))

        def write(unit: Unit, results: dict[str, Any]) -> None:
            self.objects[0] = results["read"]
            unit.make_output_available(self.objects[0])

        self.add(read, ecet_ns, wcet_ep_ns)
        self.last_action(write)


@dataclass(frozen=True)
class Fused:
    """One fusion: in which period of which station, when it began in true time, and the timestamp in ns of each station's data
    object that it used, its own among them.
    """

    period: int
    station: int
    begin_ns: int
    stamps: Mapping[int, int]

    def apart_ns(self, stations: int) -> int | None:
        """The largest difference between two timestamps; None if a station's data are missing."""
        return max(self.stamps.values()) - min(self.stamps.values()) if len(self.stamps) == stations else None


@dataclass
class Team:
    """Stations with chains of the same windows, the starts of their periods, and the radio between them.

    Attributes:
        organisers: one per station. starts: of the periods.
        skip: names of units that hand their input on.
        fused: what each fusion used, in order of time.
    """

    organisers: list[Organiser]
    starts: Starts
    skip: frozenset[str] = frozenset()
    fused: list[Fused] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        names = {unit.name for organiser in self.organisers for unit in organiser.units}
        unknown = next((name for name in sorted(self.skip) if name not in names), None)
        if unknown is not None:
            raise ValueError(f"there is no unit {unknown!r} to skip; there are {', '.join(sorted(names))}")
        if self.starts.true.shape[1] != len(self.organisers):
            raise ValueError(f"there are starts for {self.starts.true.shape[1]} stations and {len(self.organisers)} organisers")
        for organiser in self.organisers:
            organiser.start()

    def deliver(self, station: int, source: int, message: bytes, now: int) -> None:
        """A message has come to a station."""
        for unit in self.organisers[station].units:
            if isinstance(unit, CommunicationUnit) and source != station:
                unit.receive(source, message, station)

    def run(self, mail: GroupMail, measure: Callable[[int, int, int], DataObject | None]) -> list[Fused]:
        """All periods of all stations, in the order of true time.

        Args:
            mail: connects the communication units.
            measure: (station, period, true time in ns) -> what goes into the chain, None for nothing.
        """
        for station, organiser in enumerate(self.organisers):
            for unit in organiser.units:
                if isinstance(unit, CommunicationUnit):
                    unit.connect(partial(mail.send, station))
        flowing: list[Any] = [None] * len(self.organisers)
        for begin, station, period, index in self._schedule():
            mail.run(begin)
            organiser = self.organisers[station]
            unit = organiser.units[index]
            data = measure(station, period, begin) if index == 0 else flowing[station]
            flowing[station] = data if unit.name in self.skip else organiser.run_unit(index, data)
            if isinstance(unit, FusionUnit) and unit.objects and data is not None and unit.name not in self.skip:
                stamps = {number - 1: item.timestamp_ns for number, item in unit.objects.items() if number}
                self.fused.append(Fused(period, station, begin, stamps))
            if index == len(organiser.units) - 1:
                organiser.end_period()
        return self.fused

    def begin(self, station: int, window: Window) -> np.ndarray:
        """When a window of a station begins in each period, in true time, ns."""
        true, local = (np.diff(starts[:, station]) for starts in (self.starts.true, self.starts.local))
        return self.starts.true[:-1, station] + window.release_ns * true // local

    def overlap(self, one: int = 0, other: int = 1) -> np.ndarray:
        """How much of each window two stations have at the same time, as a share, shape (periods, units).

        Windows of the same phase are compared, whichever period of the other station is nearest.
        """
        period = self.starts.plan.period_ns
        shares = []
        for mine, theirs in zip(self.organisers[one].windows, self.organisers[other].windows, strict=True):
            apart = (self.begin(one, mine) - self.begin(other, theirs) + period // 2) % period - period // 2
            shares.append(np.clip(mine.deadline_ns - np.abs(apart), 0, None) / mine.deadline_ns)
        return np.stack(shares, axis=1)

    def _schedule(self) -> list[tuple[int, int, int, int]]:
        """(true time, station, period, unit) of all windows, in the order of time."""
        found = []
        for station, organiser in enumerate(self.organisers):
            for index, window in enumerate(organiser.windows):
                found += [(int(at), station, period, index) for period, at in enumerate(self.begin(station, window))]
        return sorted(found)
