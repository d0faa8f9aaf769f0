"""What became of the messages of a group, whatever the protocol."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Sent:
    """A message and what became of it.

    Attributes:
        source, number: whose, and which of its messages.
        offered_ns: begin of the slot in which its first packet was offered first.
        orders: place in the common order of each of its packets that was taken; one is missing if nobody ever heard it.
        delivered: when each station that delivered it did so, in ns.
        on: the stations that were switched on all the time. owed: those of them that have to deliver it if anybody does.
        out_of_order: whether some station had delivered a later one before.
    """

    source: int
    number: int
    offered_ns: int
    orders: list[int] = field(default_factory=list)
    delivered: dict[int, int] = field(default_factory=dict)
    on: frozenset[int] = frozenset()
    owed: frozenset[int] = frozenset()
    out_of_order: bool = False

    @property
    def agreed(self) -> bool:
        """Whether all delivered it, in the common order, that had to, or nobody."""
        return not self.out_of_order and (not self.delivered or self.owed <= self.delivered.keys())


@dataclass(frozen=True)
class Conversation:
    """What a run of one protocol did.

    Attributes:
        sent: all messages, in the order in which they were offered.
        left: how often a station left the group, known to itself.
        round_ns: length of a round. bound_ns: latest delivery after the offer by analysis.
        air_ns, elapsed_ns: time on the air, and all time, of the rounds in which messages begin. transmissions: in all rounds.
    """

    sent: tuple[Sent, ...]
    left: int
    round_ns: int
    bound_ns: int
    air_ns: int
    elapsed_ns: int
    transmissions: int

    def to_all(self) -> int:
        """Messages that every station delivered which was switched on."""
        return sum(m.agreed and bool(m.delivered) and m.on <= m.delivered.keys() for m in self.sent)

    def to_none(self) -> int:
        """Messages that nobody delivered."""
        return sum(not m.delivered for m in self.sent)

    def disagreements(self) -> int:
        """Messages that one station delivered and another one did not that had to, or not in the same order."""
        return sum(not m.agreed for m in self.sent)

    def smaller_group(self) -> int:
        """Messages that all delivered that were in the group, but not all that were switched on."""
        return len(self.sent) - self.to_all() - self.to_none() - self.disagreements()

    def latest_ns(self) -> int | None:
        """Longest time from offer to delivery at some station; None if nothing was delivered."""
        return max((when - m.offered_ns for m in self.sent for when in m.delivered.values()), default=None)
