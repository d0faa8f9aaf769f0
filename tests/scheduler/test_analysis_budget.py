"""Every analysis ends: exact for many tasks where sums suffice, and honestly undecided where it would take too long."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.scheduler import analysis, simulate
from labkit.scheduler.analysis import CriticalSection, UndecidedError, blocking_bounds, deadlock_locks, verdict
from labkit.scheduler.analysis.acceptance import accept_response_time
from labkit.scheduler.analysis.bounds import _within_liu_layland
from labkit.scheduler.analysis.shares import ONE, compared_to_one, product, total
from labkit.scheduler.tasksets import PeriodicTask, TaskPair

MANY = 2000


def many(count=MANY):
    """Tasks of all different periods and deadlines before their ends, 0.7 of the processor together."""
    periods = np.random.default_rng(1).integers(10**6, 10**8, count).tolist()
    return [PeriodicTask(f"t{i}", p * 7 // (10 * count), p, p * 19 // 20) for i, p in enumerate(periods)]


def steps_of(monkeypatch, analyse, *arguments):
    """Steps that an analysis takes, whether it answers or not."""
    spent = []
    spend = verdict.Budget.spend
    monkeypatch.setattr(verdict.Budget, "spend", lambda budget, steps: (spent.append(steps), spend(budget, steps)))
    try:
        analyse(*arguments)
    except UndecidedError as error:
        assert "undecided" in str(error)
    monkeypatch.undo()
    return sum(spent)


@pytest.mark.parametrize(
    ("test", "accepted"),
    [("liu_layland_test", False), ("hyperbolic_test", False), ("edf_utilization_test", True), ("qpa_test", True)],
)
def test_quick_tests_judge_thousands_of_tasks(test, accepted):
    assert getattr(analysis, test)(many()).accepted == accepted


@pytest.mark.parametrize("test", ["response_times", "edf_response_times", "processor_demand_test", "qpa_test", "busy_period"])
def test_no_analysis_of_thousands_of_tasks_takes_more_than_its_budget(monkeypatch, test):
    assert 0 < steps_of(monkeypatch, getattr(analysis, test), many()) < 2 * verdict.MAX_STEPS


def test_response_times_of_thousands_of_tasks_are_undecided():
    with pytest.raises(UndecidedError, match=r"^response time: undecided after 4000000 steps$"):
        analysis.response_times(many())


def test_the_demand_test_rejects_early_and_gives_up_late(monkeypatch):
    hopeless = [TaskPair("a", 25, 25, 100), TaskPair("b", 10**6, 4 * 10**6 - 1, 10**7)]
    assert 0 < 1 - analysis.taft_utilization(hopeless) < 2e-7 and not analysis.taft_demand_test(hopeless)
    assert steps_of(monkeypatch, analysis.taft_demand_test, hopeless) < 10**4
    tight = [TaskPair("a", 10**6 - 1, 0, 10**6, 10**6 - 1), TaskPair("b", 1, 0, 10**6 + 1)]
    assert 0 < 1 - analysis.taft_utilization(tight) < 1e-11
    with pytest.raises(UndecidedError, match=r"^TAFT demand: undecided"):
        analysis.taft_demand_test(tight)
    with pytest.raises(UndecidedError, match=r"^TAFT plan: undecided, with more than 200000 jobs until the releases repeat$"):
        analysis.taft_plan_test(tight)
    with pytest.raises(UndecidedError):
        analysis.taft_test(tight)


def test_windows_of_many_sets_that_hardly_grow_are_given_up():
    """The first task leaves one unit in 1024; the second one's window takes thousands of steps to settle."""
    wcets, periods = np.array([[1023, 1 << 20]] * 20_000), np.array([[1024, (1 << 31) - 1]] * 20_000)
    with pytest.raises(UndecidedError, match="undecided"):
        accept_response_time(wcets, periods)
    assert accept_response_time(wcets[:5], periods[:5]).all()


@given(st.lists(st.tuples(st.integers(1, 50), st.integers(1, 60)), min_size=1, max_size=8))
def test_sums_and_products_of_shares_are_exact(shares):
    fractions = [Fraction(c, t) for c, t in shares]
    assert total(fractions) == sum(fractions, Fraction(0))
    plain = Fraction(1)
    for fraction in fractions:
        plain *= fraction
    assert product(fractions) == plain
    assert compared_to_one(shares) == (sum(fractions) > 1) - (sum(fractions) < 1)


@pytest.mark.parametrize(
    ("shares", "sign"), [([(1, 3)] * 3, 0), ([(1, 3)] * 2 + [(ONE, 3 * ONE + 1)], -1), ([(1, 3)] * 2 + [(ONE, 3 * ONE - 1)], 1)]
)
def test_a_sum_within_a_hair_of_one_is_decided(shares, sign):
    assert compared_to_one(shares) == sign


@given(st.integers(1, 40), st.integers(0, 10**6), st.integers(1, 10**6))
def test_liu_layland_in_digits_is_liu_layland_in_fractions(count, c, t):
    used = Fraction(c, t)
    assert _within_liu_layland(used, count) == ((1 + used / count) ** count <= 2)


@given(st.lists(st.lists(st.sampled_from("abcd"), min_size=1, max_size=4, unique=True), min_size=1, max_size=4))
def test_deadlocks_are_circles_of_locks_tried_one_after_the_other(orders):
    """Each list of locks is a section with the next one inside; a lock is in a circle if some way leads back to it."""
    tops = []
    for order in orders:
        section = ()
        for depth, lock in enumerate(reversed(order), start=1):
            section = (CriticalSection("t", lock, depth, section),)
        tops += section
    inside = {(a, b) for order in orders for i, a in enumerate(order) for b in order[i + 1 :]}

    def leads(a, b, seen=frozenset()):
        return any((x, y) in inside and (y == b or (y not in seen and leads(y, b, seen | {y}))) for x, y in inside if x == a)

    assert deadlock_locks(tops) == {lock for lock in "abcd" if leads(lock, lock)}


def test_blocking_of_thousands_of_tasks_is_undecided_and_not_a_matter_of_hours():
    tasks = many(5000)
    sections = [CriticalSection(task.name, "L", 1) for task in tasks]
    for protocol in ("inheritance", "none"):
        with pytest.raises(UndecidedError, match=r"^blocking: undecided"):
            blocking_bounds(tasks, sections, protocol)


def test_thousands_of_tasks_are_released_and_scheduled_without_comparing_all_names():
    compared = [0]

    class Name(str):
        __slots__ = ()
        __hash__ = str.__hash__

        def __eq__(self, other):
            compared[0] += 1
            return str.__eq__(self, other)

    tasks = [PeriodicTask(Name(f"t{i}"), 1, 10**6) for i in range(MANY)]
    simulate(tasks, "edf", 10, {str(task.name): [1] for task in tasks})
    assert compared[0] < 10 * MANY
