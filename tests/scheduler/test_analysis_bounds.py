"""Utilisation bounds: the published figures, their limits, and the array form against the exact one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import (
    accept_edf,
    accept_hyperbolic,
    accept_liu_layland,
    edf_utilization_test,
    hyperbolic_bound,
    hyperbolic_test,
    liu_layland_bound,
    liu_layland_test,
    response_time_test,
    utilization,
)
from labkit.scheduler.tasksets import PeriodicTask, as_tasks, deadline_monotonic


def tasks(*rows):
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


def test_liu_layland_bound_of_1_to_5_tasks():
    assert [round(liu_layland_bound(n), 4) for n in range(1, 6)] == [1, 0.8284, 0.7798, 0.7568, 0.7435]
    with pytest.raises(ValueError, match="at least 1 task, not 0"):
        liu_layland_bound(0)


def test_sei_set_exceeds_liu_layland_and_still_fits():
    sei = tasks((40, 100), (40, 150), (100, 350))
    verdict = liu_layland_test(sei)
    assert round(float(utilization(sei)), 3) == 0.952  # the source rounds .9524 up to .953
    assert not verdict
    assert not verdict.exact
    assert "0.9524 exceeds 0.7798 for 3 tasks" in verdict.why
    assert response_time_test(sei)


def test_buttazzo_rate_monotonic_fails_where_edf_fits():
    pair = tasks((2, 5), (4, 7))
    assert not response_time_test(pair)
    assert edf_utilization_test(pair)


def test_hyperbolic_accepts_more_than_liu_layland():
    pair = tasks((1, 2), (1, 3))
    assert not liu_layland_test(pair)
    assert hyperbolic_test(pair)  # 3/2 * 4/3 is 2, to the point
    assert hyperbolic_bound([1 / 2, 1 / 3]) == pytest.approx(2)


def test_overload_is_a_proof_and_a_high_utilisation_is_not():
    assert edf_utilization_test(tasks((6, 10), (5, 10))).exact
    assert liu_layland_test(tasks((6, 10), (5, 10))).exact
    assert not edf_utilization_test(tasks((2, 6, 3), (2, 6, 5))).exact


def test_jitter_that_leaves_no_time_is_named():
    verdict = liu_layland_test([PeriodicTask("late", 2, 10, jitter=10)])
    assert not verdict
    assert "task 'late': jitter 10 leaves no time" in verdict.why


@st.composite
def any_sets(draw):
    rows = []
    for i in range(draw(st.integers(1, 4))):
        period = draw(st.integers(2, 40))
        deadline = draw(st.integers(1, 2 * period))
        wcet = draw(st.integers(1, min(deadline, max(1, period // 2))))
        rows.append(PeriodicTask(f"t{i}", wcet, period, deadline, jitter=draw(st.sampled_from([0, 0, 1, 3]))))
    return rows


@settings(max_examples=300, deadline=None)
@given(any_sets())
def test_whatever_a_bound_accepts_meets_its_deadlines(task_list):
    ordered = sorted(deadline_monotonic(task_list), key=lambda t: min(t.deadline, t.period) - t.jitter)
    if liu_layland_test(task_list):
        assert hyperbolic_test(task_list)
    if hyperbolic_test(task_list):
        assert edf_utilization_test(task_list)
        assert response_time_test(ordered)


def test_arrays_agree_with_the_exact_tests():
    rng = np.random.default_rng(7)
    periods = rng.integers(1, 9, (4000, 3))
    wcets = np.minimum(rng.integers(1, 5, (4000, 3)), periods)
    sets = [as_tasks(c, t) for c, t in zip(wcets, periods, strict=True)]
    for accept, test in (
        (accept_liu_layland, liu_layland_test),
        (accept_hyperbolic, hyperbolic_test),
        (accept_edf, edf_utilization_test),
    ):
        accepted = accept(wcets, periods)
        assert accepted.tolist() == [bool(test(one)) for one in sets]
        assert 0 < accepted.sum() < len(accepted)


def test_arrays_are_exact_on_the_border():
    thirds = np.array([[1, 1, 1]]), np.array([[3, 3, 3]])
    assert accept_edf(*thirds)
    assert not accept_edf(np.array([[10**9 + 1, 10**9, 10**9]]), np.array([[3 * 10**9] * 3]))
    assert accept_hyperbolic(np.array([[1, 1]]), np.array([[2, 3]]))
