"""Jobs, scopes and marks: rows in the trace that take no time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Task
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

RELEASE, DEADLINE, COMPLETE = CODE["release"], CODE["deadline"], CODE["complete"]
BEGIN, END, MARK = CODE["begin"], CODE["end"], CODE["mark"]


def release(k: Core, task: Task, nominal: int) -> None:
    """A job begins: its response time counts from `nominal`, in cycles, or from now if that is still to come."""
    now, code = k.now, task.code
    if nominal > now or nominal < 0:
        nominal = min(max(nominal, 0), now)
    task.next_release = -1
    task.released = nominal
    task.job = job = task.job + 1
    if task.deadline is None:
        k.log((now, RELEASE, code, -1, nominal, job))
    else:
        task.due = nominal + task.deadline
        k.log((now, RELEASE, code, -1, nominal, job, now, DEADLINE, code, -1, task.due, job))


def complete(k: Core, task: Task) -> None:
    """The open job, if there is one, is done: at this request, not at the end of its last computation.

    If that end falls on a tick that releases a higher task, the request comes after that task has run, as in the real kernel.
    Response-time analysis counts to the end of the computation, so a body that is to meet its bound exactly leaves its last
    cycle to the request.
    """
    if task.released >= 0:
        k.log((k.now, COMPLETE, task.code, -1, task.due, task.job))
        task.released = -1


def begin(k: Core, task: Task, scope: str) -> None:
    k.log((k.now, BEGIN, k.code_of(scope), task.code, 0, 0))


def end(k: Core, task: Task, scope: str) -> None:
    k.log((k.now, END, k.code_of(scope), task.code, 0, 0))


def mark(k: Core, task: Task, value: int, extra: int) -> None:
    k.log((k.now, MARK, task.code, -1, value, extra))
