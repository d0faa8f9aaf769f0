"""Mistakes of task bodies and settings: each one clear sentence."""

import pytest

from labkit.kernel import Costs, Kernel


def kernel(**options):
    """Ten cycles per tick: small numbers, and room between the ticks."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, **options)


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


def test_an_error_in_an_interrupt_handler_is_not_blamed_on_the_task_it_interrupted():
    k = kernel()

    def body(os):
        yield os.compute(20)

    def receive_byte(isr):
        raise KeyError("no such register")

    k.task("a", body, priority=1)
    k.interrupt(7, receive_byte)
    with pytest.raises(KeyError) as caught:
        k.run(until=50)
    (note,) = caught.value.__notes__
    assert note.startswith("in interrupt handler test_an_error_in_an_interrupt_handler")
    assert note.endswith("receive_byte, which interrupted task 'a', at cycle 7")


@pytest.mark.parametrize(
    ("request_of", "message"),
    [
        (lambda os: None, "task 'a' yielded None"),
        (lambda os: -5, "task 'a' yielded -5"),
        (lambda os: os.delay(-1), "delay of -1 ticks"),
        (lambda os: os.delay_until(0), "delay_until of 0 ticks"),
        (lambda os: os.delay_until(2.5), "delay_until of 2.5 ticks; a whole number from 1 to 4294967295 is allowed"),
        (lambda os: os.delay_until(1 << 32), "delay_until of 4294967296 ticks; 1 to 4294967295 are allowed"),
        (lambda os: os.delay_until(2, since="now"), "delay_until since tick 'now'; a whole number from -4294967295 to"),
        (lambda os: os.notify_take(timeout=1 << 32), "a time-out of 4294967296 ticks; 0 to 4294967295 are allowed"),
        (lambda os: os.compute(2.5), "compute for 2.5 cycles; a whole number of at least 0 is allowed"),
        (lambda os: os.mark(1 << 70), "mark with 1180591620717411303424"),
        (lambda os: os.take("lock"), "'lock' is no semaphore or mutex"),
        (lambda os: os.send("queue", 1), "'queue' is no queue"),
        (lambda os: os.notify_give("b"), "'b' is no task"),
        (lambda os: os.set_priority(None, 8), "set_priority to 8; 0 to 7 are allowed"),
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
        (lambda: kernel(costs=Costs(tick=10)), "no task would run"),
        (lambda: kernel().mutex("m", protocol="magic"), "protocol 'magic'; there are none, freertos, inheritance, ceiling"),
        (lambda: kernel().mutex("m", protocol="ceiling"), "needs a ceiling or its users"),
        (lambda: kernel().counting("s", length=2, init=3), "starts with 3 of 2"),
        (lambda: kernel().queue("q", length=0), "room for 0 items"),
        (lambda: kernel().task("IDLE", lambda os: iter(()), priority=1), "'IDLE' is taken"),
        (lambda: kernel().task("a", lambda os: None, priority=1), "no generator function"),
        (lambda: kernel().task("a", lambda os: None, priority=8), "priority 8; 0 to 7 are allowed"),
        (lambda: kernel().task("a", lambda os: None, priority=1, deadline=0), "a deadline of 0 cycles"),
        (lambda: kernel().task("a", lambda os: iter(()), priority=1, deadline=2.5), "a deadline of 2.5 cycles after its release"),
        (lambda: kernel().interrupt(-1, print), "an interrupt at cycle -1; a whole number of at least 0 is allowed"),
        (lambda: kernel().interrupt(5, print, every=0), "an interrupt at cycle 5, every 0 cycles; a whole number of at least 1"),
        (lambda: kernel().run(0), "run until cycle 0; a whole number of at least 1 is allowed"),
        (lambda: kernel().run(1.5), "run until cycle 1.5; a whole number of at least 1 is allowed"),
        (lambda: Kernel(cpu_hz=1 << 40, tick_hz=1), "a tick of 1099511627776 cycles; 1 to 1073741824 are allowed"),
    ],
)
def test_bad_settings_say_what_is_allowed(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_protocols_of_freertos_and_the_textbook_do_not_mix():
    k = kernel()
    k.mutex("a", protocol="freertos")
    k.mutex("b", protocol="none")
    with pytest.raises(ValueError, match="FreeRTOS's and the textbook's inheritance do not mix"):
        k.mutex("c", protocol="inheritance")
