"""The kernel's times, interrupts and jobs, one behaviour per test; the recorded rules are in test_oracle.py."""

import numpy as np

from labkit.kernel import Kernel
from labkit.trace import jobs
from labkit.trace.folds import runs


def kernel(**options):
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, **options)


def timeline(run):
    return [(run.trace.names[task], start, end) for task, start, end in runs(run.trace).tolist()]


def marks(run):
    return [(int(time), run.trace.names[task], int(value)) for time, _, task, _, value, _ in run.trace.rows("mark")]


def test_an_empty_kernel_idles():
    assert timeline(kernel().run(until=35)) == [("IDLE", 0, 35)]


def test_a_higher_task_preempts_in_the_middle_of_a_computation():
    k = kernel()

    def low(os):
        yield os.compute(25)

    def high(os):
        yield os.delay(1)
        yield os.compute(7)

    k.task("low", low, priority=1)
    k.task("high", high, priority=2)
    assert timeline(k.run(until=40)) == [("low", 0, 10), ("high", 10, 17), ("low", 17, 32), ("IDLE", 32, 40)]


def test_equals_take_turns_at_ticks_unless_slicing_is_off():
    def body(os):
        yield os.compute(15)

    def both(**options):
        k = kernel(**options)
        k.task("a", body, priority=1)
        k.task("b", body, priority=1)
        return timeline(k.run(until=30))

    assert both() == [("b", 0, 10), ("a", 10, 20), ("b", 20, 25), ("a", 25, 30)]
    assert both(time_slicing=False) == [("b", 0, 15), ("a", 15, 30)]


def test_a_delay_counts_ticks_from_the_call():
    k = kernel()

    def body(os):
        yield os.compute(13)
        yield os.delay(1)  # at cycle 13, in tick 1: until tick 2
        yield os.mark()

    k.task("a", body, priority=1)
    assert marks(k.run(until=40)) == [(20, "a", 0)]


def test_an_interrupt_comes_between_ticks_and_switches_at_once():
    k = kernel()
    data = k.queue("data", length=1)

    def reader(os):
        while True:
            item = yield os.receive(data)
            yield os.mark(item)
            yield os.compute(2)

    k.task("reader", reader, priority=1)
    k.interrupt(13, lambda isr: isr.send(data, 7), every=20)
    run = k.run(until=50)
    assert marks(run) == [(13, "reader", 7), (33, "reader", 7)]
    assert timeline(run) == [("IDLE", 0, 13), ("reader", 13, 15), ("IDLE", 15, 33), ("reader", 33, 35), ("IDLE", 35, 50)]


def test_a_task_can_start_a_device_that_interrupts_later():
    k = kernel()

    def sender(os):
        k.interrupt(os.now + 4, lambda isr: isr.notify_give(task))
        count = yield os.notify_take()
        yield os.mark(count)

    task = k.task("sender", sender, priority=1)
    assert marks(k.run(until=20)) == [(4, "sender", 1)]


def test_a_run_can_be_continued():
    def busy(os):
        while True:
            yield os.compute(7)
            yield os.compute(3)  # ends with the tick, which comes first
            yield os.delay_until(2)
            yield os.delay(0)

    def also(os):
        yield os.compute(100)

    def built():
        k = kernel()
        k.task("busy", busy, priority=2)
        k.task("also", also, priority=1)
        k.task("peer", also, priority=1)
        return k

    k = built()
    for until in range(1, 91):
        run = k.run(until)
    assert run.trace.rows().tolist() == built().run(90).trace.rows().tolist()


def test_nothing_at_or_after_the_end_is_recorded():
    k = kernel()

    def body(os):
        yield os.compute(20)
        yield os.mark()

    k.task("a", body, priority=1)
    assert marks(k.run(until=20)) == []
    assert marks(k.run(until=21)) == [(20, "a", 0)]


def test_numbers_of_numpy_are_numbers():
    k = kernel()

    def body(os):
        yield os.compute(np.int64(3))
        yield os.delay_until(np.int64(1))
        yield os.delay(np.int64(1))
        yield os.mark(np.int64(4))

    k.task("a", body, priority=1)
    assert marks(k.run(until=30)) == [(20, "a", 4)]


# Jobs


def test_delay_until_makes_jobs_and_the_first_may_start_at_zero():
    k = kernel()

    def body(os):
        for cycles in (3, 25, 3):
            yield os.compute(cycles)
            yield os.delay_until(2)

    k.task("a", body, priority=1, deadline=20)
    run = k.run(until=100)
    jobs = [(int(value), int(job)) for _, _, _, _, value, job in run.trace.rows("release")]
    ends = [(int(time), int(deadline), int(job)) for time, _, _, _, deadline, job in run.trace.rows("complete")]
    assert jobs == [(0, 0), (20, 1), (40, 2), (60, 3)]
    assert ends == [(3, 20, 0), (45, 40, 1), (48, 60, 2), (60, 80, 3)]


def test_a_first_delay_until_is_the_first_release_and_no_job():
    k = kernel()

    def body(os):
        yield os.delay_until(3)
        yield os.compute(4)

    k.task("a", body, priority=1)
    run = k.run(until=60)
    assert run.trace.rows("release")[:, [0, 4, 5]].tolist() == [[30, 30, 0]]
    assert run.trace.rows("complete")[:, [0, 4, 5]].tolist() == [[34, -1, 0]]


def test_a_job_can_be_marked_by_hand():
    k = kernel()

    def body(os):
        yield os.compute(2)
        yield os.release()
        yield os.compute(3)
        yield os.complete()

    k.task("a", body, priority=1, deadline=10)
    run = k.run(until=9)
    assert run.trace.rows("release")[:, [0, 4]].tolist() == [[2, 2]]
    assert run.trace.rows("complete")[:, [0, 4]].tolist() == [[5, 12]]


def first_job(released: bool):
    """A task that never gets to run, with a deadline it cannot meet."""
    k = Kernel(cpu_hz=1000, tick_hz=1000)

    def forever(os):
        yield os.compute(1000)

    def body(os):
        yield os.compute(1)
        yield os.delay_until(50)

    k.task("high", forever, priority=2)
    k.task("low", body, priority=1, deadline=20, released=released)
    return jobs(k.run(until=100).trace)


def test_a_job_released_at_the_start_is_missed_though_it_never_begins():
    (missed,) = np.flatnonzero(first_job(released=True).missed)
    found = first_job(released=True)
    assert (found.release[missed], found.deadline[missed], found.start[missed]) == (0, 20, -1)
    assert not first_job(released=False).missed.any()


def test_what_would_end_at_the_very_end_of_a_run_is_not_yet_missed():
    k = Kernel(cpu_hz=1000, tick_hz=1000)

    def body(os):
        yield os.compute(20)
        yield os.delay_until(50)

    k.task("low", body, priority=1, deadline=20, released=True)
    assert not jobs(k.run(until=20).trace).missed.any()
    assert not jobs(k.run(until=21).trace).missed.any()
    assert jobs(k.trace.window(0, 19)).missed.tolist() == [False]
