"""Random task sets: sums, shapes and uniformity."""

import re

import numpy as np
import pytest

from labkit.checks import whole
from labkit.scheduler.tasksets import PeriodicTask, TaskPair, as_tasks, check_names, log_uniform_periods, uunifast, whole_wcets


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
        (lambda: uunifast(0, 0.5, 1, np.random.default_rng(0)), "the number of tasks in a set is 0; a whole number of"),
        (lambda: uunifast(2, 0.0, 1, np.random.default_rng(0)), "total utilisation is 0.0; it must be above 0"),
        (lambda: log_uniform_periods(2, 1, 9, 3, np.random.default_rng(0)), "periods from 9 to 3"),
        (lambda: TaskPair("scan", 8, 3, 10), "task 'scan': ecet 8 and ep_wcet 3 exceed its deadline 10 by 1"),
        (lambda: TaskPair("scan", 8, -1, 10), "ep_wcet is -1; a whole number of at least 0 is allowed"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_names_of_many_tasks_are_checked_in_time_that_grows_with_their_number():
    """20 000 tasks took half a minute when each name was sought among all."""
    looked = [0]

    class Name(str):
        __slots__ = ()
        __hash__ = str.__hash__

        def __eq__(self, other):
            looked[0] += 1
            return str.__eq__(self, other)

    tasks = [PeriodicTask(Name(f"t{i}"), 1, 10) for i in range(2000)]
    assert check_names(tasks) == tasks
    assert looked[0] < 3 * len(tasks)
    with pytest.raises(ValueError, match="two tasks are called 't7'; names must be unique"):
        check_names([*tasks, PeriodicTask("t7", 1, 10)])


@pytest.mark.parametrize("number", [True, 2.0, "2", None, np.float64(2), -1])
def test_what_is_no_whole_number_is_refused(number):
    with pytest.raises(ValueError, match=f"^the share is {re.escape(repr(number))}; a whole number of at least 0 is allowed$"):
        whole(number, 0, "the share")


def test_a_numpy_integer_becomes_a_plain_one():
    assert type(whole(np.int8(100), 0, "x")) is int
    with pytest.raises(ValueError, match=r"^x is 100; a whole number of at least 101 is allowed$"):
        whole(np.int8(100), 101, "x")
