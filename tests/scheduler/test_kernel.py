"""The kernel's services and times, one behaviour per test; the recorded rules are in test_oracle.py."""

import pytest

from labkit.scheduler import Costs, Kernel, Wait
from labkit.trace.folds import holds, overheads, priorities, runs, waits


def kernel(**options):
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, **options)


def timeline(run):
    return [(run.trace.names[task], start, end) for task, start, end in runs(run.trace).tolist()]


def marks(run):
    return [(int(time), run.trace.names[task], int(value)) for time, _, task, _, value, _ in run.trace.rows("mark")]


# Time


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
            yield os.delay_until(2)

    def also(os):
        yield os.compute(100)

    def built():
        k = kernel()
        k.task("busy", busy, priority=2)
        k.task("also", also, priority=1)
        k.task("peer", also, priority=1)
        return k

    k = built()
    for until in (1, 7, 10, 20, 33, 40, 90):
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


# Protocols


def inversion(protocol, **options):
    k = kernel()
    lock = k.mutex("lock", protocol=protocol, **options)

    def low(os):
        yield os.take(lock)
        yield os.compute(20)
        yield os.give(lock)
        yield os.compute(5)

    def middle(os):
        yield os.delay_until(1)
        yield os.compute(30)

    def high(os):
        yield os.delay_until(1)
        yield os.take(lock)
        yield os.compute(5)
        yield os.give(lock)

    k.task("low", low, priority=1)
    k.task("middle", middle, priority=2)
    k.task("high", high, priority=3)
    return k.run(until=80)


@pytest.mark.parametrize(
    ("protocol", "options", "response"),
    [("none", {}, 45), ("freertos", {}, 15), ("inheritance", {}, 15), ("ceiling", {"ceiling": 3}, 15), ("ceiling", {"users": ["low", "high"]}, 15)],
)
def test_priority_inversion_and_its_cures(protocol, options, response):
    run = inversion(protocol, **options)
    high = run.trace.code("high")
    done = [row for row in run.trace.rows("complete").tolist() if row[2] == high]
    assert done[0][0] - 10 == response


def test_the_textbook_inherits_along_chains_where_freertos_does_not():
    def chain(protocol):
        k = kernel()
        a, b = k.mutex("a", protocol=protocol), k.mutex("b", protocol=protocol)

        def low(os):
            yield os.take(a)
            yield os.compute(30)
            yield os.give(a)

        def middle(os):
            yield os.delay_until(1)
            yield os.take(b)
            yield os.take(a)
            yield os.give(a)
            yield os.give(b)

        def high(os):
            yield os.delay_until(2)
            yield os.take(b)
            yield os.give(b)

        k.task("low", low, priority=1)
        k.task("middle", middle, priority=3)
        k.task("high", high, priority=5)
        trace = k.run(until=25).trace
        return priorities(trace)[priorities(trace)[:, 0] == trace.code("low")][-1, 3]

    assert chain("inheritance") == 5
    assert chain("freertos") == 3


def nested(protocol):
    """L holds A and B; H waits for B. The give of B should take L's inherited priority away, while it still holds A."""
    k = kernel()
    a, b = k.mutex("a", protocol=protocol), k.mutex("b", protocol=protocol)

    def low(os):
        yield os.take(a)
        yield os.take(b)
        yield os.compute(15)
        yield os.give(b)
        yield os.compute(15)
        yield os.give(a)

    def high(os):
        yield os.delay_until(1)
        yield os.take(b)
        yield os.give(b)

    k.task("low", low, priority=1)
    k.task("high", high, priority=4)
    trace = k.run(until=60).trace
    low = trace.code("low")
    return [row[1:] for row in priorities(trace).tolist() if row[0] == low]


def test_the_textbook_disinherits_at_the_give_freertos_at_the_last_give():
    assert nested("inheritance") == [[0, 10, 1], [10, 15, 4], [15, 30, 1]]
    assert nested("freertos") == [[0, 10, 1], [10, 30, 4]]


