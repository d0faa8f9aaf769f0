"""Group communication against an adversary: every pattern of lost messages of a small group, and what comes of each.

In each slot the poll, the answer and the broadcast may be lost, the broadcast by each station for itself. Two adversaries:

- "anything": whatever the radio can do.
- "assumption": nothing is lost more than OD times in a row. Counted for itself: the exchange of poll and answer with one station;
  a packet to one station; a verdict on one packet to one station, in the slots of one source.

Patterns that lead to the same situation are followed once and counted exactly, slot by slot; what cannot matter any more is left
out of a situation. Each one remembers how to get there with the fewest losses, so a failure is told by a pattern in which every
loss is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Literal

from labkit.checks import whole
from labkit.network.groups import AccessPoint, Answer, Broadcast, Group, Offer, Packet, Station

Adversary = Literal["assumption", "anything"]
#: What can be lost in a slot: the poll, the answer, or the broadcast on its way to the station of that number.
Lost = frozenset[tuple[int, "int | Literal['poll', 'answer']"]]

#: How a pattern can end, the worst last.
OUTCOMES = ("delivered by all", "delivered by none", "one has left, and knows it", "disagreement")


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


Key = tuple[AccessPoint, tuple[_Side, ...]]


def every_pattern(group: Group, adversary: Adversary = "anything", senders: int = 1) -> Found:
    """Look at all patterns of losses. Meant for 2 or 3 stations and an omission degree of 1 or 2.

    Raises:
        ValueError: an adversary that does not exist, or more senders than stations.
    """
    if adversary not in ("assumption", "anything"):
        raise ValueError(f"there is no adversary {adversary!r}; there are assumption, anything")
    point, stations = _begin(group, senders)
    slots = horizon(group, senders)
    search = _Search(group, adversary == "assumption", slots)
    start: Key = point, tuple(_Side(station) for station in stations)
    layers: list[dict[Key, tuple[int, int, Key | None, Lost]]] = [{start: (1, 0, None, frozenset())}]
    latest: tuple[int, int, Key, Lost] | None = None
    for slot in range(slots):
        after: dict[Key, tuple[int, int, Key | None, Lost]] = {}
        for here, (count, losses, _, _) in layers[-1].items():
            for there, ways, lost, delivers in search.steps(slot, here):
                seen = after.get(there)
                total = losses + len(lost)
                if seen is None or total < seen[1]:
                    after[there] = (count * ways + (seen[0] if seen else 0), total, here, lost)
                else:
                    after[there] = (seen[0] + count * ways, *seen[1:])
                if delivers and (latest is None or (slot, -total) > (latest[0], -latest[1])):
                    latest = slot, total, here, lost
        layers.append(after)
        search.forget()
    outcomes = dict.fromkeys(OUTCOMES, 0)
    fewest: dict[str, tuple[int, Key]] = {}
    for key, (count, losses, _, _) in layers[-1].items():
        outcome = _outcome(key)
        outcomes[outcome] += count
        if outcome not in fewest or losses < fewest[outcome][0]:
            fewest[outcome] = losses, key
    told = {outcome: _pattern(layers, len(layers) - 1, fewest[outcome][1]) for outcome in OUTCOMES if outcome in fewest}
    situations = sum(len(layer) for layer in layers)
    late = _pattern(layers, latest[0], latest[2]) | latest[3] if latest else frozenset()
    return Found(group, slots, sum(outcomes.values()), situations, outcomes, told, latest and latest[0] + 1, late)


def _pattern(layers: list[dict[Key, tuple[int, int, Key | None, Lost]]], layer: int, key: Key | None) -> Lost:
    """All losses on the way to a situation."""
    found: set = set()
    while layer and key is not None:
        _, _, key, lost = layers[layer][key]
        found |= lost
        layer -= 1
    return frozenset(found)


class _Search:
    """The steps out of a situation. What a station makes of a broadcast is worked out once for all situations of a slot."""

    def __init__(self, group: Group, assumption: bool, slots: int):
        self.group, self.assumption, self.slots = group, assumption, slots
        self.point = cache(self._point)
        self.side = cache(self._side)

    def forget(self) -> None:
        """The slot is over."""
        self.point.cache_clear()
        self.side.cache_clear()

    def steps(self, slot: int, key: Key) -> Iterator[tuple[Key, int, Lost, bool]]:
        """Each situation after this slot, in how many ways it is reached, one way's losses, and if something is delivered."""
        point, sides = key
        source = slot % self.group.stations
        answer = sides[source].station.answer(slot)
        for heard in (True, False):
            asked = self._charged(sides[source], [("exchange",)], heard)
            if asked is None:
                continue
            after, said = self.point(slot, point, answer if heard else None)
            choices = []
            for i, side in enumerate(sides):
                mine = asked if i == source else side
                both = ((got, self.side(mine, said, got)) for got in (True, False))
                choices.append([(got, *found) for got, found in both if found is not None])
            exchange: Lost = frozenset() if heard else frozenset({(slot, "answer")})
            for chosen in product(*choices):
                lost = exchange | {(slot, i) for i, (got, _, _) in enumerate(chosen) if not got}
                yield (after, tuple(c[1] for c in chosen)), 1 if heard else 2, lost, any(c[2] for c in chosen)

    def _point(self, slot: int, point: AccessPoint, answer: Answer | None) -> tuple[AccessPoint, Broadcast]:
        """The access point after the slot, without what cannot matter any more, and what it says."""
        after, said = point.hear(slot, answer).say(slot)
        to_come = (self.slots - 1 - slot) // self.group.stations + 1  # exchanges with a station, at most
        silent = tuple(m if (m + to_come) * self.group.stations > self.group.life else 0 for m in after.missed)
        entries = tuple(e if e.verdict is None else replace(e, sent=0, holders=frozenset()) for e in after.entries)
        return replace(after, missed=silent, entries=entries), said

    def _side(self, side: _Side, said: Broadcast, got: bool) -> tuple[_Side, bool] | None:
        """The station after the broadcast, and if it delivers something; None if the adversary must not lose it."""
        station = side.station
        told = range(max(station.next, said.first), said.first + len(said.verdicts))
        items: list[tuple] = [("verdict", o, said.slot % self.group.stations) for o in told if said.verdict(o) is not None]
        if said.packet is not None and all(said.packet.order != packet.order for packet in station.held):
            items.append(("packet", said.packet.order))
        charged = self._charged(side, items, got)
        if charged is None:
            return None
        if not got:
            return charged, False
        after, news = station.receive(said)
        begun, stays = side.begun, side.stays
        if station.inside and not after.inside:
            stays = (*stays, (begun, after.next))
        elif after.inside and not station.inside:
            begun = said.since[station.me] or 0
        delivered = (*side.delivered, *(packet.order for packet in news))
        held = {packet.order for packet in after.held}
        debts = tuple(
            d
            for d in charged.debts
            if d[0] == ("exchange",) or (d[0][1] >= after.next and (d[0][0] == "verdict" or d[0][1] not in held))
        )
        return _Side(after, delivered, begun, stays, debts), bool(news)

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


def _outcome(key: Key) -> str:
    """How it ends, once everybody has waited long enough."""
    point, sides = key
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
    if any(ended != ((0, point.next),) for ended in stays):
        return "one has left, and knows it"
    return "delivered by all" if orders else "delivered by none"
