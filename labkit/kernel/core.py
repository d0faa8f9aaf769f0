"""The engine: time, interrupts, and the states of tasks. Services, protocols and interrupt handlers act on it.

Rule numbers are those of tests/oracle/freertos/README.md.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, Any

from labkit.kernel.costs import Costs
from labkit.kernel.journal import PAGE, Journal
from labkit.kernel.objects import BLOCKED, DELETED, FOREVER, READY, SUSPENDED, Mutex, Queue, ReadyLists, Semaphore, Task, enqueue
from labkit.kernel.services import PRICED, Service, end_task, release
from labkit.trace import CODE, OVERHEADS

if TYPE_CHECKING:
    from labkit.kernel.interrupts import Interrupt

Handler = Callable[["Interrupt"], Any]

SWITCH, READIED, OVERHEAD = CODE["switch"], CODE["ready"], CODE["overhead"]
TICK_COST, SWITCH_COST, SERVICE_COST, ISR_COST = range(len(OVERHEADS))

#: Requests and interrupts in a row, without time passing, after which a program is taken to be caught in a loop.
ZERO_TIME_LIMIT = 100_000

END = (end_task, ())  # what a body asks for by returning


class Core:
    """The processor and what the kernel knows.

    Attributes:
        now: CPU cycles since the start. `tick`: cycles per tick. `ticks`: tick interrupts handled.
        until: where the simulation is to stop. What takes time is not cut there, so `now` may get past it.
        running: the task that has the CPU; it stays among the ready ones. Known from the start on, like `isr`.
        ready: the ready lists.
        delayed: heap of (wake tick, alarm, task); an entry counts only as long as it is the task's alarm.
        devices: heap of (cycle, order, handler, period or None), the interrupts to come.
        handling: the interrupt handler that is being called.
        switch_wanted: an interrupt has readied a task above the running one.
        textbook: mutexes follow the textbook's protocols.
        prices: cycles of the services that cost something.
        log: takes rows (time, kind, task, other, value, extra) of the trace, one or several in a row.
    """

    __slots__ = (
        "_room",
        "_sequence",
        "codes",
        "costs",
        "delayed",
        "devices",
        "every_tick",
        "handling",
        "isr",
        "journal",
        "log",
        "now",
        "prices",
        "ready",
        "running",
        "switch_cost",
        "switch_wanted",
        "textbook",
        "tick",
        "ticks",
        "time_slicing",
        "until",
    )
    running: Task
    isr: Interrupt

    def __init__(self, tick: int, priorities: int, costs: Costs, time_slicing: bool, most_events: int):
        self.now, self.tick, self.ticks, self.until = 0, tick, 0, 0
        self.ready = ReadyLists(priorities)
        self.delayed: list[tuple[int, int, Task]] = []
        self.devices: list[tuple[int, int, Handler, int | None]] = []
        self.handling: Handler | None = None
        self.switch_wanted = self.textbook = False
        self.time_slicing = time_slicing
        self.every_tick = costs.tick > 0  # else only those at which something can happen
        self.costs, self.switch_cost = costs, costs.switch
        self.prices: dict[Service, int] = {PRICED[name]: cycles for name, cycles in costs.by_service.items() if cycles}
        self.journal = Journal(most_events)
        self.log = self.journal.log
        self.codes: dict[str, int] = {}
        self._sequence = 0
        self._room = 64  # entries in `delayed` after which the dead ones are thrown out

    def code_of(self, name: str) -> int:
        """The code of a name in the trace; a new one if there is none yet."""
        return self.codes.setdefault(name, len(self.codes))

    def start(self, first: Task, isr: Interrupt) -> None:
        """Give the CPU to the first task, without moving the index of its ready list (rule 2)."""
        self.running, self.isr = first, isr
        self.log((0, SWITCH, first.code, -1, first.priority, -1))

    def simulate(self, until: int) -> None:
        """All that happens before cycle `until`; what is due at it is left for the next call.

        Again and again: what takes no time, request by request; then time passes, to the end of a computation or the next
        interrupt. However a simulation is cut into calls, the same things happen: each step depends on the state alone.
        """
        tick, time_slicing, rings, prices = self.tick, self.time_slicing, self.ready.rings, self.prices
        rows, delayed, devices = self.journal.rows, self.delayed, self.devices
        self.until = until
        if self.now < until:
            self._handle_interrupts(self._tick_due())  # those at the very end of the call before
        instant, steps = -1, 0
        while (now := self.now) < until:
            while not (task := self.running).remaining:
                if task.pending is not None:
                    (service, arguments), task.pending = task.pending, None
                    service(self, task, *arguments)
                else:
                    try:
                        request = task.send(task.result)
                    except StopIteration:
                        request = END
                    if type(request) is int and request >= 0:
                        task.remaining, task.computed, task.result = request, now, None
                    elif type(request) is tuple:
                        service, arguments = request
                        if prices:
                            self.spend(prices.get(service, 0), SERVICE_COST)
                        service(self, task, *arguments)
                    else:
                        raise ValueError(f"task {task.name!r} yielded {request!r}; requests and cycles from 0 on are allowed")
                if self.now != now:
                    now, task = self.now, self.running
                    break
                steps += 1
                if steps > ZERO_TIME_LIMIT:
                    if now == instant:
                        raise ValueError(
                            f"task {task.name!r} is caught in a loop that takes no time: {ZERO_TIME_LIMIT} requests at cycle "
                            f"{now} without computing or blocking"
                        )
                    instant, steps = now, 0  # looked at again after as many
            if len(rows) > PAGE:
                self.journal.pack()
            if now >= until:
                break
            end = now + task.remaining
            if self.every_tick or (time_slicing and len(rings[task.priority]) > 2):  # as in _tick_due
                due = tick_due = (self.ticks + 1) * tick
            else:
                due = tick_due = delayed[0][0] * tick if delayed else FOREVER
            if devices and devices[0][0] < due:
                due = devices[0][0]
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

    def peek(self) -> int:
        """Cycle of the next thing that happens, if nothing is added from outside; FOREVER if nothing ever does."""
        delayed = self.delayed
        while delayed and delayed[0][2].alarm != delayed[0][1]:
            heappop(delayed)
        if self.switch_wanted:
            return self.now
        due = min(self._tick_due(), self.devices[0][0] if self.devices else FOREVER)
        return min(max(due, self.now), self.now + self.running.remaining, FOREVER)

    # Interrupts

    def _tick_due(self) -> int:
        """Cycle of the next tick at which anything can happen: a slice ends or a delayed task wakes."""
        if self.every_tick or (self.time_slicing and len(self.ready.rings[self.running.priority]) > 2):
            return (self.ticks + 1) * self.tick
        return self.delayed[0][0] * self.tick if self.delayed else FOREVER

    def _handle_interrupts(self, tick_due: int) -> None:
        """All interrupts that are due, a tick before the devices, and then at most one switch (rule 5).

        What becomes due meanwhile is among them, and what becomes due during the switch follows it. If the time to stop comes
        first, the next call goes on.
        """
        at, count = self.now, 0
        while True:
            if tick_due <= self.now:
                self._tick(tick_due // self.tick)
            else:
                self.ticks = self.now // self.tick  # the ticks passed over meant nothing
                if self.devices and self.devices[0][0] <= self.now:
                    self._handle_device()
                elif self.switch_wanted:
                    before = self.now
                    self.reschedule()
                    if self.now == before:
                        return
                else:
                    return
            if self.now >= self.until:
                return
            if self.now != at:
                at, count = self.now, 0
            count += 1
            if count == ZERO_TIME_LIMIT:
                raise ValueError(f"{count} device interrupts in a row up to cycle {at}; no task gets to run between them")
            tick_due = self._tick_due()

    def _tick(self, ticks: int) -> None:
        """Wake the tasks that are due in the order of wake time, then of going to sleep; then test the slice (rules 3, 4)."""
        self.ticks = ticks
        if self.every_tick:
            self.spend(self.costs.tick, TICK_COST)
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

    def _handle_device(self) -> None:
        at, _, handler, every = heappop(self.devices)
        self.handling = handler
        self.spend(self.costs.isr_entry, ISR_COST)
        handler(self.isr)
        self.spend(self.costs.isr_exit, ISR_COST)
        self.handling = None
        if every is not None:
            self.add_device(at + every, handler, every)

    def add_device(self, at: int, handler: Handler, every: int | None) -> None:
        """A device interrupt to come; those of one instant keep the order in which they were added."""
        self._sequence += 1
        heappush(self.devices, (at, self._sequence, handler, every))

    def spend(self, cycles: int, cause: int) -> None:
        """Time that the kernel takes for itself; `cause` is an index into OVERHEADS."""
        if cycles:
            self.log((self.now, OVERHEAD, self.running.code, -1, cycles, cause))
            self.now += cycles

    # States; the services are built from these

    def reschedule(self) -> None:
        """Run the next task of the highest priority; if that is the running one again, nothing has happened."""
        self.switch_wanted = False
        task, before = self.ready.select(), self.running
        if task is not before:
            if self.switch_cost:
                self.spend(self.switch_cost, SWITCH_COST)
            self.log((self.now, SWITCH, task.code, before.code, task.priority, before.state))
            self.running = task

    def make_ready(self, task: Task) -> bool:
        """End whatever the task waits for. True if it is strictly above the running one, which then has to go (rules 4, 7)."""
        if task.state == READY:  # notified after its time-out, before it ran
            self.ready.remove(task)
        task.alarm = 0
        if task.waits_in is not None:
            self._leave(task, task.waits_in)
        task.state = READY
        self.ready.insert(task)
        priority = task.priority
        self.log((self.now, READIED, task.code, -1, priority, 0))
        return priority > self.running.priority

    def wake(self, waiters: list[Task]) -> bool:
        """Make the first waiter ready; it has to try again itself (rule 9). True if it is above the running task."""
        task = waiters.pop(0)
        task.waits_for = task.waits_in = None
        return self.make_ready(task)

    def block(self, task: Task, until: int, pending: Any, target: Semaphore | Mutex | Queue, waiters: list[Task]) -> None:
        """Take the CPU from the running task until it is woken as a waiter of `target`, or until tick `until`."""
        task.waits_for, task.waits_in = target, waiters
        enqueue(waiters, task)
        if isinstance(target, Mutex):
            target.protocol.waits(self, task, target)
        self.sleep(task, until, pending)

    def sleep(self, task: Task, until: int, pending: Any = None) -> None:
        """Take the CPU from the running task until tick `until`; then it first tries again what is pending."""
        task.pending = pending
        task.state = BLOCKED
        self.ready.remove(task)
        if until < FOREVER:
            self._sequence = task.alarm = alarm = self._sequence + 1
            delayed = self.delayed
            heappush(delayed, (until, alarm, task))
            if len(delayed) > self._room:
                self._forget_old_alarms()
        if self.switch_cost:
            self.reschedule()
        else:  # the same in short, since every job comes by here
            self.switch_wanted = False
            self.running = chosen = self.ready.select()
            self.log((self.now, SWITCH, chosen.code, task.code, chosen.priority, BLOCKED))

    def _forget_old_alarms(self) -> None:
        """Of tasks that were woken before their time-out; without this they would stay until then, however many."""
        self.delayed[:] = [entry for entry in self.delayed if entry[2].alarm == entry[1]]
        heapify(self.delayed)
        self._room = 64 + 2 * len(self.delayed)

    def suspend(self, task: Task) -> None:
        """Rules 23 and 24. The service it waited in is tried again after the resume."""
        if task.state == DELETED:
            raise ValueError(f"task {task.name!r} is suspended after it has ended; only a task that exists can be suspended")
        if task.state == READY:
            self.ready.remove(task)
        task.alarm = 0
        if task.waits_in is not None:
            self._leave(task, task.waits_in)
        task.awaits_notification = False
        task.state = SUSPENDED

    def _leave(self, task: Task, waiters: list[Task]) -> None:
        """Stop waiting for an object without having been woken by it."""
        waiters.remove(task)
        target, task.waits_for, task.waits_in = task.waits_for, None, None
        if isinstance(target, Mutex):
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
