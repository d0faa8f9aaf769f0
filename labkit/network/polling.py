"""Group communication on the radio, beside simpler ways: stations that always have something to say, and what becomes of it.

The access point has the number after the last station. It polls one station after the other, a round every `round_ns`; a round
that does not fit takes as long as it needs. A longer message goes as several packets (`labkit.network.fragments`), each offered
when its source knows what became of the one before. The `WAYS`:

- "plain": the access point repeats what it has heard, once.
- "acknowledged": it polls OD times more for what it does not hear, then asks each station whether it has got it, and repeats it
  for those who have not, OD times at most; all that at once.
- "at once": the protocol of `labkit.network.groups`, but stations deliver what they receive as soon as it is there.
- "agreed": the same with its rule.

A burst of loss hits what a station says and what it is told. Times for byte and frame are those of IEEE 802.11b at 11 Mbit/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import simpy

from labkit.checks import whole
from labkit.network.fragments import HEADER, MOST_BYTES, fragment_count
from labkit.network.groups import AccessPoint, Group, Offer, Packet, Station
from labkit.network.loss import Independent, Loss
from labkit.network.radio import Radio
from labkit.network.report import Conversation
from labkit.network.talk import Desk, Hall, Reciprocal, Steps, Talk

Way = Literal["plain", "acknowledged", "at once", "agreed"]
WAYS: dict[Way, str] = {
    "plain": "plain broadcast",
    "acknowledged": "each receiver acknowledges",
    "at once": "group without a verdict",
    "agreed": "group, all or nothing",
}
BYTE_NS = 727  # 11 Mbit/s
FRAME_NS = 230_000  # preamble 192 us, 34 bytes around the packet, the gap before it
SHORT = 8  # bytes of a poll, of an acknowledgement alone, and beside a packet of which nothing else is said
MOST_SIZE = 1 << 20
MOST_ROUNDS = 1_000_000


def converse(
    way: Way,
    stations: int,
    omission_degree: int,
    size: int = 722,
    rounds: int = 40,
    round_ns: int = 20_000_000,
    loss: Loss | None = None,
    seed: int = 0,
    late: Mapping[int, int] | None = None,
    silent: Mapping[int, int] | None = None,
) -> Conversation:
    """Let stations talk for some rounds, and go on until the last message is through.

    Args:
        size: bytes of each message. rounds: in which messages begin.
        late: station -> round in which it is switched on. silent: station -> round in which it falls silent for ever.

    Raises:
        ValueError: an unknown way, a number out of bounds, or a station that does not exist; names it.
    """
    if way not in WAYS:
        raise ValueError(f"there is no way {way!r} of talking; there are {', '.join(WAYS)}")
    group = Group(stations, omission_degree, "at once" if way == "at once" else "agreed")
    whole(size, 0, "the size of a message in bytes", MOST_SIZE)
    whole(rounds, 1, "the number of rounds", MOST_ROUNDS)
    whole(round_ns, 1, "the length of a round in ns", 1 << 50)
    on, off = _slots(late or {}, stations), _slots(silent or {}, stations)
    radio = Radio(simpy.Environment(), Reciprocal(loss or Independent()), 0, 0, BYTE_NS, FRAME_NS, seed)
    hall, talk = Hall(stations, radio), Talk(stations, size, rounds * stations, on, off)
    polls = GroupOnAir(group, hall, talk) if way in ("at once", "agreed") else _Simple(group, hall, talk, way == "acknowledged")
    load, count = min(MOST_BYTES, size + HEADER.size), fragment_count(size)
    slot_ns = max(-(-round_ns // stations), polls.slot_ns(load))
    spent = (0, 0)

    def slots() -> Steps:
        nonlocal spent
        env = radio.env
        for slot in range((rounds + count * group.bound_rounds + 1) * stations):
            yield env.timeout(slot * slot_ns - env.now)
            if slot == talk.last_slot:
                spent = radio.counts.air_ns, int(env.now)
            if slot >= talk.last_slot and talk.idle() and polls.idle():
                break
            yield from polls.turn(slot)

    radio.env.run(until=radio.env.process(slots()))
    polls.end()
    for message in talk.sent:
        slot = message.offered_ns // slot_ns
        end = slot + count * group.bound_rounds * stations
        message.on = frozenset(i for i in range(stations) if talk.on(i, slot) and talk.on(i, end))
        message.owed = message.on if len(message.orders) < count else message.on & polls.owed(message.orders)
    bound = polls.bound_ns(count, slot_ns)
    return Conversation(tuple(talk.sent), polls.left, slot_ns * stations, bound, *spent, radio.counts.sent)


def overhead(group: Group) -> tuple[int, int]:
    """Bytes that an answer has beside its packet, and a broadcast.

    An answer: its number, and a bit for each packet that is told of. A broadcast: its slot, the order of the oldest packet, two
    bits for each verdict; for each station the order from which on it belongs, and number and order of its last packet.
    """
    window = group.life + 1
    return 4 + -(-window // 8), 8 + -(-2 * window // 8) + 6 * group.stations


def _slots(rounds: Mapping[int, int], stations: int) -> dict[int, int]:
    """Rounds as slots; ValueError for a station that does not exist, or a negative round."""
    return {
        whole(station, 0, "a station that is late or silent", stations - 1): stations * whole(at, 0, "its round", MOST_ROUNDS)
        for station, at in rounds.items()
    }


class GroupOnAir:
    """The access point and the stations of `labkit.network.groups`, on the radio.

    Attributes:
        left: how often a station left the group.
        beside: see `overhead`.
    """

    def __init__(self, group: Group, hall: Hall, talk: Desk):
        self.group, self.hall, self.talk, self.left = group, hall, talk, 0
        self.point = AccessPoint.begin(group, tuple(talk.late))
        self.stations = [Station(group, i, i not in talk.late) for i in range(group.stations)]
        self.numbers = [0] * group.stations
        self.beside = overhead(group)
        self.heard = [0] * group.stations
        self.stays = [[(0, 0)] if i not in talk.late else [] for i in range(group.stations)]  # in the group: from, up to

    def slot_ns(self, load: int) -> int:
        """The longest slot: poll, answer, broadcast."""
        return 3 * FRAME_NS + (SHORT + sum(overhead(self.group)) + 2 * load) * BYTE_NS

    def bound_ns(self, count: int, slot_ns: int) -> int:
        """For messages of `count` packets: each is decided before the next one is offered."""
        return count * self.group.bound_rounds * self.group.stations * slot_ns

    def turn(self, slot: int) -> Steps:
        """One slot."""
        source, beside = slot % self.group.stations, self.beside
        self._clock(slot)
        answer = None
        station = self.stations[source]
        if self.talk.on(source, slot):
            if station.inside and station.offer is None:
                load = self.talk.next_packet(source, slot, self.hall.now)
                if load is not None:
                    station = self.stations[source] = replace(station, offer=Offer(self.numbers[source], slot, load))
                    self.numbers[source] += 1
            said = station.answer(slot)
            if (yield from self.hall.ask(source, SHORT, beside[0] + (len(said.offer.load) if said.offer else 0))):
                answer = said
        else:
            yield from self.hall.say(self.hall.access_point, SHORT, frozenset({source}))
        before = self.point.next
        self.point = self.point.hear(slot, answer)
        if self.point.next > before:
            self.talk.taken(source, before)
        self.point, broadcast = self.point.say(slot)
        size = beside[1] + (len(broadcast.packet.load) if broadcast.packet else 0)
        for i in (yield from self.hall.say(self.hall.access_point, size, self.hall.all_stations)):
            if self.talk.on(i, slot):
                self.heard[i] = slot
                self._became(i, broadcast.since[i], *self.stations[i].receive(broadcast))

    def idle(self) -> bool:
        """Whether everything is decided and told."""
        return not self.point.entries and all(station.offer is None for station in self.stations)

    def end(self) -> None:
        """Nobody will hear anything more."""
        for i, station in enumerate(self.stations):
            if station.inside and station.next < self.point.next:
                self._became(i, None, *station.wait())

    def owed(self, orders: list[int]) -> frozenset[int]:
        """The stations that were in the group for all packets of these orders; all of them if there is no verdict."""
        if self.group.delivery == "at once":
            return frozenset(range(self.group.stations))
        first, last = min(orders), max(orders)
        return frozenset(i for i, stays in enumerate(self.stays) if any(a <= first and last < b for a, b in stays))

    def _clock(self, slot: int) -> None:
        """Who has heard nothing for too long knows that it has missed something."""
        for i, station in enumerate(self.stations):
            if station.inside and slot - self.heard[i] > self.group.life and self.talk.on(i, slot):
                self.heard[i] = slot
                self._became(i, None, *station.wait())

    def _became(self, i: int, since: int | None, station: Station, delivered: tuple[Packet, ...]) -> None:
        """What a station is now, what it delivers on the way, and since when it belongs to the group."""
        was, self.stations[i], stays = self.stations[i], station, self.stays[i]
        for packet in delivered:
            self.talk.deliver(i, packet, self.hall.now)
        if since is not None and not was.inside and since >= was.next:
            stays.append((since, since))
        if stays:
            stays[-1] = stays[-1][0], max(stays[-1][1], station.next)
        if was.inside and not station.inside:
            self.left += 1
            self.talk.give_up(i)


class _Simple:
    """Ways without memory: what is not through at the end of a slot is lost."""

    left = 0

    def __init__(self, group: Group, hall: Hall, talk: Talk, acknowledged: bool):
        self.group, self.hall, self.talk = group, hall, talk
        self.tries = 1 + group.omission_degree * acknowledged
        self.acknowledged, self.order = acknowledged, 0

    def slot_ns(self, load: int) -> int:
        """The longest slot: each poll, broadcast and question as often as allowed."""
        questions = 2 * (self.group.stations - 1) * self.acknowledged
        once = 3 * FRAME_NS + (3 * SHORT + 2 * load) * BYTE_NS + questions * (FRAME_NS + SHORT * BYTE_NS)
        return self.tries * once

    def bound_ns(self, count: int, slot_ns: int) -> int:
        """For messages of `count` packets: one in each round, and delivered within its slot."""
        return ((count - 1) * self.group.stations + 1) * slot_ns

    def turn(self, slot: int) -> Steps:
        """One slot."""
        source, hall = slot % self.group.stations, self.hall
        load = self.talk.next_packet(source, slot, hall.now) if self.talk.on(source, slot) else None
        for _ in range(self.tries):
            if load is None:
                yield from hall.say(hall.access_point, SHORT, frozenset({source}))
            elif (yield from hall.ask(source, SHORT, SHORT + len(load))):
                break
        else:
            return
        assert load is not None, "an answer has a packet"
        packet = Packet(self.order, source, slot, load)
        self.talk.taken(source, self.order)
        self.order += 1
        self.talk.deliver(source, packet, hall.now)
        have, wanted = {source}, {i for i in range(self.group.stations) if i != source}
        for _ in range(self.tries):
            for i in (yield from hall.say(hall.access_point, SHORT + len(load), hall.all_stations - have)):
                if self.talk.on(i, slot):
                    self.talk.deliver(i, packet, hall.now)
                    have.add(i)
            for i in sorted(wanted) if self.acknowledged else ():
                if i not in have:  # asked in vain
                    yield from hall.say(hall.access_point, SHORT, frozenset({i}))
                elif (yield from hall.ask(i, SHORT, SHORT)):
                    wanted.discard(i)
            if not wanted:
                break

    def idle(self) -> bool:
        """Nothing is ever under way between slots."""
        return True

    def end(self) -> None:
        """Nothing to do."""

    def owed(self, orders: list[int]) -> frozenset[int]:
        """All stations."""
        return frozenset(range(self.group.stations))
