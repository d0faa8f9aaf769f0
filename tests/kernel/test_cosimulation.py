"""A kernel that is taken along by something outside: advance, peek, interrupts added meanwhile, and the trace read in between."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.kernel import FOREVER, Costs, Kernel

TICK = 10
END = 400

STEPS = st.one_of(
    st.tuples(st.just("compute"), st.integers(0, 25)),
    st.tuples(st.just("delay"), st.integers(0, 4)),
    st.tuples(st.just("delay_until"), st.integers(1, 5)),
    st.tuples(st.sampled_from(["take", "receive", "notify_take"]), st.sampled_from([0, 1, 3, None])),
    st.tuples(
        st.sampled_from(["lock", "give", "send", "yield", "notify_give", "suspend", "resume", "device", "mark"]), st.just(0)
    ),
)
TASKS = st.lists(st.tuples(st.integers(1, 3), st.lists(STEPS, min_size=1, max_size=6)), min_size=1, max_size=4)
COSTS = st.builds(Costs, *[st.integers(0, 2)] * 5) | st.just(Costs(tick=1, switch=2, service=17, isr_entry=3, isr_exit=3))
DEVICES = st.lists(st.tuples(st.integers(0, END), st.sampled_from([None, 7, 25])), max_size=3)
PROGRAMS = st.tuples(TASKS, COSTS, st.sampled_from(["none", "freertos", "inheritance"]), st.booleans(), DEVICES)


def built(program):
    """A kernel of ten cycles per tick whose tasks repeat random steps for ever, and the handler its devices use."""
    tasks, costs, protocol, slicing, devices = program
    k = Kernel(cpu_hz=1000 * TICK, costs=costs, time_slicing=slicing)
    lock, semaphore, queue = k.mutex("lock", protocol), k.counting("semaphore", 3, 1), k.queue("queue", 2)

    def handler(isr):
        isr.give(semaphore)
        isr.send(queue, isr.now)
        isr.notify_give(handles[0])
        isr.resume(handles[-1])

    def body_of(steps):
        def body(os):
            calls = {
                "compute": os.compute,
                "delay": os.delay,
                "delay_until": os.delay_until,
                "take": lambda timeout: os.take(semaphore, timeout),
                "receive": lambda timeout: os.receive(queue, timeout),
                "notify_take": lambda timeout: os.notify_take(True, timeout),
                "give": lambda _: os.give(semaphore),
                "send": lambda _: os.send(queue, os.now, 0),
                "yield": lambda _: os.yield_cpu(),
                "notify_give": lambda _: os.notify_give(handles[-1]),
                "suspend": lambda _: os.suspend(handles[0]),
                "resume": lambda _: os.resume(handles[0]),
                "mark": lambda _: os.mark(os.ticks, os.now),
            }
            while True:
                for name, argument in steps:
                    if name == "device":
                        k.interrupt(os.now + 3, handler)
                    elif name == "lock":
                        if (yield os.take(lock, timeout=2)):
                            yield os.compute(4)
                            yield os.give(lock)
                    else:
                        yield calls[name](argument)
                yield os.compute(1)

        return body

    handles = [k.task(f"t{i}", body_of(steps), priority, deadline=30) for i, (priority, steps) in enumerate(tasks)]
    for at, every in devices:
        k.interrupt(at, handler, every)
    return k, handler


@settings(max_examples=150, deadline=None)
@given(PROGRAMS, st.lists(st.integers(0, END), max_size=60))
def test_however_a_simulation_is_cut_the_trace_is_the_same(program, cuts):
    whole, _ = built(program)
    k, _ = built(program)
    for at in sorted(cuts):
        k.advance(at)
    assert np.array_equal(k.run(END).trace.rows(), whole.run(END).trace.rows())


@settings(max_examples=150, deadline=None)
@given(PROGRAMS, st.lists(st.tuples(st.none() | st.integers(1, 90), st.booleans()), max_size=30))
def test_an_interrupt_added_at_a_stop_is_as_good_as_one_asked_for_beforehand(program, stops):
    tasks, costs, protocol, slicing, _ = program
    program = ([(p, [step for step in steps if step[0] != "device"]) for p, steps in tasks], costs, protocol, slicing, [])
    k, handler = built(program)
    added = []
    for step, adds in stops:
        k.advance(max(k.now, min(k.now + step if step else k.peek(), END)))
        if adds and k.now not in added:
            added.append(k.now)
            k.interrupt(k.now, handler)
        if k.peek() == k.now:
            k.advance(k.now + 1)
    asked, handler = built(program)
    for at in added:
        asked.interrupt(at, handler)
    assert np.array_equal(k.run(2 * END).trace.rows(), asked.run(2 * END).trace.rows())


@settings(max_examples=150, deadline=None)
@given(PROGRAMS)
def test_nothing_happens_before_what_peek_says(program):
    tasks, _, *others = program
    k, _ = built((tasks, Costs(), *others))
    while (at := k.peek()) < END:
        rows = len(k.trace)
        assert at >= k.now
        k.advance(at)
        assert len(k.trace) == rows
        k.advance(at + 1)


def sleeper(os):
    yield os.delay(3)
    yield os.compute(4)


def test_peek_jumps_over_what_does_not_matter():
    k = Kernel(cpu_hz=1000 * TICK)
    k.task("a", sleeper, priority=1)
    seen = [k.peek()]
    for _ in range(3):
        k.advance(seen[-1] + 1)
        seen.append(k.peek())
    assert seen == [0, 30, 34, FOREVER]


def test_peek_is_not_held_up_by_a_time_out_that_does_not_count_any_more():
    k = Kernel(cpu_hz=1000 * TICK)
    s = k.binary("s", init=0)

    def waits(os):
        yield os.take(s, timeout=5)
        yield os.take(s)

    k.task("a", waits, priority=1)
    k.interrupt(7, lambda isr: isr.give(s))
    k.advance(8)
    assert k.peek() == FOREVER


def test_traces_read_meanwhile_stay_as_they_were():
    k, _ = built(([(1, [("compute", 3), ("delay", 1)])], Costs(), "none", True, []))
    k.advance(100)
    early = k.trace
    before = early.rows().tolist()
    k.advance(5000)
    assert early.rows().tolist() == before
    assert (early.end, k.trace.end) == (100, 5000)
    assert k.trace.rows()[: len(before)].tolist() == before
    with pytest.raises(ValueError, match="read-only"):
        k.trace.time[0] = 1


def test_the_clock_outside_stands_where_the_simulation_stopped_even_within_a_long_service():
    k = Kernel(cpu_hz=1000 * TICK, costs=Costs(service=25))
    s = k.binary("s")
    seen = []

    def body(os):
        yield os.give(s)
        seen.append((os.now, k.now))
        yield os.compute(1)

    k.task("a", body, priority=1)
    k.advance(5)
    assert k.now == 5
    assert k.peek() == 25
    k.interrupt(6, lambda isr: seen.append(isr.now))
    k.advance(30)
    assert seen == [25, (25, 25)]


def test_no_step_is_a_step_and_none_goes_back():
    k = Kernel(cpu_hz=1000 * TICK)
    k.advance(0)
    k.advance(7)
    k.advance(7)
    with pytest.raises(ValueError, match="advance until cycle 6; a whole number of at least 7 is allowed"):
        k.advance(6)


def test_a_body_cannot_advance_the_kernel_it_runs_in():
    k = Kernel(cpu_hz=1000 * TICK)

    def body(os):
        k.advance(20)
        yield os.compute(1)

    k.task("a", body, priority=1)
    with pytest.raises(ValueError, match="cannot go on from cycle 0: it is inside a task"):
        k.advance(10)


def test_after_an_error_the_kernel_does_not_go_on():
    k = Kernel(cpu_hz=1000 * TICK)

    def body(os):
        yield os.compute(3)
        raise KeyError("sensor")

    k.task("a", body, priority=1)
    with pytest.raises(KeyError):
        k.advance(10)
    with pytest.raises(ValueError, match="cannot go on from cycle 3"):
        k.advance(20)
    assert k.trace.end == 3


def test_the_dead_alarms_of_many_time_outs_are_forgotten():
    k = Kernel(cpu_hz=1000 * TICK)
    s = k.binary("s")

    def waits(os):
        while True:
            yield os.take(s, timeout=1_000_000)

    k.task("a", waits, priority=1)
    k.interrupt(0, lambda isr: isr.give(s), every=3)
    k.advance(30_000)
    assert len(k._core.delayed) < 100


def test_the_journal_is_packed_without_ticks():
    k = Kernel(cpu_hz=1000 * TICK)

    def busy(os):
        while True:
            yield os.compute(1)
            yield os.mark()

    k.task("a", busy, priority=1)
    k.advance(50_000)
    assert len(k._core.journal.rows) < 10_000
    assert len(k.trace.rows("mark")) == 49_999