def test_the_textbook_disinherits_when_the_waiter_times_out():
    k = kernel()
    lock = k.mutex("lock", protocol="inheritance")

    def low(os):
        yield os.take(lock)
        yield os.compute(60)

    def high(os):
        yield os.delay_until(1)
        answer = yield os.take(lock, timeout=2)
        yield os.mark(answer)

    k.task("low", low, priority=1)
    k.task("high", high, priority=4)
    trace = k.run(until=50).trace
    assert [row[1:] for row in priorities(trace).tolist() if row[0] == trace.code("low")] == [[0, 10, 1], [10, 30, 4], [30, 50, 1]]


@pytest.mark.parametrize("act", [lambda os, high: os.suspend(high), lambda os, high: os.set_priority(high, 1)])
def test_a_holder_that_sends_its_waiter_away_gives_way_at_once(act):
    k = kernel()
    lock = k.mutex("lock", protocol="inheritance")

    def low(os):
        yield os.take(lock)
        yield os.compute(15)
        yield act(os, high)
        yield os.compute(5)

    def middle(os):
        yield os.delay_until(1)
        yield os.mark()

    def waits(os):
        yield os.delay_until(1)
        yield os.take(lock)

    k.task("low", low, priority=1)
    k.task("middle", middle, priority=2)
    high = k.task("high", waits, priority=4)
    assert marks(k.run(until=30)) == [(15, "middle", 0)]


def test_a_task_above_the_ceiling_is_refused():
    k = kernel()
    lock = k.mutex("lock", protocol="ceiling", ceiling=2)

    def body(os):
        yield os.take(lock)

    k.task("a", body, priority=3)
    with pytest.raises(ValueError, match="'a' of priority 3 takes mutex 'lock', whose ceiling is 2"):
        k.run(until=10)


# Deadlock


def test_a_circle_of_mutexes_is_reported_with_who_waits_for_whom():
    k = kernel()
    a, b = k.mutex("a"), k.mutex("b")

    def crossing(first, second, delay):
        def body(os):
            yield os.delay(delay)
            yield os.take(first)
            yield os.compute(15)
            yield os.take(second)

        return body

    k.task("x", crossing(a, b, 0), priority=1)
    k.task("y", crossing(b, a, 1), priority=2)
    run = k.run(until=100)
    assert run.deadlock == (Wait("x", "b", "y"), Wait("y", "a", "x"))
    assert str(run.deadlock[0]) == "x waits for b, held by y"


def test_a_task_that_takes_its_own_mutex_twice_is_stuck():
    k = kernel()
    a = k.mutex("a")

    def body(os):
        yield os.take(a)
        yield os.take(a)

    k.task("x", body, priority=1)
    assert k.run(until=50).deadlock == (Wait("x", "a", "x"),)


def test_when_all_wait_for_ever_all_are_reported():
    k = kernel()
    s = k.binary("s")

    def taker(os):
        yield os.take(s)

    def sleeper(os):
        yield os.notify_take()

    k.task("x", taker, priority=1)
    k.task("y", sleeper, priority=2)
    assert k.run(until=50).deadlock == (Wait("x", "s"), Wait("y", "a notification"))


def test_a_time_out_or_an_interrupt_to_come_is_no_deadlock():
    for timeout, at in ((9, None), (None, 200)):
        k = kernel()
        s = k.binary("s")

        def taker(os):
            yield os.take(s, timeout=timeout)

        k.task("x", taker, priority=1)
        if at:
            k.interrupt(at, lambda isr: isr.give(s))
        assert k.run(until=50).deadlock == ()


# Costs


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
    assert overheads(run.trace).tolist() == [[1, 0, 1], [0, 10, 12], [1, 12, 13], [1, 16, 17], [0, 20, 22], [0, 30, 32], [1, 32, 33]]
    total = (runs(run.trace)[:, 2] - runs(run.trace)[:, 1]).sum() + (overheads(run.trace)[:, 2] - overheads(run.trace)[:, 1]).sum()
    assert total == 40


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
    every._every_tick = True
    assert every.run(300).trace.rows().tolist() == built().run(300).trace.rows().tolist()


# Mistakes


