"""Queue sets: waiting for several queues and semaphores at once (rule 61)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Queue, QueueSet, Semaphore, Task
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

SET_SEND, SELECT, SELECT_BLOCK, SELECT_FAIL = (CODE[k] for k in ("set_send", "select", "select_block", "select_fail"))


def sent_to_member(k: Core, by: int, member: Queue | Semaphore, group: QueueSet) -> bool:
    """Enter the member into its set; True if that woke a task above the running one. A full set takes no more entries."""
    if len(group.items) == group.length:
        return False
    k.log((k.now, SET_SEND, by, group.code, len(group.items), member.code))
    group.items.append(member)
    return bool(group.receivers) and k.wake(group.receivers)


def select(k: Core, task: Task, group: QueueSet, timeout: int | None) -> None:
    _select(k, task, group, k.deadline(timeout))


def _select(k: Core, task: Task, group: QueueSet, deadline: int) -> None:
    if group.items:
        task.result = group.items.popleft()
        k.log((k.now, SELECT, task.code, group.code, len(group.items) + 1, task.result.code))
    elif k.expired(task, deadline):
        k.log((k.now, SELECT_FAIL, task.code, group.code, 0, 0))
        task.result = None
    else:
        k.log((k.now, SELECT_BLOCK, task.code, group.code, 0, 0))
        k.block(task, deadline, (_select, (group, deadline)), group, group.receivers)
