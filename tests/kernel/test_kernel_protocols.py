"""Priority inversion, its cures, and deadlock; and the folds that show them."""

import pytest

from labkit.kernel import Kernel, Wait
from labkit.trace.folds import holds, priorities, waits


def kernel(**options):
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, **options)


def marks(run):
    return [(int(time), run.trace.names[task], int(value)) for time, _, task, _, value, _ in run.trace.rows("mark")]


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
    [
        ("none", {}, 45),
        ("freertos", {}, 15),
        ("inheritance", {}, 15),
        ("ceiling", {"ceiling": 3}, 15),
        ("ceiling", {"users": ["low", "high"]}, 15),
    ],
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
    low = trace.code("low")
    assert [row[1:] for row in priorities(trace).tolist() if row[0] == low] == [[0, 10, 1], [10, 30, 4], [30, 50, 1]]


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


def test_a_mutex_that_an_ended_task_kept_is_reported():
    k = kernel()
    a = k.mutex("a")

    def keeper(os):
        yield os.take(a)

    def busy(os):
        while True:
            yield os.compute(5)
            yield os.delay(1)

    k.task("keeper", keeper, priority=3)
    k.task("late", keeper, priority=2)
    k.task("busy", busy, priority=1)
    assert k.run(until=50).deadlock == (Wait("late", "a", "keeper"),)


@pytest.mark.parametrize(("timeout", "at"), [(9, None), (None, 200)])
def test_a_time_out_or_an_interrupt_to_come_is_no_deadlock(timeout, at):
    k = kernel()
    s = k.binary("s")

    def taker(os):
        yield os.take(s, timeout=timeout)

    k.task("x", taker, priority=1)
    if at:
        k.interrupt(at, lambda isr: isr.give(s))
    assert k.run(until=50).deadlock == ()


def test_holds_and_waits_follow_the_lock():
    run = inversion("freertos")
    names = run.trace.names
    held = [(names[task], names[lock], start, end) for task, lock, start, end in holds(run.trace).tolist()]
    waited = [(names[task], names[lock], start, end) for task, lock, start, end in waits(run.trace).tolist()]
    assert held == [("low", "lock", 0, 20), ("high", "lock", 20, 25)]
    assert waited == [("high", "lock", 10, 20)]


def test_priorities_are_steps_that_end_with_the_task():
    run = inversion("freertos")
    low = run.trace.code("low")
    steps = [row[1:] for row in priorities(run.trace).tolist() if row[0] == low]
    assert steps == [[0, 10, 1], [10, 20, 3], [20, 60, 1]]