def raises(match, body, **objects):
    k = kernel()
    made = {name: getattr(k, kind)(name, **arguments) for name, (kind, arguments) in objects.items()}
    k.task("a", lambda os: body(os, **made), priority=1)
    with pytest.raises(ValueError, match=match) as caught:
        k.run(until=50)
    assert any("in task 'a' at cycle" in note for note in caught.value.__notes__)


def test_a_give_by_another_than_the_holder_names_task_and_mutex():
    def body(os, m):
        yield os.give(m)

    raises("task 'a' gives mutex 'm', which nobody holds", body, m=("mutex", {}))


def test_a_loop_that_takes_no_time_names_the_task():
    def body(os, s):
        while True:
            yield os.give(s)

    raises("task 'a' is caught in a loop that takes no time", body, s=("binary", {}))


@pytest.mark.parametrize(
    ("request_of", "message"),
    [
        (lambda os: None, "task 'a' yielded None"),
        (lambda os: -5, "task 'a' yielded -5"),
        (lambda os: os.delay(-1), "delay of -1 ticks"),
        (lambda os: os.delay_until(0), "delay_until of 0 ticks"),
        (lambda os: os.delay_until(2.5), "delay_until of 2.5 ticks"),
        (lambda os: os.take("lock"), "'lock' is no semaphore or mutex"),
        (lambda os: os.send("queue", 1), "'queue' is no queue"),
        (lambda os: os.notify_give("b"), "'b' is no task"),
        (lambda os: os.set_priority(None, 8), "priority 8; 1 to 7 are allowed"),
    ],
)
def test_a_bad_request_says_what_is_wrong(request_of, message):
    def body(os):
        yield request_of(os)

    raises(message, body)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Kernel(cpu_hz=1000, tick_hz=300), "tick_hz must divide cpu_hz"),
        (lambda: Kernel(priorities=1), "2 to 64 are allowed"),
        (lambda: Costs(tick=-1), "the cost of tick is -1"),
        (lambda: Costs(service={"fly": 3}), "no service 'fly'"),
        (lambda: kernel(costs=Costs(tick=10)), "no task would ever run"),
        (lambda: kernel().mutex("m", protocol="magic"), "protocol 'magic'; there are none, freertos, inheritance, ceiling"),
        (lambda: kernel().mutex("m", protocol="ceiling"), "a ceiling or its users"),
        (lambda: kernel().counting("s", length=2, init=3), "starts with 3 of 2"),
        (lambda: kernel().queue("q", length=0), "room for 0 items"),
        (lambda: kernel().task("IDLE", lambda os: iter(()), priority=1), "'IDLE' is taken"),
        (lambda: kernel().task("a", lambda os: None, priority=1), "no generator function"),
        (lambda: kernel().task("a", lambda os: None, priority=0), "priority 0; 1 to 7 are allowed"),
        (lambda: kernel().interrupt(-1, print), "an interrupt at cycle -1"),
        (lambda: kernel().run(0), "run until cycle 0"),
    ],
)
def test_bad_settings_say_what_is_allowed(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_protocols_of_freertos_and_the_textbook_do_not_mix():
    k = kernel()
    k.mutex("a", protocol="freertos")
    k.mutex("b", protocol="none")
    with pytest.raises(ValueError, match="cannot be mixed"):
        k.mutex("c", protocol="inheritance")


# Folds


def test_holds_and_waits_follow_the_lock():
    run = inversion("freertos")
    names = run.trace.names
    assert [(names[t], names[o], s, e) for t, o, s, e in holds(run.trace).tolist()] == [("low", "lock", 0, 20), ("high", "lock", 20, 25)]
    assert [(names[t], names[o], s, e) for t, o, s, e in waits(run.trace).tolist()] == [("high", "lock", 10, 20)]


def test_priorities_are_steps_that_end_with_the_task():
    run = inversion("freertos")
    low = run.trace.code("low")
    steps = [row[1:] for row in priorities(run.trace).tolist() if row[0] == low]
    assert steps == [[0, 10, 1], [10, 20, 3], [20, 60, 1]]
