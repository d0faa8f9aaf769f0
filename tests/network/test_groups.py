"""Group communication: what no loss can break, what the assumption guarantees, and what it costs to do without."""

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from labkit.network import (
    AccessPoint,
    Broadcast,
    GilbertElliott,
    Group,
    Independent,
    Offer,
    Packet,
    Scripted,
    Station,
    converse,
    reaches_all,
)
from tests.network.many import many


class Played:
    """A group whose stations always have something to send, slot by slot; the ledger of what everybody does."""

    def __init__(self, group: Group, late: tuple[int, ...] = ()):
        n = group.stations
        self.group, self.point = group, AccessPoint.begin(group, late)
        self.stations = [Station(group, i, i not in late) for i in range(n)]
        self.numbers = [0] * n
        self.offered: dict[tuple[int, int], int] = {}
        self.verdicts: dict[int, bool] = {}
        self.delivered: list[list] = [[] for _ in range(n)]  # packets
        self.stays = [[[0, 0]] if i not in late else [] for i in range(n)]
        self.left = 0

    def turn(self, slot: int, heard: bool, received: list[bool], fresh: bool = True) -> None:
        source = slot % self.group.stations
        mine = self.stations[source]
        if fresh and mine.inside and mine.offer is None:
            load = bytes([source, self.numbers[source] % 256])
            self.stations[source] = mine = replace(mine, offer=Offer(self.numbers[source], slot, load))
            self.offered[source, self.numbers[source]] = slot
            self.numbers[source] += 1
        self.point, said = self.point.hear(slot, mine.answer(slot) if heard else None).say(slot)
        for entry in self.point.entries:
            if entry.verdict is not None:
                assert self.verdicts.setdefault(entry.packet.order, entry.verdict) == entry.verdict, "a verdict has changed"
        for i, got in enumerate(received):
            if got:
                self.receive(i, slot, said)

    def receive(self, i: int, slot: int, said) -> None:
        was = self.stations[i]
        self.stations[i], news = was.receive(said)
        assert self.stations[i].next >= was.next, "what is settled stays settled"
        for packet in news:
            assert packet.load == bytes([packet.source, packet.number % 256])
            age = (
                slot + 1 - self.offered[packet.source, packet.number]
            )  # the packet is there at the end of this slot at the latest
            assert age <= self.group.bound_rounds * self.group.stations
        self.delivered[i] += news
        if self.stations[i].inside and not was.inside:
            self.stays[i].append([said.since[i], said.since[i]])
        if self.stays[i]:
            self.stays[i][-1][1] = max(self.stays[i][-1][1], self.stations[i].next)
        self.left += was.inside and not self.stations[i].inside

    def check_agreement(self) -> None:
        """Between joining and leaving a station has delivered exactly what was accepted, in order, and once."""
        for mine, stays in zip(self.delivered, self.stays):
            owed = [order for order in sorted(self.verdicts) if self.verdicts[order] and any(a <= order < b for a, b in stays)]
            assert [packet.order for packet in mine] == owed
            assert all(a <= b for a, b in stays) and all(one[1] <= other[0] for one, other in pairwise(stays))


LOSSES = [0.0, 0.02, 0.1, 0.3, 0.6, 0.9, 1.0]


def drawn_group(rng) -> Group:
    return Group(rng.randint(2, 5), rng.randint(1, 3))


def drawn_losses(rng):
    group = drawn_group(rng)
    late = tuple(i for i in range(1, group.stations) if rng.random() < 0.2)
    return group, late, rng.choice(LOSSES), rng.choice(LOSSES), rng.randint(3, 15), rng.getrandbits(32)


@many(drawn_losses)
def test_whatever_is_lost_nobody_disagrees_and_nothing_comes_late(group, late, up, down, rounds, seed):
    played, slots = Played(group, late), rounds * group.stations
    rng = np.random.default_rng(seed)
    heard, received = rng.random(slots) >= up, rng.random((slots, group.stations)) >= down
    for slot, (answered, got) in enumerate(zip(heard.tolist(), received.tolist())):
        played.turn(slot, answered, got)
    played.check_agreement()


class WithinAssumption:
    """Losses as wild as drawn, but never more than OD in a row of an exchange with a station, or in the broadcasts of a slot."""

    def __init__(self, group: Group, loss: float, rng: random.Random):
        self.group, self.loss, self.rng = group, loss, rng
        self.row: dict[tuple[str, int, int], int] = {}

    def through(self, kind: str, source: int, station: int) -> bool:
        key = kind, source, station
        lost = self.rng.random() < self.loss and self.row.get(key, 0) < self.group.omission_degree
        self.row[key] = self.row.get(key, 0) + 1 if lost else 0
        return not lost


