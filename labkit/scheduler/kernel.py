"""The FreeRTOS kernel on one core, cycle by cycle: fixed priorities, a tick, time slices, and the services tasks ask it for.

The semantics are the real kernel's, recorded in tests/oracle/freertos, whose README numbers the rules that are cited here.

    k = Kernel(cpu_hz=216_000_000)
    lock = k.mutex("lock")

    def low(os):
        yield os.take(lock)
        yield os.compute(6 * os.ms)
        yield os.give(lock)

    k.task("low", low, priority=1)
    run = k.run(until=20 * k.ms)

Left out: interrupts inside a service or a tick (they wait until it is over), tick overflow, tasks of the idle task's priority,
event groups, stream buffers, software timers, queue sets, several cores. Caches and bus contention are not modelled: a cycle of
`compute` is a cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

from labkit.scheduler.journal import JOURNAL_PAGE, Journal
from labkit.scheduler.interrupts import Interrupt
from labkit.scheduler.objects import BLOCKED, DELETED, FOREVER, READY, SUSPENDED
from labkit.scheduler.objects import Mutex, Queue, ReadyLists, Semaphore, Task, enqueue
from labkit.scheduler.protocols import PROTOCOLS, UNOWNED
from labkit.scheduler.run import Run, TaskInfo, find_deadlock
from labkit.scheduler.services import Services, complete, release
from labkit.trace.kinds import CODE, OVERHEADS

SWITCH, READIED, CREATE, DONE, OVERHEAD = (CODE[kind] for kind in ("switch", "ready", "create", "done", "overhead"))
TICK_COST, SWITCH_COST, SERVICE_COST, ISR_COST = range(len(OVERHEADS))

#: Requests in a row, without time passing, after which a program is taken to be caught in a loop that takes no time.
ZERO_TIME_LIMIT = 100_000

#: The services that can cost something.
SERVICES = (
    "take", "give", "send", "send_front", "overwrite", "receive", "peek", "notify_give", "notify_take",
    "delay", "delay_until", "yield_cpu", "suspend", "resume", "set_priority",
)  # fmt: skip

IDLE_NAME, ISR_NAME = "IDLE", "ISR"

Body = Callable[[Services], Generator[Any, Any, None]]
Handler = Callable[[Interrupt], Any]


@dataclass(frozen=True)
class Costs:
    """What the kernel itself takes, in CPU cycles. It is charged to no task: the trace has it in `overhead` rows.

    Attributes:
        tick: each tick interrupt. If it is not 0 every tick is simulated, else only those at which something can happen.
        switch: each switch to another task, before that task goes on.
        service: each call of a service, before its effect; one number for all of them or a mapping from their names
            (take, give, send, receive, notify_give, delay_until, ...), those left out being free.
        isr_entry, isr_exit: each device interrupt, before and after what it does.
    """

    tick: int = 0
    switch: int = 0
    service: int | Mapping[str, int] = 0
    isr_entry: int = 0
    isr_exit: int = 0

    def __post_init__(self) -> None:
        own = {"tick": self.tick, "switch": self.switch, "isr_entry": self.isr_entry, "isr_exit": self.isr_exit}
        services = self.service if isinstance(self.service, Mapping) else dict.fromkeys(SERVICES, self.service)
        for name, cycles in {**own, **services}.items():
            if name not in own and name not in SERVICES:
                raise ValueError(f"no service {name!r} to cost anything; there are {', '.join(SERVICES)}")
            if not isinstance(cycles, int) or cycles < 0:
                raise ValueError(f"the cost of {name} is {cycles!r}; a whole number of cycles of at least 0 is allowed")

    def of_services(self) -> dict[str, int]:
        """Cycles of each service that costs anything."""
        services = self.service if isinstance(self.service, Mapping) else dict.fromkeys(SERVICES, self.service)
        return {name: cycles for name, cycles in services.items() if cycles}


class Kernel:
    """One core under FreeRTOS. Create objects and tasks, then `run`.

    Args:
        cpu_hz: CPU cycles per second. All times are counted in them unless a name says ticks.
        tick_hz: tick interrupts per second; divides `cpu_hz`.
        priorities: tasks have priorities 1 to priorities - 1, the highest being most urgent; 0 is the idle task's.
        costs: what the kernel itself takes.
        time_slicing: whether tasks of equal priority take turns at every tick.

    Attributes:
        now: CPU cycles since the start.
        ticks: tick interrupts handled.
        tick: CPU cycles per tick.
    """

    __slots__ = (
        "cpu_hz", "tick", "priorities", "costs", "time_slicing", "now", "ticks", "running", "switch_wanted", "ready", "delayed",
        "devices", "tasks", "textbook", "os", "isr", "log", "_journal", "_codes", "_mutexes", "_sequence", "_every_tick", "_switch_cost", "_service_costs",
    )  # fmt: skip

    def __init__(
        self,
        cpu_hz: int = 216_000_000,
        tick_hz: int = 1000,
        priorities: int = 8,
        costs: Costs = Costs(),
        time_slicing: bool = True,
    ):
        if cpu_hz < 1 or tick_hz < 1 or cpu_hz % tick_hz:
            raise ValueError(f"a tick at {tick_hz} Hz is no whole number of cycles at {cpu_hz} Hz; tick_hz must divide cpu_hz")
        if not 2 <= priorities <= 64:
            raise ValueError(f"{priorities} priorities; 2 to 64 are allowed")
        self.tick = cpu_hz // tick_hz
        if costs.tick + costs.switch + costs.isr_entry + costs.isr_exit >= self.tick:
            raise ValueError(f"tick, switch and interrupt cost as much as the {self.tick} cycles of a whole tick; no task would ever run")
        self.cpu_hz, self.priorities, self.costs, self.time_slicing = cpu_hz, priorities, costs, time_slicing
        self.now = self.ticks = 0
        self.running: Task | None = None
        self.switch_wanted = False
        self.ready = ReadyLists(priorities)
        self.delayed: list[tuple[int, int, Task]] = []  # heap of (wake tick, order of going to sleep, task), some out of date
        self.devices: list[tuple[int, int, Handler, int | None]] = []  # heap of (cycle, order, handler, period)
        self.tasks: list[Task] = []
        self.textbook = False
        self.os = Services(self)
        self._sequence = 0
        self._every_tick = costs.tick > 0
        self._switch_cost = costs.switch
        self._service_costs = costs.of_services()
        self._journal = Journal()
        self.log = self._journal.log
        self._codes: dict[str, int] = {}
        self._mutexes: list[Mutex] = []

    @property
    def ms(self) -> int:
        """Cycles in a millisecond."""
        return self._cycles_in("millisecond", 1000)

    @property
    def us(self) -> int:
        """Cycles in a microsecond."""
        return self._cycles_in("microsecond", 1_000_000)

    def _cycles_in(self, unit: str, per_second: int) -> int:
        if self.cpu_hz % per_second:
            raise ValueError(f"a {unit} is no whole number of cycles at {self.cpu_hz} Hz; count in cycles")
        return self.cpu_hz // per_second

    # What there is

    def mutex(self, name: str, protocol: str = "freertos", ceiling: int | None = None, users: Iterable[str] = ()) -> Mutex:
        """A mutex. For protocol "ceiling" give the ceiling, or the names of the tasks that use it."""
        return self._mutex(name, protocol, False, ceiling, users)

    def recursive_mutex(self, name: str, protocol: str = "freertos", ceiling: int | None = None, users: Iterable[str] = ()) -> Mutex:
        """A mutex that its holder can take again; only the outermost take and give count (rule 19)."""
        return self._mutex(name, protocol, True, ceiling, users)

    def _mutex(self, name: str, protocol: str, recursive: bool, ceiling: int | None, users: Iterable[str]) -> Mutex:
        if protocol not in PROTOCOLS:
            raise ValueError(f"mutex {name!r} has protocol {protocol!r}; there are {', '.join(PROTOCOLS)}")
        users = tuple(users)
        if (protocol == "ceiling") != (ceiling is not None or bool(users)):
            raise ValueError(f"mutex {name!r} of protocol {protocol!r}; a ceiling or its users are given for protocol 'ceiling' and no other")
        textbook = protocol in ("inheritance", "ceiling")
        if textbook != self.textbook and any(lock.protocol is not PROTOCOLS["none"] for lock in self._mutexes) and protocol != "none":
            raise ValueError(f"mutex {name!r} of protocol {protocol!r}; FreeRTOS's inheritance and the textbook's cannot be mixed in one kernel")
        self.textbook |= textbook
        top = self.checked_priority(ceiling, f"the ceiling of {name!r}") if ceiling is not None else 0
        lock = Mutex(name, self._new(name), PROTOCOLS[protocol], recursive, top, users)
        self._mutexes.append(lock)
        return lock

    def binary(self, name: str, init: int = 0) -> Semaphore:
        """A binary semaphore, empty unless `init` is 1."""
        return self.counting(name, 1, init)

    def counting(self, name: str, length: int, init: int = 0) -> Semaphore:
        """A counting semaphore with at most `length` counts, `init` of them at the start."""
        if length < 1 or not 0 <= init <= length:
            raise ValueError(f"semaphore {name!r} starts with {init} of {length}; 0 to its length are allowed, and a length of at least 1")
        return Semaphore(name, self._new(name), init, length, UNOWNED)

    def queue(self, name: str, length: int) -> Queue:
        """An empty queue with room for `length` items."""
        if length < 1:
            raise ValueError(f"queue {name!r} has room for {length} items; at least 1 is allowed")
        return Queue(name, self._new(name), length, UNOWNED)

    def task(self, name: str, body: Body, priority: int, deadline: int | None = None, stack_free: int | None = None) -> Task:
        """A task, ready at time 0. `body(os)` is a generator of requests; when it returns, the task ends.

        `deadline`, in cycles after each release, and `stack_free`, in words, are passed on to the trace and the task list.
        """
        if self.running is not None:
            raise ValueError(f"task {name!r} is created while the kernel runs; create all tasks before the first run")
        self.checked_priority(priority, f"task {name!r}")
        task = self._create(name, self._new(name), priority, deadline, stack_free)
        task.body = body(self.os)
        if not isinstance(task.body, Generator):
            raise ValueError(f"the body of task {name!r} is no generator function; it must yield its requests")
        return task

    def _create(self, name: str, code: int, priority: int, deadline: int | None = None, stack_free: int | None = None) -> Task:
        task = Task(name, code, len(self.tasks) + 1, priority, deadline, stack_free)
        self.tasks.append(task)
        self.log((0, CREATE, task.code, -1, priority, 0))
        self.ready.insert(task)
        self.log((0, READIED, task.code, -1, priority, 0))
        return task

    def interrupt(self, at: int, handler: Handler, every: int | None = None) -> None:
        """A device interrupt at cycle `at`, repeated `every` so many cycles. `handler` is called with an `Interrupt`.

        Interrupts of one instant come in the order in which they were asked for, after the tick, before the one switch.
        """
        if at < self.now or (every is not None and every < 1):
            raise ValueError(f"an interrupt at cycle {at}, every {every}; it cannot be before {self.now} or more than once per cycle")
        heappush(self.devices, (at, self._next(), handler, every))

    def checked_priority(self, priority: int, whose: str) -> int:
        """The priority, if a task may have it."""
        if not isinstance(priority, int) or not 1 <= priority < self.priorities:
            raise ValueError(f"{whose}: priority {priority!r}; 1 to {self.priorities - 1} are allowed, 0 is the idle task's")
        return priority

    def code_of(self, name: str) -> int:
        """The code of a name in the trace; a new one if there is none yet."""
        return self._codes.setdefault(name, len(self._codes))

    def _new(self, name: str) -> int:
        if not isinstance(name, str) or not name or name in self._codes or name in (IDLE_NAME, ISR_NAME):
            raise ValueError(f"the name {name!r} is taken or none; every task and object needs its own, and IDLE and ISR are the kernel's")
        return self.code_of(name)

    def _next(self) -> int:
        self._sequence += 1
        return self._sequence

    # Time

    def run(self, until: int) -> Run:
        """Simulate up to cycle `until` (nothing at or after it is recorded); a later call goes on from there.

        Errors: ValueError for a program that breaks a rule of the kernel or makes requests for ever without using time; it and
        exceptions from task bodies carry a note saying which task ran and when.
        """
        if until <= self.now:
            raise ValueError(f"run until cycle {until}; it must be after {self.now}")
        if self.running is None:
            self._start()
        try:
            self._simulate(until)
        except Exception as error:
            error.add_note(f"in task {self.running.name!r} at cycle {self.now}")
            raise
        infos = tuple(TaskInfo(t.name, t.number, t.created, t.deadline, t.stack_free) for t in self.tasks)
        trace = self._journal.trace(self._codes, self.cpu_hz, until)
        return Run(trace, infos, self.tick, find_deadlock(self.tasks[:-1], bool(self.devices)))

    def _start(self) -> None:
        """The last created of the highest priority runs first, the index of its list not having moved (rule 2)."""
        by_name = {task.name: task for task in self.tasks}
        for lock in self._mutexes:
            for user in lock.users:
                if user not in by_name:
                    raise ValueError(f"mutex {lock.name!r} names {user!r} as a user; the tasks are {', '.join(by_name) or 'none'}")
                lock.ceiling = max(lock.ceiling, by_name[user].base)
        self._create(IDLE_NAME, self.code_of(IDLE_NAME), 0).remaining = FOREVER
        self.isr = Interrupt(self, self.code_of(ISR_NAME))
        self.running = max(reversed(self.tasks), key=lambda task: task.priority)
        self.log((0, SWITCH, self.running.code, -1, self.running.priority, -1))

    def _simulate(self, until: int) -> None:
        """First what takes no time, request by request; then time passes, to the end of a computation or the next interrupt."""
        tick, delayed, devices, rings = self.tick, self.delayed, self.devices, self.ready.rings
        every_tick, time_slicing, costs = self._every_tick, self.time_slicing, self._service_costs
        while (now := self.now) < until:
            for _ in range(ZERO_TIME_LIMIT):
                task = self.running
                if task.remaining or self.now != now:
                    break
                if task.pending is not None:
                    (service, arguments), task.pending = task.pending, None
                    service(self, task, *arguments)
                    continue
                try:
                    request = task.body.send(task.result)
                except StopIteration:
                    self._end(task)
                    continue
                if type(request) is int and request >= 0:
                    task.remaining, task.computed, task.result = request, True, None
                elif type(request) is tuple:
                    service, arguments = request
                    if costs:
                        self._spend(costs.get(service.__name__, 0), SERVICE_COST)
                    service(self, task, *arguments)
                else:
                    raise ValueError(f"task {task.name!r} yielded {request!r}; requests such as os.take(lock) and cycles from 0 are allowed")
            else:
                raise ValueError(
                    f"task {task.name!r} is caught in a loop that takes no time: {ZERO_TIME_LIMIT} requests at cycle {now} "
                    "without computing or blocking"
                )
            now = self.now
            # the next tick at which anything can happen: a slice ends or a delayed task wakes
            if every_tick or time_slicing and len(rings[task.priority]) > 2:
                tick_due = (self.ticks + 1) * tick
            else:
                tick_due = delayed[0][0] * tick if delayed else FOREVER
            due = devices[0][0] if devices and devices[0][0] < tick_due else tick_due
            end = now + task.remaining
            if end < due and end < until:
                task.remaining = 0
                self.now = end
                self.ticks = end // tick  # the ticks passed over meant nothing
            elif due < until:
                if due > now:
                    task.remaining = end - due
                    self.now = due
                self._handle_interrupts(tick_due)
            else:
                task.remaining = end - until
                self.now = until

    def _end(self, task: Task) -> None:
        complete(self, task)
        self.log((self.now, DONE, task.code, -1, 0, 0))
        task.state = DELETED
        self.ready.remove(task)
        self.reschedule()

    # Interrupts

    def _tick_due(self) -> int:
        """Cycle of the next tick at which anything can happen: a slice ends or a delayed task wakes."""
        if self._every_tick or self.time_slicing and len(self.ready.rings[self.running.priority]) > 2:
            return (self.ticks + 1) * self.tick
        return self.delayed[0][0] * self.tick if self.delayed else FOREVER

    def _handle_interrupts(self, tick_due: int) -> None:
        """All interrupts that are due, the tick before the devices, and then at most one switch (rule 5)."""
        while True:
            before = self.now
            if tick_due <= before:
                self._tick(tick_due // self.tick)
            else:
                self.ticks = before // self.tick
            while self.devices and self.devices[0][0] <= self.now:
                self._device()
            if self.now == before:
                break
            tick_due = self._tick_due()  # handling them took time: more may be due by now
            if tick_due > self.now and not (self.devices and self.devices[0][0] <= self.now):
                break
        self.ticks = self.now // self.tick
        if self.switch_wanted:
            self.reschedule()

    def _tick(self, ticks: int) -> None:
        """Wake the tasks that are due in the order of wake time, then of going to sleep; then test the slice (rules 3, 4)."""
        self.ticks = ticks
        if len(self._journal.rows) > JOURNAL_PAGE:
            self._journal.pack()
        if self._every_tick:
            self._spend(self.costs.tick, TICK_COST)
        delayed = self.delayed
        while delayed and delayed[0][0] <= ticks:
            _, alarm, task = heappop(delayed)
            if task.alarm == alarm:
                if task.next_release >= 0:
                    release(self, task, task.next_release)
                if self.make_ready(task):
                    self.switch_wanted = True
        if self.time_slicing and len(self.ready.rings[self.running.priority]) > 2:
            self.switch_wanted = True

    def _device(self) -> None:
        at, _, handler, every = heappop(self.devices)
        self._spend(self.costs.isr_entry, ISR_COST)
        handler(self.isr)
        self._spend(self.costs.isr_exit, ISR_COST)
        if every is not None:
            heappush(self.devices, (at + every, self._next(), handler, every))

    def _spend(self, cycles: int, cause: int) -> None:
        if cycles:
            self.log((self.now, OVERHEAD, self.running.code, -1, cycles, cause))
            self.now += cycles

    # States; the services are built from these

    def reschedule(self) -> None:
        """Run the next task of the highest priority; if that is the running one again, nothing has happened."""
        self.switch_wanted = False
        task, before = self.ready.select(), self.running
        if task is not before:
            if self._switch_cost:
                self._spend(self._switch_cost, SWITCH_COST)
            self.log((self.now, SWITCH, task.code, before.code, task.priority, before.state))
            self.running = task

    def make_ready(self, task: Task) -> bool:
        """End whatever the task waits for. True if it is strictly above the running one, which then has to go (rules 4, 7)."""
        if task.state == READY:  # notified after its time-out, before it ran
            self.ready.remove(task)
        task.alarm = 0
        if task.waits_in is not None:
            self._leave(task)
        task.state = READY
        self.ready.insert(task)
        self.log((self.now, READIED, task.code, -1, task.priority, 0))
        return task.priority > self.running.priority

    def wake(self, waiters: list[Task]) -> bool:
        """Make the first waiter ready; it has to try again itself (rule 9). True if it is above the running task."""
        task = waiters.pop(0)
        task.waits_for = task.waits_in = None
        return self.make_ready(task)

    def block(self, task: Task, until: int, pending: Any, target: Any, waiters: list[Task]) -> None:
        """Take the CPU from the running task until it is woken as a waiter of `target`, or until tick `until`."""
        task.waits_for, task.waits_in = target, waiters
        enqueue(waiters, task)
        target.protocol.waits(self, task, target)
        self.sleep(task, until, pending)

    def sleep(self, task: Task, until: int, pending: Any = None) -> None:
        """Take the CPU from the running task until tick `until`; then it first tries again what is pending."""
        task.pending = pending
        task.state = BLOCKED
        self.ready.remove(task)
        if until < FOREVER:
            self._sequence = task.alarm = self._sequence + 1
            heappush(self.delayed, (until, task.alarm, task))
        self.reschedule()

    def suspend(self, task: Task) -> None:
        """Rules 23 and 24. The service it waited in is tried again after the resume."""
        if task.state == DELETED:
            raise ValueError(f"task {task.name!r} is suspended after it has ended; only a task that exists can be suspended")
        if task.state == READY:
            self.ready.remove(task)
        task.alarm = 0
        if task.waits_in is not None:
            self._leave(task)
        task.awaits_notification = False
        task.state = SUSPENDED

    def _leave(self, task: Task) -> None:
        """Stop waiting for an object without having been woken by it."""
        task.waits_in.remove(task)
        target, task.waits_for, task.waits_in = task.waits_for, None, None
        target.protocol.left(self, task, target)

    def change_priority(self, task: Task, priority: int) -> None:
        """A ready task changes lists, or its place in its list (rule 21); of any other only the number changes (rule 14)."""
        if task.state != READY:
            task.priority = priority
            return
        self.ready.remove(task)
        task.priority = priority
        self.ready.insert(task)
        self.log((self.now, READIED, task.code, -1, priority, 0))

    def is_outranked(self) -> bool:
        """Under a textbook protocol: whether a ready task is above the running one, however that came about."""
        return self.textbook and self.ready.highest() > self.running.priority
