"""A broadcast medium on SimPy, in whole nanoseconds: one station sends, all others receive, or lose it, each for itself.

A transmission takes its time on the air (`frame_ns` plus `byte_ns` for each byte) and waits while another one is there: carrier
sense, first come, first served. Its end reaches everybody after the same `delay_ns`, as the ways in a hall are short. Then each
receiver takes a moment of its own until it notices, from 0 to `jitter_ns`, uniform: interrupt latency. That is all in which
receptions of one broadcast differ, and why it pays to compare reception times.

Left out: collisions, hidden stations, the back-off of the medium access, unicast acknowledgements of the link layer, and messages
that arrive damaged (their checksum makes them lost ones).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import simpy

from labkit.checks import whole
from labkit.network.clocks import drawn
from labkit.network.loss import Channel, Independent, Loss

#: Called at the instant of the reception with the message and its sender.
Receive = Callable[[Any, int], None]


@dataclass
class Counts:
    """What went over a radio: broadcasts sent, their bytes, time on the air in ns, receptions that succeeded and that failed."""

    sent: int = 0
    bytes: int = 0
    air_ns: int = 0
    received: int = 0
    lost: int = 0


class Radio:
    """The medium that some stations share; stations are numbers from 0.

    Args:
        env: the SimPy environment; its time is in ns..
        loss: who loses what (`labkit.network.loss`).
        delay_ns: from the end of a transmission to its reception.
        jitter_ns: largest extra time until a receiver notices.
        byte_ns, frame_ns: time on the air for a byte, and for what stands around them. 0: messages take none.
        seed: every pair of sender and receiver has random numbers of its own, so that one station more changes nothing elsewhere.

    Attributes:
        env: as given.
        counts: what has been sent so far. A broadcast that is on its way counts as sent, not yet as received.
        busy_until: when the medium is free.
    """

    def __init__(
        self,
        env: simpy.Environment,
        loss: Loss | None = None,
        delay_ns: int = 0,
        jitter_ns: int = 0,
        byte_ns: int = 0,
        frame_ns: int = 0,
        seed: int = 0,
    ):
        self.env, self.loss = env, loss or Independent()
        self.delay_ns = whole(delay_ns, 0, "the radio's delay in ns")
        self.jitter_ns = whole(jitter_ns, 0, "the radio's jitter in ns")
        self.byte_ns = whole(byte_ns, 0, "the radio's time for a byte in ns")
        self.frame_ns = whole(frame_ns, 0, "the radio's time for a frame in ns")
        self.seed = whole(seed, 0, "the radio's seed")
        self.counts = Counts()
        self.busy_until = 0
        self._receivers: dict[int, Receive] = {}
        self._channels: dict[tuple[int, int], Channel] = {}
        self._jitters: dict[int, Iterator[int]] = {}

    def attach(self, station: int, receive: Receive) -> None:
        """Switch a station on: from now on `receive(message, sender)` is called for all it hears."""
        self._receivers[whole(station, 0, "the station")] = receive

    def detach(self, station: int) -> None:
        """Switch a station off: it hears nothing any more, not even what is on its way."""
        self._receivers.pop(station, None)

    def attach_only(self, receivers: Mapping[int, Receive]) -> None:
        """Switch these stations on, and off all others."""
        self._receivers = dict(receivers)

    def send(self, sender: int, message: Any, size: int = 0, echo: bool = False) -> int:
        """Broadcast a message of `size` bytes; with `echo` the sender hears it, too, without loss and with its own jitter.

        Returns the instant at which it leaves the air; who does not wait for it is queued behind it.
        """
        now = int(self.env.now)
        begin = max(now, self.busy_until)
        air = self.frame_ns + self.byte_ns * whole(size, 0, "the message's size in bytes")
        self.busy_until = begin + air
        self.counts.sent += 1
        self.counts.bytes += size
        self.counts.air_ns += air
        wait = begin + air + self.delay_ns - now
        reached = []
        for station in self._receivers:
            if station == sender:
                if echo:
                    reached.append(station)
            elif (self._channels.get((sender, station)) or self._channel(sender, station))():
                self.counts.lost += 1
            else:
                reached.append(station)
        if self.jitter_ns:
            for station in reached:
                self._deliver((station,), message, sender, wait + next(self._jitter(station)))
        elif reached:
            self._deliver(reached, message, sender, wait)
        return self.busy_until

    def _deliver(self, stations: Sequence[int], message: Any, sender: int, wait: int) -> None:
        """All of them notice at one instant, in this order: a single event, as there may be many."""

        def arrive(_: simpy.Event) -> None:
            for station in stations:
                receive = self._receivers.get(station)
                if receive is not None:
                    if station != sender:
                        self.counts.received += 1
                    receive(message, sender)

        event = self.env.timeout(wait)
        assert event.callbacks is not None, "a new event has its list of callbacks"
        event.callbacks.append(arrive)

    def _channel(self, sender: int, receiver: int) -> Channel:
        """A new one; `send` asks first whether there is one."""
        rng = np.random.default_rng([self.seed, sender, receiver])
        found = self._channels[sender, receiver] = self.loss.channel(sender, receiver, rng)
        return found

    def _jitter(self, station: int) -> Iterator[int]:
        if station not in self._jitters:
            self._jitters[station] = drawn([self.seed, station], 0, self.jitter_ns)
        return self._jitters[station]


def at(env: simpy.Environment, when: int, action: Callable[[], None]) -> None:
    """Have `action` called at the instant `when`, now at the earliest: a timer, without a process of its own."""
    event = env.timeout(max(0, when - env.now))
    assert event.callbacks is not None, "a new event has its list of callbacks"
    event.callbacks.append(lambda _: action())
