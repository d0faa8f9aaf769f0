"""Group communication as a service: hand over bytes, and every station gets them, in the same order, or none does."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

import simpy

from labkit.checks import whole
from labkit.network.fragments import HEADER, MOST_BYTES, Message, Reassembly, fragment_count, fragments
from labkit.network.groups import Group, Packet
from labkit.network.loss import Independent, Loss
from labkit.network.polling import BYTE_NS, FRAME_NS, GroupOnAir
from labkit.network.radio import Radio
from labkit.network.talk import Hall, Reciprocal, Steps

#: Called with the station that gets a message, the one it is from, the bytes, and the time in ns.
Deliver = Callable[[int, int, bytes, int], None]


class GroupMail:
    """The protocol of `labkit.network.groups` on a radio of its own, polling round after round.

    Args:
        group: its constants. size: bytes of the longest message.
        round_ns: length of a round; one that does not fit takes as long as it needs.
        deliver: called for every message that a station delivers, its own ones among them.
        loss, seed: who loses what.

    Attributes:
        round_ns: as it is. bound_ns: after the hand-over of a message to a station that has nothing else to send, it is delivered
            within that time or never.
        left: how often a station left the group.
    """

    late: Mapping[int, int] = {}

    def __init__(self, group: Group, size: int, round_ns: int, deliver: Deliver, loss: Loss | None = None, seed: int = 0):
        whole(round_ns, 1, "the length of a round in ns")
        count = fragment_count(whole(size, 0, "the size of a message in bytes"))
        n = group.stations
        self._size, self._deliver = size, deliver
        self._queues: list[deque[bytes]] = [deque() for _ in range(n)]
        self._numbers = [0] * n
        self._desks = [[Reassembly() for _ in range(n)] for _ in range(n)]
        self._env = simpy.Environment()
        radio = Radio(self._env, Reciprocal(loss or Independent()), 0, 0, BYTE_NS, FRAME_NS, seed)
        self._polls = GroupOnAir(group, Hall(n, radio), self)
        self._slot_ns = max(-(-round_ns // n), self._polls.slot_ns(min(MOST_BYTES, size + HEADER.size)))
        self.round_ns = self._slot_ns * n
        self.bound_ns = self.round_ns + self._polls.bound_ns(count, self._slot_ns)
        self._env.process(self._slots())

    @property
    def left(self) -> int:
        return self._polls.left

    def send(self, station: int, data: bytes) -> None:
        """Hand over a message. ValueError if it is longer than the longest."""
        if len(data) > self._size:
            raise ValueError(f"the message has {len(data)} bytes; at most {self._size} are allowed")
        self._queues[station].extend(fragments(Message(self._numbers[station], int(self._env.now), data)))
        self._numbers[station] += 1

    def run(self, until_ns: int) -> None:
        """Let time pass; deliveries are told on the way."""
        if until_ns > self._env.now:
            self._env.run(until=until_ns)

    def _slots(self) -> Steps:
        slot = 0
        while True:
            yield self._env.timeout(slot * self._slot_ns - self._env.now)
            yield from self._polls.turn(slot)
            slot += 1

    # What the protocol asks for: the packets of the stations.

    def on(self, station: int, slot: int) -> bool:
        return True

    def next_packet(self, station: int, slot: int, now: int) -> bytes | None:
        return self._queues[station].popleft() if self._queues[station] else None

    def taken(self, source: int, order: int) -> None:
        pass

    def give_up(self, station: int) -> None:
        self._queues[station].clear()

    def deliver(self, station: int, packet: Packet, now: int) -> None:
        message = self._desks[station][packet.source].add(packet.load)
        if message is not None:
            self._deliver(station, packet.source, message.data, now)
