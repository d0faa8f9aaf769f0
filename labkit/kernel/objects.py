"""What the kernel keeps about tasks, locks and queues, and the three kinds of list it keeps them in."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from typing import Any

FOREVER = 1 << 62  #: a time, in ticks or cycles, that never comes

READY, BLOCKED, SUSPENDED, DELETED = range(4)  #: in the order of `labkit.trace.kinds.STATES`; the running task is READY


class Task:
    """A task: what it does, how urgent it is, and what it waits for. A handle for the services; the kernel does the work.

    Attributes:
        base, priority: the priority it was given and the one it has now, perhaps inherited.
        key: its place among waiters; set together with the priority, but not always the same (rule 22).
        remaining: CPU cycles it still needs before its body goes on.
        body: the generator; `result` is what its last request returned.
        pending: a service that could not finish and is tried again when the task runs, as (service, arguments).
        alarm: identifies its entry among the delayed tasks; 0: none.
        waits_for, waits_in: the object it is blocked on, and the list of waiters it stands in.
        held: the mutexes it has taken, oldest first (not those of protocol "none").
    """

    __slots__ = (
        "alarm",
        "awaits_notification",
        "base",
        "body",
        "code",
        "computed",
        "created",
        "deadline",
        "held",
        "inherited",
        "job",
        "key",
        "last_wake",
        "name",
        "next_release",
        "notified",
        "number",
        "pending",
        "priority",
        "released",
        "remaining",
        "result",
        "stack_free",
        "state",
        "waits_for",
        "waits_in",
    )

    def __init__(self, name: str, code: int, number: int, priority: int, deadline: int | None, stack_free: int | None):
        self.name, self.code, self.number = name, code, number
        self.deadline, self.stack_free = deadline, stack_free
        self.created = self.base = self.priority = self.key = priority
        self.state = READY
        self.remaining = 0
        self.body: Generator[Any, Any, None] | None = None
        self.result: Any = None
        self.pending: tuple[Callable[..., None], tuple] | None = None
        self.alarm = 0
        self.waits_for: Semaphore | Mutex | Queue | None = None
        self.waits_in: list[Task] | None = None
        self.held: list[Mutex] = []
        self.inherited = False  # rule 18: whether its last block found a holder of lower base priority
        self.notified = 0
        self.awaits_notification = False
        self.last_wake = 0  # ticks, the variable of delay_until
        self.computed = False
        self.job = -1
        self.released = self.next_release = -1  # nominal release of the open job, and of the one slept for, in cycles; -1: none

    def __repr__(self) -> str:
        return f"<task {self.name!r}>"


class Semaphore:
    """A binary or counting semaphore: a count up to `length`, and who waits for it."""

    __slots__ = ("code", "count", "length", "name", "protocol", "waiters")
    kind, recursive, holder = "semaphore", False, None

    def __init__(self, name: str, code: int, count: int, length: int, protocol: Any):
        self.name, self.code, self.count, self.length, self.protocol = name, code, count, length, protocol
        self.waiters: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Mutex:
    """A lock with an owner. `depth` counts the nested takes of a recursive one; `users` name the tasks its ceiling covers."""

    __slots__ = ("ceiling", "code", "count", "depth", "holder", "length", "name", "protocol", "recursive", "users", "waiters")
    kind = "mutex"

    def __init__(self, name: str, code: int, protocol: Any, recursive: bool, ceiling: int, users: tuple[str, ...]):
        self.name, self.code, self.protocol, self.recursive = name, code, protocol, recursive
        self.ceiling, self.users = ceiling, users
        self.count = self.length = 1
        self.depth = 0
        self.holder: Task | None = None
        self.waiters: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Queue:
    """A queue of at most `length` items, and who waits for room in it or for an item."""

    __slots__ = ("code", "items", "length", "name", "protocol", "receivers", "senders")
    kind = "queue"

    def __init__(self, name: str, code: int, length: int, protocol: Any):
        self.name, self.code, self.length, self.protocol = name, code, length, protocol
        self.items: deque[Any] = deque()
        self.senders: list[Task] = []
        self.receivers: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class ReadyLists:
    """The ready tasks, one circular list per priority (rule 1).

    A circular list is held as a Python list that starts behind the index and ends with the node at the index; None is the
    sentinel. To insert before the index is then to insert before the last place; to remove the node at the index makes the one
    before it the last, which is the step back; to move the index forward is to rotate by one.
    """

    __slots__ = ("occupied", "rings")

    def __init__(self, priorities: int):
        self.rings: list[list[Task | None]] = [[None] for _ in range(priorities)]
        self.occupied = 0  # bit p: there is a task in rings[p]

    def insert(self, task: Task) -> None:
        self.rings[task.priority].insert(-1, task)
        self.occupied |= 1 << task.priority

    def remove(self, task: Task) -> None:
        ring = self.rings[task.priority]
        ring.remove(task)
        if len(ring) == 1:
            self.occupied ^= 1 << task.priority

    def select(self) -> Task:
        """The next task of the highest priority that has one; there always is one, the idle task."""
        ring = self.rings[self.occupied.bit_length() - 1]
        task = ring.pop(0)
        if task is None:
            task = ring.pop(0)
            ring.append(None)
        ring.append(task)
        return task

    def highest(self) -> int:
        """The highest priority that has a ready task."""
        return self.occupied.bit_length() - 1


def enqueue(waiters: list[Task], task: Task) -> None:
    """Put a task among waiters: by key, first come first served among equals (rule 11)."""
    at = 0
    while at < len(waiters) and waiters[at].key >= task.key:
        at += 1
    waiters.insert(at, task)
