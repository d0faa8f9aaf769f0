"""Clock synchronisation: what holds for every setting, how good the bound is, and what happens beyond its assumption."""

from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
import pytest

from labkit.network import Clock, Independent, Member, Rule, Scripted, precision_bound, synchronise
from tests.network.many import many

MS, S = 1_000_000, 1_000_000_000


def at_most_in_a_row(most, seed, share=0.7):
    """Random loss that never takes more than `most` messages of a pair in a row."""
    patterns = {}

    def lost(sender, receiver, n):
        if receiver not in patterns:
            row, pattern = 0, []
            for draw in np.random.default_rng([seed, receiver]).random(200):
                row = row + 1 if draw < share and row < most else 0
                pattern.append(row > 0)
            patterns[receiver] = pattern
        return patterns[receiver][n]

    return Scripted(lost)


@dataclass(frozen=True)
class Setting:
    """Everything a run depends on."""

    ppm: tuple[float, ...]
    offsets_ms: tuple[int, ...]
    wander: float
    reading_ns: int
    jitter_ns: int
    rule: Rule
    seed: int

    def members(self):
        return [
            Member(Clock(ppm, offset * MS, self.wander, self.reading_ns, [self.seed, i]))
            for i, (ppm, offset) in enumerate(zip(self.ppm, self.offsets_ms))
        ]

    def run(self, rounds=30, loss=None):
        loss = loss or at_most_in_a_row(self.rule.omission_degree, self.seed)
        until = rounds * self.rule.interval_ns
        return synchronise(self.members(), self.rule, until, loss, jitter_ns=self.jitter_ns, seed=self.seed)


def drawn_setting(rng, *modes):
    stations = rng.randint(2, 4)
    return Setting(
        tuple(rng.choices([-200, -50, -1.5, 0, 2.14, 50, 200], k=stations)),
        tuple(rng.randint(-300, 300) for _ in range(stations)),
        rng.choice([0, 0, 0.5, 20]),
        rng.choice([0, 100, 20_000]),
        rng.choice([0, 100, 50_000]),
        Rule(rng.choice([100, 500, 1000, 3000]) * MS, rng.randint(1, 4), rng.choice(modes)),
        rng.randint(0, 10_000),
    )


@many(lambda rng: (drawn_setting(rng, "rate", "jump"),))
def test_the_precision_stays_below_its_bound_while_no_more_than_od_are_lost_in_a_row(drawn):
    run = drawn.run()
    assert run.kept()
    assert sum(tally.without_common for tally in run.tallies) == 0
    if run.settled_ns is not None:
        assert run.precision() <= run.bound_ns


def goes_steadily(drawn, loss):
    run = drawn.run(rounds=16, loss=Independent(loss))
    rng = np.random.default_rng(drawn.seed)
    for station, clock in enumerate(run.virtual):
        times, ahead = run.deviation(station)
        steps, gained = np.diff(times), np.diff(times + ahead)
        assert np.all(gained >= 0.48 * steps - 2) and np.all(gained <= 1.52 * steps + 2)
        for bend in (*clock.bends(), *rng.integers(0, run.until_ns, 20).tolist()):
            before, here, after = (clock.time(max(0, int(bend) + d)) for d in (-1, 0, 1))
            # 2 ns are at most 3 of the local clock, whose reading is rounded; the correction adds half of these, rounded up
            assert before <= here <= after <= before + 3 + 2


@many(lambda rng: (drawn_setting(rng, "rate", "drift"), rng.choice([0.0, 0.5, 0.9, 1.0])))
def test_a_virtual_clock_never_goes_back_and_never_jumps(drawn, loss):
    goes_steadily(drawn, loss)


def test_a_virtual_clock_that_gains_5_ns_in_2_does_not_jump():
    goes_steadily(Setting((-200, 200, -200, -200), (0, -227, 0, 0), 0.5, 0, 0, Rule(500 * MS, 3, "rate"), 1275), 0.5)


# ------------------------------------------------------------------------------------------------ how good the bound is


