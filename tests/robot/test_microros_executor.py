"""The numbered rules of micro-ROS's executor, timers and waits, one by one; numbers as in the docstrings of the model."""

import pytest

from labkit.kernel import Kernel
from labkit.robot.microros_executor import (
    DATA,
    EMPTY,
    TICK,
    Client,
    Executor,
    Subscription,
    Timer,
    spin,
    spin_once,
    spin_periodically,
)

MS = 1000  # cycles per tick in these tests


class World:
    """A kernel of 1000 cycles per tick with a task `uros`, and a note of what was called when, in cycles."""

    def __init__(self, pool=4, rule="poll", room=6):
        self.k = Kernel(cpu_hz=1_000_000, tick_hz=1000)
        self.mailbox = self.k.queue("mailbox", room)
        self.called = []
        self.pool, self.rule = pool, rule

    def note(self, name, cycles=0):
        def callback(os, given):
            self.called.append((os.now, name, given))
            yield cycles

        return callback

    def client(self, *executors):
        subscriptions = [h for e in executors for h in e.handles if isinstance(h, Subscription)]
        known = {s.topic for s in subscriptions}
        return Client(self.mailbox, subscriptions, lambda d: d[0] if d[0] in known | {"else"} else None, self.pool, self.rule)

    def arrives(self, at, *datagram):
        self.k.interrupt(at, lambda isr: isr.send(self.mailbox, datagram))

    def run(self, until, *executors, body=None):
        self.used = self.client(*executors)
        self.k.task("uros", body or (lambda os: spin(os, executors, self.used)), 1)
        self.k.run(until)
        return self.called


def timer(period, callback, **more):
    return Timer(period, callback, **more)


def waits(w):
    numbers = w.used.waits.tolist()
    return [tuple(numbers[i : i + 4]) for i in range(0, len(numbers), 4)]


def names(called):
    return [name for _, name, _ in called]


def test_1_a_pass_waits_once_and_calls_in_the_order_of_adding():
    w = World()
    executor = Executor("e", [Subscription("b", w.note("b")), Subscription("a", w.note("a")), Timer(1, w.note("t"))])
    w.arrives(300, "a", 1)
    w.arrives(300, "b", 2)  # read by the second pass only
    assert w.run(1500, executor) == [(300, "a", ("a", 1)), (300, "b", ("b", 2)), (1000, "t", 1)]


def test_1_order_of_adding_decides_when_both_are_ready():
    w = World()
    executor = Executor("e", [Subscription("b", w.note("b")), Subscription("a", w.note("a"))], "let")
    used = w.client(executor)
    used.store("a", 1)
    used.store("b", 2)
    w.run(10, executor, body=lambda os: spin_once(os, executor, used))
    assert names(w.called) == []  # the wait still waits
    w.k.run(1500)
    assert w.called == [(1000, "b", 2), (1000, "a", 1)]


@pytest.mark.parametrize(("semantics", "seen"), [("default", "new"), ("let", "old")])
def test_2_let_takes_all_inputs_before_it_executes_any(semantics, seen):
    w = World()

    def publishes_to_b(os, given):
        used.store("b", "new")
        yield 1

    executor = Executor("e", [Subscription("a", publishes_to_b), Subscription("b", w.note("b"))], semantics)
    used = w.client(executor)
    used.store("a", 1)
    used.store("b", "old")
    w.run(1500, executor, body=lambda os: spin_once(os, executor, used))
    assert w.called == [(1001, "b", seen)]


@pytest.mark.parametrize(
    ("trigger", "ready", "goes"),
    [
        ("any", (True, False), True),
        ("any", (False, False), False),
        ("all", (True, False), False),
        ("all", (True, True), True),
        (1, (True, False), False),
        (1, (False, True), True),
        ("always", (False, False), True),
    ],
)
def test_3_triggers(trigger, ready, goes):
    w = World()
    executor = Executor("e", [Subscription(n, w.note(n)) for n in "ab"], trigger=trigger)
    assert executor.triggered(ready) == goes


def test_3_if_the_trigger_says_no_data_stay_in_the_buffer():
    w = World()
    executor = Executor("e", [Subscription("a", w.note("a")), Timer(3, w.note("t"))], "let", trigger=1)
    w.arrives(200, "a", 7)
    assert w.run(3500, executor) == [(3000, "a", ("a", 7)), (3000, "t", 3)]


def test_4_one_message_per_pass_and_always_means_without_one_too():
    w = World()
    executor = Executor("e", [Subscription("a", w.note("a"), always=True, depth=3), Timer(1, w.note("t"))], trigger=1)
    used = w.client(executor)
    for n in (1, 2):
        used.store("a", n)
    w.run(3500, executor, body=lambda os: spin(os, [executor], used))
    assert [given for _, name, given in w.called if name == "a"] == [1, 2, None]
    assert names(w.called).count("t") == 3


def test_5_a_long_callback_keeps_all_others_waiting():
    w = World()
    executor = Executor("e", [Timer(1, w.note("long", 2500)), Timer(1, w.note("short"))])
    assert w.run(3600, executor)[:2] == [(1000, "long", 1), (3500, "short", 3)]


def test_6_periodic_spin_catches_up_after_an_overrun():
    w = World()
    work = iter([3500, 100, 100, 100])

    def varied(os, given):
        w.called.append((os.now, "t", given))
        yield next(work)

    executor = Executor("e", [Timer(1, varied, created=-1)], limit=0)
    w.run(6500, executor, body=lambda os: spin_periodically(os, executor, w.used, 2))
    # passes at 0, at once at 3.5 ms for the one due at 2 ms, then at 4 and 6 ms
    assert [at for at, _, _ in w.called] == [0, 3500, 4000, 6000]


