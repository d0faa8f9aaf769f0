"""What the kernel keeps about tasks and what they share, and the lists it keeps the tasks in."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

if TYPE_CHECKING:
    from labkit.kernel.protocols import Protocol

FOREVER = 1 << 62  #: a time, in ticks or cycles, that never comes

NOTIFICATIONS = 3  #: notifications per task, FreeRTOS's configTASK_NOTIFICATION_ARRAY_ENTRIES

READY, BLOCKED, SUSPENDED, DELETED = range(4)  #: in the order of `labkit.trace.kinds.STATES`; the running task is READY


class Task:
    """A task: what it does, how urgent it is, and what it waits for. A handle for the services; the kernel does the work.

    Attributes:
        base, priority: the priority it was given and the one it has now, perhaps inherited.
        key: its place among waiters; set together with the priority, but not always the same (rule 22).
        remaining: CPU cycles it still needs before its body goes on.
        send: takes the result of the last request into the body and returns its next one; `result` is that result.
        pending: a service that could not finish and is tried again when the task runs, as (service, arguments).
        alarm: identifies its entry among the delayed tasks; 0: none.
        last_wake: in ticks, the previous wake time of delay_until. `computed`: when it last asked for CPU time; -1: never.
        job: number of the job released last; `due`: its absolute deadline; -1: none.
        released, next_release: nominal release of the open job, and of the one slept for, in cycles; -1: none.
        waits_for, waits_in: the object it is blocked on, and the list of waiters it stands in.
        held: the mutexes it has taken, oldest first (not those of protocol "none").
        notified, noted: values of its notifications, and which are pending; awaits: index of the one it waits for, or -1.
        wants, granted: the bits of an event group it waits for, as (bits, all of them, clear them); what it got, -1: nothing.
        blocks: addresses of its stack and its record in the heap, if there is one.
        aborted: the wait for an object was cut short by abort_delay, and no service has given up because of it yet.
    """

    __slots__ = (
        "aborted",
        "alarm",
        "awaits",
        "base",
        "blocks",
        "code",
        "computed",
        "created",
        "deadline",
        "due",
        "granted",
        "held",
        "inherited",
        "job",
        "key",
        "last_wake",
        "name",
        "next_release",
        "noted",
        "notified",
        "number",
        "pending",
        "priority",
        "released",
        "remaining",
        "result",
        "send",
        "stack_free",
        "state",
        "waits_for",
        "waits_in",
        "wants",
    )

    def __init__(self, name: str, code: int, number: int, priority: int, deadline: int | None, stack_free: int | None):
        self.name, self.code, self.number = name, code, number
        self.deadline, self.stack_free = deadline, stack_free
        self.created = self.base = self.priority = self.key = priority
        self.state = READY
        self.remaining = 0
        self.send: Callable[[Any], Any] = _no_body
        self.result: Any = None
        self.pending: tuple[Callable[..., None], tuple] | None = None
        self.alarm = 0
        self.waits_for: Target | None = None
        self.waits_in: list[Task] | None = None
        self.held: list[Mutex] = []
        self.inherited = False  # rule 18: whether its last block found a holder of lower base priority
        self.notified, self.noted, self.awaits = [0] * NOTIFICATIONS, [False] * NOTIFICATIONS, -1
        self.wants, self.granted = (0, False, False), -1
        self.aborted = False
        self.blocks: tuple[int, ...] = ()
        self.last_wake = 0
        self.computed = self.job = self.due = self.released = self.next_release = -1

    def __repr__(self) -> str:
        return f"<task {self.name!r}>"


def _no_body(result: Any) -> NoReturn:
    raise StopIteration


class Semaphore:
    """A binary or counting semaphore: a count up to `length`, who waits for it, and the queue set it is in."""

    __slots__ = ("code", "container", "count", "length", "name", "waiters")
    kind: ClassVar[str] = "semaphore"

    def __init__(self, name: str, code: int, count: int, length: int):
        self.name, self.code, self.count, self.length = name, code, count, length
        self.waiters: list[Task] = []
        self.container: QueueSet | None = None

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Mutex:
    """A lock with an owner. `depth` counts the nested takes of a recursive one; `users` name the tasks its ceiling covers."""

    __slots__ = ("ceiling", "code", "count", "depth", "holder", "length", "name", "protocol", "recursive", "users", "waiters")
    kind: ClassVar[str] = "mutex"

    def __init__(self, name: str, code: int, protocol: Protocol, recursive: bool, ceiling: int, users: tuple[str, ...]):
        self.name, self.code, self.protocol, self.recursive = name, code, protocol, recursive
        self.ceiling, self.users = ceiling, users
        self.count = self.length = 1
        self.depth = 0
        self.holder: Task | None = None
        self.waiters: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Queue:
    """A queue of at most `length` items, who waits for room in it or for an item, and the queue set it is in."""

    __slots__ = ("code", "container", "items", "length", "name", "receivers", "senders")
    kind: ClassVar[str] = "queue"

    def __init__(self, name: str, code: int, length: int):
        self.name, self.code, self.length = name, code, length
        self.items: deque[Any] = deque()
        self.senders: list[Task] = []
        self.receivers: list[Task] = []
        self.container: QueueSet | None = None

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class QueueSet:
    """Queues and semaphores to wait for together: a queue of those that something was sent to."""

    __slots__ = ("code", "items", "length", "name", "receivers")
    kind: ClassVar[str] = "queue set"

    def __init__(self, name: str, code: int, length: int):
        self.name, self.code, self.length = name, code, length
        self.items: deque[Queue | Semaphore] = deque()
        self.receivers: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class EventGroup:
    """Bits that tasks wait for, alone or together; the waiters stand in the order in which they began to wait (rule 48)."""

    __slots__ = ("bits", "code", "name", "waiters")
    kind: ClassVar[str] = "event group"

    def __init__(self, name: str, code: int):
        self.name, self.code = name, code
        self.bits = 0
        self.waiters: list[Task] = []

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Buffer:
    """A stream buffer of `length` bytes, or a message buffer, whose messages each take `header` bytes more than they have.

    What is in the bytes does not matter here; `level` of them are in use, those of the `messages` in order. One task may wait
    to read, another to write.
    """

    __slots__ = ("code", "header", "length", "level", "messages", "name", "reader", "trigger", "writer")

    def __init__(self, name: str, code: int, length: int, trigger: int, header: int):
        self.name, self.code, self.length, self.trigger, self.header = name, code, length, trigger, header
        self.level = 0
        self.messages: deque[int] = deque()
        self.reader: Task | None = None
        self.writer: Task | None = None

    @property
    def room(self) -> int:
        """Free bytes."""
        return self.length - self.level

    @property
    def kind(self) -> str:
        return "message buffer" if self.header else "stream buffer"

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


class Timer:
    """A software timer; `expiry` is the tick at which it is due next, as long as it is `active`."""

    __slots__ = ("active", "auto_reload", "callback", "code", "expiry", "name", "period")
    kind: ClassVar[str] = "timer"

    def __init__(self, name: str, code: int, period: int, callback: Callable[[Any], Any], auto_reload: bool):
        self.name, self.code, self.period, self.callback, self.auto_reload = name, code, period, callback, auto_reload
        self.active, self.expiry = False, 0

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"


Target = Semaphore | Mutex | Queue | QueueSet | EventGroup  #: what a task can wait for in a list of waiters


#: The sentinel that each circular list of ready tasks contains.
SENTINEL = Task("", -1, 0, 0, None, None)


class ReadyLists:
    """The ready tasks, one circular list per priority (rule 1).

    A circular list is held as a Python list that starts behind the index and ends with the node at the index. To insert before
    the index is then to insert before the last place; to remove the node at the index makes the one before it the last, which is
    the step back; to move the index forward is to rotate by one.
    """

    __slots__ = ("bits", "occupied", "rings")

    def __init__(self, priorities: int):
        self.rings: list[list[Task]] = [[SENTINEL] for _ in range(priorities)]
        self.bits = [1 << priority for priority in range(priorities)]
        self.occupied = 0  # bit p: there is a task in rings[p]

    def insert(self, task: Task) -> None:
        priority = task.priority
        self.rings[priority].insert(-1, task)
        self.occupied |= self.bits[priority]

    def remove(self, task: Task) -> None:
        ring = self.rings[task.priority]
        if ring[-1] is task:
            ring.pop()  # the running one
        else:
            ring.remove(task)
        if len(ring) == 1:
            self.occupied ^= self.bits[task.priority]

    def replaced(self, running: Task) -> Task:
        """Remove the task that was selected last, and select the next one."""
        ring = self.rings[running.priority]
        if ring[-1] is not running:  # it has been moved since
            self.remove(running)
        else:
            ring.pop()
            if len(ring) == 1:
                self.occupied ^= self.bits[running.priority]
        return self.select()

    def select(self) -> Task:
        """The next task of the highest priority that has one; there always is one, the idle task."""
        ring = self.rings[self.occupied.bit_length() - 1]
        if len(ring) == 2:
            if ring[1] is SENTINEL:
                ring.reverse()
            return ring[1]  # once around
        task = ring.pop(0)
        if task is SENTINEL:
            task = ring.pop(0)
            ring.append(SENTINEL)
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
