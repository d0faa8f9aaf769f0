"""Notebook 07: published answers, what analysis promises against every simulation, and the exercises."""

import numpy as np
import pytest
from hypothesis import given, settings

from labkit.data import published_table
from labkit.experiments import acceptance
from labkit.experiments.acceptance import LOADS, TESTS, AcceptanceCurves, ExpectedTime, check_expected_time, half
from labkit.experiments.schedulability import (
    HORIZON,
    MS,
    ResponseBounds,
    Schedules,
    StarvedPair,
    check_beyond_the_bounds,
    check_fed_pair,
    check_rm_misses,
    misses,
)
from labkit.scheduler.analysis import UndecidedError, taft_test, verdict
from labkit.scheduler.tasksets import PeriodicTask
from labkit.trace import jobs


def test_buttazzos_set_misses_at_7_under_rm_and_never_under_edf():
    result = Schedules().run()
    table = jobs(result["rm"].trace).frame()
    first = table[table["missed"]].sort_values("deadline").iloc[0]
    assert (first["task"], first["job"], first["deadline"], first["completion"]) == ("task 2", 0, 7 * MS, 8 * MS)
    assert not len(result["edf"].misses) and not len(result["taft"].misses)
    assert len(result["rm"].misses) == table["missed"].sum()


@settings(max_examples=30)
@given(Schedules.strategy())
def test_all_policies_get_the_same_jobs_and_an_accepted_taft_set_gives_every_part_its_expected_time(experiment):
    result = experiment.run()
    releases = {policy: [r[0] for r in history.trace.rows("release").tolist()] for policy, history in result.items()}
    assert releases["rm"] == releases["edf"] == releases["taft"]
    if taft_test(experiment.pairs()).accepted:
        table = jobs(result["taft"].trace)
        ecet = np.array([p.ecet for p in experiment.pairs()])[table.task]
        assert (table.main >= ecet)[table.abort >= 0].all()


def test_random_times_stay_within_c_and_have_the_shape_of_the_contour_filter():
    rng = np.random.default_rng(1)
    from labkit.experiments.schedulability import draw

    times = draw("filter", 10_000, 20_000, rng)
    assert times.max() <= 10_000 and np.mean(times < 3600) == pytest.approx(0.9, abs=0.01)
    assert draw("uniform", 10, 5000, rng).min() == 1 and draw("uniform", 10, 5000, rng).max() == 10


@pytest.mark.parametrize("seed", range(12))
def test_released_together_and_taking_c_the_first_jobs_reach_the_bound_of_rm(seed):
    experiment = ResponseBounds(seed=seed, tasks=4, utilization=70)
    result = experiment.run()
    assert result.longest == result.bound
    spread = ResponseBounds(seed=seed, tasks=4, utilization=70, start="spread", least=50).run()
    assert all(r <= b for r, b in zip(spread.longest, spread.bound, strict=True))


@settings(max_examples=30)
@given(ResponseBounds.strategy())
def test_no_response_exceeds_its_bound(experiment):
    result = experiment.run()
    assert all(b is None or r <= b for r, b in zip(result.longest, result.bound, strict=True))


def test_the_sum_is_not_enough():
    result = StarvedPair().run()
    assert StarvedPair().starved(result)[0] == (9, "task 1", 0)
    assert StarvedPair().measure("sum of (ECET + EP) / T") == pytest.approx(52 / 55)


@settings(max_examples=40)
@given(StarvedPair.strategy())
def test_starvation_is_exactly_what_the_safe_test_excludes(experiment):
    """With every main part aborted and released together the plan test is exact in both directions."""
    verdict = taft_test(experiment.pairs())
    assert verdict.accepted or verdict.exact
    short = bool(experiment.starved(experiment.run()))
    assert not (verdict.accepted and short)
    assert verdict.accepted or short or misses(experiment.run()) or experiment.measure("sum of (ECET + EP) / T") > 1


def test_the_run_times_have_the_two_published_numbers():
    table = (
        published_table("diplom_measurements.csv")
        .query("experiment == 'contour filter'")
        .set_index("quantity")["value"]
        .astype(float)
    )
    assert (table["longest run time (one scanner)"], table["90 percent of run times below"]) == (
        acceptance.WCET,
        acceptance.BELOW,
    )
    times = np.concatenate([ExpectedTime(seed=s).run().times.ravel() for s in range(5)])
    assert np.mean(times < acceptance.BELOW) == pytest.approx(acceptance.SHARE, abs=0.01)
    assert times.max() <= acceptance.WCET


@settings(max_examples=15)
@given(ExpectedTime.strategy())
def test_an_accepted_set_of_filters_aborts_only_what_takes_longer_than_expected(experiment):
    result = experiment.run()
    if taft_test(experiment.pairs()).accepted:
        assert not misses(result.taft)
        table = jobs(result.taft).frame()
        longer = {(f"filter {i + 1}", k) for i, k in np.argwhere(result.times > experiment.ECET).tolist()}
        aborted = table[table["abort"].notna()]
        assert set(zip(aborted["task"], aborted["job"], strict=True)) <= longer


