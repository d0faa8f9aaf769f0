"""Running a scenario: task bodies, callbacks and interrupt handlers that carry out steps.

A tick is one cycle here, so all times are ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any

from labkit.kernel.kernel import Kernel
from labkit.kernel.objects import Queue
from labkit.kernel.requests import Services
from labkit.kernel.run import Run
from labkit.kernel.scenario.read import InterruptSpec, ObjectSpec, Scenario, TaskSpec
from labkit.kernel.scenario.steps import STEP_NAMES, STEPS, Step

#: The most events of a run: some ten seconds, 200 MB.
MOST_EVENTS = 2_000_000

Answers = Generator[Any, Any, Any]

#: Steps that are a request as they stand.
REQUESTS: dict[str, Callable[..., Any]] = {
    "burn": Services.compute,
    "delay": Services.delay,
    "yield": Services.yield_cpu,
    "take": Services.take,
    "give": Services.give,
    "rtake": Services.take,
    "rgive": Services.give,
    "send": Services.send,
    "send_front": Services.send_front,
    "overwrite": Services.overwrite,
    "recv": Services.receive,
    "peek": Services.peek,
    "queue_reset": Services.reset,
    "messages_waiting": Services.messages_waiting,
    "spaces_available": Services.spaces_available,
    "select": Services.select,
    "notify_give": Services.notify_give,
    "notify_take": Services.notify_take,
    "notify": Services.notify,
    "notify_wait": Services.notify_wait,
    "notify_state_clear": Services.notify_state_clear,
    "notify_value_clear": Services.notify_value_clear,
    "set_bits": Services.set_bits,
    "clear_bits": Services.clear_bits,
    "get_bits": Services.get_bits,
    "wait_bits": Services.wait_bits,
    "sync": Services.sync,
    "stream_send": Services.buffer_send,
    "stream_recv": Services.buffer_receive,
    "message_send": Services.buffer_send,
    "message_recv": Services.buffer_receive,
    "stream_available": Services.buffer_available,
    "stream_spaces": Services.buffer_spaces,
    "timer_start": Services.timer_start,
    "timer_stop": Services.timer_stop,
    "timer_reset": Services.timer_reset,
    "timer_change_period": Services.timer_change_period,
    "timer_active": Services.timer_active,
    "suspend": Services.suspend,
    "resume": Services.resume,
    "set_prio": Services.set_priority,
    "get_prio": Services.get_priority,
    "get_base_prio": Services.get_base_priority,
    "delete": Services.delete,
    "abort_delay": Services.abort_delay,
    "enter_critical": Services.enter_critical,
    "exit_critical": Services.exit_critical,
    "suspend_all": Services.suspend_all,
    "resume_all": Services.resume_all,
}

VALUES = (
    *("tick_count", "notify_value_clear", "set_bits", "clear_bits", "get_bits", "timer_active", "get_prio", "get_base_prio"),
    *("messages_waiting", "spaces_available", "stream_send", "stream_recv", "message_send", "message_recv"),
    *("stream_available", "stream_spaces"),
)
#: Steps whose answer is noted, and those whose answer becomes the task's `last`.
NOTED = {*VALUES, "notify", "notify_state_clear", "resume_all", "pend_call"}
NOTED |= {"timer_start", "timer_stop", "timer_reset", "timer_change_period"}
KEPT = {*VALUES, "notify_take", "notify_wait", "wait_bits", "sync"}


def run_scenario(scenario: Scenario, protocol: str = "freertos") -> Run:
    """Run a scenario to its end tick, under one protocol for all its mutexes; ceilings are those of the tasks that use them.

    Errors: ValueError as from `Kernel.run`, or after `MOST_EVENTS`.
    """
    return Play(scenario, protocol).kernel.run(scenario.end_tick)


class _Task:
    """What the recorder keeps for each task, and once for the timer task: see the steps that change it."""

    def __init__(self) -> None:
        self.sequence = self.last = 0
        self.since: int | None = None
        self.selected: Any = None


class Play:
    """A scenario on a kernel of its own, ready to run: its objects by name, and how its steps become requests."""

    def __init__(self, scenario: Scenario, protocol: str = "freertos"):
        k = self.kernel = Kernel(
            *(1000, 1000, scenario.priorities),
            time_slicing=scenario.time_slicing,
            most_events=MOST_EVENTS,
            idle_should_yield=scenario.idle_should_yield,
            pending_ticks=scenario.pending_ticks,
            timer_priority=scenario.timer_priority,
            timer_queue=scenario.timer_queue,
        )
        self.objects: dict[str, Any] = {}
        self.tasks = {task.name: task for task in scenario.tasks}
        self.daemon = _Task()
        users = _users(scenario) if protocol == "ceiling" else {}
        for spec in scenario.objects:
            self.objects[spec.name] = self._object(spec, protocol, users.get(spec.name))
        for task in scenario.tasks:
            if task.created:
                k.task(task.name, self._body(task), task.priority)
        for interrupt in scenario.interrupts:
            k.interrupt(interrupt.tick, self._handler(interrupt))

    def _object(self, spec: ObjectSpec, protocol: str, users: list[str] | None) -> Any:
        k = self.kernel
        ceiling = 0 if protocol == "ceiling" else None
        match spec.kind:
            case "mutex":
                return k.mutex(spec.name, protocol, ceiling, users or ())
            case "recursive":
                return k.recursive_mutex(spec.name, protocol, ceiling, users or ())
            case "queue":
                return k.queue(spec.name, spec.length)
            case "event_group":
                return k.event_group(spec.name)
            case "stream_buffer":
                return k.stream_buffer(spec.name, spec.length, spec.trigger)
            case "message_buffer":
                return k.message_buffer(spec.name, spec.length)
            case "queue_set":
                return k.queue_set(spec.name, [self.objects[member] for member in spec.members], spec.length)
            case "timer":
                callback = self._in_daemon(spec.callback)
                return k.timer(spec.name, spec.period, callback, spec.auto_reload, spec.started)
        return k.counting(spec.name, spec.length, spec.init)

    def _handle(self, name: Any) -> Any:
        """The object or task of that name; ValueError for a task that has never been created. What is no name stays."""
        if not isinstance(name, str):
            return name
        found = self.objects.get(name) or self.kernel.named.get(name)
        if found is None:
            raise ValueError(f"task {name!r} has not been created yet; only a task that exists can be named")
        return found

    def _handler(self, spec: InterruptSpec) -> Callable[[Any], Any]:
        op = {"recv": "receive", "stream_send": "buffer_send", "message_send": "buffer_send"}.get(spec.op, spec.op)

        def handler(isr: Any) -> None:
            answer = getattr(isr, op)(self._handle(spec.target), *spec.arguments)
            if op == "buffer_send":
                isr.mark(answer, STEP_NAMES.index(spec.op))

        return handler

    def _body(self, spec: TaskSpec) -> Callable[[Services], Answers]:
        def body(os: Services) -> Answers:
            task = _Task()
            yield from self._steps(os, task, spec.program)
            while spec.loop_from is not None:
                yield from self._steps(os, task, spec.program, spec.loop_from)

        return body

    def _in_daemon(self, program: Sequence[Step]) -> Callable[[Services], Answers]:
        return lambda os: self._steps(os, self.daemon, program)

    def _steps(self, os: Services, task: _Task, program: Sequence[Step], at: int = 0) -> Answers:
        while at < len(program):
            step = program[at]
            answer, failed = yield from self._step(os, task, step)
            if step.name in KEPT or (step.name in ("recv", "peek") and not failed):
                task.last = answer
            if step.name in NOTED:
                yield os.mark(int(answer), STEP_NAMES.index(step.name))
            at += 1 + (step.skip if failed else 0)

    def _step(self, os: Services, task: _Task, step: Step) -> Answers:
        """What a step returned, and whether it failed."""
        name, arguments = step.name, step.arguments
        match name:
            case "tick_count":
                return os.ticks, False
            case "set_last_wake":
                task.since = os.ticks + arguments[0]
                return None, False
            case "delay_until":
                since, task.since = task.since, None
                slept = yield os.delay_until(arguments[0], since)
                return slept, not slept
            case "pend_call":
                number, steps, timeout = arguments
                sent = yield os.pend_call(self._in_daemon(steps), timeout, number)
                return sent, not sent
            case "create":
                spec = self.tasks[arguments[0]]
                created = yield os.create(spec.name, self._body(spec), spec.priority)
                return created, False
            case "recv_selected":
                return (yield from self._receive_selected(os, task))
        if name in ("send", "send_front", "overwrite"):
            arguments = (arguments[0], self._item(task, arguments[1]), *arguments[2:])
        if STEPS[name] and STEPS[name][0] not in ("ticks", "clear", "value"):
            arguments = (self._handle(arguments[0]), *arguments[1:])
        answer = yield REQUESTS[name](os, *arguments)
        match name:
            case "select":
                task.selected = answer
            case "notify_wait":
                noted, value = answer
                return value, not noted
            case "wait_bits":
                wanted, every = arguments[1:3]
                return answer, (answer & wanted != wanted) if every else not answer & wanted
            case "sync":
                return answer, answer & arguments[2] != arguments[2]
            case "stream_send" | "message_send":
                return answer, answer < arguments[1]
            case "notify_take" | "stream_recv" | "message_recv" | "timer_active":
                return answer, not answer
        return answer, answer is None or answer is False

    def _item(self, task: _Task, item: Any) -> Any:
        if item == "seq":
            task.sequence += 1
            return task.sequence - 1
        return task.last if item == "last" else item

    def _receive_selected(self, os: Services, task: _Task) -> Answers:
        member = task.selected
        if member is None:
            return None, True
        if isinstance(member, Queue):
            answer = yield os.receive(member, 0)
            if answer is not None:
                task.last = answer
            return answer, answer is None
        taken = yield os.take(member, 0)
        return taken, not taken


def _users(scenario: Scenario) -> dict[str, list[str]]:
    """Object -> the tasks whose programs name it."""
    users: dict[str, list[str]] = {}
    for task in scenario.tasks:
        for name in {step.arguments[0] for step in task.program if step.arguments and isinstance(step.arguments[0], str)}:
            users.setdefault(name, []).append(task.name)
    return users
