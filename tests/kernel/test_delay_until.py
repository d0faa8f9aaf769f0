"""delay_until: the rule of the real kernel, and the jobs that follow from it."""

import numpy as np

from labkit.kernel import Kernel
from labkit.trace.folds import runs
from labkit.trace.kinds import CODE


def kernel():
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000)


def resumed_early():
    """A sleeps until tick 10; B suspends it at 2 and resumes it at 3, before its wake time."""
    k = Kernel(cpu_hz=1000, tick_hz=1000)

    def a(os):
        while True:
            yield os.compute(1)
            yield os.delay_until(10)

    def b(os):
        yield os.delay(2)
        yield os.suspend(task)
        yield os.delay(1)
        yield os.resume(task)
        yield os.suspend()

    task = k.task("A", a, priority=1, deadline=10)
    k.task("B", b, priority=2)
    return k.run(until=30)


def test_a_task_resumed_early_finds_its_wake_time_ahead_and_does_not_block_any_more():
    run = resumed_early()
    timeline = [(run.trace.names[task], start, end) for task, start, end in runs(run.trace).tolist()]
    assert timeline == [("A", 0, 1), ("IDLE", 1, 3), ("A", 3, 30)]
    calls = run.trace.rows("delay_until")
    assert calls[:3, [0, 4, 5]].tolist() == [[1, 10, 1], [4, 20, 0], [5, 30, 0]]


def test_its_jobs_are_released_when_they_begin_not_at_a_time_still_to_come():
    trace = resumed_early().trace
    releases = trace.rows("release")
    assert releases[:4, [0, 4]].tolist() == [[1, 0], [3, 3], [4, 4], [5, 5]]


def test_a_program_counts_from_a_tick_that_it_has_read_itself():
    k = kernel()

    def body(os):
        yield os.delay(7)
        start = os.ticks
        yield os.compute(12)
        slept = yield os.delay_until(3, since=start)
        yield os.mark(slept)
        slept = yield os.delay_until(3)
        yield os.mark(slept)

    k.task("a", body, priority=1, deadline=20)
    trace = k.run(until=200).trace
    assert trace.rows("mark")[:, [0, 4]].tolist() == [[100, 1], [130, 1]]
    assert trace.rows("release")[:, [4, 5]].tolist() == [[70, 0], [100, 1], [130, 2]]
    assert trace.rows("complete")[:, [0, 4, 5]].tolist() == [[82, 90, 0], [100, 120, 1], [130, 150, 2]]


def test_work_before_the_tick_counted_from_is_no_job():
    k = kernel()

    def body(os):
        yield os.compute(23)
        yield os.delay(2)
        yield os.delay_until(5, since=os.ticks)

    k.task("a", body, priority=1)
    assert k.run(until=200).trace.rows("release")[:, [0, 4, 5]].tolist() == [[90, 90, 0]]


def test_a_count_from_before_the_start_is_late_and_wraps_no_more():
    k = kernel()

    def body(os):
        slept = yield os.delay_until(3, since=-5)
        yield os.mark(slept)
        slept = yield os.delay_until(3)  # from -2: tick 1 is to come
        yield os.mark(slept)

    k.task("a", body, priority=1)
    assert k.run(until=50).trace.rows("mark")[:, [0, 4]].tolist() == [[0, 0], [10, 1]]


# Deadlines


def test_each_release_with_a_deadline_is_followed_by_it():
    k = kernel()

    def by_hand(os):
        yield os.compute(2)
        yield os.release()
        yield os.compute(1000)

    def periodic(os):
        while True:
            yield os.compute(1)
            yield os.delay_until(3)

    def without(os):
        while True:
            yield os.delay_until(3)

    k.task("hand", by_hand, priority=1, deadline=15)
    k.task("periodic", periodic, priority=2, deadline=30)
    k.task("without", without, priority=3)
    trace = k.run(until=65).trace
    rows = [(int(t), trace.names[task], int(at), int(job)) for t, _, task, _, at, job in trace.rows("deadline")]
    assert rows == [(1, "periodic", 30, 0), (3, "hand", 18, 0), (30, "periodic", 60, 1), (60, "periodic", 90, 2)]
    table = trace.rows()
    at = np.flatnonzero(trace.kind == CODE["deadline"])
    assert (table[at - 1, 1] == CODE["release"]).all()
    assert np.array_equal(table[at - 1][:, [0, 2, 5]], table[at][:, [0, 2, 5]])  # time, task and job are those of the release


def test_a_body_that_begins_by_hand_has_its_first_deadline_even_if_it_never_ends():
    k = kernel()

    def body(os):
        yield os.release()
        yield os.compute(1000)
        yield os.delay_until(2)

    k.task("a", body, priority=1, deadline=20)
    trace = k.run(until=50).trace
    assert trace.rows("release", "deadline")[:, [0, 4, 5]].tolist() == [[0, 0, 0], [0, 20, 0]]
