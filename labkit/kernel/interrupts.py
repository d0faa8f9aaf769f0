"""Device interrupts: what a handler can ask of the kernel, FreeRTOS's ...FromISR calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from labkit.kernel.objects import Mutex, Queue, Semaphore, Task
from labkit.kernel.services import PRICED, SEND, SEND_FAIL, give_semaphore, notify, resumed, stamp
from labkit.trace import CODE, ISR_OPS, OVERHEADS

if TYPE_CHECKING:
    from labkit.kernel.core import Core

ISR, SERVICE_COST = CODE["isr"], OVERHEADS.index("service")


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

    def notify_give(self, task: Task) -> None:
        """Count up a task's notifications and wake it if it waits for one."""
        k = self._enter("notify_give", task, 0)
        k.switch_wanted |= notify(k, self.code, task)

    def give(self, semaphore: Semaphore) -> bool:
        """Give a semaphore; False if it is full. A mutex cannot be given here: an interrupt owns nothing."""
        if not isinstance(semaphore, Semaphore):
            raise ValueError(f"an interrupt gives {semaphore!r}; only a semaphore can be given from an interrupt")
        k = self._enter("give", semaphore, 0)
        given, switch = give_semaphore(k, self.code, semaphore)
        k.switch_wanted |= switch
        return given

    def send(self, queue: Queue, item: Any) -> bool:
        """Append an item to a queue; False if it is full (rule 27)."""
        if not isinstance(queue, Queue):
            raise ValueError(f"an interrupt sends to {queue!r}; only a queue takes items")
        k = self._enter("send", queue, stamp(item))
        full = len(queue.items) == queue.length
        k.log((k.now, SEND_FAIL if full else SEND, self.code, queue.code, len(queue.items), stamp(item)))
        if not full:
            queue.items.append(item)
            k.switch_wanted |= bool(queue.receivers) and k.wake(queue.receivers)
        return not full

    def resume(self, task: Task) -> None:
        """Make a suspended task ready; no effect on any other."""
        k = self._enter("resume", task, 0)
        k.switch_wanted |= resumed(k, self.code, task)

    def _enter(self, op: str, target: Task | Semaphore | Mutex | Queue, value: int) -> Core:
        k = self._core
        k.spend(k.prices.get(PRICED[op], 0), SERVICE_COST)
        k.log((k.now, ISR, k.running.code, target.code, value, ISR_OPS.index(op)))
        return k
