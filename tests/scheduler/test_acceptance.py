"""The vectorised exact test against the scalar one, set by set."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import accept_hyperbolic, response_time_test
from labkit.scheduler.analysis.acceptance import accept_response_time
from labkit.scheduler.tasksets import as_tasks, log_uniform_periods, uunifast, whole_wcets


@settings(max_examples=60)
@given(st.integers(1, 6), st.floats(0.3, 1.1), st.integers(0, 1000))
def test_it_says_what_response_time_analysis_says(tasks, utilization, seed):
    rng = np.random.default_rng(seed)
    periods = log_uniform_periods(tasks, 12, 5, 60, rng)
    wcets = whole_wcets(uunifast(tasks, utilization, 12, rng), periods).clip(max=periods)
    expected = [response_time_test(as_tasks(c, t)).accepted for c, t in zip(wcets, periods, strict=True)]
    assert accept_response_time(wcets, periods).tolist() == expected


def test_textbook_sets():
    wcets = np.array([[3, 3, 5], [10, 10, 12], [4, 5, 32], [5, 10, 40], [40, 40, 100]])
    periods = np.array([[7, 12, 20], [30, 40, 50], [16, 40, 80], [20, 40, 80], [100, 150, 350]])
    assert accept_response_time(wcets, periods).tolist() == [True, False, True, True, True]
    assert accept_response_time(np.array([[2, 4]]), np.array([[5, 7]])).tolist() == [False]


def test_whatever_the_hyperbolic_bound_accepts_is_accepted_and_the_order_of_tasks_is_no_matter():
    rng = np.random.default_rng(3)
    periods = log_uniform_periods(5, 2000, 10, 1000, rng)
    wcets = whole_wcets(uunifast(5, 0.8, 2000, rng), periods)
    exact = accept_response_time(wcets, periods)
    assert np.all(exact >= accept_hyperbolic(wcets, periods)) and 0 < exact.sum() < 2000
    assert np.array_equal(exact, accept_response_time(wcets[:, ::-1], periods[:, ::-1]))


@pytest.mark.parametrize(
    ("wcets", "periods", "sentence"),
    [
        ([1, 2], [3, 4], "both must be"),
        ([[1, 2]], [[3]], "both must be"),
        ([[0]], [[3]], "from 1 to"),
        ([[1]], [[1 << 31]], "from 1 to"),
    ],
)
def test_what_is_not_an_array_of_sets_is_refused(wcets, periods, sentence):
    with pytest.raises(ValueError, match=sentence):
        accept_response_time(np.array(wcets), np.array(periods))
