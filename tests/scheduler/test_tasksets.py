"""Random task sets: sums, shapes and uniformity."""

import numpy as np
import pytest

from labkit.scheduler.tasksets import TaskPair, as_tasks, log_uniform_periods, uunifast, whole_wcets


def test_uunifast_rows_add_up_and_are_reproducible():
    drawn = uunifast(5, 0.8, 1000, np.random.default_rng(1))
    assert drawn.shape == (1000, 5)
    assert drawn.min() > 0
    np.testing.assert_allclose(drawn.sum(axis=1), 0.8)
    np.testing.assert_array_equal(drawn, uunifast(5, 0.8, 1000, np.random.default_rng(1)))


@pytest.mark.parametrize("column", [0, 1, 3])
def test_uunifast_is_uniform_over_the_simplex(column):
    """Each share of a uniform point of the simplex follows a Beta(1, n - 1) law, whichever its column."""
    from scipy.stats import beta, kstest

    drawn = uunifast(4, 0.9, 20_000, np.random.default_rng(2))
    assert kstest(drawn[:, column] / 0.9, beta(1, 3).cdf).pvalue > 0.001


def test_one_task_gets_all():
    assert uunifast(1, 0.5, 3, np.random.default_rng(0)).tolist() == [[0.5]] * 3


def test_log_uniform_periods_cover_each_decade_alike():
    periods = log_uniform_periods(10, 5000, 10, 9999, np.random.default_rng(3))
    assert periods.dtype == np.int64
    assert periods.min() == 10
    assert periods.max() == 9999
    counts = np.bincount(np.log10(periods).astype(int).ravel())[1:]
    np.testing.assert_allclose(counts / counts.sum(), 1 / 3, atol=0.01)


def test_drawn_sets_become_tasks_in_priority_order():
    rng = np.random.default_rng(4)
    periods = log_uniform_periods(4, 1, 100, 10_000, rng)
    wcets = whole_wcets(uunifast(4, 0.7, 1, rng), periods)
    tasks = as_tasks(wcets[0], periods[0])
    assert [t.period for t in tasks] == sorted(periods[0].tolist())
    assert sum(t.wcet / t.period for t in tasks) == pytest.approx(0.7, abs=0.02)
    tight = as_tasks([1, 1], [10, 20], [9, 5])
    assert [t.name for t in tight] == ["t2", "t1"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: uunifast(0, 0.5, 1, np.random.default_rng(0)), "at least one task per set"),
        (lambda: uunifast(2, 0.0, 1, np.random.default_rng(0)), "total utilisation is 0.0; it must be above 0"),
        (lambda: log_uniform_periods(2, 1, 9, 3, np.random.default_rng(0)), "periods from 9 to 3"),
        (lambda: TaskPair("scan", 8, 3, 10), "task 'scan': ecet 8 and ep_wcet 3 exceed its deadline 10 by 1"),
        (lambda: TaskPair("scan", 8, -1, 10), "ep_wcet is -1; it must be at least 0"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
