"""The FreeRTOS kernel on one core, cycle by cycle: fixed priorities, a tick, time slices, and the services tasks ask it for.

The semantics are the real kernel's, recorded in tests/oracle/freertos and freertos2, whose READMEs number the rules cited here.

    k = Kernel(cpu_hz=216_000_000)
    lock = k.mutex("lock")

    def low(os):
        yield os.take(lock)
        yield os.compute(6 * os.ms)
        yield os.give(lock)

    k.task("low", low, priority=1)
    run = k.run(until=20 * k.ms)

A plant, a radio or a DMA that lives outside goes along step by step: it stops the kernel where it likes, looks, and adds
interrupts. However a simulation is cut into steps, the trace is the same; a step costs what happens in it.

    while k.now < end:
        k.advance(min(k.peek(), plant.next_event(), end))
        if k.now == plant.next_event():
            k.interrupt(k.now, plant.sample())

Left out: interrupts inside a service or a tick (they wait until it is over), tick overflow, several cores, tickless idle,
co-routines, hooks, deletion of timers and objects, batching buffers, several readers or writers of one buffer, and every call
that the list in `labkit.kernel` does not have. Blocking while the scheduler is suspended or inside a critical section is an error
here; the real kernel forbids it and goes astray. Caches and bus contention are not modelled: a cycle of `compute` is a cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Any

from labkit.kernel.checks import whole
from labkit.kernel.core import Core
from labkit.kernel.costs import Costs
from labkit.kernel.devices import LOWEST, Device
from labkit.kernel.heap import POINTER, Heap
from labkit.kernel.interrupts import Interrupt
from labkit.kernel.objects import DELETED, Buffer, EventGroup, Mutex, Queue, QueueSet, Semaphore, Task, Timer
from labkit.kernel.protocols import PROTOCOLS
from labkit.kernel.requests import MOST_TICKS, Services
from labkit.kernel.run import Run, TaskInfo, Wait, find_deadlock
from labkit.kernel.services.idle import idle_body
from labkit.kernel.services.jobs import release
from labkit.kernel.services.memory import no_room, reserve, reserve_for_task
from labkit.kernel.services.timers import Daemon, daemon_body, started_early
from labkit.trace import Trace

IDLE, TIMER, ISR = "IDLE", "TIMER", "ISR"

#: With this, the cycle of the last tick that FreeRTOS can count fits a trace.
MOST_CYCLES_PER_TICK = 1 << 30

FREE = Costs()
Body = Callable[[Services], Generator[Any, Any, None]]


class Kernel:
    """One core under FreeRTOS. Create objects and tasks, then `run`, or `advance` step by step.

    Args:
        cpu_hz: CPU cycles per second. All times are counted in them unless a name says ticks.
        tick_hz: tick interrupts per second; divides `cpu_hz`.
        priorities: tasks have priorities 0 to priorities - 1, the highest being most urgent; 0 they share with the idle task.
        costs: what the kernel itself takes.
        time_slicing: whether tasks of equal priority take turns at every tick.
        idle_should_yield: whether the idle task goes at once when another task of priority 0 is ready (rule 57).
        pending_ticks: what a critical section keeps of the ticks in it: "one", as the single pending flag of a Cortex-M does,
            the others being lost, or "all" (rule 28).
        timer_priority, timer_queue: priority of the timer task, None for a kernel without timers, and how many commands its
            queue has room for.
        heap: what tasks and objects are made from; None: memory is not counted.
        max_syscall_priority: interrupts of a priority below this number preempt critical sections and may not call the kernel.
        most_events: a run that makes more ends with a ValueError; a million take 48 MB.

    Attributes:
        tick: CPU cycles per tick.
        tasks: handles of the tasks in order of creation; the idle task joins them at the first run.
        named: the latest task of each name.
        os: what task bodies get as their argument.
    """

    def __init__(
        self,
        cpu_hz: int = 216_000_000,
        tick_hz: int = 1000,
        priorities: int = 8,
        costs: Costs = FREE,
        time_slicing: bool = True,
        most_events: int = 50_000_000,
        *,
        idle_should_yield: bool = True,
        pending_ticks: str = "one",
        timer_priority: int | None = None,
        timer_queue: int = 10,
        max_syscall_priority: int = 5,
        heap: Heap | None = None,
    ):
        cpu_hz, tick_hz = whole(cpu_hz, 1, "a CPU at", " Hz"), whole(tick_hz, 1, "ticks at", " Hz")
        if cpu_hz % tick_hz:
            raise ValueError(f"a tick at {tick_hz} Hz is no whole number of cycles at {cpu_hz} Hz; tick_hz must divide cpu_hz")
        self.tick = whole(cpu_hz // tick_hz, 1, "a tick of", " cycles", MOST_CYCLES_PER_TICK)
        priorities = whole(priorities, 2, "priorities:", most=64)
        if costs.tick + costs.switch + costs.isr_entry + costs.isr_exit >= self.tick:
            raise ValueError(f"tick, switch and interrupt cost the {self.tick} cycles of a tick and more; no task would run")
        if pending_ticks not in ("one", "all"):
            raise ValueError(f"pending_ticks are {pending_ticks!r}; 'one' or 'all' is allowed")
        self.cpu_hz, self.priorities = cpu_hz, priorities
        self.tasks: list[Task] = []
        self.named: dict[str, Task] = {}
        self._mutexes: list[Mutex] = []
        self._early: list[Timer] = []
        self._idle_should_yield = idle_should_yield
        most_events = whole(most_events, 1, "most_events")
        mask = whole(max_syscall_priority, 0, "max_syscall_priority", most=LOWEST)
        self._core = Core(
            *(self.tick, priorities, costs, most_events), time_slicing=time_slicing, one_pending=pending_ticks == "one", mask=mask
        )
        self._core.heap = heap
        self._core.idle = Task(IDLE, -1, 0, 0, None, None)
        self._timer_priority = timer_priority
        if timer_priority is not None:
            self._checked_priority(timer_priority, "the timer task")
            timer_queue = whole(timer_queue, 1, "the timer task's queue has room for", " commands")
            self._core.daemon = Daemon(Queue("timer commands", -1, timer_queue))
            reserve(self._core, "the timer task's queue", "queue", timer_queue * heap.sizes.command if heap else 0)
        self._started = self._busy = False
        self._end = 0  # up to where it has been simulated
        self.os = Services(self, self._core)

    @property
    def now(self) -> int:
        """CPU cycles since the start: inside bodies and handlers those of the processor, outside where the simulation stopped."""
        return self._core.now if self._busy else self._end

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

    def mutex(self, name: str, protocol: str = "freertos", ceiling: int | None = None, users: Iterable[str] = ()) -> Mutex:
        """A mutex. For protocol "ceiling" give the ceiling, or the names of the tasks that use it.

        With time slicing, tasks of exactly the ceiling's priority take turns with the holder. The textbook's promises, no
        deadlock among them, hold without: `Kernel(time_slicing=False)`.
        """
        return self._mutex(name, protocol, False, ceiling, users)

    def recursive_mutex(
        self, name: str, protocol: str = "freertos", ceiling: int | None = None, users: Iterable[str] = ()
    ) -> Mutex:
        """A mutex that its holder can take again; only the outermost take and give count (rule 19)."""
        return self._mutex(name, protocol, True, ceiling, users)

    def _mutex(self, name: str, protocol: str, recursive: bool, ceiling: int | None, users: Iterable[str]) -> Mutex:
        users = tuple(users)
        if protocol not in PROTOCOLS:
            raise ValueError(f"mutex {name!r} has protocol {protocol!r}; there are {', '.join(PROTOCOLS)}")
        if (protocol == "ceiling") != (ceiling is not None or bool(users)):
            raise ValueError(f"mutex {name!r} of protocol {protocol!r}; 'ceiling', and no other, needs a ceiling or its users")
        families = {lock.protocol.family for lock in self._mutexes} | {PROTOCOLS[protocol].family}
        if {"freertos", "textbook"} <= families:
            raise ValueError(f"mutex {name!r} of protocol {protocol!r}; FreeRTOS's and the textbook's inheritance do not mix")
        top = 0 if ceiling is None else self._checked_priority(ceiling, f"the ceiling of {name!r}")
        lock = Mutex(name, self._made(name), PROTOCOLS[protocol], recursive, top, users)
        self._mutexes.append(lock)
        self._core.textbook = "textbook" in families
        return lock

    def binary(self, name: str, init: int = 0) -> Semaphore:
        """A binary semaphore, empty unless `init` is 1."""
        return self.counting(name, 1, init)

    def counting(self, name: str, length: int, init: int = 0) -> Semaphore:
        """A counting semaphore with at most `length` counts, `init` of them at the start."""
        length = whole(length, 1, f"semaphore {name!r} has room for", " counts")
        init = whole(init, 0, f"semaphore {name!r} starts with", f" of {length}", length)
        return Semaphore(name, self._made(name), init, length)

    def queue(self, name: str, length: int, item: int = 4) -> Queue:
        """An empty queue with room for `length` items, each of `item` bytes in the heap."""
        length = whole(length, 1, f"queue {name!r} has room for", " items")
        item = whole(item, 0, f"queue {name!r} has items of", " bytes")
        return Queue(name, self._made(name, more=length * item), length)

    def queue_set(self, name: str, members: Iterable[Queue | Semaphore], length: int | None = None) -> QueueSet:
        """Empty queues and semaphores to wait for together, with room for `length` of what is sent to them (None: all)."""
        members = tuple(members)
        for member in members:
            if not isinstance(member, Queue | Semaphore):
                raise ValueError(f"queue set {name!r} has member {member!r}; queues and semaphores are allowed")
            if member.count if isinstance(member, Semaphore) else member.items:
                raise ValueError(f"queue set {name!r} has member {member.name!r}, which is not empty")
            if member.container is not None:
                raise ValueError(f"queue set {name!r} has member {member.name!r}, which is in {member.container.name!r}")
        length = sum(member.length for member in members) if length is None else length
        length = whole(length, 1, f"queue set {name!r} has room for", " entries")
        group = QueueSet(name, self._made(name, more=length * POINTER), length)
        for member in members:
            member.container = group
        return group

    def event_group(self, name: str) -> EventGroup:
        """24 bits, all 0."""
        return EventGroup(name, self._made(name, "event_group"))

    def stream_buffer(self, name: str, length: int, trigger: int = 1) -> Buffer:
        """An empty buffer of `length` bytes; a reader that waits is woken when there are `trigger` of them."""
        length = whole(length, 1, f"stream buffer {name!r} has room for", " bytes")
        trigger = whole(trigger, 1, f"stream buffer {name!r} has a trigger level of", " bytes", length)
        return Buffer(name, self._made(name, "buffer", length + 1), length, trigger, 0)

    def message_buffer(self, name: str, length: int, header: int = 4) -> Buffer:
        """An empty buffer of `length` bytes, of which each message takes `header` beside its own."""
        header = whole(header, 1, f"message buffer {name!r} takes for a message", " bytes more")
        length = whole(length, header + 1, f"message buffer {name!r} has room for", " bytes")
        return Buffer(name, self._made(name, "buffer", length + 1), length, 1, header)

    def timer(
        self, name: str, period: int, callback: Callable[[Services], Any], auto_reload: bool = False, started: bool = False
    ) -> Timer:
        """A timer that runs `callback(os)` in the timer task `period` ticks after its start, and then again if `auto_reload`.

        The callback is a plain function, or a generator of requests that do not wait. `started`: before the scheduler runs.
        """
        if self._timer_priority is None:
            raise ValueError(f"timer {name!r}, but there is no timer task; give the kernel a timer_priority")
        period = whole(period, 1, f"timer {name!r} has a period of", " ticks", MOST_TICKS)
        timer = Timer(name, self._made(name, "timer"), period, callback, auto_reload)
        if started:
            self._early.append(timer)
        return timer

    def task(
        self,
        name: str,
        body: Body,
        priority: int,
        deadline: int | None = None,
        stack_free: int | None = None,
        released: bool = False,
        stack: int | None = None,
    ) -> Task:
        """A task, ready at time 0. `body(os)` is a generator of requests; when it returns, the task ends.

        `deadline`, in cycles after each release, is noted in the trace at every release. `stack_free`, in words, is what of its
        `stack` it never uses, the stack's high-water mark in the task list; a heap has room for that stack (None: as much as the
        idle task has). A body that begins with its work is known to have jobs only at its first delay_until; say `released` to
        have its first job, released at 0, and the deadline of that in the trace even if it never ends or never begins.
        """
        if self._started:
            raise ValueError(f"task {name!r} is created after the start; from then on tasks create others, by os.create")
        task = self._create(name, body, priority, deadline, stack_free, released, stack)
        if task is None:
            raise no_room(self._core, f"task {name!r}")
        return task

    def _create(
        self,
        name: str,
        body: Body,
        priority: int,
        deadline: int | None = None,
        stack_free: int | None = None,
        released: bool = False,
        stack: int | None = None,
        by: int = -1,
    ) -> Task | None:
        """The task, or None if the heap has no room for it."""
        if deadline is not None:
            deadline = whole(deadline, 1, f"task {name!r} has a deadline of", " cycles after its release")
        self._checked_priority(priority, f"task {name!r}")
        before = self.named.get(name)
        code = before.code if before is not None and before.state == DELETED else self._new(name)
        generator = body(self.os)
        if not isinstance(generator, Generator):
            raise ValueError(f"the body of task {name!r} is no generator function; it must yield its requests")
        task = Task(name, code, len(self.tasks) + 1, priority, deadline, stack_free)
        if not reserve_for_task(self._core, task, stack, by):
            return None
        if before:
            task.job = before.job  # the jobs of one name are counted on
        task.send = generator.send
        self._admit(task, by)
        if released:
            release(self._core, task, self.now)
        return task

    def _made(self, name: str, record: str = "queue", more: int = 0) -> int:
        """The code of a new object, for which the heap has room: its record, and so many bytes more."""
        code = self._new(name)
        reserve(self._core, f"object {name!r}", record, more, code)
        return code

    def _admit(self, task: Task, by: int = -1) -> None:
        self.tasks.append(task)
        self.named[task.name] = task
        self._core.admit(task, by)

    def interrupt(
        self, at: int, handler: Callable[[Interrupt], Any], every: int | None = None, priority: int = LOWEST, cycles: int = 0
    ) -> None:
        """A device interrupt at cycle `at`, repeated `every` so many cycles. `handler` is called with an `Interrupt`, after it
        has computed for so many `cycles`.

        `priority` is counted as on a Cortex-M: 0 is the most urgent, 15 that of the tick. An interrupt preempts handlers of a
        higher number, tasks, and, below `max_syscall_priority`, critical sections, too; from there it may not call the kernel.
        Interrupts of one instant come by priority, then in the order in which they were asked for, those of the lowest priority
        after the tick, all before the one switch. Task bodies and handlers may ask for more, such as the end of a transfer they
        start. An exception in a handler ends the run.
        """
        at = whole(at, self.now, "an interrupt at cycle")
        every = every if every is None else whole(every, 1, f"an interrupt at cycle {at}, every", " cycles")
        priority = whole(priority, 0, f"an interrupt at cycle {at}, priority", most=LOWEST)
        cycles = whole(cycles, 0, f"an interrupt at cycle {at} computes for", " cycles")
        self._core.devices.add(at, Device(handler, every, priority, cycles))

    def _checked_priority(self, priority: int, whose: str) -> int:
        return whole(priority, 0, f"{whose}: priority", most=self.priorities - 1)

    def _new(self, name: str) -> int:
        if not isinstance(name, str) or not name or name in self._core.codes or name in (IDLE, TIMER, ISR):
            raise ValueError(
                f"the name {name!r} is taken or no name; each object needs its own, {IDLE}, {TIMER} and {ISR} are the kernel's"
            )
        return self._core.code_of(name)

    def run(self, until: int) -> Run:
        """Simulate up to cycle `until` (nothing at or after it is recorded); a later call goes on from there.

        Errors: as from `advance`.
        """
        self.advance(whole(until, 1, "run until cycle"))
        latest = self.named.values()
        infos = (TaskInfo(task.name, task.number, task.created, task.deadline, task.stack_free) for task in latest)
        return Run(self.trace, tuple(infos), self.tick, self.deadlock)

    def advance(self, until: int) -> None:
        """Simulate up to cycle `until`, without it: what is due there, happens in the next call, after any interrupt added now.

        Errors: ValueError for a program that breaks a rule of the kernel or makes requests for ever without using time; it and
        exceptions from bodies and handlers carry a note saying where and when. After them the kernel cannot go on.
        """
        core = self._core
        if self._busy:
            raise ValueError(f"the kernel cannot go on from cycle {core.now}: it is inside a task or handler, or one has failed")
        until = whole(until, self._end, "advance until cycle")
        if not self._started:
            self._start()
        self._busy = True
        try:
            core.simulate(until)
        except Exception as error:
            where = f"in task {core.running.name!r}"
            if core.handling is not None:
                name = getattr(core.handling.handler, "__qualname__", core.handling.handler)
                where = f"in interrupt handler {name}, which interrupted task {core.running.name!r},"
            error.add_note(f"{where} at cycle {core.now}")
            raise
        self._end, self._busy = until, False

    def peek(self) -> int:
        """The cycle at which the next thing happens unless an interrupt is added, `now` or later; FOREVER if nothing ever does.

        It may be no more than a tick or the end of a computation. What the kernel takes for itself is not cut: with costs, rows
        of a service, a tick or an interrupt that is under way now may still come before it; nothing can change them any more.
        """
        return max(self._core.peek(), self._end) if self._started else 0

    @property
    def trace(self) -> Trace:
        """All that has happened up to `now`. Made when it is read; then only what is new since the last time takes time."""
        return self._core.journal.trace(self._core.codes, self.cpu_hz, self.now)

    @property
    def deadlock(self) -> tuple[Wait, ...]:
        """Who waits for ever at this time, see `Run.deadlock`."""
        daemon = self._core.daemon
        waits = [task for task in self.tasks if task.name != IDLE and (daemon is None or task.waits_for is not daemon.queue)]
        return find_deadlock(waits, bool(self._core.devices or (daemon and daemon.due)))

    def _start(self) -> None:
        base = {task.name: task.base for task in self.tasks}
        for lock in self._mutexes:
            for user in lock.users:
                if user not in base:
                    raise ValueError(f"mutex {lock.name!r} names {user!r} as a user; the tasks are {', '.join(base) or 'none'}")
                lock.ceiling = max(lock.ceiling, base[user])
        core = self._core
        core.idle.code, core.idle.number = core.code_of(IDLE), len(self.tasks) + 1
        core.idle.send = idle_body(core, self._idle_should_yield).send
        self._admit_own(core.idle, "idle_stack")
        if core.daemon is not None and self._timer_priority is not None:
            for timer in self._early:
                started_early(core.daemon, timer)
            core.daemon.task = self._create_daemon(core.daemon, self._timer_priority)
        last_of_highest = max(reversed(self.tasks), key=lambda task: task.priority)  # rule 2
        core.start(last_of_highest, Interrupt(core, core.code_of(ISR)))
        self._started = True

    def _create_daemon(self, daemon: Daemon, priority: int) -> Task:
        task = Task(TIMER, self._core.code_of(TIMER), len(self.tasks) + 1, priority, None, None)
        task.send = daemon_body(self._core, daemon)(self.os).send
        self._admit_own(task, "timer_stack")
        return task

    def _admit_own(self, task: Task, stack: str) -> None:
        """A task of the kernel's own joins the others."""
        heap = self._core.heap
        if heap is not None and not reserve_for_task(self._core, task, getattr(heap.sizes, stack), -1):
            raise no_room(self._core, f"task {task.name!r}")
        self._admit(task)
