"""Every pattern of losses of small groups: the rule holds against all of them, and the bound is reached."""

import random

import pytest

from labkit.network import DELIVERIES, OUTCOMES, Group, every_pattern, play
from labkit.network.adversary import horizon

ALL, NONE, LEFT, DISAGREE = OUTCOMES
SMALL = [(2, 1, 1), (2, 1, 2), (2, 2, 1), (3, 1, 1), (3, 2, 1)]  # stations, omission degree, senders


@pytest.mark.parametrize("stations, degree, senders", SMALL)
def test_within_the_assumption_all_deliver_and_the_bound_is_reached(stations, degree, senders):
    found = every_pattern(Group(stations, degree), "assumption", senders)
    assert found.outcomes[ALL] == found.patterns > 10**8
    assert found.latest == found.slots == horizon(found.group, senders)
    assert found.latest == found.group.bound_rounds * stations + senders - 1


@pytest.mark.parametrize("stations, degree, senders", SMALL)
def test_whatever_is_lost_nobody_disagrees(stations, degree, senders):
    found = every_pattern(Group(stations, degree), "anything", senders)
    assert found.patterns == (3 * 2**stations) ** found.slots, "poll lost, answer lost or neither; each station hears it or not"
    assert found.outcomes[DISAGREE] == 0
    assert all(found.outcomes[outcome] > 0 for outcome in (ALL, NONE, LEFT))
    assert found.latest is not None and found.latest <= found.slots


@pytest.mark.parametrize("delivery", ["at once", "silence is no", "silence is yes"])
def test_every_other_delivery_fails(delivery):
    found = every_pattern(Group(2, 1, delivery), "anything")
    assert found.outcomes[DISAGREE] > 0
    turns = play(found.group, 1, found.losses[DISAGREE])
    per_station = [[packet.order for turn in turns for who, packet in turn.delivered if who == i] for i in (0, 1)]
    assert per_station[0] != per_station[1]


def test_the_search_ends_soon_for_stations_that_hand_on_at_once():
    """They wait for no verdict but the one on their own packet: were all of them counted, it would take minutes."""
    found = every_pattern(Group(3, 2, "at once"), "assumption")
    assert found.situations < 40_000
    assert found.outcomes[ALL] == found.patterns and found.latest < found.slots


def test_at_once_breaks_the_order_even_within_the_assumption():
    found = every_pattern(Group(2, 1, "at once"), "assumption", 2)
    assert found.outcomes[DISAGREE] > 0 and len(found.losses[DISAGREE]) == 1
    turns = play(found.group, 2, found.losses[DISAGREE])
    orders = [[packet.load for turn in turns for who, packet in turn.delivered if who == i] for i in (0, 1)]
    assert sorted(orders[0]) == sorted(orders[1]) and orders[0] != orders[1]


def _got(group: Group, lost: frozenset) -> list[bool]:
    """Which stations deliver the packet of station 0."""
    who = {i for turn in play(group, 1, lost) for i, _ in turn.delivered}
    return [i in who for i in range(group.stations)]


@pytest.mark.parametrize("delivery", DELIVERIES)
def test_shares_agree_with_patterns_drawn_at_random(delivery):
    """All patterns are equally likely here: poll, answer or neither lost, one in three each; each reception one in two."""
    group, rng, draws = Group(2, 1, delivery), random.Random(3), 2000
    found, all_got = every_pattern(group), 0
    for _ in range(draws):
        lost: set = {(slot, what) for slot in range(found.slots) if (what := rng.choice(["poll", "answer", None]))}
        lost |= {(slot, i) for slot in range(found.slots) for i in (0, 1) if rng.random() < 0.5}
        all_got += all(_got(group, frozenset(lost)))
    share = found.outcomes[ALL] / found.patterns
    if delivery == "agreed":
        assert all_got / draws == pytest.approx(share, abs=0.03)
    else:  # both have it, but one may have left in between, or the order may be wrong
        assert all_got / draws >= share - 0.03


def test_the_pattern_with_the_fewest_losses_is_one():
    """Each of its losses is needed: without it the pattern ends otherwise."""
    found = every_pattern(Group(2, 1, "silence is no"))
    lost = found.losses[DISAGREE]
    assert sorted(_got(found.group, lost)) == [False, True]
    assert all(sum(_got(found.group, lost - {one})) != 1 for one in lost)


def test_the_worst_case_is_played_to_its_last_slot():
    found = every_pattern(Group(2, 1), "assumption")
    turns = play(found.group, 1, found.latest_losses)
    assert turns[-1].slot + 1 == found.latest and turns[-1].delivered[-1][0] == 1
    assert not any(turn.left for turn in turns)


@pytest.mark.parametrize(
    "arguments, words", [((Group(2, 1), "nobody"), "no adversary 'nobody'"), ((Group(2, 1), "anything", 3), "senders is 3")]
)
def test_bad_questions_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        every_pattern(*arguments)