def test_acceptance_curves_are_ordered_as_theory_demands():
    result = AcceptanceCurves(sets=40, EP=10, spread=20).run().share
    ll, hyperbolic, exact, edf, safe, plain = (np.array(result[name]) for name in TESTS)
    assert (ll <= hyperbolic).all() and (hyperbolic <= exact).all() and (exact <= edf).all() and (safe <= plain).all()
    assert (safe < plain).any(), "here the safe test must be stricter than the sum"
    assert edf[LOADS.index(100)] == 100 and edf[LOADS.index(101)] == 0


def test_sets_that_the_safe_test_gives_up_are_counted_and_shown_and_no_step_is_long(monkeypatch):
    """These curves took 53 s: intervals without end at a sum within a hair of 1."""
    hard = AcceptanceCurves(tasks=2, ECET=30, EP=20, spread=21, sets=60, seed=44)
    spent = []
    spend = verdict.Budget.spend
    monkeypatch.setattr(verdict.Budget, "spend", lambda budget, steps: (spent.append(steps), spend(budget, steps)))
    result = hard.run()
    assert 0 < sum(spent) < verdict.MAX_STEPS  # for all points together

    def give_up(pairs):
        raise UndecidedError("too hard")

    monkeypatch.setattr(acceptance, "taft_demand_test", give_up)
    given_up = hard.run()
    shown = {metric.name: metric.value for metric in hard.metrics(given_up)}
    assert shown["undecided"] == round(sum(result.share["TAFT, sum (not safe)"]) / 100 * hard.sets) > result.undecided
    assert not any(given_up.share["TAFT, safe test"])


def test_half_is_the_last_load_before_the_fall():
    assert half([100.0] * 3 + [40.0] + [60.0] * (len(LOADS) - 4)) == LOADS[2]
    assert half([10.0] * len(LOADS)) is None and half([100.0] * len(LOADS)) == LOADS[-1]


def test_exercises_ask_the_model():
    assert not check_rm_misses(Schedules()).solved  # 97 %
    assert not check_rm_misses(Schedules(C2=2)).solved  # RM meets all
    assert not check_rm_misses(Schedules(work="uniform")).solved
    assert check_rm_misses(Schedules(C1=4, T1=8, C2=5, T2=12)).solved
    assert not check_beyond_the_bounds([PeriodicTask("a", 1, 4), PeriodicTask("b", 2, 8), PeriodicTask("c", 4, 20)]).solved
    assert not check_beyond_the_bounds([PeriodicTask("a", 2, 5), PeriodicTask("b", 3, 7), PeriodicTask("c", 4, 24)]).solved
    assert check_beyond_the_bounds([PeriodicTask("a", 1, 4), PeriodicTask("b", 2, 8), PeriodicTask("c", 8, 16)]).solved
    assert not check_fed_pair(StarvedPair()).solved
    assert not check_fed_pair(StarvedPair(EP2=0)).solved
    assert not check_fed_pair(StarvedPair(EP2=2, T2=20)).solved
    assert sum(check_fed_pair(StarvedPair(EP2=ep)).solved for ep in range(7)) == 1
    assert check_beyond_the_bounds([PeriodicTask("a", 2, 5), PeriodicTask("b", 2, 7), PeriodicTask("c", 6, 20)]).solved
    assert not check_expected_time(ExpectedTime()).solved
    assert not check_expected_time(ExpectedTime(filters=5, period=210, ECET=42)).solved  # 5 * 42.5 > 210
    assert not check_expected_time(ExpectedTime(filters=5, period=300, ECET=40)).solved  # longer than need be
    assert not check_expected_time(ExpectedTime(filters=5, period=160, ECET=31)).solved  # too many aborts
    assert check_expected_time(ExpectedTime(filters=5, period=210, ECET=41)).solved


def test_answers_of_the_wrong_kind_get_a_sentence():
    for check in (check_rm_misses, check_beyond_the_bounds, check_fed_pair, check_expected_time):
        for answer in (None, 3, "Schedules()", [1, 2], [(2, 5), (2, 7), (6, 20)]):
            told = check(answer)
            assert not told.solved and "the answer is" in told.text
    assert "leave EP=0.5" in check_expected_time(ExpectedTime(filters=5, period=210, ECET=41, EP=0)).text
    assert "same name" in check_beyond_the_bounds([PeriodicTask("a", 1, 4), PeriodicTask("a", 2, 8)]).text
    assert not check_fed_pair(StarvedPair(EP2=6)).solved


def test_a_task_that_there_is_not_has_no_lane():
    two, three = (Schedules(C3=c) for c in (0, 6))
    for experiment, rows in ((two, 2), (three, 3)):
        axes = [axis for name, axis in experiment.figure(experiment.run())["layout"].items() if name.startswith("yaxis")]
        assert [axis["range"] for axis in axes] == [[0.5 - rows, 0.5]] * 3


def test_the_horizon_shows_a_whole_number_of_seconds():
    assert HORIZON % 1000 == 0  # the metrics say so
