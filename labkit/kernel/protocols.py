"""What taking and giving a lock does to priorities: FreeRTOS's simplified inheritance, and the textbook's protocols.

A protocol is five verbs. `taken`: the task has got the lock. `waits`: the task is about to block on it. `left`: the task stopped
waiting without being woken by a give. `timed_out`: the task runs and gives up. `give`: the holder puts the lock back and wakes
the first waiter; says whether the CPU must be given away at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Mutex, Task, enqueue
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

INHERIT, DISINHERIT, DISINHERIT_TIMEOUT = CODE["inherit"], CODE["disinherit"], CODE["disinherit_timeout"]


class Protocol:
    """Protocol "none": a mutex with an owner, and priority inversion of any length."""

    family = "none"

    def taken(self, k: Core, task: Task, lock: Mutex) -> None:
        lock.holder = task

    def waits(self, k: Core, task: Task, lock: Mutex) -> None: ...

    def left(self, k: Core, task: Task, lock: Mutex) -> None: ...

    def timed_out(self, k: Core, task: Task, lock: Mutex) -> None: ...

    def give(self, k: Core, task: Task, lock: Mutex) -> bool:
        lock.holder = None
        lock.count = 1
        return bool(lock.waiters) and k.wake(lock.waiters)


class FreeRTOS(Protocol):
    """Protocol "freertos": only the direct holder inherits, and keeps it until it holds no mutex at all (rules 14 to 18)."""

    family = "freertos"

    def taken(self, k: Core, task: Task, lock: Mutex) -> None:
        lock.holder = task
        task.held.append(lock)

    def waits(self, k: Core, task: Task, lock: Mutex) -> None:
        holder = lock.holder
        assert holder is not None  # else there was nothing to wait for
        task.inherited = holder.base < task.priority
        if holder.priority < task.priority:
            holder.key = task.priority
            k.change_priority(holder, task.priority)
            k.log((k.now, INHERIT, holder.code, task.code, task.priority, holder.base))

    def timed_out(self, k: Core, task: Task, lock: Mutex) -> None:
        holder = lock.holder
        if not task.inherited or holder is None or len(holder.held) != 1:
            return
        fallback = max(holder.base, lock.waiters[0].key if lock.waiters else 0)
        if fallback != holder.priority:
            k.log((k.now, DISINHERIT_TIMEOUT, holder.code, lock.code, fallback, holder.priority))
            holder.key = fallback
            k.change_priority(holder, fallback)

    def give(self, k: Core, task: Task, lock: Mutex) -> bool:
        lock.holder = None
        task.held.remove(lock)
        drops = not task.held and task.priority != task.base
        if drops:
            k.log((k.now, DISINHERIT, task.code, lock.code, task.base, task.priority))
            task.key = task.base
            k.change_priority(task, task.base)
        lock.count = 1
        if lock.waiters:  # rule 17: then the waiter alone decides, whoever else is ready
            return k.wake(lock.waiters)
        return drops


class Textbook(Protocol):
    """Protocols "inheritance" and "ceiling": a task's priority is the maximum of its base, the ceilings of the mutexes it holds
    and the priorities of those who wait for one of them (Sha, Rajkumar, Lehoczky 1990; immediate ceiling as in POSIX).

    It is computed anew at each take, block, give, time-out and priority change, and passed on along chains of holders. A give
    leaves the CPU whenever a higher task is ready.
    """

    family = "textbook"

    def taken(self, k: Core, task: Task, lock: Mutex) -> None:
        if lock.ceiling and task.base > lock.ceiling:
            raise ValueError(
                f"task {task.name!r} of priority {task.base} takes mutex {lock.name!r}, whose ceiling is {lock.ceiling}; "
                "the ceiling is at least the priority of every user"
            )
        lock.holder = task
        task.held.append(lock)
        settle(k, task, None, lock)

    def waits(self, k: Core, task: Task, lock: Mutex) -> None:
        settle(k, lock.holder, task, lock)

    def left(self, k: Core, task: Task, lock: Mutex) -> None:
        settle(k, lock.holder, task, lock, DISINHERIT_TIMEOUT)

    def give(self, k: Core, task: Task, lock: Mutex) -> bool:
        lock.holder = None
        task.held.remove(lock)
        settle(k, task, None, lock)
        lock.count = 1
        if lock.waiters:
            k.wake(lock.waiters)
        return k.ready.highest() > task.priority


def settle(k: Core, task: Task | None, cause: Task | None, lock: Mutex | None, lowered: int = DISINHERIT) -> None:
    """Give a task the priority that the textbook's rule asks for, and so on along the chain of those whom it waits for."""
    by, at = cause.code if cause else -1, lock.code if lock else -1
    while task is not None:
        waiting = [mutex.waiters[0].priority for mutex in task.held if mutex.waiters]
        wanted = max([task.base, *(mutex.ceiling for mutex in task.held), *waiting])
        before = task.priority
        if wanted == before:
            return
        task.key = wanted
        k.change_priority(task, wanted)
        if wanted > before:
            k.log((k.now, INHERIT, task.code, by, wanted, task.base))
        else:
            k.log((k.now, lowered, task.code, at, wanted, before))
        if task.waits_in is None:
            return
        task.waits_in.remove(task)
        enqueue(task.waits_in, task)
        task = task.waits_for.holder if isinstance(task.waits_for, Mutex) else None


#: The protocols by the names users give them.
PROTOCOLS: dict[str, Protocol] = {"none": Protocol(), "freertos": FreeRTOS(), "inheritance": Textbook(), "ceiling": Textbook()}