@many(lambda rng: (drawn_group(rng), rng.choice(LOSSES), rng.randint(2, 9), rng.getrandbits(32)))
def test_within_the_assumption_everything_is_delivered_by_all_in_time(group, loss, talk, seed):
    played, radio, n = Played(group), WithinAssumption(group, loss, random.Random(seed)), group.stations
    for slot in range((talk + group.bound_rounds) * n):
        source = slot % n
        heard = radio.through("exchange", source, source)
        played.turn(slot, heard, [radio.through("broadcast", source, i) for i in range(n)], slot < talk * n)
    assert played.left == 0
    for mine in played.delivered:
        assert sorted((packet.source, packet.number) for packet in mine) == sorted(played.offered)
    played.check_agreement()


def test_without_losses_a_packet_is_delivered_within_a_round():
    played = Played(Group(4, 2))
    for slot in range(40):
        played.turn(slot, True, [True] * 4)
    mine = played.delivered[0]
    assert [packet.order for packet in mine] == list(range(37)), "one per slot, accepted three slots later"


def test_one_loss_too_many_loses_a_packet_for_all_and_nobody_leaves():
    """Station 2 never hears the packet of station 0, and hears everything else."""
    played = Played(Group(3, 1))
    for slot in range(15):
        packet_goes_out = slot in (0, 3)
        played.turn(slot, True, [True, True, not packet_goes_out], fresh=slot == 0)
    assert played.verdicts == {0: False} and played.delivered == [[], [], []] and played.left == 0


def test_who_does_not_hear_the_verdict_leaves_and_comes_back():
    group = Group(2, 1)
    played = Played(group)
    for slot in range(30):
        deaf = 1 < slot <= 1 + group.life + 1
        played.turn(slot, True, [True, not deaf], fresh=slot % 2 == 0)
    assert played.left == 1 and played.stations[1].inside
    assert len(played.stays[1]) == 2
    played.check_agreement()
    assert 0 < len(played.delivered[1]) < len(played.delivered[0])


def test_who_has_not_got_what_was_accepted_leaves():
    """It cannot happen to one that stays in the group, as its acknowledgement is needed; a safeguard, so it is asked directly."""
    said = Broadcast(3, 0, (True, True), (0, 0), ((0, 1), (-1, -1)), None)
    station, news = Station(Group(2, 1), 1, held=(Packet(1, 0, 0, b"later"),)).receive(said)
    assert not station.inside and station.next == 0 and news == () and station.answer(5).joins


@pytest.mark.parametrize(
    "arguments, words",
    [
        ((1, 1), "number of stations is 1"),
        ((65, 1), "number of stations is 65"),
        ((3, 0), "omission degree is 0"),
        ((3, 1.5), "omission degree is 1.5"),
        ((3, 1, "never"), "no delivery 'never'"),
    ],
)
def test_what_is_no_group_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        Group(*arguments)


# --------------------------------------------------------------------------------------------------------- on the radio

TABLE = [  # loss in %, omission degree, receivers: share printed in the fact sheet
    (5, 1, 3, 0.99252),
    (5, 1, 10, 0.97528),
    (10, 1, 3, 0.97030),
    (10, 1, 10, 0.90438),
    (10, 2, 3, 0.99700),
    (10, 2, 10, 0.99004),
    (20, 2, 3, 0.97619),
    (20, 2, 10, 0.92282),
    (20, 4, 3, 0.99904),
    (20, 4, 10, 0.99680),
]


@pytest.mark.parametrize("loss, degree, receivers, share", TABLE)
def test_how_far_an_omission_degree_carries(loss, degree, receivers, share):
    assert reaches_all(loss / 100, degree, receivers) == pytest.approx(share, abs=5e-6)
    lost = np.random.default_rng(1).random((40_000, receivers, degree + 1)) < loss / 100
    assert np.mean(~lost.all(axis=2).any(axis=1)) == pytest.approx(share, abs=0.005)


def drawn_talk(rng):
    late, silent = ({rng.randint(0, 1): rng.randint(0, 6)} if rng.random() < 0.5 else {} for _ in range(2))
    return (
        rng.choice(["plain", "acknowledged", "agreed"]),
        rng.randint(2, 4),
        rng.randint(1, 3),
        rng.choice([0, 722, 1483, 1484, 3000]),
        rng.choice([0.0, 0.1, 0.3, 0.6]),
        rng.choice([1, 5, 30]),
        rng.randint(0, 10_000),
        late,
        silent,
    )


