"""What a task body says: the requests it yields, checked as they are made.

A request is a pair (service, arguments), or an integer: CPU cycles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from labkit.kernel import services
from labkit.kernel.checks import whole
from labkit.kernel.objects import FOREVER, Mutex, Queue, Semaphore, Task

if TYPE_CHECKING:
    from labkit.kernel.core import Core
    from labkit.kernel.kernel import Kernel

Request = tuple | int

#: The largest tick count that FreeRTOS can hold; nobody can wait longer without waiting for ever.
MOST_TICKS = (1 << 32) - 1


class Services:
    """What a task body sees as `os`: each method makes a request to be yielded, `answer = yield os.take(lock)`.

    Time-outs, delays and periods are in ticks; a time-out of None waits for ever, 0 does not wait. CPU time is in cycles;
    `os.us`, `os.ms` and `os.tick` are the cycles in a microsecond, a millisecond and a tick.
    """

    def __init__(self, kernel: Kernel, core: Core):
        self._kernel, self._core = kernel, core
        self.tick = core.tick

    @property
    def ms(self) -> int:
        return self._kernel.ms

    @property
    def us(self) -> int:
        return self._kernel.us

    @property
    def now(self) -> int:
        """CPU cycles since the start."""
        return self._core.now

    @property
    def ticks(self) -> int:
        """The tick count, for `delay_until`."""
        return self._core.ticks

    def compute(self, cycles: int) -> Request:
        """Use the CPU for so many cycles; the request is the number itself."""
        return cycles if type(cycles) is int else whole(cycles, 0, "compute for", " cycles")

    def take(self, lock: Semaphore | Mutex, timeout: int | None = None) -> Request:
        """Take a semaphore or mutex: True, or False after the time-out."""
        return services.take, (_lock(lock), _timeout(timeout))

    def give(self, lock: Semaphore | Mutex) -> Request:
        """Give a semaphore (False if it is full) or a mutex that the task holds."""
        return services.give, (_lock(lock),)

    def send(self, queue: Queue, item: Any, timeout: int | None = None) -> Request:
        """Append an item: True, or False if there was no room until the time-out."""
        return services.send, (_queue(queue), item, _timeout(timeout))

    def send_front(self, queue: Queue, item: Any, timeout: int | None = None) -> Request:
        """Put an item where it is received next: True, or False if there was no room until the time-out."""
        return services.send_front, (_queue(queue), item, _timeout(timeout))

    def overwrite(self, queue: Queue, item: Any) -> Request:
        """Replace the item of a queue of length 1 (a mailbox); never fails."""
        if _queue(queue).length != 1:
            raise ValueError(f"overwrite on queue {queue.name!r} of length {queue.length}; only length 1 is allowed")
        return services.overwrite, (queue, item)

    def receive(self, queue: Queue, timeout: int | None = None) -> Request:
        """Remove and return the first item; None after the time-out."""
        return services.receive, (_queue(queue), _timeout(timeout))

    def peek(self, queue: Queue, timeout: int | None = None) -> Request:
        """Return the first item and leave it there; None after the time-out."""
        return services.peek, (_queue(queue), _timeout(timeout))

    def notify_give(self, task: Task) -> Request:
        """Count up a task's notifications and wake it if it waits for one."""
        return services.notify_give, (_task(task),)

    def notify_take(self, clear: bool = True, timeout: int | None = None) -> Request:
        """Return the caller's count of notifications, then clear it or count it down; 0 after the time-out."""
        return services.notify_take, (clear, _timeout(timeout))

    def delay(self, ticks: int) -> Request:
        """Sleep; counted from the call, so periods built from it drift. 0 yields."""
        return services.delay, (_ticks(ticks, 0, "delay of"),)

    def delay_until(self, period: int, since: int | None = None) -> Request:
        """Sleep until `period` ticks after the previous wake time, or after tick `since`; ends the job, and begins the next.

        The first call counts from 0, or from what the body has read: `start = os.ticks` ... `os.delay_until(5, since=start)`.
        True if it slept; False if it was late, and then it only yields. So it does if the previous wake time is still to come
        (the task was suspended in the call before and resumed early): the real kernel takes that for an overflow of the count.
        """
        period = period if type(period) is int and 0 < period <= MOST_TICKS else _ticks(period, 1, "delay_until of")
        if since is not None:
            since = whole(since, -MOST_TICKS, "delay_until since tick", most=MOST_TICKS)
        return services.delay_until, (period, since)

    def yield_cpu(self) -> Request:
        """Let the next task of the same priority run."""
        return services.yield_cpu, ()

    def suspend(self, task: Task | None = None) -> Request:
        """Suspend a task (None: the caller) until it is resumed; ends whatever it waits for."""
        return services.suspend, (task and _task(task),)

    def resume(self, task: Task) -> Request:
        """Make a suspended task ready; no effect on any other."""
        return services.resume, (_task(task),)

    def set_priority(self, task: Task | None, priority: int) -> Request:
        """Set the base priority of a task (None: the caller)."""
        priority = whole(priority, 1, "set_priority to", most=self._kernel.priorities - 1)
        return services.set_priority, (task and _task(task), priority)

    def release(self) -> Request:
        """Begin a job by hand, released now. Tasks that call delay_until need not."""
        return services.release, (self._core.now,)

    def complete(self) -> Request:
        """End the open job by hand."""
        return services.complete, ()

    def begin(self, scope: str) -> Request:
        """Enter a named scope, for the trace only."""
        return services.begin, (scope,)

    def end(self, scope: str) -> Request:
        """Leave a named scope."""
        return services.end, (scope,)

    def mark(self, value: int = 0, extra: int = 0) -> Request:
        """Leave a mark with two free integers in the trace."""
        return services.mark, (whole(value, -FOREVER, "mark with"), whole(extra, -FOREVER, "mark with"))


def _lock(lock: Any) -> Semaphore | Mutex:
    if not isinstance(lock, Semaphore | Mutex):
        raise ValueError(f"{lock!r} is no semaphore or mutex")
    return lock


def _queue(queue: Any) -> Queue:
    if not isinstance(queue, Queue):
        raise ValueError(f"{queue!r} is no queue")
    return queue


def _task(task: Any) -> Task:
    if not isinstance(task, Task):
        raise ValueError(f"{task!r} is no task")
    return task


def _timeout(timeout: Any) -> int | None:
    return None if timeout is None else _ticks(timeout, 0, "a time-out of")


def _ticks(ticks: Any, least: int, what: str) -> int:
    return whole(ticks, least, what, " ticks", MOST_TICKS)
