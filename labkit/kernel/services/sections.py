"""Critical sections and the suspended scheduler: what is held back, and let in at the end (rules 28 to 33)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Task
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

ENTER_CRITICAL, EXIT_CRITICAL = CODE["enter_critical"], CODE["exit_critical"]
SUSPEND_ALL, RESUME_ALL = CODE["suspend_all"], CODE["resume_all"]


def enter_critical(k: Core, task: Task) -> None:
    task.result = None
    k.hold_interrupts()
    k.log((k.now, ENTER_CRITICAL, task.code, -1, k.critical, 0))


def exit_critical(k: Core, task: Task) -> None:
    if not k.critical:
        raise ValueError(f"task {task.name!r} leaves a critical section, but is in none; enter_critical comes first")
    task.result = None
    k.log((k.now, EXIT_CRITICAL, task.code, -1, k.critical - 1, 0))
    k.let_interrupts_in()


def suspend_all(k: Core, task: Task) -> None:
    task.result = None
    k.log((k.now, SUSPEND_ALL, task.code, -1, 0, 0))
    k.hold_switches()


def resume_all(k: Core, task: Task) -> None:
    """Rule 33. The result says whether it switched."""
    if not k.suspended:
        raise ValueError(f"task {task.name!r} resumes the scheduler, which is not suspended; suspend_all comes first")
    k.log((k.now, RESUME_ALL, task.code, -1, 0, 0))
    task.result = k.let_switches_in()
    if task.result:
        k.reschedule()
