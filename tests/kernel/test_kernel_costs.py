"""What the kernel's own work costs, when, and whom."""

import pytest

from labkit.kernel import Costs, Kernel
from labkit.trace.folds import overheads, runs
from labkit.trace.kinds import OVERHEADS


def kernel(**options):
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, **options)


def timeline(run):
    return [(run.trace.names[task], start, end) for task, start, end in runs(run.trace).tolist()]


def marks(run):
    return [(int(time), run.trace.names[task], int(value)) for time, _, task, _, value, _ in run.trace.rows("mark")]


def test_costs_delay_and_are_charged_to_nobody():
    k = kernel(costs=Costs(tick=2, switch=1))

    def low(os):
        yield os.compute(20)

    def high(os):
        yield os.delay(1)
        yield os.compute(3)

    k.task("low", low, priority=1)
    k.task("high", high, priority=2)
    run = k.run(until=40)
    # 0: switch to low. 10: tick 2, switch 1. 16: high done, switch. 20: tick. 30: tick. 34: low done, switch.
    assert timeline(run) == [("low", 1, 10), ("high", 13, 16), ("low", 17, 20), ("low", 22, 30), ("IDLE", 33, 40)]
    ticks = [[0, 10, 12], [0, 20, 22], [0, 30, 32]]
    switches = [[1, 0, 1], [1, 12, 13], [1, 16, 17], [1, 32, 33]]
    assert overheads(run.trace).tolist() == sorted(ticks + switches, key=lambda row: row[1])


def test_services_cost_each_its_own():
    k = kernel(costs=Costs(service={"give": 3}))
    s = k.binary("s")

    def body(os):
        yield os.give(s)
        yield os.take(s)
        yield os.mark()

    k.task("a", body, priority=1)
    assert marks(k.run(until=10)) == [(3, "a", 0)]


def test_an_interrupt_costs_entry_and_exit_and_the_switch_comes_after():
    k = kernel(costs=Costs(isr_entry=2, isr_exit=1, switch=1))

    def body(os):
        yield os.notify_take()
        yield os.mark()

    task = k.task("a", body, priority=1)
    k.interrupt(5, lambda isr: isr.notify_give(task))
    assert marks(k.run(until=20)) == [(9, "a", 0)]


def test_calls_in_interrupts_cost_what_services_cost():
    k = kernel(costs=Costs(isr_entry=2, isr_exit=1, service={"give": 3, "send": 4, "notify_give": 5, "resume": 6}))
    s, q = k.binary("s"), k.queue("q", 1)
    seen = []

    def handler(isr):
        for call in (lambda: isr.give(s), lambda: isr.send(q, 1), lambda: isr.notify_give(task), lambda: isr.resume(task)):
            call()
            seen.append(isr.now)

    task = k.task("a", lambda os: (yield os.suspend()), priority=1)
    k.interrupt(5, handler)
    run = k.run(until=40)
    assert seen == [10, 14, 19, 25]
    spent = run.trace.rows("overhead")[:, [0, 4, 5]].tolist()
    isr, service = OVERHEADS.index("isr"), OVERHEADS.index("service")
    calls = [[7, 3, service], [10, 4, service], [14, 5, service], [19, 6, service]]
    assert spent == [[5, 2, isr], *calls, [25, 1, isr]]


def test_an_interrupt_during_a_switch_comes_before_the_new_task_goes_on():
    k = kernel(costs=Costs(switch=4))

    def body(os):
        yield os.delay(1)
        order.append(("task", os.now))
        yield os.compute(1)

    k.task("a", body, priority=1)
    k.interrupt(12, lambda isr: order.append(("interrupt", isr.now)))
    order = []
    k.run(until=30)
    assert order == [("interrupt", 14), ("task", 14)]


def test_interrupts_that_leave_no_time_do_not_hang():
    k = kernel(costs=Costs(isr_entry=2))
    k.interrupt(0, lambda isr: None, every=1)
    assert timeline(k.run(until=100)) == []


def test_interrupts_that_take_no_time_and_never_stop_are_reported():
    k = kernel()

    def again(isr):
        k.interrupt(isr.now, again)

    k.interrupt(5, again)
    with pytest.raises(ValueError, match="device interrupts in a row up to cycle 5"):
        k.run(until=10)


def test_an_interrupt_and_a_task_that_keep_each_other_going_are_reported():
    k = kernel()

    def body(os):
        while True:
            k.interrupt(os.now, lambda isr: isr.notify_give(task))
            yield os.notify_take()

    task = k.task("a", body, priority=1)
    with pytest.raises(ValueError, match="'a' is caught in a loop that takes no time"):
        k.run(until=10)


def test_a_tick_during_a_service_waits_until_it_is_over():
    k = kernel(costs=Costs(service={"give": 8}))
    s = k.binary("s")

    def body(os):
        yield os.compute(5)
        yield os.give(s)
        yield os.compute(5)

    def high(os):
        yield os.delay(1)
        yield os.mark()

    k.task("low", body, priority=1)
    k.task("high", high, priority=2)
    assert marks(k.run(until=30)) == [(13, "high", 0)]


def test_visiting_every_tick_changes_nothing():
    def built():
        k = kernel()
        lock = k.mutex("lock")

        def body(os):
            for _ in range(3):
                yield os.delay_until(3)
                yield os.take(lock)
                yield os.compute(17)
                yield os.give(lock)

        for name, priority in (("a", 1), ("b", 1), ("c", 2)):
            k.task(name, body, priority=priority)
        return k

    every = built()
    every._core.every_tick = True
    assert every.run(300).trace.rows().tolist() == built().run(300).trace.rows().tolist()
