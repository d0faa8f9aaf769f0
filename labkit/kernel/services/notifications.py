"""Direct notifications: each task has some values that others change and that it can wait for (rules 26, 43 to 47)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Task
from labkit.trace import CODE, NOTIFY_ACTIONS

if TYPE_CHECKING:
    from labkit.kernel.core import Core

NOTIFY, NOTIFY_TAKE, NOTIFY_TAKE_BLOCK = CODE["notify"], CODE["notify_take"], CODE["notify_take_block"]
NOTIFY_WAIT, NOTIFY_WAIT_BLOCK = CODE["notify_wait"], CODE["notify_wait_block"]
REFUSED = 4096  # see NOTIFY_ACTIONS
VALUES = (1 << 32) - 1


def notify(k: Core, task: Task, target: Task, action: str, value: int, index: int) -> None:
    task.result, switch = notified(k, task.code, target, action, value, index)
    if switch:
        k.reschedule()


def notify_give(k: Core, task: Task, target: Task, index: int) -> None:
    task.result = None
    if notified(k, task.code, target, "give", 0, index)[1]:
        k.reschedule()


def notified(k: Core, by: int, target: Task, action: str, value: int, index: int) -> tuple[bool, bool]:
    """Change a value; wake the target if it waits there, or has stopped waiting and not run since (rule 47).

    Returns:
        Whether it was not refused, and whether a task above the running one woke.
    """
    before, refused = target.notified[index], 0
    match action:
        case "give" | "increment":
            target.notified[index] = before + 1 & VALUES
        case "set_bits":
            target.notified[index] = before | value
        case "overwrite":
            target.notified[index] = value
        case "keep" if target.noted[index]:
            refused = REFUSED  # rule 43: because of the state, whatever the value
        case "keep":
            target.notified[index] = value
    target.noted[index] = True
    k.log((k.now, NOTIFY, by, target.code, target.notified[index], NOTIFY_ACTIONS.index(action) + 8 * index + refused))
    if target.awaits != index:
        return not refused, False
    target.awaits = -1
    return not refused, k.rouse(target)


def notify_take(k: Core, task: Task, clear: bool, timeout: int | None, index: int) -> None:
    if task.notified[index] or timeout == 0:
        _notify_take(k, task, clear, index)
    else:
        k.log((k.now, NOTIFY_TAKE_BLOCK, task.code, -1, 0, index))
        await_notification(k, task, index, k.deadline(timeout), (_notify_take, (clear, index)))


def _notify_take(k: Core, task: Task, clear: bool, index: int) -> None:
    value = task.result = task.notified[index]
    forget(task, index)
    if value:
        task.notified[index] = 0 if clear else value - 1
    k.log((k.now, NOTIFY_TAKE, task.code, -1, value, index))


def notify_wait(k: Core, task: Task, clear_first: int, clear_last: int, timeout: int | None, index: int) -> None:
    if task.noted[index] or timeout == 0:
        _notify_wait(k, task, clear_last, index)
    else:
        task.notified[index] &= ~clear_first  # rule 45: only if it goes to sleep
        k.log((k.now, NOTIFY_WAIT_BLOCK, task.code, -1, 0, index))
        await_notification(k, task, index, k.deadline(timeout), (_notify_wait, (clear_last, index)))


def _notify_wait(k: Core, task: Task, clear_last: int, index: int) -> None:
    noted, value = task.noted[index], task.notified[index]
    task.result = noted, value
    forget(task, index)
    if noted:
        task.notified[index] = value & ~clear_last
    k.log((k.now, NOTIFY_WAIT, task.code, -1, value, 2 * index + noted))


def await_notification(k: Core, task: Task, index: int, deadline: int, then: tuple) -> None:
    """Sleep until notified there, whatever was pending before."""
    task.noted[index] = False
    task.awaits = index
    k.sleep(task, deadline, then)


def forget(task: Task, index: int) -> None:
    """The state goes back to none (rule 44)."""
    task.noted[index] = False
    task.awaits = -1


def state_clear(k: Core, task: Task, target: Task | None, index: int) -> None:
    target = target or task
    task.result = target.noted[index]
    target.noted[index] = False


def value_clear(k: Core, task: Task, target: Task | None, bits: int, index: int) -> None:
    target = target or task
    task.result = target.notified[index]
    target.notified[index] &= ~bits
