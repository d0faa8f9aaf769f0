"""Time: delays, the tick count, and cutting a wait short."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import BLOCKED, Task
from labkit.kernel.services.jobs import release
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

DELAY, DELAY_UNTIL, YIELD, COMPLETE = CODE["delay"], CODE["delay_until"], CODE["yield"], CODE["complete"]
ABORT_DELAY = CODE["abort_delay"]


def delay(k: Core, task: Task, ticks: int) -> None:
    wake = k.ticks + ticks
    task.result = None
    k.log((k.now, DELAY, task.code, -1, wake * k.tick, ticks))
    if ticks:
        k.sleep(task, wake)
    else:
        k.reschedule()  # rule 8


def delay_until(k: Core, task: Task, period: int, since: int | None) -> None:
    """Rule 25. Each call ends a job and releases the next one; the nominal release is the wake time, even if that has passed.

    A previous wake time that is still to come is to the kernel a tick count that has overflowed: the call does not block, and
    the wake time moves on (rule 59). The next job is then released at once.
    """
    now, tick = k.now, k.tick
    previous = task.last_wake = task.last_wake if since is None else since
    if task.job < 0 and task.released < 0 and task.computed >= max(previous, 0) * tick:
        release(k, task, max(previous, 0) * tick)  # it began with work instead of waiting for its first release
    wake = task.last_wake = previous + period
    at = wake * tick
    task.result = sleeps = previous <= k.ticks < wake
    if task.released >= 0:
        task.released = -1
        k.log((now, COMPLETE, task.code, -1, task.due, task.job, now, DELAY_UNTIL, task.code, -1, at, sleeps))
    else:
        k.log((now, DELAY_UNTIL, task.code, -1, at, sleeps))
    if sleeps:
        task.next_release = at + k.origin
        k.sleep(task, wake)
    else:
        release(k, task, at + k.origin)
        k.reschedule()


def yield_cpu(k: Core, task: Task) -> None:
    task.result = None
    k.log((k.now, YIELD, task.code, -1, 0, 0))
    k.reschedule()


def abort_delay(k: Core, task: Task, target: Task) -> None:
    """Rule 58: a blocked task becomes ready; what it waited for, it tries once more."""
    blocked = target.state == BLOCKED and target.waits_in is not k.postponed
    task.pending = _aborted, (target, blocked)
    if blocked:
        target.aborted = target.waits_in is not None
        if target.next_release >= 0:
            release(k, target, target.next_release)
        if k.make_ready(target):
            k.reschedule()


def _aborted(k: Core, task: Task, target: Task, blocked: bool) -> None:
    k.log((k.now, ABORT_DELAY, task.code, target.code, int(blocked), 0))
    task.result = blocked
