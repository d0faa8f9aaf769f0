"""Interrupts of different priorities: who preempts whom, what a critical section holds back, and who may call the kernel."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.kernel import Costs, Kernel
from labkit.trace import KINDS, overheads, runs

MASK = 5


def kernel(**options):
    """A hundred cycles per tick."""
    return Kernel(cpu_hz=100_000, tick_hz=1000, max_syscall_priority=MASK, **options)


def marks(run):
    """(cycle, value) of the marks, in order."""
    return run.trace.rows("mark")[:, [0, 4]].tolist()


def critical_for(cycles):
    def body(os):
        yield os.compute(10)
        yield os.enter_critical()
        yield os.compute(cycles)
        yield os.exit_critical()
        yield os.compute(1000)

    return body


def test_a_critical_section_holds_an_interrupt_back_unless_it_is_above_the_mask():
    k = kernel()
    k.task("a", critical_for(50), 1)
    for number, priority in enumerate((MASK - 1, MASK, 15)):
        k.interrupt(20 + number, lambda isr, number=number: isr.mark(number), priority=priority)
    assert marks(k.run(200)) == [[20, 0], [60, 1], [60, 2]]


def test_of_those_held_back_the_most_urgent_comes_first():
    k = kernel()
    k.task("a", critical_for(50), 1)
    for priority in (15, 9, 12, 7):
        k.interrupt(20, lambda isr, priority=priority: isr.mark(priority), priority=priority)
    assert marks(k.run(200)) == [[60, 7], [60, 9], [60, 12], [60, 15]]


def test_a_handler_is_preempted_by_a_more_urgent_one_only_and_finished_later():
    k = kernel(costs=Costs(isr_entry=2, isr_exit=3))
    k.task("a", critical_for(1), 1)
    k.interrupt(20, lambda isr: isr.mark(8), priority=8, cycles=10)
    k.interrupt(25, lambda isr: isr.mark(3), priority=3, cycles=4)
    k.interrupt(26, lambda isr: isr.mark(9), priority=9, cycles=1)
    run = k.run(100)
    # 8: 20 enters, computes 22..25; 3: 25 enters, computes 27..31, leaves at 34; 8: 34..41, leaves at 44; 9: computes 46..47
    assert marks(run) == [[31, 3], [41, 8], [47, 9]]
    assert overheads(run.trace)[:, 1:].tolist() == [
        *([20, 22], [22, 25], [25, 27], [27, 31], [31, 34], [34, 41], [41, 44], [44, 46], [46, 47], [47, 50])
    ]


def test_a_call_from_above_the_mask_is_an_error_that_names_it():
    k = kernel()
    k.task("a", critical_for(50), 1)
    signal = k.binary("signal")
    k.interrupt(20, lambda isr: isr.give(signal), priority=MASK - 1)
    with pytest.raises(ValueError, match="an interrupt of priority 4 calls give on 'signal'; only those of priority 5 to 15 may"):
        k.run(200)


def test_what_a_nested_interrupt_readies_runs_after_all_of_them():
    k = kernel()
    signal = k.binary("signal")

    def waiter(os):
        yield os.take(signal)
        yield os.mark(7)

    k.task("low", critical_for(1), 1)
    k.task("high", waiter, 2)
    k.interrupt(20, lambda isr: isr.mark(9), priority=9, cycles=10)
    k.interrupt(22, lambda isr: isr.give(signal), priority=6, cycles=2)
    assert marks(k.run(100)) == [[32, 9], [32, 7]]


@pytest.mark.parametrize("priority", [15, 7])
def test_a_task_woken_off_the_tick_gets_its_turn_at_the_next_one(priority):
    """Of the ticks before that, in which the running task was alone, none is made up for."""
    k = kernel(costs=Costs(isr_entry=2))
    signal = k.binary("signal")

    def waits(os):
        yield os.take(signal)
        yield os.compute(50)

    k.task("busy", critical_for(1), 1)
    k.task("woken", waits, 1)
    k.interrupt(550, lambda isr: isr.give(signal), priority=priority)
    switches = k.run(900).trace.rows("switch")
    assert switches[switches[:, 0] >= 550][0, [0, 2]].tolist() == [600, 2]


def test_interrupts_that_take_all_the_time_end_in_an_error():
    k = kernel()
    k.task("a", critical_for(1), 1)
    k.interrupt(20, lambda isr: None, priority=8, cycles=10)
    k.interrupt(22, lambda isr: None, priority=3, cycles=5, every=5)
    with pytest.raises(ValueError, match="100000 more urgent interrupts in a handler of priority 8; it never ends"):
        k.run(200)


interrupts = st.lists(
    st.tuples(st.integers(0, 400), st.integers(0, 15), st.integers(0, 30)), min_size=1, max_size=12
)  # cycle, priority, cycles of the handler
sections = st.lists(st.tuples(st.integers(1, 60), st.integers(1, 60)), max_size=5)  # outside and inside


@given(interrupts, sections, st.sampled_from((Costs(), Costs(isr_entry=3, isr_exit=2), Costs(tick=2, switch=1))))
@settings(max_examples=150, deadline=None)
def test_what_holds_for_every_pattern_of_interrupts(interrupts, sections, costs):
    k = kernel(costs=costs, pending_ticks="all")

    def body(os):
        for outside, inside in sections:
            yield os.compute(outside)
            yield os.enter_critical()
            yield os.compute(inside)
            yield os.exit_critical()
        while True:
            yield os.compute(7)

    k.task("a", body, 1)
    done = []
    for number, (at, priority, cycles) in enumerate(interrupts):
        k.interrupt(at, lambda isr, number=number: done.append((number, isr.now)), priority=priority, cycles=cycles)
    run = k.run(3000)

    ends = dict(done)
    assert sorted(ends) == list(range(len(interrupts)))
    busy = runs(run.trace)[:, 1:].tolist() + overheads(run.trace)[:, 1:].tolist()
    assert sum(end - start for start, end in busy) == 3000  # every cycle has one owner

    entry = costs.isr_entry
    for number, (at, priority, cycles) in enumerate(interrupts):
        assert ends[number] >= at + entry + cycles
        above = [other for other in interrupts if other[1] <= priority and other is not interrupts[number]]
        if priority < MASK and not above:
            # Nothing that runs holds it back, but for what cannot be preempted: an entry or exit, a tick, a switch.
            assert ends[number] <= at + entry + cycles + max(entry, costs.isr_exit, costs.tick + costs.switch)

    inside = []  # critical sections, as (start, end)
    for time, kind, *_ in run.trace.rows("enter_critical", "exit_critical").tolist():
        inside.append([time]) if KINDS[kind] == "enter_critical" else inside[-1].append(time)
    for number, (_, priority, _) in enumerate(interrupts):
        if priority >= MASK:
            assert not any(start < ends[number] < end for start, end in inside)
    for first, one in enumerate(interrupts):
        for second, other in enumerate(interrupts):
            if one[1] < other[1] and one[0] <= other[0] and one[1] < MASK:
                assert ends[first] <= ends[second]  # more urgent and not later, and nothing holds it: it is done first
