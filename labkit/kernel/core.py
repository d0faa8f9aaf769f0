"""The engine: time, interrupts, and the states of tasks. Services, protocols and interrupt handlers act on it.

Rule numbers are those of tests/oracle/freertos (1 to 27) and freertos2 (from 28).
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, Any

from labkit.kernel.costs import Costs
from labkit.kernel.devices import TASKS, Device, Devices
from labkit.kernel.heap import Heap
from labkit.kernel.journal import PAGE, Journal
from labkit.kernel.objects import BLOCKED, FOREVER, READY, Mutex, ReadyLists, Target, Task, enqueue
from labkit.kernel.services import PRICED, Service
from labkit.kernel.services.jobs import release
from labkit.kernel.services.tasks import end_task
from labkit.kernel.services.timers import Daemon
from labkit.trace import CODE, OVERHEADS

if TYPE_CHECKING:
    from labkit.kernel.interrupts import Interrupt

SWITCH, READIED, OVERHEAD = CODE["switch"], CODE["ready"], CODE["overhead"]
CREATE, TICK_LOST = CODE["create"], CODE["tick_lost"]
TICK_COST, SWITCH_COST, SERVICE_COST, ISR_COST = range(len(OVERHEADS))

#: Requests and interrupts in a row, without time passing, after which a program is taken to be caught in a loop.
ZERO_TIME_LIMIT = 100_000

END = (end_task, ())  # what a body asks for by returning


class Core:
    """The processor and what the kernel knows.

    Attributes:
        now: CPU cycles since the start. `tick`: cycles per tick. `ticks`: the tick count.
        origin: the cycle at which a tick count that has lost no tick since would have been 0.
        until: where the simulation is to stop. What takes time is not cut there, so `now` may get past it.
        running: the task that has the CPU; it stays among the ready ones. Known from the start on, like `isr`.
        ready: the ready lists.
        delayed: heap of (wake tick, alarm, task); an entry counts only as long as it is the task's alarm.
        devices: the interrupts to come. `mask`: those of a priority below it are never held, and may not call the kernel.
        handling: the device whose handler has the CPU, if one has.
        switch_wanted: an interrupt has readied a task above the running one, or a switch was asked for while it was held.
        critical, suspended: depth of critical sections and of suspensions of the scheduler; held: either of them is above 0.
        postponed: tasks woken while the scheduler is suspended that are not ready before it is resumed (rule 32).
        idle, daemon: the idle task; what the timer task works with, if there is one.
        heap: the memory, if it is counted; ended: tasks that have ended and whose memory the idle task is to give back.
        textbook: mutexes follow the textbook's protocols.
        prices: cycles of the services that cost something.
        log: takes rows (time, kind, task, other, value, extra) of the trace, one or several in a row.
    """

    # Without slots, Python looks up an attribute of an object with this many of them in a dictionary.
    # fmt: off
    __slots__ = (
        "_room", "_sequence", "beat", "codes", "costs", "critical", "daemon", "delayed", "devices", "ended", "entered",
        "every_tick", "flagged", "handling", "heap", "held", "idle", "isr", "journal", "log", "mask", "now", "one_pending",
        "origin", "postponed", "prices", "ready", "running", "suspended", "switch_cost", "switch_wanted", "textbook", "tick",
        "ticks", "time_slicing", "until",
    )
    # fmt: on
    running: Task
    idle: Task
    isr: Interrupt

    def __init__(
        self, tick: int, priorities: int, costs: Costs, most_events: int, *, time_slicing: bool, one_pending: bool, mask: int
    ):
        self.now, self.tick, self.ticks, self.until, self.origin = 0, tick, 0, 0, 0
        self.critical = self.suspended = 0
        self.held, self.one_pending = False, one_pending
        self.beat, self.flagged, self.entered = 0, False, 0
        self.postponed: list[Task] = []
        self.daemon: Daemon | None = None
        self.heap: Heap | None = None
        self.ended: list[Task] = []
        self.ready = ReadyLists(priorities)
        self.delayed: list[tuple[int, int, Task]] = []
        self.devices, self.mask = Devices(), mask
        self.handling: Device | None = None
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
        rows, delayed, devices, urgent = self.journal.rows, self.delayed, self.devices.lowest, self.devices.urgent
        free = not (self.every_tick or self.switch_cost)  # neither ticks nor switches take time
        self.until = until
        if self.now < until:
            self.handle_interrupts(self.tick_due())  # those at the very end of the call before
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
                    if type(request) is tuple:
                        service, arguments = request
                        if prices:
                            self.spend(prices.get(service, 0), SERVICE_COST)
                        service(self, task, *arguments)
                    elif type(request) is int and request >= 0:
                        task.computed, task.result = now, None
                        if request:
                            task.remaining = request
                            break
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
            if held := self.held:
                due = tick_due = self._held_tick_due()
            elif self.every_tick or (time_slicing and len(rings[task.priority]) > 2):  # as in tick_due
                due = tick_due = (self.ticks + 1) * tick + self.origin
            else:
                due = tick_due = delayed[0][0] * tick + self.origin if delayed else FOREVER
            if devices and devices[0][0] < due and not self.critical:
                due = devices[0][0]
            if urgent:
                due = min(due, self.devices.next_urgent(self._preempted()))
            if end < due and end < until:
                task.remaining = 0
                self.now = end
                if not held:
                    self.ticks = (end - self.origin) // tick  # the ticks passed over meant nothing
            elif due < until:
                if due > now:
                    task.remaining = end - due
                    self.now = due
                if free and not (urgent or held or (devices and devices[0][0] <= due)):  # the same in short: just a tick is due
                    self.count_tick((due - self.origin) // tick)
                    if self.switch_wanted:
                        self.reschedule()
                else:
                    self.handle_interrupts(tick_due)
            else:
                task.remaining = end - until
                self.now = until

    def peek(self) -> int:
        """Cycle of the next thing that happens, if nothing is added from outside; FOREVER if nothing ever does."""
        delayed = self.delayed
        while delayed and delayed[0][2].alarm != delayed[0][1]:
            heappop(delayed)
        if self.switch_wanted and not self.held:
            return self.now
        lowest = self.devices.lowest
        due = min(self.tick_due(), self.devices.next_urgent(self._preempted()))
        if lowest and not self.critical:
            due = min(due, lowest[0][0])
        return min(max(due, self.now), self.now + self.running.remaining, FOREVER)

    # Interrupts

    def tick_due(self) -> int:
        """Cycle of the next tick at which anything can happen: a slice ends or a delayed task wakes."""
        if self.held:
            return self._held_tick_due()
        if self.every_tick or (self.time_slicing and len(self.ready.rings[self.running.priority]) > 2):
            return (self.ticks + 1) * self.tick + self.origin
        return self.delayed[0][0] * self.tick + self.origin if self.delayed else FOREVER

    def handle_interrupts(self, tick_due: int) -> None:
        """All interrupts that are due, a tick before devices of its priority, and then at most one switch (rule 5).

        What becomes due meanwhile is among them, and what becomes due during the switch follows it. If the time to stop comes
        first, the next call goes on.
        """
        at, count = self.now, 0
        devices = self.devices
        urgent = devices.urgent
        if tick_due > at and not self.held:
            self.ticks = (at - self.origin) // self.tick  # the ticks passed over meant nothing
        while True:
            if urgent and (first := devices.take_urgent(self.now, self._preempted())):
                if tick_due == self.now and not self.held:
                    self.ticks = (tick_due - self.origin) // self.tick - 1  # so did those before the one that is due
                self._handle_device(first)
            elif tick_due <= self.now:
                if self.held:
                    self._hold_tick()
                else:
                    if self.every_tick:
                        self.spend(self.costs.tick, TICK_COST)
                    self.count_tick((tick_due - self.origin) // self.tick)
                tick_due += self.tick  # the earliest at which another one can be due
            elif devices.lowest and devices.lowest[0][0] <= self.now and not self.critical:
                self._handle_device(devices.take_lowest())
            elif self.switch_wanted and not self.held:
                before = self.now
                self.reschedule()
                if self.now == before:
                    return
            else:
                return
            if self.now >= self.until:
                return
            if self.now != at or tick_due <= self.now:
                tick_due = self.tick_due()
                if tick_due > self.now and not self.held:
                    self.ticks = (self.now - self.origin) // self.tick
            if self.now != at:
                at, count = self.now, 0
            count += 1
            if count == ZERO_TIME_LIMIT:
                raise ValueError(f"{count} device interrupts in a row up to cycle {at}; no task gets to run between them")

    def count_tick(self, ticks: int) -> None:
        """Wake the tasks that are due in the order of wake time, then of going to sleep; then test the slice (rules 3, 4)."""
        self.ticks = ticks
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

    def _preempted(self) -> int:
        """Interrupts of a priority below this number preempt what runs."""
        if self.handling is not None:
            return self.handling.priority
        return self.mask if self.critical else TASKS

    def _handle_device(self, entry: tuple[int, int, Device]) -> None:
        """An interrupt from its entry to its exit; the handler makes its calls at the end of what it computes."""
        at, _, device = entry
        before, self.handling = self.handling, device
        self.spend(self.costs.isr_entry, ISR_COST)
        left, nested = device.cycles, 0
        while left:
            due = self.devices.next_urgent(device.priority) if self.devices.urgent else FOREVER
            part = min(left, max(due - self.now, 0))
            self.spend(part, ISR_COST)
            left -= part
            if left and (first := self.devices.take_urgent(self.now, device.priority)):
                self._handle_device(first)
                nested += 1
                if nested == ZERO_TIME_LIMIT:
                    raise ValueError(f"{nested} more urgent interrupts in a handler of priority {device.priority}; it never ends")
        device.handler(self.isr)
        self.spend(self.costs.isr_exit, ISR_COST)
        self.handling = before
        if device.every is not None:
            self.devices.add(at + device.every, device)

    def spend(self, cycles: int, cause: int) -> None:
        """Time that the kernel takes for itself; `cause` is an index into OVERHEADS."""
        if cycles:
            self.log((self.now, OVERHEAD, self.running.code, -1, cycles, cause))
            self.now += cycles

    def hold(self) -> None:
        """What a critical section or the suspension of the scheduler begins with."""
        if not self.held:
            self.beat = (self.ticks + 1) * self.tick + self.origin
        elif not self.every_tick:
            self.beat = (self.now // self.tick + 1) * self.tick
        self.held = True

    def _held_tick_due(self) -> int:
        """Ticks that are held matter only if they are lost or cost something."""
        return self.beat if (self.one_pending if self.critical else self.every_tick) else FOREVER

    def _hold_tick(self) -> None:
        """Held by a suspended scheduler, a tick is counted later; in a critical section only one is (rule 28)."""
        self.beat += self.tick
        if not self.critical:
            self.spend(self.costs.tick, TICK_COST)
        elif self.flagged:
            self.origin += self.tick
            self.log((self.now, TICK_LOST, self.isr.code, -1, self.ticks, 0))
        else:
            self.flagged = True

    def must_not_be_held(self, task: Task, what: str) -> None:
        """ValueError if the running task is about to go although nobody else may run."""
        if self.held:
            where = "inside a critical section" if self.critical else "while the scheduler is suspended"
            raise ValueError(f"task {task.name!r} {what} {where}; it must go on to the end of that")

    # States; the services are built from these

    def deadline(self, timeout: int | None) -> int:
        """The tick at which a wait gives up; -1: it does not begin."""
        return FOREVER if timeout is None else self.ticks + timeout if timeout else -1

    def expired(self, task: Task, deadline: int) -> bool:
        """Whether a service that could not be had gives up. Once, if abort_delay has cut short a wait of the task (rule 58)."""
        if deadline < 0:
            return True
        if task.aborted:
            task.aborted = False
            return True
        return self.ticks >= deadline

    def admit(self, task: Task, by: int) -> None:
        """A new task becomes ready."""
        self.log((self.now, CREATE, task.code, by, task.priority, 0))
        self.ready.insert(task)
        if not task.priority:
            self.idle.remaining = 0
        self.log((self.now, READIED, task.code, -1, task.priority, 0))

    def reschedule(self) -> None:
        """Run the next task of the highest priority; if that is the running one again, nothing has happened."""
        if self.held:
            self.switch_wanted = True  # rules 29 and 31
            return
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
            self.leave(task, task.waits_in)
        task.state = READY
        priority, ready = task.priority, self.ready
        ready.rings[priority].insert(-1, task)  # as ReadyLists.insert does, since every job comes by here
        ready.occupied |= ready.bits[priority]
        if not priority:
            self.idle.remaining = 0  # it has to look whether it is alone
        self.log((self.now, READIED, task.code, -1, priority, 0))
        return priority > self.running.priority

    def wake(self, waiters: list[Task]) -> bool:
        """Make the first waiter ready; it has to try again itself (rule 9). True if it is above the running task."""
        task = waiters.pop(0)
        task.waits_for = task.waits_in = None
        return self._postpone(task) if self.suspended else self.make_ready(task)

    def rouse(self, task: Task) -> bool:
        """Make a task ready; for an interrupt and with the scheduler suspended, that is when it is resumed (rule 32)."""
        return self._postpone(task) if self.suspended and self.handling is not None else self.make_ready(task)

    def _postpone(self, task: Task) -> bool:
        task.waits_in = self.postponed
        self.postponed.append(task)
        return task.priority > self.running.priority

    def block(self, task: Task, until: int, pending: Any, target: Target, waiters: list[Task]) -> None:
        """Take the CPU from the running task until it is woken as a waiter of `target`, or until tick `until`."""
        task.waits_for, task.waits_in = target, waiters
        enqueue(waiters, task)
        if isinstance(target, Mutex):
            target.protocol.waits(self, task, target)
        self.sleep(task, until, pending)

    def sleep(self, task: Task, until: int, pending: Any = None) -> None:
        """Take the CPU from the running task until tick `until`; then it first tries again what is pending."""
        if self.held:
            self.must_not_be_held(task, "waits")
        task.pending = pending
        task.state = BLOCKED
        if until < FOREVER:
            self._sequence = task.alarm = alarm = self._sequence + 1
            delayed = self.delayed
            heappush(delayed, (until, alarm, task))
            if len(delayed) > self._room:
                self._forget_old_alarms()
        if self.switch_cost:
            self.ready.remove(task)
            self.reschedule()
        else:  # the same in short, since every job comes by here
            self.switch_wanted = False
            self.running = chosen = self.ready.replaced(task)
            self.log((self.now, SWITCH, chosen.code, task.code, chosen.priority, BLOCKED))

    def _forget_old_alarms(self) -> None:
        """Of tasks that were woken before their time-out; without this they would stay until then, however many."""
        self.delayed[:] = [entry for entry in self.delayed if entry[2].alarm == entry[1]]
        heapify(self.delayed)
        self._room = 64 + 2 * len(self.delayed)

    def leave(self, task: Task, waiters: list[Task]) -> None:
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
        if not priority:
            self.idle.remaining = 0
        self.log((self.now, READIED, task.code, -1, priority, 0))

    def is_outranked(self) -> bool:
        """Under a textbook protocol: whether a ready task is above the running one, however that came about."""
        return self.textbook and self.ready.highest() > self.running.priority
