"""Folds over hand-made rows: who ran, held, waited, and at which priority."""

import pytest

from labkit.trace import Trace
from labkit.trace.folds import holds, overheads, priorities, ready, runs, waits
from labkit.trace.kinds import CODE

A, B, LOCK = 0, 1, 2


def trace(*rows, end=50):
    """Rows as (time, kind, task, other, value, extra), the last three optional."""
    return Trace.from_rows([(time, CODE[kind], *rest) for time, kind, *rest in _padded(rows)], ("A", "B", "L"), 1000, end=end)


def _padded(rows):
    for time, kind, task, *rest in rows:
        other, value, extra = rest + [-1, 0, 0][len(rest) :]
        yield time, kind, task, other, value, extra


def test_runs_are_cut_at_the_end_and_joined_when_no_time_passed_in_between():
    t = trace((0, "switch", A), (10, "switch", B, A), (10, "switch", A, B), (20, "switch", B, A))
    assert runs(t).tolist() == [[A, 0, 20], [B, 20, 50]]


def test_kernel_time_is_in_no_run():
    first, second, last = (5, "overhead", A, -1, 2), (20, "overhead", A, -1, 3, 1), (48, "overhead", B, -1, 5)
    t = trace((0, "switch", A), first, second, (23, "switch", B, A), last)
    assert runs(t).tolist() == [[A, 0, 5], [A, 7, 20], [B, 23, 48]]
    assert overheads(t).tolist() == [[0, 5, 7], [1, 20, 23], [0, 48, 50]]


def test_overheads_one_behind_the_other_leave_no_gap():
    t = trace((0, "switch", A), (5, "overhead", A, -1, 2), (7, "overhead", A, -1, 1, 1), (8, "switch", B, A))
    assert runs(t).tolist() == [[A, 0, 5], [B, 8, 50]]


def test_a_lock_is_held_from_take_to_give_or_to_the_end():
    t = trace((1, "take", A, LOCK), (9, "give", A, LOCK), (12, "take", B, LOCK))
    assert holds(t).tolist() == [[A, LOCK, 1, 9], [B, LOCK, 12, 50]]


def test_a_semaphore_given_by_another_is_held_by_nobody():
    t = trace((1, "give", A, LOCK), (2, "take", B, LOCK))
    assert holds(t).tolist() == []


def test_a_wait_ends_when_the_task_is_ready_or_suspended():
    woken = (1, "take_block", A, LOCK), (5, "ready", A)
    suspended = (6, "recv_block", A, LOCK), (8, "suspend", B, A)
    t = trace(*woken, *suspended, (9, "notify_take_block", B))
    assert waits(t).tolist() == [[A, LOCK, 1, 5], [A, LOCK, 6, 8], [B, -1, 9, 50]]


def test_priorities_step_at_inheritance_and_end_with_the_task():
    created = (0, "create", A, -1, 1), (0, "create", B, -1, 2)
    t = trace(*created, (10, "inherit", A, B, 2), (20, "disinherit", A, LOCK, 1), (30, "done", A))
    assert priorities(t).tolist() == [[A, 0, 10, 1], [B, 0, 50, 2], [A, 10, 20, 2], [A, 20, 30, 1]]


def test_a_priority_set_while_blocked_counts_at_once():
    t = trace((0, "create", A, -1, 1), (0, "create", B, -1, 2), (10, "prio_set", B, A, 5, 5))
    assert priorities(t).tolist() == [[A, 0, 10, 1], [B, 0, 50, 2], [A, 10, 50, 5]]


@pytest.mark.parametrize("fold", [runs, overheads, holds, waits, priorities])
def test_an_empty_trace_has_no_intervals(fold):
    assert len(fold(trace())) == 0


def test_a_lock_taken_twice_by_two_is_told_apart():
    t = trace((0, "take", A, LOCK), (3, "take", B, LOCK), (4, "give", B, LOCK), (6, "give", A, LOCK))
    assert holds(t).tolist() == [[A, LOCK, 0, 6], [B, LOCK, 3, 4]]


def test_a_window_that_begins_inside_an_overhead_keeps_what_is_left_of_it():
    rows = [(0, CODE["switch"], 0, -1, 1, -1), (10, CODE["overhead"], 0, -1, 6, 0), (30, CODE["switch"], 1, 0, 1, 0)]
    trace = Trace.from_rows(rows, ("a", "b"), 1000, end=40)
    assert runs(trace).tolist() == [[0, 0, 10], [0, 16, 30], [1, 30, 40]]
    assert runs(trace.window(13, 35)).tolist() == [[0, 16, 30], [1, 30, 35]]


def test_ready_is_preempted_or_not_yet_chosen():
    state = {"ready": 0, "blocked": 1}
    rows = [
        (0, CODE["switch"], 0, -1, 1, -1),
        (3, CODE["ready"], 1, -1, 2, 0),
        (3, CODE["switch"], 1, 0, 2, state["ready"]),  # 0 is preempted
        (5, CODE["ready"], 2, -1, 1, 0),  # becomes ready behind it
        (7, CODE["switch"], 0, 1, 1, state["blocked"]),
        (8, CODE["suspend"], 0, 2, 0, 0),  # 2 is suspended before it ever ran
    ]
    trace = Trace.from_rows(rows, ("a", "b", "c"), 1000, end=10)
    assert ready(trace).tolist() == [[0, 3, 7], [2, 5, 8]]
