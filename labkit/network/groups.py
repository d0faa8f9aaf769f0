"""Group communication with an access point: all stations deliver the same packets in the same order. The protocol, no radio.

One *slot* belongs to each station in turn, a *round* is a slot of each. In a slot the access point polls the station; the station
answers with a packet, if it has one, and with its acknowledgements; the access point broadcasts the packet, and with it its
verdicts on those of before. Every packet gets a number that is its place in the common order. With n stations and the omission
degree OD, counted from the slot in which a packet is broadcast first:

- The packet is broadcast in the slot of its source, in OD + 1 rounds at most. An acknowledgement says which packets one holds.
- The access point alone decides, once. *Accepted*: every station of the group has acknowledged it. *Rejected*: (2 OD + 1) n - 1
  slots have gone by without that.
- From then on the verdict is part of every broadcast, until (3 OD + 1) n - 1 slots have gone by: the packet's `life`.
- A station delivers a packet when it knows that it was accepted, and has delivered or dropped all before it. **The rule**: one
  that cannot know any more (the verdict is no longer told), or that has not got what was accepted, delivers nothing from there
  on. It has left the group, knows it, and asks to be let in again.
- An offer that the access point has not heard within OD rounds after the first one is withdrawn. So a packet is delivered
  within 4 OD + 1 rounds after the begin of the slot in which it is offered first, or never.
- Who does not answer for a packet's life is taken out of the group; until then nothing is accepted. Who joins gets the number of
  the packet from which on it belongs.

Why it holds. *Whatever is lost*: there is one verdict, only the access point gives it, and stations act on it in the order of the
numbers, without a gap. So what a station delivers, from the packet with which it joined to the one with which it leaves, is
exactly what was accepted. *As long as the assumption holds* (not lost more than OD times in a row: the exchange of poll and
answer with a station; a packet to a station; a verdict to a station, in the broadcasts of one slot), every packet is accepted and
nobody leaves: all hold it after OD rounds, the last acknowledgement comes OD rounds later, in time for the verdict, and everybody
hears that in another OD rounds. More is impossible: if anything may be lost, no protocol can promise agreement of *all* within a
bound (two generals). What can be promised is that who is not in agreement knows.

`labkit.network.adversary` tries all this with every pattern of losses. The other `DELIVERIES` do without the rule.

Source 2, section 6.1.3 (the outline); M. Mock, E. Nett, S. Schemmer, EDCC-3 (1999) and IEEE Trans. Computers 52(2) 2003 (the idea
that decisions travel redundantly). Bounds and the way back into the group are this model's. Left out: a failure of the access
point, and clocks so bad that a station answers in a slot that is not its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from labkit.checks import whole

Delivery = Literal["agreed", "at once", "silence is no", "silence is yes"]
DELIVERIES: dict[Delivery, str] = {
    "agreed": "on the verdict, or leave",
    "at once": "as soon as it is there",
    "silence is no": "verdict; unknown: rejected",
    "silence is yes": "verdict; unknown: accepted",
}
MOST_STATIONS = 64
MOST_DEGREE = 32


@dataclass(frozen=True)
class Group:
    """The constants that all know. ValueError for fewer than 2 stations, a degree below 1, or a delivery that does not exist."""

    stations: int
    omission_degree: int
    delivery: Delivery = "agreed"

    def __post_init__(self) -> None:
        whole(self.stations, 2, "the number of stations", MOST_STATIONS)
        whole(self.omission_degree, 1, "the omission degree", MOST_DEGREE)
        if self.delivery not in DELIVERIES:
            raise ValueError(f"there is no delivery {self.delivery!r}; there are {', '.join(DELIVERIES)}")

    @property
    def offered(self) -> int:
        """Slots after which an offer is withdrawn, counted from the first."""
        return self.omission_degree * self.stations

    @property
    def undecided(self) -> int:
        """Slots from the first broadcast to the last moment of the verdict."""
        return (2 * self.omission_degree + 1) * self.stations - 1

    @property
    def life(self) -> int:
        """Slots from the first broadcast to the last one that tells the verdict."""
        return (3 * self.omission_degree + 1) * self.stations - 1

    @property
    def bound_rounds(self) -> int:
        """Rounds from the begin of the slot in which a packet is offered first, until it is delivered or never will be."""
        return 4 * self.omission_degree + 1


def reaches_all(loss: float, omission_degree: int, receivers: int) -> float:
    """How likely a packet that is sent OD + 1 times reaches all receivers, if each of them loses each time with the same chance.

    (1 - p^(OD+1))^m: how far the assumption of an omission degree carries, for this part of it, on a channel without memory.
    """
    return float((1 - loss ** (omission_degree + 1)) ** receivers)


@dataclass(frozen=True, slots=True)
class Offer:
    """What a station wants to send: its own number of it, the slot in which it is offered first, and the bytes."""

    number: int
    slot: int
    load: bytes


@dataclass(frozen=True, slots=True)
class Answer:
    """A station's answer to a poll: the numbers of the packets it holds, its offer, and whether it asks to be let in."""

    holds: tuple[int, ...]
    offer: Offer | None
    joins: bool


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet in the common order: its number there, who sent it, that station's own number, and the bytes."""

    order: int
    source: int
    number: int
    load: bytes


