"""Group communication against an adversary: every pattern of lost messages of a small group, and what comes of each.

In each slot the poll, the answer and the broadcast may be lost, the broadcast by each station for itself. Two adversaries:

- "anything": whatever the radio can do.
- "assumption": nothing is lost more than OD times in a row. Counted for itself: the exchange of poll and answer with one station;
  a packet to one station; a verdict on one packet to one station that waits for it, in the slots of one source.

Patterns that lead to the same situation are followed once and counted exactly, slot by slot; what cannot matter any more is left
out of a situation. Each one remembers how to get there with the fewest losses, so a failure is told by a pattern in which every
loss is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

from labkit.checks import whole
from labkit.network.groups import AccessPoint, Answer, Broadcast, Group, Offer, Packet, Station

Adversary = Literal["assumption", "anything"]
#: What can be lost in a slot: the poll, the answer, or the broadcast on its way to the station of that number.
Lost = frozenset[tuple[int, "int | Literal['poll', 'answer']"]]

#: How a pattern can end, the worst last.
OUTCOMES = ("delivered by all", "delivered by none", "delivered by those who stayed", "disagreement")


@dataclass(frozen=True)
class Turn:
    """One slot as it was played.

    Attributes:
        slot: which. answer: what the station said; None if it heard no poll. heard: whether the access point got that.
        said: the broadcast. received: the stations that heard it.
        delivered: (station, packet), in order. left: stations that left the group in this slot, or after it, by their clock.
    """

    slot: int
    answer: Answer | None
    heard: bool
    said: Broadcast
    received: frozenset[int]
    delivered: tuple[tuple[int, Packet], ...]
    left: tuple[int, ...]


@dataclass(frozen=True)
class Found:
    """What all patterns of one group come to.

    Attributes:
        slots: length of the patterns. patterns: how many there are. situations: how many different ones were looked at.
        outcomes: for each of `OUTCOMES` how many patterns end there.
        losses: for each outcome that exists, the pattern with the fewest losses.
        latest: number of slots after the first offer at whose end the last delivery of all patterns takes place; None if there is
            none. latest_losses: the pattern with the fewest losses that has it.
    """

    group: Group
    slots: int
    patterns: int
    situations: int
    outcomes: Mapping[str, int]
    losses: Mapping[str, Lost]
    latest: int | None
    latest_losses: Lost


def play(group: Group, senders: int, lost: Lost, slots: int | None = None) -> tuple[Turn, ...]:
    """Play one pattern. The first `senders` stations offer a packet each, in their first slot: A, B, ..."""
    point, stations = _begin(group, senders)
    turns = []
    total = horizon(group, senders) if slots is None else slots
    for slot in range(total):
        source = slot % group.stations
        polled = (slot, "poll") not in lost
        answer = stations[source].answer(slot) if polled else None
        heard = polled and (slot, "answer") not in lost
        point, said = point.hear(slot, answer if heard else None).say(slot)
        received = frozenset(i for i in range(group.stations) if (slot, i) not in lost)
        before, delivered = [station.inside for station in stations], []
        for i in received:
            stations[i], news = stations[i].receive(said)
            delivered += [(i, packet) for packet in news]
        if slot == total - 1:
            for i, station in enumerate(stations):
                if station.inside and station.next < point.next:
                    stations[i], news = station.wait()
                    delivered += [(i, packet) for packet in news]
        left = tuple(i for i in range(group.stations) if before[i] and not stations[i].inside)
        turns.append(Turn(slot, answer, heard, said, received, tuple(delivered), left))
    return tuple(turns)


def horizon(group: Group, senders: int) -> int:
    """Slots after which everything is decided and told."""
    return group.bound_rounds * group.stations + senders - 1


def _begin(group: Group, senders: int) -> tuple[AccessPoint, list[Station]]:
    whole(senders, 1, "the number of senders", group.stations)
    offers = [Offer(0, i, bytes([65 + i])) if i < senders else None for i in range(group.stations)]
    return AccessPoint.begin(group), [Station(group, i, offer=offer) for i, offer in enumerate(offers)]


@dataclass(frozen=True, slots=True)
class _Side:
    """A station with what it has delivered, the stays that it has ended, and how often what concerns it was lost in a row."""

    station: Station
    delivered: tuple[int, ...] = ()
    begun: int = 0
    stays: tuple[tuple[int, int], ...] = ()
    debts: tuple[tuple[tuple, int], ...] = ()


#: A situation: the numbers of the access point and of each side in `_Search.things`.
Key = tuple[int, ...]
#: How a slot went: whether the access point got the answer, and which stations got the broadcast.
Went = tuple[bool, tuple[bool, ...]]


@dataclass(slots=True)
class _Way:
    """How a situation is reached: in how many ways, and the one with the fewest losses: how many, from where, and how."""

    count: int
    losses: int
    before: Key = ()
    went: Went = (True, ())


def every_pattern(
    group: Group, adversary: Adversary = "anything", senders: int = 1, watch: Callable[[range], Iterable[int]] = iter
) -> Found:
    """Look at all patterns of losses. Meant for 2 or 3 stations and an omission degree of 1 or 2.

    `watch` is given the slots and hands them out: for whoever shows how far the search is, or wants to end it.

    Raises:
        ValueError: an adversary that does not exist, or more senders than stations.
    """
    if adversary not in ("assumption", "anything"):
        raise ValueError(f"there is no adversary {adversary!r}; there are assumption, anything")
    point, stations = _begin(group, senders)
    slots = horizon(group, senders)
    search = _Search(group, adversary == "assumption", slots)
    start = tuple(search.number(thing) for thing in (point, *map(_Side, stations)))
    layers = [{start: _Way(1, 0)}]
    latest: tuple[int, int, Key, Went] | None = None
    for slot in watch(range(slots)):
        after: dict[Key, _Way] = {}
        for here, way in layers[-1].items():
            for there, ways, losses, went, delivers in search.steps(slot, here):
                total = way.losses + losses
                seen = after.get(there)
                if seen is None:
                    after[there] = _Way(way.count * ways, total, here, went)
                else:
                    seen.count += way.count * ways
                    if total < seen.losses:
                        seen.losses, seen.before, seen.went = total, here, went
                if delivers and (latest is None or latest[0] < slot or total < latest[1]):
                    latest = slot, total, here, went
        layers.append(after)
        search.forget()
    outcomes = dict.fromkeys(OUTCOMES, 0)
    fewest: dict[str, tuple[int, Key]] = {}
    for key, way in layers[-1].items():
        outcome = _outcome(search.things[key[0]], [search.things[side] for side in key[1:]])
        outcomes[outcome] += way.count
        if outcome not in fewest or way.losses < fewest[outcome][0]:
            fewest[outcome] = way.losses, key
    told = {outcome: _pattern(layers, fewest[outcome][1]) for outcome in OUTCOMES if outcome in fewest}
    late = _pattern(layers[: latest[0] + 1], latest[2]) | _lost(latest[0], latest[3]) if latest else frozenset()
    situations = sum(len(layer) for layer in layers)
    return Found(group, slots, sum(outcomes.values()), situations, outcomes, told, latest and latest[0] + 1, late)


def _pattern(layers: Sequence[Mapping[Key, _Way]], key: Key) -> Lost:
    """All losses on the way to a situation of the last layer."""
    found: Lost = frozenset()
    for slot in range(len(layers) - 2, -1, -1):
        way = layers[slot + 1][key]
        found |= _lost(slot, way.went)
        key = way.before
    return found


def _lost(slot: int, went: Went) -> Lost:
    heard, got = went
    return frozenset({(slot, i) for i, there in enumerate(got) if not there} | (set() if heard else {(slot, "answer")}))


class _Search:
    """The steps out of a situation. What becomes of one participant is worked out once for all situations of a slot.

    Attributes:
        things: all access points and sides that were met; they are dealt with by their numbers, as these are quick to compare.
    """

    def __init__(self, group: Group, assumption: bool, slots: int):
        self.group, self.assumption, self.slots = group, assumption, slots
        self.things: list[Any] = []
        self._numbers: dict[Any, int] = {}
        self.asked, self.point, self.side = cache(self._asked), cache(self._point), cache(self._side)

    def number(self, thing: Any) -> int:
        """The number of an access point, side, answer or broadcast; equal ones have the same."""
        found = self._numbers.setdefault(thing, len(self.things))
        if found == len(self.things):
            self.things.append(thing)
        return found

    def forget(self) -> None:
        """The slot is over."""
        for cached in (self.asked, self.point, self.side):
            cached.cache_clear()

    def steps(self, slot: int, key: Key) -> Iterator[tuple[Key, int, int, Went, bool]]:
        """Each situation after this slot, in how many ways it is reached, with how many losses, how, and if one delivers."""
        source = 1 + slot % self.group.stations
        for heard in (True, False):
            asked = self.asked(slot, key[source], heard)
            if asked is None:
                continue
            side, answer = asked
            after, said = self.point(slot, key[0], answer)
            found: list[tuple[Key, int, int, tuple[bool, ...], bool]] = [((after,), 1 if heard else 2, int(not heard), (), False)]
            for i, mine in enumerate(key[1:], 1):
                choices = self.side(side if i == source else mine, said)
                found = [
                    ((*there, to), ways * many, losses + (not got), (*gots, got), delivers or one)
                    for there, ways, losses, gots, delivers in found
                    for got, to, one, many in choices
                ]
            for there, ways, losses, gots, delivers in found:
                yield there, ways, losses, (heard, gots), delivers

    def _asked(self, slot: int, number: int, heard: bool) -> tuple[int, int | None] | None:
        """The side whose slot it is, after poll and answer, and the answer if it is heard; None if it must not be lost."""
        side = self.things[number]
        after = self._charged(side, [("exchange",)], heard)
        if after is None:
            return None
        return self.number(after), self.number(side.station.answer(slot)) if heard else None

    def _point(self, slot: int, number: int, answer: int | None) -> tuple[int, int]:
        """The access point after the slot, without what cannot matter any more, and what it says."""
        after, said = self.things[number].hear(slot, None if answer is None else self.things[answer]).say(slot)
        to_come = (self.slots - 1 - slot) // self.group.stations + 1  # exchanges with a station, at most
        silent = tuple(m if (m + to_come) * self.group.stations > self.group.life else 0 for m in after.missed)
        entries = tuple(e if e.verdict is None else replace(e, sent=0, holders=frozenset()) for e in after.entries)
        return self.number(replace(after, missed=silent, entries=entries)), self.number(said)

    def _side(self, number: int, saying: int) -> list[tuple[bool, int, bool, int]]:
        """What may become of a side in a broadcast: if it gets it, the side after, if that delivers, and in how many ways."""
        there, lost = (self._told(number, saying, got) for got in (True, False))
        assert there is not None, "what arrives is always allowed"
        if there == lost:
            return [(True, *there, 2)]
        return [(True, *there, 1)] + ([(False, *lost, 1)] if lost else [])

    def _told(self, number: int, saying: int, got: bool) -> tuple[int, bool] | None:
        """The side after the broadcast, and if it delivers something; None if the adversary must not lose it."""
        side, said = self.things[number], self.things[saying]
        station = side.station
        told = self._awaited(station, said)
        items: list[tuple] = [("verdict", o, said.slot % self.group.stations) for o in told if said.verdict(o) is not None]
        if said.packet is not None and all(said.packet.order != packet.order for packet in station.held):
            items.append(("packet", said.packet.order))
        charged = self._charged(side, items, got)
        if charged is None:
            return None
        if not got:
            return self.number(charged), False
        after, news = station.receive(said)
        begun, stays = side.begun, side.stays
        if station.inside and not after.inside:
            stays = (*stays, (begun, after.next))
        elif after.inside and not station.inside:
            begun = said.since[station.me] or 0
        held = {("packet", packet.order) for packet in after.held}
        debts = tuple(d for d in charged.debts if d[0] not in held and (d[0] == ("exchange",) or d[0][1] >= after.next))
        delivered = (*side.delivered, *(packet.order for packet in news))
        return self.number(_Side(after, delivered, begun, stays, debts)), bool(news)

    def _awaited(self, station: Station, said: Broadcast) -> Iterable[int]:
        """The packets on whose verdict the station waits, as far as it is told here: with the delivery "at once" only its own."""
        if self.group.delivery != "at once":
            return range(max(station.next, said.first), said.first + len(said.verdicts))
        number, order = said.taken[station.me]
        return [order] if station.offer is not None and station.offer.number == number and order >= said.first else []

    def _charged(self, side: _Side, items: list[tuple], through: bool) -> _Side | None:
        """The side with these items through, or lost once more; None if one of them was lost as often as it may be."""
        if not items or not self.assumption:
            return side
        debts = dict(side.debts)
        for item in items:
            count = debts.pop(item, 0) + 1
            if through:
                continue
            if count > self.group.omission_degree:
                return None
            debts[item] = count
        return replace(side, debts=tuple(sorted(debts.items())))


def _outcome(point: AccessPoint, sides: Sequence[_Side]) -> str:
    """How it ends, once everybody has waited long enough."""
    delivered, stays = [], []
    for side in sides:
        station, mine, ended = side.station, side.delivered, side.stays
        if station.inside and station.next < point.next:
            station, news = station.wait()
            mine = (*mine, *(packet.order for packet in news))
            if not station.inside:
                ended = (*ended, (side.begun, station.next))
        if station.inside:
            ended = (*ended, (side.begun, point.next))
        delivered.append(mine)
        stays.append(ended)
    orders = sorted({order for mine in delivered for order in mine})
    for mine, ended in zip(delivered, stays):
        if list(mine) != [order for order in orders if any(a <= order < b for a, b in ended)]:
            return "disagreement"
    if not orders:
        return "delivered by none"
    stayed = all(ended == ((0, point.next),) for ended in stays)
    return "delivered by all" if stayed else "delivered by those who stayed"
