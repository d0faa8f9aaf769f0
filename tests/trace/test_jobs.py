"""Slices and jobs of every scheduler's trace, and of windows of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.scheduler import PeriodicTask, TaskPair, simulate
from labkit.trace import Trace, jobs, slices
from labkit.trace.kinds import CODE


def trace_of(rows, names, end, start=0, exception_of=()):
    """(time, kind, name, value, extra) rows as a trace."""
    names = names.split()
    table = [(time, CODE[kind], names.index(name), -1, value, extra) for time, kind, name, value, extra in rows]
    return Trace.from_rows(table, names, 1000, end=end, start=start, exception_of=exception_of)


def ran(trace):
    return [(trace.names[task], part, job, start, end) for task, part, job, start, end in slices(trace).rows().tolist()]


# ------------------------------------------------------------------------------------------------ rules, by hand


def test_a_run_is_cut_where_one_job_of_a_task_ends_and_the_next_begins():
    rows = [
        (0, "release", "A", 0, 0),
        (0, "switch", "A", 1, -1),
        (3, "complete", "A", -1, 0),
        (4, "release", "A", 4, 1),
        (6, "complete", "A", -1, 1),
        (7, "switch", "I", 0, 0),
    ]
    trace = trace_of(rows, "A I", 9)
    assert ran(trace) == [("A", 0, 0, 0, 3), ("A", 0, -1, 3, 4), ("A", 0, 1, 4, 6), ("A", 0, -1, 6, 7), ("I", 0, -1, 7, 9)]
    table = jobs(trace)
    assert [table.release.tolist(), table.start.tolist(), table.completion.tolist()] == [[0, 4], [0, 4], [3, 6]]
    assert table.response.tolist() == [3, 2] and table.main.tolist() == [3, 2]
    assert table.deadline.tolist() == [-1, -1] and table.tardiness.tolist() == [-1, -1] and not table.missed.any()


def test_jobs_are_served_in_order_of_release():
    rows = [
        (0, "release", "A", 0, 0),
        (0, "switch", "A", 1, -1),
        (2, "release", "A", 2, 1),
        (4, "release", "A", 4, 2),
        (5, "complete", "A", 2, 0),
    ]
    trace = trace_of(rows, "A", 8)
    assert ran(trace) == [("A", 0, 0, 0, 5), ("A", 0, 1, 5, 8)]


def test_a_job_that_never_ends_though_a_later_one_does_was_given_up():
    rows = [(0, "release", "A", 0, 0), (0, "switch", "A", 1, -1), (2, "release", "A", 2, 1), (5, "complete", "A", -1, 1)]
    trace = trace_of(rows, "A", 6)
    assert ran(trace) == [("A", 0, 0, 0, 2), ("A", 0, 1, 2, 5), ("A", 0, -1, 5, 6)]
    assert jobs(trace).completion.tolist() == [-1, 5]


def test_time_of_the_kernel_is_in_no_slice():
    rows = [
        (0, "release", "A", 0, 0),
        (0, "switch", "A", 1, -1),
        (2, "overhead", "A", 3, 0),
        (7, "complete", "A", -1, 0),
        (7, "overhead", "A", 1, 1),
        (8, "switch", "I", 0, 0),
    ]
    trace = trace_of(rows, "A I", 10)
    assert ran(trace) == [("A", 0, 0, 0, 2), ("A", 0, 0, 5, 7), ("I", 0, -1, 8, 10)]
    assert jobs(trace).main.tolist() == [4]


@pytest.mark.parametrize(
    ("end_of_job", "end", "missed", "tardiness"),
    [(4, 9, False, 0), (5, 9, False, 0), (6, 9, True, 1), (None, 9, True, -1), (None, 5, True, -1), (None, 4, False, -1)],
)
@pytest.mark.parametrize("closed", [True, False])
def test_a_miss_follows_from_deadline_and_completion(end_of_job, end, missed, tardiness, closed):
    missed = missed and (closed or end > 5)  # what ends exactly at the end is not in an open trace
    rows = [(0, "release", "A", 0, 0), (0, "deadline", "A", 5, 0), (0, "switch", "A", 1, -1)]
    if end_of_job:
        rows.append((end_of_job, "complete", "A", 5, 0))
    table = jobs(replace(trace_of(rows, "A", end), closed=closed))
    assert (table.missed.tolist(), table.tardiness.tolist(), table.deadline.tolist()) == ([missed], [tardiness], [5])


def test_an_exception_part_is_declared_and_its_completion_is_that_of_the_job():
    rows = [
        (0, "release", "A", 0, 0),
        (0, "switch", "A", 1, -1),
        (3, "abort", "A", 5, 0),
        (3, "switch", "x", 2, 1),
        (5, "complete", "x", 5, 0),
        (5, "switch", "A.ep", 0, 1),
    ]
    trace = trace_of(rows, "A x A.ep", 7, exception_of=(-1, 0, -1))
    assert ran(trace) == [("A", 0, 0, 0, 3), ("A", 1, 0, 3, 5), ("A.ep", 0, -1, 5, 7)]
    table = jobs(trace)
    assert (table.abort.tolist(), table.completion.tolist(), table.missed.tolist()) == ([3], [5], [False])
    assert (table.main.tolist(), table.exception.tolist()) == ([3], [2])
    frame = table.frame()
    assert frame["task"].tolist() == ["A"] and frame["abort"].tolist() == [3]
    assert slices(trace).frame()["part"].tolist() == ["mp", "ep", "mp"]


def test_nothing_in_nothing_out():
    empty = Trace.from_rows([], ["A"], 1000, end=5)
    assert not len(slices(empty)) and not len(jobs(empty)) and not len(jobs(empty).frame()) and not len(slices(empty).frame())


# ------------------------------------------------------------------------------- every scheduler, and windows of it


@st.composite
def schedules(draw):
    """A schedule of one of the schedulers, with overloads, backlogs and aborts."""
    policy = draw(st.sampled_from(["rm", "edf", "taft"]))
    tasks = []
    for i in range(draw(st.integers(1, 3))):
        period = draw(st.integers(3, 12))
        if policy == "taft":
            ep = draw(st.integers(0, period - 1))
            tasks.append(TaskPair(f"t{i}", draw(st.integers(1, period - ep)), ep, period))
        else:
            tasks.append(PeriodicTask(f"t{i}", draw(st.integers(1, period)), period, offset=draw(st.integers(0, 5))))
    times = {task.name: draw(st.lists(st.integers(1, 9), min_size=1, max_size=4)) for task in tasks}
    return simulate(tasks, policy, draw(st.integers(1, 60)), times)


@settings(max_examples=300, deadline=None)
@given(schedules(), st.data())
def test_a_window_tells_the_truth_or_nothing(trace, data):
    start = data.draw(st.integers(0, trace.end))
    end = data.draw(st.integers(start, trace.end))
    whole = slices(trace).rows()
    cut = whole.copy()
    cut[:, 3:] = np.clip(cut[:, 3:], start, end)
    cut = cut[cut[:, 3] < cut[:, 4]]
    units = {(t, u): (part, job) for t, part, job, a, b in cut.tolist() for u in range(a, b)}
    seen = {(t, u): (part, job) for t, part, job, a, b in slices(trace.window(start, end)).rows().tolist() for u in range(a, b)}
    assert seen.keys() == units.keys()
    for at, (part, job) in seen.items():
        assert (part, job) == units[at] or (part, job) == (units[at][0], -1)


@settings(max_examples=200, deadline=None)
@given(schedules())
def test_slices_do_not_overlap_and_jobs_hold_what_the_slices_say(trace):
    ran, table = slices(trace), jobs(trace)
    assert (ran.job >= 0).all() and (ran.end > ran.start).all() and (ran.start[1:] >= ran.end[:-1]).all()
    for row in table.frame().itertuples():
        mine = (ran.task == trace.names.index(row.task)) & (ran.job == row.job)
        granted = [int(np.sum((ran.end - ran.start)[mine & (ran.part == part)])) for part in (0, 1)]
        assert granted == [row.main, row.exception]
        if mine.any():
            assert ran.start[mine][0] == row.start >= row.release
    late = (table.completion < 0) | (table.completion > table.deadline)
    assert np.array_equal(table.missed, late & (table.deadline >= 0) & (table.deadline <= trace.end))


@settings(max_examples=200, deadline=None)
@given(schedules(), st.data())
def test_a_window_from_the_beginning_judges_what_is_due_in_it(trace, data):
    end = data.draw(st.integers(0, trace.end))
    table, cut = jobs(trace), jobs(trace.window(0, end))
    due = (table.deadline <= end) & ((table.completion < 0) | (table.completion > table.deadline)) & (table.release < end)
    whole = set(zip(table.task[due].tolist(), table.job[due].tolist(), strict=True))
    assert set(zip(cut.task[cut.missed].tolist(), cut.job[cut.missed].tolist(), strict=True)) == whole
    assert jobs(trace.window(0, trace.end)).frame().equals(table.frame())