@dataclass(frozen=True, slots=True)
class Broadcast:
    """What the access point says in a slot.

    Attributes:
        slot: which.
        first: order of the oldest packet whose verdict is told.
        verdicts: of it and all later ones; None: not yet decided.
        since: for each station the order from which on it belongs to the group, None if it does not.
        taken: for each station its own number and the order of the last packet taken from it, (-1, -1) if none was.
        packet: the one that is broadcast, if any.
    """

    slot: int
    first: int
    verdicts: tuple[bool | None, ...]
    since: tuple[int | None, ...]
    taken: tuple[tuple[int, int], ...]
    packet: Packet | None

    def verdict(self, order: int) -> bool | None:
        """What it says of a packet that is not older than `first`."""
        at = order - self.first
        return self.verdicts[at] if at < len(self.verdicts) else None


@dataclass(frozen=True, slots=True)
class Entry:
    """A packet in the book of the access point: when it was broadcast first, how often, who holds it, and the verdict."""

    packet: Packet
    slot: int
    sent: int
    holders: frozenset[int]
    verdict: bool | None = None

    def after(self, sent: int | None = None, holders: frozenset[int] | None = None, verdict: bool | None = None) -> Entry:
        """With what is new; made without `replace`, which takes several times as long."""
        return Entry(
            self.packet, self.slot, sent or self.sent, holders or self.holders, self.verdict if verdict is None else verdict
        )


@dataclass(frozen=True, slots=True)
class AccessPoint:
    """What the access point knows; every change makes a new one. In each slot it first `hear`s, then it `say`s.

    Attributes:
        first: order of the oldest entry. entries: all packets that are not older than their life, in order.
        since, taken: as in `Broadcast`. missed: rounds in which a station has not answered, up to now.
    """

    group: Group = field(compare=False, repr=False)
    first: int
    entries: tuple[Entry, ...]
    since: tuple[int | None, ...]
    taken: tuple[tuple[int, int], ...]
    missed: tuple[int, ...]

    @classmethod
    def begin(cls, group: Group, late: tuple[int, ...] = ()) -> AccessPoint:
        """At slot 0. All stations belong to the group but those that are `late`."""
        n = group.stations
        return cls(group, 0, (), tuple(None if i in late else 0 for i in range(n)), ((-1, -1),) * n, (0,) * n)

    @property
    def next(self) -> int:
        """Order of the packet that comes next."""
        return self.first + len(self.entries)

    def hear(self, slot: int, answer: Answer | None) -> AccessPoint:
        """The answer of the station whose slot it is; None if there was none."""
        group, source = self.group, slot % self.group.stations
        old, count = 0, len(self.entries)
        while old < count and self.entries[old].slot + group.life < slot:  # they are in order of their slots
            old += 1
        first, entries, since, taken = self.first + old, list(self.entries[old:]), self.since, self.taken
        missed = _put(self.missed, source, 0 if answer else self.missed[source] + 1)
        if answer is None:
            if missed[source] * group.stations > group.life:
                since = _put(since, source, None)
        elif answer.joins:
            since = _put(since, source, self.next)
        else:
            for order in answer.holds:
                if order >= first and entries[order - first].verdict is None:
                    entry = entries[order - first]
                    entries[order - first] = entry.after(holders=entry.holders | {source})
        entries = [self._decided(entry, slot, since) if entry.verdict is None else entry for entry in entries]
        offer = answer.offer if answer and since[source] is not None else None
        if (
            offer is not None
            and offer.number > taken[source][0]
            and not any(entry.packet.source == source and entry.verdict is None for entry in entries)
        ):
            taken = _put(taken, source, (offer.number, self.next))
            packet = Packet(self.next, source, offer.number, offer.load)
            entries.append(self._decided(Entry(packet, slot, 0, frozenset({source})), slot, since))
        return AccessPoint(group, first, tuple(entries), since, taken, missed)

    def say(self, slot: int) -> tuple[AccessPoint, Broadcast]:
        """What it broadcasts in this slot."""
        source, packet, entries = slot % self.group.stations, None, self.entries
        for i, entry in enumerate(entries):
            if entry.packet.source == source and entry.verdict is None and entry.sent <= self.group.omission_degree:
                packet, entries = entry.packet, _put(entries, i, entry.after(sent=entry.sent + 1))
        verdicts = tuple(entry.verdict for entry in entries)
        after = self
        if packet is not None:
            after = AccessPoint(self.group, self.first, entries, self.since, self.taken, self.missed)
        return after, Broadcast(slot, self.first, verdicts, self.since, self.taken, packet)

    def _decided(self, entry: Entry, slot: int, since: tuple[int | None, ...]) -> Entry:
        """An entry without a verdict with its verdict, if there is one now."""
        needed = [i for i, order in enumerate(since) if order is not None and order <= entry.packet.order]
        if needed and entry.holders.issuperset(needed):
            return entry.after(verdict=True)
        return entry.after(verdict=False) if slot >= entry.slot + self.group.undecided else entry