@many(drawn_talk)
def test_on_the_radio_nothing_is_late_and_a_group_agrees(way, stations, degree, size, loss, longer, seed, late, silent):
    said = converse(way, stations, degree, size, 5, 20_000_000, GilbertElliott.bursts(loss, longer), seed, late, silent)
    assert said.latest_ns() is None or said.latest_ns() <= said.bound_ns
    assert said.to_all() + said.to_none() + said.smaller_group() + said.disagreements() == len(said.sent)
    if way == "agreed":
        assert said.disagreements() == 0
    if loss == 0 and not late and not silent:
        assert said.to_all() == len(said.sent) > 0


def test_at_once_is_not_in_order_and_not_for_all():
    said = converse("at once", 4, 1, 722, 60, loss=Independent(0.3), seed=1)
    assert any(m.out_of_order for m in said.sent) and any(m.delivered and not m.out_of_order and not m.agreed for m in said.sent)
    agreed = converse("agreed", 4, 1, 722, 60, loss=Independent(0.3), seed=1)
    assert agreed.disagreements() == 0 and agreed.to_all() > 0


def test_a_radio_that_loses_everything_is_reported():
    said = converse("agreed", 3, 2, loss=Independent(1.0))
    assert said.to_none() == len(said.sent) == 3 and said.left == 3
    assert said.latest_ns() is None


def test_bursts_break_the_assumption_more_often_than_the_same_loss_without_memory():
    shares = {
        longer: np.mean(
            [_share(converse("agreed", 4, 2, 722, 40, loss=GilbertElliott.bursts(0.1, longer), seed=s)) for s in range(8)]
        )
        for longer in (1, 30)
    }
    assert shares[1] > 0.98 and shares[30] < 0.85


def _share(said) -> float:
    return said.to_all() / len(said.sent)


def test_a_silent_station_costs_the_group_its_patience_and_no_more():
    said = converse("agreed", 4, 1, 722, 40, silent={2: 10})
    lost = [message for message in said.sent if not message.delivered]
    began = {message.offered_ns // said.round_ns for message in lost}
    assert lost and began <= set(range(9, 9 + 2 * 4 + 1)), "messages are lost until it is taken out, 3 OD + 1 rounds later"
    after = [message for message in said.sent if message.offered_ns // said.round_ns > 20]
    assert after and all(message.delivered.keys() == {0, 1, 3} for message in after)
    assert said.disagreements() == 0


def test_a_late_station_is_let_in_and_then_gets_everything():
    said = converse("agreed", 3, 1, 722, 30, late={2: 10})
    early, later = ([m for m in said.sent if (m.offered_ns // said.round_ns < 10) == early] for early in (True, False))
    assert early and all(m.delivered.keys() == {0, 1} for m in early if m.offered_ns // said.round_ns < 9)
    assert all(m.delivered.keys() == {0, 1, 2} for m in later if m.offered_ns // said.round_ns > 12)
    assert any(m.source == 2 for m in later)
    assert said.disagreements() == 0


def test_one_lost_acknowledgement_costs_one_round():
    """Nothing is lost but the third transmission between access point and station 1: its answer in the first round."""
    whole, hurt = (
        converse("agreed", 2, 1, 100, 1, 20_000_000, Scripted(lambda a, b, n, lost=lost: (a, b, n) == lost))
        for lost in (None, (2, 1, 2))
    )
    for i in (0, 1):
        assert hurt.sent[0].delivered[i] - whole.sent[0].delivered[i] == pytest.approx(20_000_000, rel=0.05)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"way": "shout"}, "no way 'shout'"),
        ({"size": -1}, "size of a message in bytes is -1"),
        ({"size": 1 << 21}, "size of a message"),
        ({"rounds": 0}, "number of rounds is 0"),
        ({"round_ns": 0}, "length of a round in ns is 0"),
        ({"late": {5: 1}}, "late or silent is 5"),
        ({"silent": {0: -1}}, "its round is -1"),
    ],
)
def test_bad_settings_are_refused_by_name(change, words):
    with pytest.raises(ValueError, match=words):
        converse(**{"way": "agreed", "stations": 3, "omission_degree": 1, **change})


def test_a_megabyte_goes_through():
    said = converse("agreed", 2, 1, 1_000_000, 1, loss=Independent(0.0))
    assert said.to_all() == len(said.sent) == 2
