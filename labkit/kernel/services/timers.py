"""Software timers: commands, and the task that carries them out and calls back (rules 34 to 42)."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any

from labkit.kernel.objects import FOREVER, EventGroup, Queue, Task, Timer
from labkit.kernel.services.events import bits_cleared, bits_set
from labkit.trace import CODE, TIMER_COMMANDS

if TYPE_CHECKING:
    from labkit.kernel.core import Core

SEND, SEND_BLOCK, SEND_FAIL = CODE["timer_send"], CODE["timer_send_block"], CODE["timer_send_fail"]
COMMAND, EXPIRED, PEND_CALL = CODE["timer_command"], CODE["timer_expired"], CODE["pend_call"]
START, STOP, RESET, CHANGE_PERIOD, CALL, SET_BITS, CLEAR_BITS = range(len(TIMER_COMMANDS))

#: A command: which, the timer or event group, and a number or, for a pended call, (function, its number).
Command = tuple[int, Any, Any]
Callback = Callable[[Any], Any]


class Daemon:
    """The queue of commands and the active timers, in order of expiry, of equals in order of insertion."""

    def __init__(self, queue: Queue):
        self.queue = queue
        self.due: list[Timer] = []
        self.task: Task | None = None

    def insert(self, timer: Timer, expiry: int) -> None:
        timer.expiry = expiry
        insort(self.due, timer, key=lambda each: each.expiry)


def timer_start(k: Core, task: Task, timer: Timer, timeout: int | None) -> None:
    command(k, task, (START, timer, k.ticks), timeout)


def timer_reset(k: Core, task: Task, timer: Timer, timeout: int | None) -> None:
    command(k, task, (RESET, timer, k.ticks), timeout)


def timer_stop(k: Core, task: Task, timer: Timer, timeout: int | None) -> None:
    command(k, task, (STOP, timer, 0), timeout)


def timer_change_period(k: Core, task: Task, timer: Timer, period: int, timeout: int | None) -> None:
    command(k, task, (CHANGE_PERIOD, timer, period), timeout)


def pend_call(k: Core, task: Task, function: Callback, number: int, timeout: int | None) -> None:
    command(k, task, (CALL, None, (function, number)), timeout)


def timer_active(k: Core, task: Task, timer: Timer) -> None:
    task.result = timer.active


def command(k: Core, task: Task, order: Command, timeout: int | None) -> None:
    """Queue a command; while the scheduler is suspended it is not waited for room."""
    if order[0] < CALL and k.suspended:
        timeout = 0
    _command(k, task, order, k.deadline(timeout))


def _command(k: Core, task: Task, order: Command, deadline: int) -> None:
    queue = daemon_of(k).queue
    if len(queue.items) < queue.length:
        task.result = True
        if _put(k, task.code, order):
            k.reschedule()
    elif k.expired(task, deadline):
        _note(k, task.code, order, SEND_FAIL)
        task.result = False
    else:
        _note(k, task.code, order, SEND_BLOCK)
        k.block(task, deadline, (_command, (order, deadline)), queue, queue.senders)


def command_from_isr(k: Core, by: int, order: Command) -> tuple[bool, bool]:
    """Whether there was room, and whether the timer task woke and is above the running one."""
    queue = daemon_of(k).queue
    if len(queue.items) < queue.length:
        return True, _put(k, by, order)
    _note(k, by, order, SEND_FAIL)
    return False, False


def _put(k: Core, by: int, order: Command) -> bool:
    queue = daemon_of(k).queue
    _note(k, by, order, SEND)
    queue.items.append(order)
    return bool(queue.receivers) and k.wake(queue.receivers)


def _note(k: Core, by: int, order: Command, kind: int) -> None:
    which, target, _ = order
    timer = target.code if isinstance(target, Timer) else -1
    k.log((k.now, kind, by, timer, len(daemon_of(k).queue.items), which))


def daemon_of(k: Core) -> Daemon:
    """The timer task's things; ValueError if there is none."""
    if k.daemon is None:
        raise ValueError("there is no timer task; give the kernel a timer_priority")
    return k.daemon


def daemon_body(k: Core, daemon: Daemon) -> Callable[[Any], Generator[Any, Any, None]]:
    """The body of the timer task (rule 35): run the timer that is due or wait; then carry out all commands."""

    def body(os: Any) -> Generator[Any, Any, None]:
        while True:
            first = daemon.due[0] if daemon.due else None
            if first is not None and first.expiry <= k.ticks:
                daemon.due.pop(0)
                yield from _expire(k, daemon, os, first, first.expiry)
            else:
                yield _wait, (daemon.queue, FOREVER if first is None else first.expiry)
            while (order := (yield _next_command, (daemon.queue,))) is not None:
                yield from _carry_out(k, daemon, os, order)

    return body


def _wait(k: Core, task: Task, queue: Queue, until: int) -> None:
    """Until a command or a tick; if there is a command already, it only yields (rule 36)."""
    task.result = None
    if queue.items:
        k.reschedule()
    else:
        k.block(task, until, None, queue, queue.receivers)


def _next_command(k: Core, task: Task, queue: Queue) -> None:
    """A command, or None. A sender that waits for room may preempt before it is carried out (rule 41)."""
    task.result = queue.items.popleft() if queue.items else None
    if task.result is not None and queue.senders and k.wake(queue.senders):
        k.reschedule()


def _carry_out(k: Core, daemon: Daemon, os: Any, order: Command) -> Generator[Any, Any, None]:
    which, target, value = order
    code = k.running.code
    if which == CALL:
        function, number = value
        k.log((k.now, PEND_CALL, code, -1, number, 0))
        yield from _called(function, os)
    elif isinstance(target, EventGroup):
        yield _change_bits, (which, target, value)
    else:
        k.log((k.now, COMMAND, code, target.code, value, which))
        if target in daemon.due:
            daemon.due.remove(target)
        target.active = which != STOP
        if which == CHANGE_PERIOD:
            target.period = value
            daemon.insert(target, k.ticks + value)  # rule 38
        elif which != STOP:
            expiry = value + target.period  # rule 37
            if expiry > k.ticks:
                daemon.insert(target, expiry)
            else:
                yield from _expire(k, daemon, os, target, expiry)


def _change_bits(k: Core, task: Task, which: int, group: EventGroup, bits: int) -> None:
    task.result = None
    if which == CLEAR_BITS:
        bits_cleared(k, task.code, group, bits)
    elif bits_set(k, task.code, group, bits):
        k.reschedule()


def _expire(k: Core, daemon: Daemon, os: Any, timer: Timer, expiry: int) -> Generator[Any, Any, None]:
    """One callback, or of an auto-reload timer one per period that is over now (rule 39)."""
    now = k.ticks
    if timer.auto_reload:
        while (expiry := expiry + timer.period) <= now:
            yield from _call_back(k, os, timer)
        daemon.insert(timer, expiry)
    else:
        timer.active = False
    yield from _call_back(k, os, timer)


def _call_back(k: Core, os: Any, timer: Timer) -> Generator[Any, Any, None]:
    k.log((k.now, EXPIRED, k.running.code, timer.code, 0, 0))
    yield from _called(timer.callback, os)


def _called(function: Callback, os: Any) -> Generator[Any, Any, None]:
    """A function that makes requests is a generator; any other has done its work when it returns."""
    if (requests := function(os)) is not None:
        yield from requests


def started_early(daemon: Daemon, timer: Timer) -> None:
    """A start before the scheduler runs; a queue that is full drops it."""
    if len(daemon.queue.items) < daemon.queue.length:
        daemon.queue.items.append((START, timer, 0))
