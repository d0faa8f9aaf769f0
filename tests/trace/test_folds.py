"""Folds over hand-made rows: who ran, held, waited, and at which priority."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.trace import Trace
from labkit.trace.folds import holds, overheads, priorities, ready, runs, waits
from labkit.trace.kinds import CODE, STATES

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


# ------------------------------------------------------------------------ any rows at all, event by event


def holds_by_event(t):
    takes, signals, rows = {}, set(), []
    for time, kind, task, lock, *_ in t.rows("take", "give").tolist():
        if kind == CODE["take"]:
            takes.setdefault((task, lock), []).append(time)
        elif takes.get((task, lock)):
            rows.append([task, lock, takes[task, lock].pop(), time])
        else:
            signals.add(lock)
    open_takes = takes.items()
    return rows + [[task, lock, time, t.end] for (task, lock), times in open_takes if lock not in signals for time in times]


def waits_by_event(t):
    open_waits, rows = {}, []
    for time, kind, task, other, *_ in t.rows().tolist():
        if kind in {CODE[name] for name in ("take_block", "send_block", "recv_block", "peek_block", "notify_take_block")}:
            open_waits.setdefault(task, (other, time))
        elif kind == CODE["ready"] and task in open_waits:
            rows.append([task, *open_waits.pop(task), time])
        elif kind == CODE["suspend"] and other in open_waits:
            rows.append([other, *open_waits.pop(other), time])
    return rows + [[task, target, start, t.end] for task, (target, start) in open_waits.items()]


def ready_by_event(t):
    since, running, rows = {}, -1, []
    for time, kind, task, other, _, extra in t.rows("ready", "switch", "suspend").tolist():
        if kind == CODE["switch"]:
            running = task
            if extra == STATES.index("ready") and other >= 0:
                since.setdefault(other, time)
        elif kind == CODE["ready"]:
            if task != running:
                since.setdefault(task, time)
            continue
        gone = task if kind == CODE["switch"] else other
        if since.get(gone, time) < time:
            rows.append([gone, since[gone], time])
        since.pop(gone, None)
    return rows + [[task, start, t.end] for task, start in since.items() if start < t.end]


def priorities_by_event(t):
    kinds = ("create", "ready", "switch", "inherit", "disinherit", "disinherit_timeout", "prio_set", "done")
    steps, rows = {}, []
    for time, kind, task, other, value, extra in t.rows(*kinds).tolist():
        if kind == CODE["prio_set"]:
            task, value = other, extra
        since, priority = steps.get(task, (time, None))
        if kind != CODE["done"] and value == priority:
            continue
        if time > since:
            rows.append([task, since, time, priority])
        if kind == CODE["done"]:
            steps.pop(task, None)
        else:
            steps[task] = time, value
    return rows + [[task, since, t.end, priority] for task, (since, priority) in steps.items()]


KINDS_OF = {
    holds: ("take", "give"),
    waits: ("take_block", "recv_block", "ready", "suspend"),
    ready: ("ready", "switch", "suspend"),
    priorities: ("create", "ready", "inherit", "prio_set", "done"),
}


@pytest.mark.parametrize("fold", KINDS_OF, ids=lambda fold: fold.__name__)
@settings(max_examples=400, deadline=None)
@given(st.data())
def test_a_fold_says_the_same_as_one_event_after_the_other(fold, data):
    small = st.integers(0, 2)
    row = st.tuples(st.integers(0, 12), st.sampled_from(KINDS_OF[fold]), small, small, small, small)
    t = trace(*sorted(data.draw(st.lists(row, max_size=25)), key=lambda row: row[0]), end=12)
    told = fold(t).tolist()
    begins = {holds: 2, waits: 2}.get(fold, 1)
    assert [row[begins] for row in told] == sorted(row[begins] for row in told)
    assert sorted(told) == sorted(globals()[f"{fold.__name__}_by_event"](t))
