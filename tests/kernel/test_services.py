"""The list of services is complete, and each of them has its price, its errors and its way into the trace."""

import re

import pytest

import labkit.kernel
from labkit.kernel import Costs, Heap, Kernel
from labkit.kernel.interrupts import Interrupt
from labkit.kernel.requests import Services
from labkit.kernel.services import PRICED

ALONE = {"tick", "us", "ms", "now", "ticks", "compute", "release", "complete", "begin", "end", "mark"}


def listed(word):
    """What the package's list says of `os.` or `isr.`."""
    table = labkit.kernel.__doc__.partition("differs\n")[2].partition("\n\n")[0]
    return [name for line in table.splitlines() for name in re.findall(rf"\b{word}\.(\w+)", line.partition("  an attribute")[0])]


def public(kind):
    return {name for name in vars(kind) if not name.startswith("_")}


def test_every_service_is_listed_once():
    in_tasks, in_handlers = listed("os"), listed("isr")
    assert len(set(in_tasks)) == len(in_tasks) and len(set(in_handlers)) == len(in_handlers)
    assert set(in_tasks) - {"ticks"} == public(Services) - ALONE == set(PRICED)
    assert set(in_handlers) == public(Interrupt) - ALONE


def kernel(**options):
    """Ten cycles per tick."""
    return Kernel(cpu_hz=10_000, tick_hz=1000, timer_priority=3, **options)


#: A call of each service that neither waits nor switches.
CALLS = {
    "take": lambda os, o: os.take(o["counting"]),
    "give": lambda os, o: os.give(o["counting"]),
    "send": lambda os, o: os.send(o["queue"], 1),
    "send_front": lambda os, o: os.send_front(o["queue"], 1),
    "overwrite": lambda os, o: os.overwrite(o["queue"], 1),
    "receive": lambda os, o: os.receive(o["queue"], 0),
    "peek": lambda os, o: os.peek(o["queue"], 0),
    "reset": lambda os, o: os.reset(o["queue"]),
    "messages_waiting": lambda os, o: os.messages_waiting(o["queue"]),
    "spaces_available": lambda os, o: os.spaces_available(o["queue"]),
    "select": lambda os, o: os.select(o["set"], 0),
    "notify": lambda os, o: os.notify(o["other"], "set_bits", 1),
    "notify_give": lambda os, o: os.notify_give(o["other"]),
    "notify_take": lambda os, o: os.notify_take(timeout=0),
    "notify_wait": lambda os, o: os.notify_wait(timeout=0),
    "notify_state_clear": lambda os, o: os.notify_state_clear(),
    "notify_value_clear": lambda os, o: os.notify_value_clear(None, 1),
    "set_bits": lambda os, o: os.set_bits(o["events"], 1),
    "clear_bits": lambda os, o: os.clear_bits(o["events"], 1),
    "get_bits": lambda os, o: os.get_bits(o["events"]),
    "wait_bits": lambda os, o: os.wait_bits(o["events"], 1, timeout=0),
    "sync": lambda os, o: os.sync(o["events"], 1, 1),
    "buffer_send": lambda os, o: os.buffer_send(o["stream"], 1),
    "buffer_receive": lambda os, o: os.buffer_receive(o["stream"], 1, 0),
    "buffer_available": lambda os, o: os.buffer_available(o["stream"]),
    "buffer_spaces": lambda os, o: os.buffer_spaces(o["stream"]),
    "timer_start": lambda os, o: os.timer_start(o["timer"]),
    "timer_stop": lambda os, o: os.timer_stop(o["timer"]),
    "timer_reset": lambda os, o: os.timer_reset(o["timer"]),
    "timer_change_period": lambda os, o: os.timer_change_period(o["timer"], 50),
    "timer_active": lambda os, o: os.timer_active(o["timer"]),
    "pend_call": lambda os, o: os.pend_call(lambda os: None),
    "delay": lambda os, o: os.delay(0),
    "delay_until": lambda os, o: os.delay_until(1, since=-5),
    "abort_delay": lambda os, o: os.abort_delay(o["other"]),
    "yield_cpu": lambda os, o: os.yield_cpu(),
    "create": lambda os, o: os.create("new", o["body"], 0),
    "delete": lambda os, o: os.delete(o["other"]),
    "suspend": lambda os, o: os.suspend(o["other"]),
    "resume": lambda os, o: os.resume(o["other"]),
    "set_priority": lambda os, o: os.set_priority(None, 5),
    "get_priority": lambda os, o: os.get_priority(),
    "get_base_priority": lambda os, o: os.get_base_priority(),
    "allocate": lambda os, o: os.allocate(10),
    "free": lambda os, o: os.free(o["block"]),
    "enter_critical": lambda os, o: os.enter_critical(),
    "exit_critical": None,  # needs the one before
    "suspend_all": lambda os, o: os.suspend_all(),
    "resume_all": None,
}


@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call])
def test_each_service_costs_what_it_is_said_to(name):
    heap = Heap(8192)
    k = kernel(costs=Costs(service={name: 3}), heap=heap)

    def body(os):
        yield CALLS[name](os, made)
        yield os.mark()
        yield os.compute(1000)

    def idle(os):
        while True:
            yield os.compute(1000)

    made = {
        "counting": k.counting("counting", 2, 1),
        "queue": k.queue("queue", 1),
        "events": k.event_group("events"),
        "stream": k.stream_buffer("stream", 4),
        "timer": k.timer("timer", 50, lambda os: None),
        "body": idle,
        "block": heap.allocate(10),
    }
    made["set"] = k.queue_set("set", [k.queue("member", 1)])
    made["other"] = k.task("other", idle, 1)
    k.task("caller", body, 5)
    run = k.run(20)
    assert run.trace.rows("mark")[:, 0].tolist() == [3]
    assert run.trace.rows("overhead")[0, [0, 4]].tolist() == [0, 3]


