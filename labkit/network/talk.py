"""What every way of talking in a group needs: a radio on which one speaks at a time, and the messages of all stations."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import simpy

from labkit.network.fragments import Message, Reassembly, fragments
from labkit.network.groups import Packet
from labkit.network.loss import Channel, Loss
from labkit.network.radio import Radio, Receive
from labkit.network.report import Sent

Steps = Generator[simpy.Event, Any, Any]


@dataclass(frozen=True)
class Reciprocal:
    """A model of loss in which both directions between two stations share one channel: a burst hits both."""

    loss: Loss
    _made: dict[tuple[int, int], Channel] = field(default_factory=dict, compare=False, repr=False)

    def channel(self, sender: int, receiver: int, rng: np.random.Generator) -> Channel:
        pair = min(sender, receiver), max(sender, receiver)
        if pair not in self._made:
            self._made[pair] = self.loss.channel(sender, receiver, rng)
        return self._made[pair]


class Hall:
    """A radio on which one speaks at a time: who says something learns who has heard it. The access point is the last number.

    Only those who are meant listen; for the others a message is nothing that they could lose.
    """

    def __init__(self, stations: int, radio: Radio):
        self.radio, self.access_point = radio, stations
        self.all_stations = frozenset(range(stations))
        self._ears = [self._ear(station) for station in range(stations + 1)]
        self._listening: frozenset[int] = frozenset()
        self._tuned: dict[int, Receive] = {}  # the same, in order of their tuning in
        self._heard: set[int] = set()

    @property
    def now(self) -> int:
        """The time in ns."""
        return int(self.radio.env.now)

    def _ear(self, station: int) -> Receive:
        return lambda message, sender: self._heard.add(station)

    def say(self, sender: int, size: int, to: frozenset[int]) -> Generator[simpy.Event, Any, set[int]]:
        """Send so many bytes to these and wait until they have heard them who will; returns who."""
        if to != self._listening:
            kept = [station for station in self._tuned if station in to]
            self._tuned = {station: self._ears[station] for station in (*kept, *(to - self._listening))}
            self.radio.attach_only(self._tuned)
        self._listening, self._heard = to, set()
        end = self.radio.send(sender, None, size) + self.radio.delay_ns + self.radio.jitter_ns
        yield self.radio.env.timeout(end - self.now)  # made after the receptions of that instant, so it ends after them
        return self._heard

    def ask(self, station: int, poll: int, answer: int) -> Generator[simpy.Event, Any, bool]:
        """Poll a station and wait for its answer, so many bytes each; whether the answer arrives."""
        if not (yield from self.say(self.access_point, poll, frozenset({station}))):
            return False
        return bool((yield from self.say(station, answer, frozenset({self.access_point}))))


class Desk(Protocol):
    """Where the packets of all stations come from and go to."""

    @property
    def late(self) -> Mapping[int, int]:
        """Station -> slot from which on it is switched on."""
        ...

    def on(self, station: int, slot: int) -> bool:
        """Whether the station is switched on."""
        ...

    def next_packet(self, station: int, slot: int, now: int) -> bytes | None:
        """What the station sends next, None for nothing."""
        ...

    def taken(self, source: int, order: int) -> None:
        """A packet of this source has got its place in the common order."""
        ...

    def give_up(self, station: int) -> None:
        """The station does not send the rest of its message."""
        ...

    def deliver(self, station: int, packet: Packet, now: int) -> None:
        """A station takes a packet over."""
        ...


@dataclass
class Talk:
    """The messages of all stations, and what becomes of them. A station has one message at a time.

    Attributes:
        size: of a message in bytes. last_slot: the first one in which no message begins any more.
        late, silent: station -> slot from which on it is switched on, or off.
        sent: all messages.
    """

    stations: int
    size: int
    last_slot: int
    late: Mapping[int, int]
    silent: Mapping[int, int]
    sent: list[Sent] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._of: list[list[Sent]] = [[] for _ in range(self.stations)]
        self._rest: list[deque[bytes]] = [deque() for _ in range(self.stations)]
        self._desks = [[Reassembly() for _ in range(self.stations)] for _ in range(self.stations)]
        self._last = [-1] * self.stations

    def on(self, station: int, slot: int) -> bool:
        """Whether the station is switched on."""
        return self.late.get(station, 0) <= slot < self.silent.get(station, slot + 1)

    def idle(self) -> bool:
        """Whether nobody has anything left to send."""
        return not any(self._rest)

    def next_packet(self, station: int, slot: int, now: int) -> bytes | None:
        """What the station sends next, in its slot: the rest of its message, else the begin of a new one."""
        rest = self._rest[station]
        if not rest and slot < self.last_slot:
            mine = self._of[station]
            mine.append(Sent(station, len(mine), now))
            self.sent.append(mine[-1])
            rest.extend(fragments(Message(len(mine) - 1, now, bytes(self.size))))
        return rest.popleft() if rest else None

    def give_up(self, station: int) -> None:
        """The station does not send the rest of its message."""
        self._rest[station].clear()

    def taken(self, source: int, order: int) -> None:
        """A packet of this source has got its place in the common order."""
        self._of[source][-1].orders.append(order)

    def deliver(self, station: int, packet: Packet, now: int) -> None:
        """A station takes a packet over; if that completes its message, the message is delivered."""
        early, self._last[station] = packet.order < self._last[station], max(self._last[station], packet.order)
        message = self._desks[station][packet.source].add(packet.load)
        if message is not None:
            sent = self._of[packet.source][message.number]
            sent.delivered[station] = now
            sent.out_of_order |= early