@dataclass(frozen=True, slots=True)
class Station:
    """What a station knows; every change makes a new one.

    Attributes:
        me: its number, which is that of its slot in a round.
        inside: whether it belongs to the group, as far as it knows.
        next: order of the packet that it will deliver or drop next.
        held: packets that it has and that are not delivered or dropped yet; with the delivery "at once" those it has delivered.
        offer: what it wants to send or has sent, until it knows what has become of that.
    """

    group: Group = field(compare=False, repr=False)
    me: int
    inside: bool = True
    next: int = 0
    held: tuple[Packet, ...] = ()
    offer: Offer | None = None

    def answer(self, slot: int) -> Answer:
        """Its answer when it is polled in this slot."""
        if not self.inside:
            return Answer((), None, True)
        offer = self.offer
        if offer is not None:
            taken = any(packet.source == self.me and packet.number == offer.number for packet in self.held)
            if taken or slot - offer.slot > self.group.offered:
                offer = None
        return Answer(tuple(packet.order for packet in self.held), offer, False)

    def receive(self, said: Broadcast) -> tuple[Station, tuple[Packet, ...]]:
        """What it makes of a broadcast, and the packets that it delivers now, in order."""
        since = said.since[self.me]
        inside, after = self.inside and since is not None, self.next
        if since is not None and not inside and since >= after:
            inside, after = True, since  # a new stay in the group: it begins with that packet
        at_once = self.group.delivery == "at once"
        oldest = said.first if at_once else after
        known = {packet.order: packet for packet in self.held if packet.order >= oldest} if inside else {}
        new = self._news(said, after, known) if inside else ()
        if at_once:
            return self._after(said, inside, after, known), new
        delivered = []
        while inside and after < said.first + len(said.verdicts):
            verdict = said.verdict(after) if after >= said.first else self._guess()
            if after >= said.first and verdict is None:
                break
            packet = known.pop(after, None)
            if self.group.delivery == "agreed" and (verdict is None or (verdict and packet is None)):
                inside, known = False, {}
                break
            if verdict and packet is not None:
                delivered.append(packet)
            after += 1
        return self._after(said, inside, after, known), tuple(delivered)

    def wait(self) -> tuple[Station, tuple[Packet, ...]]:
        """What it concludes, by its own clock, from having heard nothing for a packet's life; and what it delivers then."""
        if self.group.delivery == "agreed":
            return replace(self, inside=False, held=()), ()
        if self.group.delivery == "silence is yes":
            return replace(self, held=()), tuple(packet for packet in self.held if packet.order >= self.next)
        return self, ()

    def _after(self, said: Broadcast, inside: bool, after: int, known: dict[int, Packet]) -> Station:
        """It after a broadcast; made without `replace`, which takes as long as all the rest of a reception."""
        return Station(self.group, self.me, inside, after, tuple(known.values()), self._pending(said))

    def _guess(self) -> bool | None:
        """What it believes of a verdict that is no longer told."""
        return {"silence is no": False, "silence is yes": True}.get(self.group.delivery)

    def _news(self, said: Broadcast, least: int, known: dict[int, Packet]) -> tuple[Packet, ...]:
        """Take over into `known` what it did not hold: the packet that is broadcast, or its own, once it knows its order."""
        number, order = said.taken[self.me]
        new: tuple[Packet, ...] = ()
        if self.offer is not None and number == self.offer.number and order >= least and order not in known:
            known[order] = Packet(order, self.me, number, self.offer.load)
            new = (known[order],)
        packet = said.packet
        if packet is not None and packet.order >= least and packet.order not in known:
            known[packet.order] = packet
            new = (*new, packet)
        return new

    def _pending(self, said: Broadcast) -> Offer | None:
        """Its offer, unless that is decided or withdrawn now."""
        if self.offer is None:
            return None
        number, order = said.taken[self.me]
        if number < self.offer.number:
            return self.offer if said.slot - self.offer.slot <= self.group.offered else None
        return self.offer if order >= said.first and said.verdict(order) is None else None


def _put(items: tuple, at: int, item: object) -> tuple:
    """The tuple with another item at one place."""
    return (*items[:at], item, *items[at + 1 :])