def test_every_service_is_tried():
    assert set(CALLS) == set(PRICED)


@pytest.mark.parametrize(
    ("requests", "message"),
    [
        (lambda os, o: [os.enter_critical(), os.delay(1)], "task 'a' waits inside a critical section; it must go on to the end"),
        (lambda os, o: [os.suspend_all(), os.take(o)], "task 'a' waits while the scheduler is suspended"),
        (lambda os, o: [os.suspend_all(), os.suspend()], "task 'a' suspends itself while the scheduler is suspended"),
        (lambda os, o: [os.enter_critical(), os.delete()], "task 'a' deletes itself inside a critical section"),
        (lambda os, o: [os.enter_critical()], "task 'a' ends inside a critical section"),
        (lambda os, o: [os.exit_critical()], "task 'a' leaves a critical section, but is in none; enter_critical comes first"),
        (lambda os, o: [os.resume_all()], "task 'a' resumes the scheduler, which is not suspended; suspend_all comes first"),
        (lambda os, o: [os.notify(o, "add")], "is no task"),
        (lambda os, o: [os.notify_take(index=3)], "notification 3; 0 to 2 are allowed"),
        (lambda os, o: [os.notify_wait(clear_first=-1)], "a notification's value or bits -1; 0 to 4294967295 are allowed"),
        (lambda os, o: [os.set_bits(o, 1)], "is no event group"),
        (lambda os, o: [os.timer_start(o)], "is no timer"),
        (lambda os, o: [os.buffer_send(o, 1)], "is no stream or message buffer"),
        (lambda os, o: [os.select(o)], "is no queue set"),
        (lambda os, o: [os.reset(o)], "is no queue"),
    ],
)
def test_a_mistake_says_what_is_wrong(requests, message):
    k = kernel()
    signal = k.binary("signal")

    def body(os):
        yield from requests(os, signal)

    k.task("a", body, 1)
    with pytest.raises(ValueError, match=message):
        k.run(50)


def two_sets(k, queue):
    for name in "st":
        k.queue_set(name, [queue])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda k: k.queue_set("s", [k.mutex("m")]), "queue set 's' has member <mutex 'm'>; queues and semaphores are allowed"),
        (lambda k: two_sets(k, k.queue("q", 1)), "queue set 't' has member 'q', which is in 's'"),
        (lambda k: k.stream_buffer("s", 4, trigger=5), "stream buffer 's' has a trigger level of 5 bytes; 1 to 4 are allowed"),
        (lambda k: k.message_buffer("m", 4), "message buffer 'm' has room for 4 bytes; a whole number of at least 5"),
        (lambda k: k.timer("t", 0, print), "timer 't' has a period of 0 ticks; 1 to 4294967295 are allowed"),
        (lambda k: Kernel().timer("t", 1, print), "there is no timer task; give the kernel a timer_priority"),
        (lambda k: Kernel(pending_ticks="two"), "pending_ticks are 'two'; 'one' or 'all' is allowed"),
        (lambda k: Kernel(timer_priority=9), "the timer task: priority 9; 0 to 7 are allowed"),
        (lambda k: Kernel(max_syscall_priority=16), "max_syscall_priority 16; 0 to 15 are allowed"),
        (lambda k: k.interrupt(5, print, priority=16), "an interrupt at cycle 5, priority 16; 0 to 15 are allowed"),
        (lambda k: k.interrupt(5, print, cycles=-1), "an interrupt at cycle 5 computes for -1 cycles"),
    ],
)
def test_a_bad_setting_says_what_is_allowed(make, message):
    with pytest.raises(ValueError, match=message):
        make(kernel())


def test_a_task_created_under_an_old_name_goes_on_counting_its_jobs():
    k = kernel()

    def worker(os):
        yield os.delay_until(1, since=os.ticks)
        yield os.compute(5)
        yield os.delay_until(1)
        yield os.suspend()

    def boss(os):
        for _ in range(2):
            task = yield os.create("worker", worker, 1)
            yield os.delay(5)
            yield os.delete(task)

    k.task("boss", boss, 2)
    run = k.run(200)
    assert run.trace.rows("release")[:, 5].tolist() == [0, 1, 2, 3]
    assert [info.name for info in run.tasks] == ["boss", "IDLE", "TIMER", "worker"]


def test_a_callback_that_blocks_holds_up_every_timer():
    """The trap: the timer task waits in one callback, and the other timer is late by that."""
    k = kernel()
    signal = k.binary("signal")

    def waits(os):
        yield os.take(signal, 6)

    k.timer("first", 2, waits, started=True)
    k.timer("second", 3, lambda os: None, started=True)
    run = k.run(120)
    assert run.trace.rows("timer_expired")[:, 0].tolist() == [20, 80]  # at 2, and at 8 instead of 3


def test_who_waits_for_what_a_timer_will_do_is_in_no_deadlock():
    def waits_for(auto_reload):
        k = kernel()
        signal = k.binary("signal")

        def body(os):
            while True:
                yield os.take(signal)

        k.timer("timer", 2, lambda os: (yield os.give(signal)), auto_reload=auto_reload, started=True)
        k.task("a", body, 1)
        return [str(wait) for wait in k.run(100).deadlock]

    assert waits_for(auto_reload=True) == []
    assert waits_for(auto_reload=False) == ["a waits for signal"]