def worst_gaps(od):
    """Every round heard is followed by OD that are lost."""
    return Scripted(lambda sender, receiver, n: n % (od + 1) != 0)


@pytest.mark.parametrize("mode", ["rate", "jump"])
@pytest.mark.parametrize("od", [1, 2, 5])
def test_drift_and_losses_come_close_to_the_bound(mode, od):
    members = [Member(Clock(ppm)) for ppm in (0, 100, -100)]
    run = synchronise(members, Rule(S, od, mode), 60 * S, worst_gaps(od))
    assert 0.95 * run.bound_ns < run.precision() <= run.bound_ns


def test_reading_errors_come_close_to_the_bound():
    """The master reads early in even rounds and late in odd ones; one slave hears the even ones, one the odd ones."""
    clocks = [Clock(ppm, reading_ns=20_000) for ppm in (0, 1, -1)]
    for clock, wrong in zip(clocks, ([20_000, -20_000], [-20_000], [20_000])):
        clock._readings = cycle(wrong)
    loss = Scripted(lambda sender, receiver, n: n % 2 != receiver - 1)
    run = synchronise([Member(clock) for clock in clocks], Rule(S, 1), 60 * S, loss)
    assert 0.95 * run.bound_ns < run.precision() <= run.bound_ns


def test_without_losses_rate_costs_one_interval_of_age_on_average_and_nothing_in_the_worst_case():
    worst, mean = {}, {}
    for mode in ("jump", "rate"):
        run = synchronise([Member(Clock(0)), Member(Clock(10))], Rule(S, 1, mode), 100 * S)
        times, apart = run.spread(10 * S)
        worst[mode] = apart.max()
        even = np.arange(10 * S, 100 * S, S // 50)
        mean[mode] = np.interp(even, times, apart).mean()
    assert worst["jump"] == pytest.approx(20_000, rel=0.01) and worst["rate"] == pytest.approx(20_000, rel=0.01)
    assert mean["jump"] == pytest.approx(15_000, rel=0.02) and mean["rate"] == pytest.approx(19_700, rel=0.02)


# ----------------------------------------------------------------------------------------------- beyond the assumption


def lost_in_a_row(first, count):
    return Scripted(lambda sender, receiver, n: first <= n < first + count)


def test_od_losses_in_a_row_cost_no_correction_and_one_more_costs_the_next_indication():
    found = {}
    for count in (0, 2, 3):
        run = synchronise([Member(Clock(0)), Member(Clock(10))], Rule(S, 2), 30 * S, lost_in_a_row(10, count))
        found[count] = run.tallies[1]
        assert run.lost(1).tolist() == list(range(10, 10 + count)) and run.longest_gap(1) == count
        assert run.kept() == (count < 3)
    assert [found[count].without_common for count in (0, 2, 3)] == [0, 0, 1]
    assert [len(found[count].rounds) - found[count].corrected for count in (0, 2, 3)] == [1, 1, 2]


def test_after_too_many_losses_the_second_indication_heard_brings_the_clock_back():
    run = synchronise([Member(Clock(0)), Member(Clock(100))], Rule(S, 1), 60 * S, lost_in_a_row(10, 20))
    assert run.precision(12 * S, 31 * S) > run.bound_ns  # on its own for 20 rounds and one more
    assert run.precision(33 * S) <= run.bound_ns  # heard rounds 30 and 31, through before 32


def test_a_master_that_dies_leaves_clocks_that_part_at_their_own_rates():
    members = [Member(Clock(0), leaves_ns=20 * S), Member(Clock(30)), Member(Clock(-20))]
    run = synchronise(members, Rule(S, 1), 120 * S)
    assert run.precision(5 * S, 19 * S) <= run.bound_ns
    _, apart = run.spread(25 * S)
    assert (apart[-1] - apart[0]) / 95 == pytest.approx(50_000, rel=0.01)  # 50 ppm against each other
    estimated = synchronise(members, Rule(S, 1, "drift"), 120 * S)
    assert estimated.precision(25 * S) < 1_000  # constant rates: the estimate goes on


def test_a_station_that_joins_late_has_the_common_time_after_its_second_indication():
    members = [Member(Clock(0)), Member(Clock(10)), Member(Clock(-10, offset_ns=50 * MS), joins_ns=20 * S)]
    run = synchronise(members, Rule(S, 1), 60 * S)
    assert 21 * S < run.settled_ns < 24 * S
    assert run.precision() <= run.bound_ns < run.precision(20 * S)


def test_a_large_offset_is_made_up_at_half_speed():
    run = synchronise([Member(Clock(0)), Member(Clock(0, offset_ns=-5 * S))], Rule(S, 1), 60 * S)
    assert run.settled_ns == pytest.approx(11 * S, abs=1.01 * S)
    assert run.precision() < 10


def test_a_station_that_falls_silent_counts_no_longer():
    members = [Member(Clock(0)), Member(Clock(10)), Member(Clock(300), leaves_ns=20 * S)]
    run = synchronise(members, Rule(S, 1), 60 * S)
    assert run.precision(25 * S) < 30_000 < run.precision(5 * S)


def test_loss_of_everything_is_reported():
    run = synchronise([Member(Clock(0)), Member(Clock(10))], Rule(S, 1), 100 * S, Independent(1.0))
    assert (
        run.settled_ns is None
        and run.tallies[1].rounds == []
        and run.tallies[1].corrected == 0
        and run.longest_gap(1) == 100
        and not run.kept()
    )
    assert (run.counts.sent, run.counts.received, run.counts.lost) == (100, 0, 100)
    assert run.precision() == pytest.approx(1 * MS, rel=0.001)


def test_a_gap_at_the_end_counts_and_what_was_sent_to_a_station_that_had_left_does_not():
    members = [Member(Clock(0)), Member(Clock(10)), Member(Clock(10), leaves_ns=15 * S)]
    run = synchronise(members, Rule(S, 1), 20 * S, lost_in_a_row(12, 100))
    assert run.lost(1).tolist() == list(range(12, 20)) and run.lost(2).tolist() == [12, 13, 14]


def test_no_synchronisation_sends_nothing():
    run = synchronise([Member(Clock(0)), Member(Clock(2.14))], Rule(S, 1, "none"), 1100 * S)
    assert run.counts.sent == 0 and run.bound_ns is None
    assert run.precision() == pytest.approx(2_354_000, abs=2)


def test_estimated_drift_takes_constant_rates_out():
    members = [Member(Clock(ppm)) for ppm in (0, 50, -50)]
    rate, drift = (synchronise(members, Rule(S, 1, mode), 60 * S).precision(20 * S) for mode in ("rate", "drift"))
    assert drift < 10 < 190_000 < rate


def test_the_same_seed_is_the_same_run():
    drawn = Setting((0, 20, -20), (0, 5, 9), 1, 1000, 1000, Rule(S, 1), 7)
    one, two, other = (replace(drawn, seed=seed).run(loss=Independent(0.3)).precision() for seed in (7, 7, 8))
    assert one == two != other


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Rule(0), "interval in ns is 0"),
        (lambda: Rule(S, 0), "omission degree is 0"),
        (lambda: Rule(S, 1, "leap"), "corrected by 'leap'"),
        (lambda: Member(Clock(), joins_ns=5, leaves_ns=5), "leaves, in ns, is 5"),
        (lambda: synchronise([Member(Clock())], Rule(), S), "1 station"),
        (lambda: synchronise([Member(Clock())] * 2, Rule(), 0), "length of the run in ns is 0"),
        (lambda: synchronise([Member(Clock())] * 2, Rule(MS), S, delay_ns=MS), "delay in ns is 1000000"),
        (lambda: precision_bound(Rule(MS), 0, jitter_ns=MS), "too short for a reception jitter"),
        (lambda: precision_bound(Rule(MS), 0, reading_ns=MS), "too short to correct"),
    ],
)
def test_what_cannot_be_synchronised_is_refused_by_name(make, word):
    with pytest.raises(ValueError, match=word):
        make()
