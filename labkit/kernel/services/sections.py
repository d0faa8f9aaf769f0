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
    if not k.critical:
        k.entered = k.now
        k.hold()
    k.critical += 1
    k.log((k.now, ENTER_CRITICAL, task.code, -1, k.critical, 0))


def exit_critical(k: Core, task: Task) -> None:
    """The outermost exit lets in ticks, then interrupts, then at most one switch (rule 29)."""
    if not k.critical:
        raise ValueError(f"task {task.name!r} leaves a critical section, but is in none; enter_critical comes first")
    task.result = None
    k.critical -= 1
    k.log((k.now, EXIT_CRITICAL, task.code, -1, k.critical, 0))
    if not k.critical:
        k.held, k.flagged = k.suspended > 0, False
        k.handle_interrupts(k.tick_due())


def suspend_all(k: Core, task: Task) -> None:
    task.result = None
    k.log((k.now, SUSPEND_ALL, task.code, -1, 0, 0))
    if not k.suspended:
        k.hold()
    k.suspended += 1


def resume_all(k: Core, task: Task) -> None:
    """The outermost resume lets in the tasks that were woken, then the ticks, then a switch; the result says so (rule 33)."""
    if not k.suspended:
        raise ValueError(f"task {task.name!r} resumes the scheduler, which is not suspended; suspend_all comes first")
    k.log((k.now, RESUME_ALL, task.code, -1, 0, 0))
    k.suspended -= 1
    task.result = False
    if k.suspended:
        return
    k.held = k.critical > 0
    while k.postponed:
        k.switch_wanted |= k.make_ready(k.postponed[0])
    until = k.entered if k.critical else k.now
    for ticks in range(k.ticks + 1, (until - k.origin) // k.tick + 1):
        k.count_tick(ticks)
    task.result = k.switch_wanted
    if task.result:
        k.reschedule()