def test_7_time_stands_still_between_ticks():
    """A timer of 1 ms that was called at 1.9 ms is due again at 2 ms: it counts ticks."""
    w = World()
    executor = Executor("e", [Timer(1, w.note("t", 900))])
    assert [at for at, _, _ in w.run(3500, executor)] == [1000, 2000, 3000]


def test_8_first_call_a_period_after_creation():
    t = Timer(5, None, created=3)
    assert (t.ready(7), t.ready(8), t.ready(9)) == (False, True, True)


@pytest.mark.parametrize(
    ("rule", "late", "due", "dropped"),
    [
        ("jazzy", 0, 20, 0),
        ("jazzy", 9, 20, 0),
        ("jazzy", 10, 30, 1),  # late by exactly a period: dropped
        ("jazzy", 25, 40, 2),
        ("humble", 9, 20, 0),
        ("humble", 10, 20, 0),  # and here caught up: due again at once
        ("humble", 11, 30, 1),
        ("humble", 25, 40, 2),
    ],
)
def test_9_a_late_call_drops_periods(rule, late, due, dropped):
    t = Timer(10, None, rule)
    t.call(10 + late)
    assert (t.next, t.dropped) == (due, dropped)
    assert t.next % 10 == 0  # the grid stays
    assert t.next > 10 + late if rule == "jazzy" else t.next >= 10 + late


def test_10_the_callback_is_told_the_ticks_since_its_last_call():
    t = Timer(10, None)
    assert [t.call(now) for now in (10, 23, 30)] == [10, 13, 7]


def test_11_the_limit_is_the_spin_limit_or_what_is_left_of_its_own_timers():
    a = Executor("a", [Timer(5, None), Timer(3, None)], limit=10)
    b = Executor("b", [Subscription("x", None)], limit=10)
    assert [a.wait_limit(now) for now in (0, 2, 3, 9)] == [3, 1, 0, 0]
    assert b.wait_limit(0) == 10
    assert Executor("c", [Timer(5, None)], limit=1).wait_limit(0) == 1


def test_12_data_for_another_ends_the_wait_and_waits_are_blind_to_buffers():
    w = World()
    first, second = Executor("1", [Subscription("a", w.note("a"))]), Executor("2", [Subscription("b", w.note("b"))])
    w.arrives(400, "a", 0)  # during the wait of the first
    w.arrives(600, "a", 1)  # during the wait of the second: ends it, and is found by the first only after its own next wait
    assert w.run(1900, first, second) == [(400, "a", ("a", 0)), (1000, "a", ("a", 1))]
    assert waits(w)[:3] == [(1, DATA, 400, 0), (1, DATA, 600, 0), (1, TICK, 1000, -1)]


def test_13_a_datagram_without_data_only_uses_up_time():
    w = World()
    executor = Executor("e", [Subscription("a", w.note("a"))], limit=2)
    w.arrives(300, "heartbeat")
    w.arrives(500, "else")
    w.run(2400, executor)
    assert waits(w)[:2] == [(2, DATA, 500, -1), (2, TICK, 2000, -1)]


def test_14_a_limit_of_one_ends_at_the_coming_tick_and_zero_at_once():
    w = World()

    def body(os):
        yield 300
        yield from w.used.wait(os, 1)
        yield from w.used.wait(os, 0)
        yield from w.used.wait(os, 3)

    w.run(5000, body=body)
    assert waits(w) == [(1, TICK, 1000, -1), (0, EMPTY, 1000, -1), (3, TICK, 4000, -1)]


@pytest.mark.parametrize(
    ("rule", "calls"),
    [
        ("poll", [1000, 2200, 3400]),
        ("at least 1", [1000, 3000]),  # a due timer waits for the next tick
        ("0 is for ever", [1000, 2500]),  # a due timer waits for a packet
        ("for ever", [2500]),  # and here one that is not due, too
    ],
)
def test_15_traps_of_the_transports(rule, calls):
    w = World(rule=rule)
    executor = Executor("e", [Timer(1, w.note("t", 1200)), Subscription("else", w.note("else"))])
    if "for ever" in rule:
        w.arrives(2500, "else")
    assert [at for at, name, _ in w.run(4100, executor) if name == "t"] == calls


def test_16_buffers_keep_the_newest_and_an_empty_pool_drops():
    w = World(pool=3)
    a, b = Subscription("a", None, depth=2), Subscription("b", None, depth=2)
    used = w.client(Executor("e", [a, b]))
    for n in range(4):
        used.store("a", n)
    assert list(a.buffer) == [2, 3]
    used.store("b", 0)
    used.store("b", 1)  # the pool of three is taken
    assert (list(b.buffer), used.dropped) == ([0], 1)


def test_16_the_mailbox_holds_six_datagrams():
    w = World()
    executor = Executor("e", [Subscription("a", w.note("a")), Timer(1, w.note("t", 1500))])
    for n in range(9):
        w.arrives(1100, "a", n)
    w.run(12_000, executor)
    assert [given for _, name, given in w.called if name == "a"] == [("a", n) for n in range(6)]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Timer(0, None), "0 ticks"),
        (lambda: Timer(1, None, "iron"), "jazzy, humble"),
        (lambda: Subscription("a", None, depth=0), "1 or more"),
        (lambda: Executor("e", [], trigger=2), "handle 2"),
        (lambda: Client(None, [], rule="sometimes"), "poll"),
    ],
)
def test_mistakes_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
