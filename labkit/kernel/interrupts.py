"""Device interrupts: what a handler can ask of the kernel, FreeRTOS's ...FromISR calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from labkit.kernel.checks import whole
from labkit.kernel.devices import LOWEST
from labkit.kernel.objects import FOREVER, Buffer, EventGroup, Queue, Semaphore, Task, Timer
from labkit.kernel.requests import MOST_TICKS, check_action, check_bits, check_index, check_kind, check_value
from labkit.kernel.services import PRICED, buffers, notifications, queues, semaphores, tasks, timers
from labkit.kernel.services.queues import stamp
from labkit.trace import CODE, ISR_OPS, OVERHEADS

if TYPE_CHECKING:
    from labkit.kernel.core import Core

ISR, MARK, SERVICE_COST = CODE["isr"], CODE["mark"], OVERHEADS.index("service")

#: Name of a service -> name of the interrupt's call in the trace, where that is another one.
TRACED = {"receive": "recv"}


class Interrupt:
    """Given to a handler: `kernel.interrupt(at, lambda isr: isr.send(queue, 7))`. Calls act at once; nothing is yielded.
    They cost what the services of the same names cost.

    A task that becomes ready above the interrupted one runs after all interrupts of that instant (rule 5).
    """

    def __init__(self, core: Core, code: int):
        self._core = core
        self.code = code  # the name "ISR", which stands for the caller in the trace

    @property
    def now(self) -> int:
        """CPU cycles since the start."""
        return self._core.now

    def give(self, semaphore: Semaphore) -> bool:
        """Give a semaphore; False if it is full. A mutex cannot be given here: an interrupt owns nothing."""
        if not isinstance(semaphore, Semaphore):
            raise ValueError(f"an interrupt gives {semaphore!r}; only a semaphore can be given from an interrupt")
        k = self._enter("give", semaphore)
        return self._done(*semaphores.give_semaphore(k, self.code, semaphore))

    def take(self, semaphore: Semaphore) -> bool:
        """Take a count that is there; False if there is none. It wakes nobody (rule 62)."""
        if not isinstance(semaphore, Semaphore):
            raise ValueError(f"an interrupt takes {semaphore!r}; only a semaphore can be taken from an interrupt")
        k = self._enter("take", semaphore)
        return semaphores.take_from_isr(k, self.code, semaphore)

    def send(self, queue: Queue, item: Any) -> bool:
        """Append an item to a queue; False if it is full (rule 27)."""
        return self._send("send", queue, item, queues.SEND)

    def send_front(self, queue: Queue, item: Any) -> bool:
        """Put an item where it is received next; False if the queue is full."""
        return self._send("send_front", queue, item, queues.SEND_FRONT)

    def overwrite(self, queue: Queue, item: Any) -> bool:
        """Replace the item of a queue of length 1; never fails."""
        return self._send("overwrite", queue, item, queues.OVERWRITE)

    def _send(self, op: str, queue: Queue, item: Any, kind: int) -> bool:
        if not isinstance(queue, Queue):
            raise ValueError(f"an interrupt sends to {queue!r}; only a queue takes items")
        if kind == queues.OVERWRITE and queue.length != 1:
            raise ValueError(f"overwrite on queue {queue.name!r} of length {queue.length}; only length 1 is allowed")
        k = self._enter(op, queue, stamp(item))
        return self._done(*queues.send_from_isr(k, self.code, queue, item, kind))

    def receive(self, queue: Queue) -> Any:
        """Remove and return the first item, which lets a sender in (rule 62); None if there is none."""
        k = self._enter("receive", check_kind(Queue, queue))
        return self._done(*queues.receive_from_isr(k, self.code, queue))

    def notify_give(self, task: Task, index: int = 0) -> None:
        """Count up a task's notifications and wake it if it waits for one."""
        k = self._enter("notify_give", check_kind(Task, task))
        self._done(*notifications.notified(k, self.code, task, "give", 0, check_index(index)))

    def notify(self, task: Task, action: str, value: int = 0, index: int = 0) -> bool:
        """Change a notification of a task and wake it if it waits there; False if it was refused. See `Services.notify`."""
        value = check_value(value)
        k = self._enter("notify", check_kind(Task, task), value)
        return self._done(*notifications.notified(k, self.code, task, check_action(action), value, check_index(index)))

    def resume(self, task: Task) -> None:
        """Make a suspended task ready; no effect on any other."""
        k = self._enter("resume", check_kind(Task, task))
        self._done(None, tasks.resumed(k, self.code, task))

    def set_bits(self, group: EventGroup, bits: int) -> bool:
        """Have the timer task set bits (rule 53); False if its queue is full."""
        return self._command("set_bits", timers.SET_BITS, check_kind(EventGroup, group), check_bits(bits))

    def clear_bits(self, group: EventGroup, bits: int) -> bool:
        """Have the timer task clear bits; False if its queue is full."""
        return self._command("clear_bits", timers.CLEAR_BITS, check_kind(EventGroup, group), check_bits(bits))

    def buffer_send(self, buffer: Buffer, count: int) -> int:
        """Write as many of the bytes as there is room for, of a message all or none; returns how many."""
        count = whole(count, 0, "buffer_send of", " bytes")
        check_kind(Buffer, buffer)
        k = self._enter("buffer_send", buffer, count, "message_send" if buffer.header else "stream_send")
        return self._done(*buffers.put(k, self.code, buffer, count, buffer.room))

    def timer_start(self, timer: Timer) -> bool:
        """Ask the timer task to start a timer, or start it anew, counting from now; False if its queue is full."""
        return self._command("timer_start", timers.START, check_kind(Timer, timer), self._core.ticks)

    def timer_reset(self, timer: Timer) -> bool:
        """The same as timer_start, by the name that says what for."""
        return self._command("timer_reset", timers.RESET, check_kind(Timer, timer), self._core.ticks)

    def timer_stop(self, timer: Timer) -> bool:
        """Ask the timer task to stop a timer."""
        return self._command("timer_stop", timers.STOP, check_kind(Timer, timer), 0)

    def timer_change_period(self, timer: Timer, period: int) -> bool:
        """Ask the timer task to start a timer with another period, counting from when the task does so."""
        period = whole(period, 1, "a timer's period of", " ticks", MOST_TICKS)
        return self._command("timer_change_period", timers.CHANGE_PERIOD, check_kind(Timer, timer), period)

    def mark(self, value: int = 0, extra: int = 0) -> None:
        """Leave a mark with two free integers in the trace; it costs nothing."""
        value, extra = whole(value, -FOREVER, "mark with"), whole(extra, -FOREVER, "mark with")
        self._core.log((self._core.now, MARK, self.code, -1, value, extra))

    def _command(self, op: str, which: int, target: Timer | EventGroup, value: int) -> bool:
        k = self._enter(op, target, value)
        return self._done(*timers.command_from_isr(k, self.code, (which, target, value)))

    def _enter(self, op: str, target: Any, value: int = 0, traced: str = "") -> Core:
        """What each call begins with: its price, and its row."""
        k = self._core
        if k.handling is not None and k.handling.priority < k.mask:
            raise ValueError(
                f"an interrupt of priority {k.handling.priority} calls {op} on {target.name!r}; "
                f"only those of priority {k.mask} to {LOWEST} may call the kernel"
            )
        k.spend(k.prices.get(PRICED[op], 0), SERVICE_COST)
        k.log((k.now, ISR, k.running.code, target.code, value, ISR_OPS.index(traced or TRACED.get(op, op))))
        return k

    def _done(self, answer: Any, switch: bool) -> Any:
        """What each call that may wake a task ends with."""
        self._core.switch_wanted |= switch
        return answer
