"""The kernel and the periodic simulator, which share no code, tell the same jobs and statistics of the same set."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.kernel import Kernel
from labkit.scheduler import PeriodicTask, simulate
from labkit.scheduler.analysis import response_time_test
from labkit.scheduler.tasksets import rate_monotonic
from labkit.trace import jobs, slices, statistics

TICK = 1000  # cycles; more than there are jobs, so that no computation ends with a tick and counts a higher task's as well


def in_kernel(tasks, ticks):
    """The set in the kernel, in order of priority; each job leaves the last cycle of its wcet to its closing request."""
    kernel = Kernel(cpu_hz=1000 * TICK, priorities=len(tasks) + 1)
    for i, task in enumerate(tasks):

        def body(os, task=task):
            while True:
                yield os.compute(task.wcet)
                yield os.delay_until(task.period // TICK)

        kernel.task(task.name, body, priority=len(tasks) - i, deadline=task.deadline)
    return kernel.run(ticks * TICK).trace


def in_cycles(rows):
    """(C, T) rows in ticks, C less one cycle, by falling priority."""
    return rate_monotonic([PeriodicTask(f"t{i}", c * TICK - 1, t * TICK) for i, (c, t) in enumerate(rows)])


COLUMNS = ("job", "release", "deadline", "start", "completion", "response", "tardiness", "missed", "main", "exception")


def rows_of(table, whole=None):
    """The jobs as tuples; with `whole` only those that are complete by then."""
    kept = np.ones(len(table), bool) if whole is None else (table.completion >= 0) & (table.completion <= whole)
    names = [table.names[task] for task in table.task[kept].tolist()]
    return list(zip(names, *(getattr(table, column)[kept].tolist() for column in COLUMNS), strict=True))


def test_a_missed_deadline_of_rate_monotonic_is_counted_in_both():
    tasks = in_cycles([(2, 5), (4, 7)])
    periodic, kernel = simulate(tasks, "rm", 35 * TICK, hz=1000 * TICK), in_kernel(tasks, 35)
    for trace in (periodic, kernel):
        frame = statistics(trace)
        assert frame["misses"].to_dict() == {"t0": 0, "t1": 1} | dict.fromkeys(set(frame.index) - {"t0", "t1"}, 0)
        assert frame.loc["t1", "response_max"] == 8000 - 3  # us, less a cycle of the job and of each that preempts it


sets = st.lists(st.tuples(st.integers(1, 6), st.sampled_from([4, 5, 6, 8, 10, 12, 15, 20])), min_size=1, max_size=4)


@settings(max_examples=100, deadline=None)
@given(sets, st.integers(1, 60))
def test_jobs_slices_and_statistics_of_a_schedulable_set_are_the_same(rows, ticks):
    assume(all(c <= t for c, t in rows))
    tasks = in_cycles(rows)
    assume(response_time_test(tasks))
    periodic = simulate(tasks, "rm", ticks * TICK, hz=1000 * TICK)
    assume((jobs(periodic).completion[jobs(periodic).job == 0] >= 0).all())  # the kernel knows of a first job when it is complete
    kernel = in_kernel(tasks, ticks)
    assert rows_of(jobs(kernel)) == rows_of(jobs(periodic))
    mine = slices(kernel)
    assert mine.rows()[mine.job >= 0].tolist() == slices(periodic).rows().tolist()
    names = [task.name for task in tasks]
    left, right = (statistics(trace).loc[names].drop(columns="cut") for trace in (kernel, periodic))
    assert left.astype(float).equals(right.astype(float))


@settings(max_examples=100, deadline=None)
@given(sets, st.integers(1, 60))
def test_jobs_that_are_complete_are_the_same_in_overload(rows, ticks):
    assume(all(c <= t for c, t in rows))
    tasks = in_cycles(rows)
    periodic, kernel = jobs(simulate(tasks, "rm", ticks * TICK, hz=1000 * TICK)), jobs(in_kernel(tasks, ticks))
    assert rows_of(kernel, ticks * TICK) == rows_of(periodic, ticks * TICK)
