"""Semaphores and mutexes: take and give."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Mutex, Semaphore, Task
from labkit.kernel.services.sets import sent_to_member
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

TAKE, TAKE_BLOCK, TAKE_FAIL, GIVE, GIVE_FAIL = (CODE[k] for k in ("take", "take_block", "take_fail", "give", "give_fail"))


def take(k: Core, task: Task, lock: Semaphore | Mutex, timeout: int | None) -> None:
    task.inherited = False
    if isinstance(lock, Mutex) and lock.recursive and lock.holder is task:
        lock.depth += 1  # rule 19
        task.result = True
    else:
        _take(k, task, lock, k.deadline(timeout))


def _take(k: Core, task: Task, lock: Semaphore | Mutex, deadline: int) -> None:
    if lock.count:
        take_one(k, task.code, lock)
        if isinstance(lock, Mutex):
            lock.protocol.taken(k, task, lock)
        task.result = True
    elif k.expired(task, deadline):  # rule 12: only after it has tried
        if isinstance(lock, Mutex):
            lock.protocol.timed_out(k, task, lock)
        k.log((k.now, TAKE_FAIL, task.code, lock.code, 0, 0))
        task.result = False
    else:
        k.log((k.now, TAKE_BLOCK, task.code, lock.code, 0, 0))
        k.block(task, deadline, (_take, (lock, deadline)), lock, lock.waiters)


def take_one(k: Core, by: int, lock: Semaphore | Mutex) -> None:
    """A count that is there."""
    k.log((k.now, TAKE, by, lock.code, lock.count, 0))
    lock.count -= 1


def take_from_isr(k: Core, by: int, semaphore: Semaphore) -> bool:
    if semaphore.count:
        take_one(k, by, semaphore)
        return True
    k.log((k.now, TAKE_FAIL, by, semaphore.code, 0, 0))
    return False


def give(k: Core, task: Task, lock: Semaphore | Mutex) -> None:
    task.result = True
    if isinstance(lock, Semaphore):
        task.result, switch = give_semaphore(k, task.code, lock)
        if switch:
            k.reschedule()
        return
    if lock.holder is not task:
        owner = f"which {lock.holder.name!r} holds" if lock.holder else "which nobody holds"
        raise ValueError(f"task {task.name!r} gives mutex {lock.name!r}, {owner}; only its holder may give it")
    if lock.depth:
        lock.depth -= 1
        return
    k.log((k.now, GIVE, task.code, lock.code, lock.count, 0))
    if lock.protocol.give(k, task, lock):
        k.reschedule()


def give_semaphore(k: Core, by: int, semaphore: Semaphore) -> tuple[bool, bool]:
    """Whether there was room for another count, and whether the waiter it woke is above the running task."""
    count = semaphore.count
    if count == semaphore.length:
        k.log((k.now, GIVE_FAIL, by, semaphore.code, count, 0))
        return False, False
    k.log((k.now, GIVE, by, semaphore.code, count, 0))
    semaphore.count = count + 1
    if semaphore.container is not None:
        return True, sent_to_member(k, by, semaphore, semaphore.container)
    return True, bool(semaphore.waiters) and k.wake(semaphore.waiters)
