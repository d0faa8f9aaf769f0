"""What a task body says: the requests it yields, checked as they are made.

A request is a pair (service, arguments), or an integer: CPU cycles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from labkit.kernel.checks import whole
from labkit.kernel.objects import FOREVER, NOTIFICATIONS, Buffer, EventGroup, Mutex, Queue, QueueSet, Semaphore, Task, Timer
from labkit.kernel.services import (
    buffers,
    delays,
    events,
    jobs,
    memory,
    notifications,
    queues,
    sections,
    semaphores,
    sets,
    tasks,
    timers,
)
from labkit.trace import NOTIFY_ACTIONS

if TYPE_CHECKING:
    from labkit.kernel.core import Core
    from labkit.kernel.kernel import Kernel

Request = tuple | int

#: What a task may do to another's notification; "give" counts up like "increment", but without an answer.
ACTIONS = NOTIFY_ACTIONS[1:-1]

MOST_BITS = (1 << 24) - 1  #: of an event group

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
        return semaphores.take, (_lock(lock), _timeout(timeout))

    def give(self, lock: Semaphore | Mutex) -> Request:
        """Give a semaphore (False if it is full) or a mutex that the task holds."""
        return semaphores.give, (_lock(lock),)

    def send(self, queue: Queue, item: Any, timeout: int | None = None) -> Request:
        """Append an item: True, or False if there was no room until the time-out."""
        return queues.send, (_queue(queue), item, _timeout(timeout))

    def send_front(self, queue: Queue, item: Any, timeout: int | None = None) -> Request:
        """Put an item where it is received next: True, or False if there was no room until the time-out."""
        return queues.send_front, (_queue(queue), item, _timeout(timeout))

    def overwrite(self, queue: Queue, item: Any) -> Request:
        """Replace the item of a queue of length 1 (a mailbox); never fails."""
        if _queue(queue).length != 1:
            raise ValueError(f"overwrite on queue {queue.name!r} of length {queue.length}; only length 1 is allowed")
        return queues.overwrite, (queue, item)

    def receive(self, queue: Queue, timeout: int | None = None) -> Request:
        """Remove and return the first item; None after the time-out."""
        return queues.receive, (_queue(queue), _timeout(timeout))

    def peek(self, queue: Queue, timeout: int | None = None) -> Request:
        """Return the first item and leave it there; None after the time-out."""
        return queues.peek, (_queue(queue), _timeout(timeout))

    def reset(self, queue: Queue) -> Request:
        """Empty a queue; of the senders that wait, one is woken."""
        return queues.reset, (check_kind(Queue, queue),)

    def messages_waiting(self, waiting: Queue | Semaphore | Mutex) -> Request:
        """How many items a queue has, or counts a semaphore or mutex."""
        return queues.messages_waiting, (check_kind(Queue | Semaphore | Mutex, waiting),)

    def spaces_available(self, queue: Queue) -> Request:
        """For how many items a queue has room."""
        return queues.spaces_available, (check_kind(Queue, queue),)

    def select(self, group: QueueSet, timeout: int | None = None) -> Request:
        """The member of a queue set that something was sent to, the earliest first; None after the time-out.

        It is not received from; who does so directly leaves an entry in the set for a member that is empty.
        """
        return sets.select, (check_kind(QueueSet, group), _timeout(timeout))

    def notify(self, task: Task, action: str, value: int = 0, index: int = 0) -> Request:
        """Change a notification of a task and wake it if it waits there: False if it was refused.

        `action` is "none", "set_bits", "increment", "overwrite", or "keep", which is refused while one is pending.
        """
        return notifications.notify, (check_kind(Task, task), check_action(action), check_value(value), check_index(index))

    def notify_give(self, task: Task, index: int = 0) -> Request:
        """Count up a task's notifications and wake it if it waits for one."""
        return notifications.notify_give, (check_kind(Task, task), check_index(index))

    def notify_take(self, clear: bool = True, timeout: int | None = None, index: int = 0) -> Request:
        """Return the caller's count of notifications, then clear it or count it down; 0 after the time-out."""
        return notifications.notify_take, (clear, _timeout(timeout), check_index(index))

    def notify_wait(self, clear_first: int = 0, clear_last: int = 0, timeout: int | None = None, index: int = 0) -> Request:
        """Wait until notified, whatever the value: (True, value), or (False, value) after the time-out.

        The bits of `clear_first` are cleared if it has to wait, those of `clear_last` after it was notified.
        """
        return notifications.notify_wait, (
            check_value(clear_first),
            check_value(clear_last),
            _timeout(timeout),
            check_index(index),
        )

    def notify_state_clear(self, task: Task | None = None, index: int = 0) -> Request:
        """Take back a pending notification, but not its value: True if there was one. None: the caller's."""
        return notifications.state_clear, (_or_self(task), check_index(index))

    def notify_value_clear(self, task: Task | None, bits: int, index: int = 0) -> Request:
        """Clear bits of a notification's value, which is returned as it was. None: the caller's."""
        return notifications.value_clear, (_or_self(task), check_value(bits), check_index(index))

    def set_bits(self, group: EventGroup, bits: int) -> Request:
        """Set bits and release everyone who waits for them; returns the bits once those who clear them have."""
        return events.set_bits, (check_kind(EventGroup, group), check_bits(bits))

    def clear_bits(self, group: EventGroup, bits: int) -> Request:
        """Clear bits; returns them as they were."""
        return events.clear_bits, (check_kind(EventGroup, group), check_bits(bits))

    def get_bits(self, group: EventGroup) -> Request:
        """The bits as they are."""
        return events.get_bits, (check_kind(EventGroup, group),)

    def wait_bits(
        self, group: EventGroup, bits: int, every: bool = False, clear: bool = False, timeout: int | None = None
    ) -> Request:
        """Wait for one of the bits, or for every one; returns the bits at that time, or those after the time-out.

        `clear` takes away the bits waited for, after everybody who waits for them has been released.
        """
        return events.wait_bits, (check_kind(EventGroup, group), check_bits(bits, 1), every, clear, _timeout(timeout))

    def sync(self, group: EventGroup, bits: int, wanted: int, timeout: int | None = None) -> Request:
        """Set bits and wait for all that are wanted, a rendezvous; returns as wait_bits and then clears them."""
        return events.sync, (check_kind(EventGroup, group), check_bits(bits), check_bits(wanted, 1), _timeout(timeout))

    def buffer_send(self, buffer: Buffer, count: int, timeout: int | None = None) -> Request:
        """Write so many bytes, waiting for room for all of them; returns how many went in, of a message all or 0."""
        return buffers.send, (check_kind(Buffer, buffer), whole(count, 0, "buffer_send of", " bytes"), _timeout(timeout))

    def buffer_receive(self, buffer: Buffer, most: int, timeout: int | None = None) -> Request:
        """Read at most so many bytes, waiting if there are none; returns how many. A message that is longer stays there."""
        return buffers.receive, (check_kind(Buffer, buffer), whole(most, 0, "buffer_receive of", " bytes"), _timeout(timeout))

    def buffer_available(self, buffer: Buffer) -> Request:
        """Bytes in a buffer."""
        return buffers.available, (check_kind(Buffer, buffer),)

    def buffer_spaces(self, buffer: Buffer) -> Request:
        """Free bytes of a buffer."""
        return buffers.spaces, (check_kind(Buffer, buffer),)

    def timer_start(self, timer: Timer, timeout: int | None = 0) -> Request:
        """Ask the timer task to start a timer, or start it anew, counting from now: False if its queue stays full."""
        return timers.timer_start, (check_kind(Timer, timer), _timeout(timeout))

    def timer_stop(self, timer: Timer, timeout: int | None = 0) -> Request:
        """Ask the timer task to stop a timer."""
        return timers.timer_stop, (check_kind(Timer, timer), _timeout(timeout))

    def timer_reset(self, timer: Timer, timeout: int | None = 0) -> Request:
        """The same as timer_start, by the name that says what for."""
        return timers.timer_reset, (check_kind(Timer, timer), _timeout(timeout))

    def timer_change_period(self, timer: Timer, period: int, timeout: int | None = 0) -> Request:
        """Ask the timer task to start a timer with another period, counting from when the task does so."""
        return timers.timer_change_period, (check_kind(Timer, timer), _ticks(period, 1, "a timer's period of"), _timeout(timeout))

    def timer_active(self, timer: Timer) -> Request:
        """Whether a timer runs, as far as the timer task has got."""
        return timers.timer_active, (check_kind(Timer, timer),)

    def pend_call(self, function: Callable[[Services], Any], timeout: int | None = 0, number: int = 0) -> Request:
        """Have the timer task call `function(os)`; `number` is for the trace."""
        return timers.pend_call, (function, whole(number, 0, "pend_call of number"), _timeout(timeout))

    def delay(self, ticks: int) -> Request:
        """Sleep; counted from the call, so periods built from it drift. 0 yields."""
        return delays.delay, (_ticks(ticks, 0, "delay of"),)

    def delay_until(self, period: int, since: int | None = None) -> Request:
        """Sleep until `period` ticks after the previous wake time, or after tick `since`; ends the job, and begins the next.

        The first call counts from 0, or from what the body has read: `start = os.ticks` ... `os.delay_until(5, since=start)`.
        True if it slept; False if it was late, and then it only yields. So it does if the previous wake time is still to come
        (the task was suspended in the call before and resumed early): the real kernel takes that for an overflow of the count.
        """
        period = period if type(period) is int and 0 < period <= MOST_TICKS else _ticks(period, 1, "delay_until of")
        if since is not None:
            since = whole(since, -MOST_TICKS, "delay_until since tick", most=MOST_TICKS)
        return delays.delay_until, (period, since)

    def yield_cpu(self) -> Request:
        """Let the next task of the same priority run."""
        return delays.yield_cpu, ()

    def abort_delay(self, task: Task) -> Request:
        """End a delay or wait of a task early, as if its time were over: True if it was blocked."""
        return delays.abort_delay, (check_kind(Task, task),)

    def create(self, name: str, body: Callable[..., Any], priority: int, **how: Any) -> Request:
        """Create a task, as `Kernel.task` does; returns its handle, or None if there is no memory for it.

        The name may be that of a task that has ended. `how`: deadline, stack_free, stack.
        """
        by = self._core.running.code
        return tasks.create, (lambda: self._kernel._create(name, body, priority, by=by, **how),)

    def delete(self, task: Task | None = None) -> Request:
        """Delete a task (None: the caller). What it holds stays taken."""
        return tasks.delete, (_or_self(task),)

    def suspend(self, task: Task | None = None) -> Request:
        """Suspend a task (None: the caller) until it is resumed; ends whatever it waits for."""
        return tasks.suspend, (_or_self(task),)

    def resume(self, task: Task) -> Request:
        """Make a suspended task ready; no effect on any other."""
        return tasks.resume, (check_kind(Task, task),)

    def get_priority(self, task: Task | None = None) -> Request:
        """Current priority of a task (None: the caller), perhaps inherited."""
        return tasks.get_priority, (_or_self(task),)

    def get_base_priority(self, task: Task | None = None) -> Request:
        """Base priority of a task (None: the caller)."""
        return tasks.get_base_priority, (_or_self(task),)

    def allocate(self, size: int) -> Request:
        """A block of so many bytes: its address, or None if no free block is large enough."""
        return memory.allocate, (whole(size, 0, "allocate", " bytes"),)

    def free(self, address: int) -> Request:
        """Give a block back."""
        return memory.free, (address,)

    def enter_critical(self) -> Request:
        """Hold interrupts, ticks and switches until the matching exit_critical; the caller must not wait in between."""
        return sections.enter_critical, ()

    def exit_critical(self) -> Request:
        """Leave a critical section; the outermost exit lets in what was held."""
        return sections.exit_critical, ()

    def suspend_all(self) -> Request:
        """Hold switches and the tick count, but not interrupts, until the matching resume_all."""
        return sections.suspend_all, ()

    def resume_all(self) -> Request:
        """Resume the scheduler: True if the outermost call has switched to another task."""
        return sections.resume_all, ()

    def set_priority(self, task: Task | None, priority: int) -> Request:
        """Set the base priority of a task (None: the caller)."""
        priority = whole(priority, 0, "set_priority to", most=self._kernel.priorities - 1)
        return tasks.set_priority, (_or_self(task), priority)

    def release(self) -> Request:
        """Begin a job by hand, released now. Tasks that call delay_until need not."""
        return jobs.release, (self._core.now,)

    def complete(self) -> Request:
        """End the open job by hand."""
        return jobs.complete, ()

    def begin(self, scope: str) -> Request:
        """Enter a named scope, for the trace only."""
        return jobs.begin, (scope,)

    def end(self, scope: str) -> Request:
        """Leave a named scope."""
        return jobs.end, (scope,)

    def mark(self, value: int = 0, extra: int = 0) -> Request:
        """Leave a mark with two free integers in the trace."""
        return jobs.mark, (whole(value, -FOREVER, "mark with"), whole(extra, -FOREVER, "mark with"))


