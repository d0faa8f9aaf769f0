"""Tasks and their priorities: create, delete, suspend, resume."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from labkit.kernel.objects import DELETED, READY, SUSPENDED, Task
from labkit.kernel.protocols import settle
from labkit.kernel.services.jobs import complete, release
from labkit.kernel.services.memory import give_back_all
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

SUSPEND, RESUME, PRIO_SET, DONE, DELETE = (CODE[k] for k in ("suspend", "resume", "prio_set", "done", "delete"))


def create(k: Core, task: Task, make: Callable[[], Task | None]) -> None:
    """Rule 55: `make` admits the new task, or has no memory for it; the caller goes on unless that task is above it."""
    created = task.result = make()
    if created is not None and created.priority > task.priority:
        k.reschedule()


def delete(k: Core, task: Task, target: Task | None) -> None:
    """Rule 54. Its mutexes stay taken."""
    target = target or task
    if target.state == DELETED:
        raise ValueError(f"task {target.name!r} is deleted after it has ended; only a task that exists can be deleted")
    k.log((k.now, DELETE, task.code, target.code, 0, 0))
    task.result = None
    _remove(k, target, DELETED, "deletes itself")
    if target is task or k.is_outranked():
        k.reschedule()


def end_task(k: Core, task: Task) -> None:
    """The body has returned: the task is deleted, and its last job is complete."""
    complete(k, task)
    k.log((k.now, DONE, task.code, -1, 0, 0))
    _remove(k, task, DELETED, "ends")
    k.reschedule()


def suspend(k: Core, task: Task, target: Task | None) -> None:
    """Rules 23 and 24. The service it waited in is tried again after the resume."""
    target = target or task
    if target.state == DELETED:
        raise ValueError(f"task {target.name!r} is suspended after it has ended; only a task that exists can be suspended")
    task.result = None
    k.log((k.now, SUSPEND, task.code, target.code, 0, 0))
    _remove(k, target, SUSPENDED, "suspends itself")
    if target is task or k.is_outranked():
        k.reschedule()


def _remove(k: Core, task: Task, state: int, what: str) -> None:
    """Off all lists."""
    if task is k.running:
        k.must_not_be_held(task, what)
    if task.state == READY:
        k.ready.remove(task)
    task.alarm = 0
    if task.waits_in is not None:
        k.leave(task, task.waits_in)
    task.awaits = -1
    task.state = state
    if state == DELETED and task.blocks:
        if task is k.running:  # it still needs its stack; the idle task will give that back
            k.ended.append(task)
            k.idle.remaining = 0
        else:
            give_back_all(k, k.running.code, task)


def resume(k: Core, task: Task, target: Task) -> None:
    task.result = None
    if resumed(k, task.code, target):
        k.reschedule()


def resumed(k: Core, by: int, target: Task) -> bool:
    """Rules 23 and 24. True if the target was suspended and is above the running task."""
    if target.state != SUSPENDED or target.waits_in is not None:  # or it has been resumed while the scheduler is suspended
        return False
    k.log((k.now, RESUME, by, target.code, 0, 0))
    if target.next_release >= 0:
        release(k, target, target.next_release)
    return k.rouse(target)


def set_priority(k: Core, task: Task, target: Task | None, priority: int) -> None:
    """Rules 20 to 22."""
    target = target or task
    base, current = target.base, target.priority
    task.result = None
    if priority != base and not k.textbook and (current == base or priority > current):
        current = priority
    k.log((k.now, PRIO_SET, task.code, target.code, priority, current))
    if priority == base:
        return
    target.base = priority
    if k.textbook:
        settle(k, target, None, None)
    else:
        target.key = priority
        k.change_priority(target, current)
    lowers_itself = target is task and priority < base
    raises_above = target is not task and base < priority and priority > task.priority
    if lowers_itself or raises_above or k.is_outranked():
        k.reschedule()


def get_priority(k: Core, task: Task, target: Task | None) -> None:
    task.result = (target or task).priority


def get_base_priority(k: Core, task: Task, target: Task | None) -> None:
    task.result = (target or task).base
