"""EDF: published answers, and a scheduler that knows nothing but the rule, run over every offset."""

from fractions import Fraction
from itertools import product
from math import lcm

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import (
    busy_period,
    demand_bound,
    demand_limit,
    edf_job_response,
    edf_response_times,
    processor_demand_test,
    qpa_test,
    response_time_test,
    utilization,
)
from labkit.scheduler.tasksets import PeriodicTask, deadline_monotonic


def tasks(*rows):
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


def simulate(task_list, offsets, until, disfavoured=None, first_late=False):
    """Unit by unit the job with the earliest deadline runs; on a tie `disfavoured` loses. Longest response of each task.

    With `first_late` a task's first job arrives its jitter before the offset and is released at it.
    """
    jobs, worst, overdue = [], [0] * len(task_list), False
    for now in range(until):
        for i, (task, offset) in enumerate(zip(task_list, offsets, strict=True)):
            start = offset - task.jitter * first_late
            for arrival in range(start, now + 1, task.period):
                if max(arrival, offset) == now:
                    jobs.append([arrival + task.deadline, i == disfavoured, i, arrival, task.wcet])
        jobs.sort()
        if jobs:
            jobs[0][4] -= 1
            if not jobs[0][4]:
                due, _, i, arrival, _ = jobs.pop(0)
                worst[i] = max(worst[i], now + 1 - arrival)
                overdue |= now + 1 > due
        overdue |= any(due <= now for due, *_ in jobs)
    return worst, overdue


# --- published answers ------------------------------------------------------------------------------


def test_buttazzo_processor_demand():
    three = tasks((2, 6, 4), (2, 8, 5), (3, 9, 7))
    assert utilization(three) == Fraction(11, 12)
    assert demand_limit(three) == 25
    assert {t: demand_bound(three, t) for t in (4, 5, 7, 10, 13, 16)} == {4: 2, 5: 4, 7: 7, 10: 9, 13: 11, 16: 16}
    assert processor_demand_test(three)
    assert qpa_test(three)


def test_buttazzo_edf_meets_what_rate_monotonic_misses():
    pair = tasks((2, 5), (4, 7))
    assert qpa_test(pair)
    assert not response_time_test(pair)
    assert simulate(pair, [0, 0], 70)[1] is False


def test_schedcat_qpa_infeasible():
    pair = tasks((331, 15000, 2688), (3654, 77000, 3849))
    for test in (qpa_test, processor_demand_test):
        verdict = test(pair)
        assert not verdict
        assert verdict.exact
        assert verdict.why == "3985 must be done within 3849 after a common release, 136 too much"


@pytest.mark.parametrize(
    ("rows", "answer"),
    [
        ([(2, 4), (3, 12)], [2, 7]),
        ([(2, 4), (2, 9), (3, 12)], [3, 8, 11]),
        ([(1, 4), (1, 12), (3, 16)], [1, 2, 6]),
        ([(2, 5, 4), (3, 6, 5)], [4, 5]),
    ],
)
def test_schedcat_exact_edf_response_times(rows, answer):
    assert list(edf_response_times(tasks(*rows)).values()) == answer


# --- reports ----------------------------------------------------------------------------------------


def test_overload_is_reported():
    heavy = tasks((6, 10), (5, 10))
    assert edf_response_times(heavy) == {"t1": None, "t2": None}
    assert busy_period(heavy) is None
    assert demand_limit(heavy) is None
    assert qpa_test(heavy).why == "utilisation 1.1000 exceeds 1"


def test_jitter_that_leaves_too_little_time_is_named():
    late = [PeriodicTask("late", 3, 10, 8, jitter=6)]
    for test in (qpa_test, processor_demand_test):
        assert test(late).why == "task 'late': jitter 6 and wcet 3 exceed its deadline 8 by 1"


def test_qpa_copes_with_a_busy_period_of_many_jobs():
    many = tasks((999_999, 2_000_003, 2_000_000), (499_999, 1_000_003), (1, 10**12, 10**11))
    assert qpa_test(many)


# --- against the simulated schedule -------------------------------------------------------------------


@st.composite
def task_sets(draw, most=3, jitters=(0,)):
    rows = []
    for i in range(draw(st.integers(1, most))):
        period = draw(st.sampled_from([2, 3, 4, 5, 6, 8]))
        wcet = draw(st.integers(1, max(1, period // 2)))
        deadline = draw(st.integers(wcet, 2 * period))
        rows.append(PeriodicTask(f"t{i}", wcet, period, deadline, jitter=draw(st.sampled_from(jitters))))
    return rows


@settings(max_examples=60, deadline=None)
@given(task_sets(most=2))
def test_response_times_are_those_of_the_worst_offsets(task_list):
    assume(utilization(task_list) <= 1)
    cycle = lcm(*(t.period for t in task_list))
    worst = [
        max(
            simulate(task_list, offsets, 3 * cycle, disfavoured=i)[0][i]
            for offsets in product(*(range(t.period) for t in task_list))
        )
        for i in range(len(task_list))
    ]
    assert worst == list(edf_response_times(task_list).values())


@settings(max_examples=150, deadline=None)
@given(task_sets(jitters=(0, 0, 1, 2, 5)), st.data())
def test_no_offset_or_jitter_exceeds_the_response_times(task_list, data):
    assume(utilization(task_list) <= 1)
    offsets = [data.draw(st.integers(0, t.period)) for t in task_list]
    until = 2 * lcm(*(t.period for t in task_list)) + 20
    for i, bound in enumerate(edf_response_times(task_list).values()):
        assert simulate(task_list, offsets, until, i, first_late=data.draw(st.booleans()))[0][i] <= bound


@settings(max_examples=200, deadline=None)
@given(task_sets(jitters=(0, 0, 1, 3)))
def test_demand_qpa_response_times_and_the_schedule_agree(task_list):
    verdict = qpa_test(task_list)
    assert verdict.accepted == processor_demand_test(task_list).accepted
    responses = edf_response_times(task_list)
    assert verdict.accepted == all(responses[t.name] is not None and responses[t.name] <= t.deadline for t in task_list)
    until = 3 * lcm(*(t.period for t in task_list)) + 40
    assert verdict.accepted != simulate(task_list, [0] * len(task_list), until, first_late=True)[1]


@settings(max_examples=100, deadline=None)
@given(task_sets())
def test_edf_fits_whatever_fixed_priorities_fit(task_list):
    if response_time_test(deadline_monotonic(task_list)):
        assert qpa_test(task_list)


def test_a_late_arrival_can_be_the_worst():
    pair = tasks((2, 4), (2, 9), (3, 12))
    assert edf_job_response(pair, "t1", 0) == 2
    assert edf_response_times(pair)["t1"] == 3