def _lock(lock: Any) -> Semaphore | Mutex:
    if not isinstance(lock, Semaphore | Mutex):
        raise ValueError(f"{lock!r} is no semaphore or mutex")
    return lock


def _queue(queue: Any) -> Queue:
    if not isinstance(queue, Queue):
        raise ValueError(f"{queue!r} is no queue")
    return queue


def check_kind(kind: Any, given: Any) -> Any:
    """What was given, if it is of that kind."""
    if not isinstance(given, kind):
        raise ValueError(f"{given!r} is no {KIND[kind]}")
    return given


KIND = {
    Buffer: "stream or message buffer",
    EventGroup: "event group",
    Queue: "queue",
    QueueSet: "queue set",
    Queue | Semaphore | Mutex: "queue, semaphore or mutex",
    Task: "task",
    Timer: "timer",
}


def _or_self(task: Any) -> Task | None:
    return None if task is None else check_kind(Task, task)


def check_action(action: Any) -> str:
    if action not in ACTIONS:
        raise ValueError(f"notify with action {action!r}; {', '.join(ACTIONS)} are allowed")
    return action


def check_index(index: Any) -> int:
    return whole(index, 0, "notification", most=NOTIFICATIONS - 1)


def check_value(value: Any) -> int:
    return whole(value, 0, "a notification's value or bits", most=(1 << 32) - 1)


def check_bits(bits: Any, least: int = 0) -> int:
    return whole(bits, least, "an event group's bits", most=MOST_BITS)


def _timeout(timeout: Any) -> int | None:
    return None if timeout is None else _ticks(timeout, 0, "a time-out of")


def _ticks(ticks: Any, least: int, what: str) -> int:
    return whole(ticks, least, what, " ticks", MOST_TICKS)
