"""What a simulation of the kernel leaves behind: the trace, the tasks, and who is stuck."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from labkit.kernel.objects import BLOCKED, DELETED, Mutex, Task
from labkit.trace import Trace


@dataclass(frozen=True)
class TaskInfo:
    """A task as created: number from 1 in order of creation, base priority, relative deadline in cycles, free stack words."""

    name: str
    number: int
    priority: int
    deadline: int | None = None
    stack_free: int | None = None


@dataclass(frozen=True)
class Wait:
    """A task waits for ever for an object; `holder` has it, if it is a mutex."""

    task: str
    object: str
    holder: str | None = None

    def __str__(self) -> str:
        return f"{self.task} waits for {self.object}" + (f", held by {self.holder}" if self.holder else "")


@dataclass(frozen=True)
class Run:
    """A finished simulation.

    Attributes:
        trace: all events from 0 to the end, in CPU cycles.
        tasks: the tasks by name in order of creation, a name used again as it was last; the kernel's own among them.
        tick: CPU cycles per tick.
        deadlock: waits without time-out that cannot end: those around a circle of mutexes, or up to a mutex whose holder has
            ended; failing that, all of them if every task that has not ended waits for ever and no interrupt or timer is due.
    """

    trace: Trace
    tasks: tuple[TaskInfo, ...]
    tick: int
    deadlock: tuple[Wait, ...] = ()


def find_deadlock(tasks: Iterable[Task], more_to_come: bool) -> tuple[Wait, ...]:
    """The waits of a deadlock, see `Run.deadlock`; of several, the one that the task created first is in."""
    alive = [task for task in tasks if task.state != DELETED]
    stuck = [task for task in alive if task.state == BLOCKED and not task.alarm]
    for task in stuck:
        chain = [task]
        while (holder := holder_of(chain[-1])) is not None and holder in stuck and holder not in chain:
            chain.append(holder)
        if holder is task or (holder is not None and holder.state == DELETED):
            return tuple(wait_of(each) for each in chain)
    if stuck and len(stuck) == len(alive) and not more_to_come:
        return tuple(wait_of(each) for each in stuck)
    return ()


def holder_of(task: Task) -> Task | None:
    """The task that has the mutex for which this one waits."""
    return task.waits_for.holder if isinstance(task.waits_for, Mutex) else None


def wait_of(task: Task) -> Wait:
    """What a blocked task waits for, by name."""
    target = task.waits_for
    if target is None:
        return Wait(task.name, "a notification")
    holder = holder_of(task)
    return Wait(task.name, target.name, holder.name if holder else None)
