"""Scenarios: task sets as data, in the JSON format of tests/oracle/freertos, and a run of one as the two CSV files used there.

A tick is one cycle here, so all times are ticks.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from labkit.checks import shown, whole
from labkit.kernel.kernel import Kernel
from labkit.kernel.objects import FOREVER, Mutex, Queue, Semaphore
from labkit.kernel.requests import Services
from labkit.kernel.run import Run
from labkit.outside import Name, a_list, a_whole, checked, read_json
from labkit.trace import ISR_OPS, KINDS, STATES, runs

#: The longest run of a scenario, and the most events of it: some ten seconds, 200 MB.
LAST_TICK, MOST_EVENTS = 10_000_000, 2_000_000


class _Data(BaseModel):
    """Part of a scenario as its file has it; what recordings note beside it, such as a title, is let be."""

    model_config = ConfigDict(frozen=True, extra="ignore")


def _not_the_kernels(name: str) -> str:
    if name in ("IDLE", "ISR", "self"):
        raise ValueError("taken")
    return name


_Name = Annotated[
    Name,
    AfterValidator(_not_the_kernels),
    Field(description="a text of 1 to 100 printable characters, other than IDLE, ISR and self,"),
]
_On = Annotated[Literal[1], Field(description="only 1, which the model covers,")]
_Off = Annotated[Literal[0], Field(description="only 0, which the model covers,")]


class ObjectSpec(_Data):
    """A semaphore or mutex with `init` of `length` counts, or a queue."""

    name: _Name
    kind: Annotated[
        Literal["binary", "counting", "mutex", "recursive", "queue"],
        Field(description="one of binary, counting, mutex, recursive, queue"),
    ]
    length: Annotated[int, a_whole(1)] = 1
    init: Annotated[int | None, a_whole(0)] = None


class InterruptSpec(_Data):
    """A device interrupt at a tick: one of ISR_OPS on a target, with a value to send."""

    tick: Annotated[int, a_whole(1)]
    op: Annotated[Literal["notify_give", "give", "send", "resume"], Field(description=f"one of {', '.join(ISR_OPS)}")]
    target: Any = None
    value: Annotated[int, a_whole(-FOREVER)] = 0


class _Task(_Data):
    """A task as its file has it; `_compiled` checks what depends on the rest of the scenario."""

    name: _Name
    priority: Any = None
    loop_from: Any = None
    program: Annotated[tuple[Any, ...], a_list("steps", 10_000)]


class _Config(_Data):
    preemption: _On = 1
    tickless: _Off = 0
    timers: _Off = 0
    cores: _On = 1
    max_priorities: Annotated[int, a_whole(2, 64)] = 8
    time_slicing: Annotated[int, a_whole(0, 1)] = 1


class _File(_Data):
    name: Any = "scenario"
    config: _Config = _Config()
    end_tick: Annotated[int, a_whole(1, LAST_TICK)]
    objects: Annotated[tuple[ObjectSpec, ...], a_list("objects", 1000)]
    tasks: Annotated[tuple[_Task, ...], a_list("tasks", 1000)]
    isr: Annotated[tuple[InterruptSpec, ...], a_list("interrupts", 100_000)] = ()


@dataclass(frozen=True)
class TaskSpec:
    """A task: steps as (name, arguments, steps to skip on failure); after the last it goes on at `loop_from`, or ends at None."""

    name: str
    priority: int
    loop_from: int | None
    program: tuple[tuple[str, tuple[Any, ...], int], ...]


@dataclass(frozen=True)
class Scenario:
    """A task set that `read_scenario` has found to be sound."""

    name: str
    end_tick: int
    priorities: int
    time_slicing: bool
    objects: tuple[ObjectSpec, ...]
    tasks: tuple[TaskSpec, ...]
    interrupts: tuple[InterruptSpec, ...]


#: Steps and their arguments: kinds of object, or words that `_argument` checks. `skip` counts the steps to jump over on failure.
STEPS: dict[str, tuple[str, ...]] = {
    "burn": ("ticks",),
    "delay": ("ticks",),
    "delay_until": ("period",),
    "yield": (),
    "take": ("binary counting mutex", "timeout", "skip"),
    "give": ("binary counting mutex",),
    "rtake": ("recursive", "timeout", "skip"),
    "rgive": ("recursive",),
    "send": ("queue", "item", "timeout", "skip"),
    "send_front": ("queue", "item", "timeout", "skip"),
    "overwrite": ("queue", "item"),
    "recv": ("queue", "timeout", "skip"),
    "peek": ("queue", "timeout", "skip"),
    "notify_give": ("task",),
    "notify_take": ("clear", "timeout", "skip"),
    "suspend": ("task or self",),
    "resume": ("task",),
    "set_prio": ("task or self", "priority"),
}

TARGETS = {"notify_give": "task", "give": "binary counting", "send": "queue", "resume": "task"}


def read_scenario(source: Mapping[str, Any] | str | Path) -> Scenario:
    """Read and check a scenario: a mapping, or a file of JSON of at most `labkit.outside.MOST_BYTES`.

    A scenario has at most 1000 tasks of 10 000 steps, 1000 objects, 100 000 interrupts, and ends by `LAST_TICK`.

    Errors: ValueError, one sentence saying what is wrong, where, and what is allowed. OSError if the file cannot be read.
    """
    data = checked(_File, source if isinstance(source, Mapping) else read_json(source), "the scenario")
    known: dict[str, str] = {}
    for name, kind in [(each.name, each.kind) for each in data.objects] + [(task.name, "task") for task in data.tasks]:
        if name in known:
            raise ValueError(f"the name {name!r} is used more than once; every object and task needs its own")
        known[name] = kind
    objects = tuple(_sound(each) for each in data.objects)
    lengths = {each.name: each.length for each in objects}
    for at, interrupt in enumerate(data.isr):
        _argument(interrupt.target, TARGETS[interrupt.op], f"isr {at}: {interrupt.op}", known, {})
    return Scenario(
        name=str(data.name),
        end_tick=data.end_tick,
        priorities=data.config.max_priorities,
        time_slicing=bool(data.config.time_slicing),
        objects=objects,
        tasks=tuple(_compiled(each, known, lengths, data.config.max_priorities) for each in data.tasks),
        interrupts=data.isr,
    )


def _sound(data: ObjectSpec) -> ObjectSpec:
    """The object with its `init` settled; ValueError if its numbers do not fit its kind."""
    one = data.kind in ("binary", "mutex", "recursive")
    whole(data.length, 1, f"object {data.name!r}: length", 1 if one else FOREVER)
    least, most = {"mutex": (1, 1), "recursive": (1, 1), "queue": (0, 0)}.get(data.kind, (0, data.length))
    init = least if data.init is None else whole(data.init, least, f"object {data.name!r}: init", most)
    return data.model_copy(update={"init": init})


def _compiled(data: _Task, known: Mapping[str, str], lengths: Mapping[str, int], priorities: int) -> TaskSpec:
    whose, count = f"task {data.name!r}", len(data.program)
    if data.loop_from is not None:
        whole(data.loop_from, 0, f"{whose}: loop_from", count - 1)
    steps = []
    for at, step in enumerate(data.program):
        where = f"{whose}, step {at}"
        if not isinstance(step, list | tuple) or not step or not isinstance(step[0], str) or step[0] not in STEPS:
            raise ValueError(f"{where}: unknown step {shown(step)}; there are {', '.join(STEPS)}")
        name, *given = step
        words = STEPS[name]
        if len(given) != len(words):
            raise ValueError(f"{where}: {name} has {len(given)} arguments; it takes {len(words)}: {', '.join(words)}")
        limits = {"skip": count - 1 - at, "priority": priorities - 1}
        arguments = [_argument(value, word, f"{where}: {name}", known, limits) for value, word in zip(given, words)]
        if name == "overwrite" and (length := lengths[arguments[0]]) != 1:
            raise ValueError(f"{where}: overwrite on queue {arguments[0]!r} of length {length}; only length 1 is allowed")
        skip = arguments.pop() if words and words[-1] == "skip" else 0
        steps.append((name, tuple(arguments), skip))
    priority = whole(data.priority, 1, f"{whose}: priority", priorities - 1)
    return TaskSpec(data.name, priority, data.loop_from, tuple(steps))


def _argument(value: Any, word: str, where: str, known: Mapping[str, str], limits: Mapping[str, int]) -> Any:
    """One argument of a step, checked against its word in STEPS."""
    match word:
        case "ticks":
            return whole(value, 0, f"{where}: ticks", FOREVER)
        case "period":
            return whole(value, 1, f"{where}: period", FOREVER)
        case "timeout":
            return None if value is None else whole(value, 0, f"{where}: timeout", FOREVER)
        case "skip":
            return whole(value, 0, f"{where}: skip", limits["skip"])
        case "priority":
            return whole(value, 1, f"{where}: priority", limits["priority"])
        case "item":
            named = isinstance(value, str) and value in ("seq", "last")
            return value if named else whole(value, -FOREVER, f"{where}: item (or 'seq' or 'last')", FOREVER)
        case "clear":
            if value not in ("clear", "decrement"):
                raise ValueError(f"{where}: {shown(value)} is not allowed; 'clear' or 'decrement' is")
            return value == "clear"
        case "task or self" if value == "self":
            return None
    kinds = word.removesuffix(" or self").split()
    kind = known.get(value) if isinstance(value, str) else None
    if kind is None:
        some = ", ".join(list(known)[:20]) + (", ..." if len(known) > 20 else "")
        raise ValueError(f"{where}: there is no {' or '.join(kinds)} {shown(value)}; known names are {some}")
    if kind not in kinds:
        raise ValueError(f"{where}: {value!r} is a {kind}; a {' or '.join(kinds)} is allowed")
    return value


def run_scenario(scenario: Scenario, protocol: str = "freertos") -> Run:
    """Run a scenario to its end tick, under one protocol for all its mutexes; ceilings are those of the tasks that use them.

    Errors: ValueError as from `Kernel.run`, or after `MOST_EVENTS`.
    """
    k = Kernel(1000, 1000, scenario.priorities, time_slicing=scenario.time_slicing, most_events=MOST_EVENTS)
    users = _users(scenario) if protocol == "ceiling" else {}
    handles: dict[str | None, Any] = {None: None}
    for spec in scenario.objects:
        handles[spec.name] = _object(k, spec, protocol, users.get(spec.name))
    for task in scenario.tasks:
        handles[task.name] = k.task(task.name, _body(task, handles), task.priority)
    for interrupt in scenario.interrupts:
        k.interrupt(interrupt.tick, _handler(interrupt, handles))
    return k.run(scenario.end_tick)


def _object(k: Kernel, spec: ObjectSpec, protocol: str, users: list[str] | None) -> Mutex | Semaphore | Queue:
    ceiling = 1 if protocol == "ceiling" else None
    match spec.kind:
        case "mutex":
            return k.mutex(spec.name, protocol, ceiling, users or ())
        case "recursive":
            return k.recursive_mutex(spec.name, protocol, ceiling, users or ())
        case "queue":
            return k.queue(spec.name, spec.length)
    return k.counting(spec.name, spec.length, spec.init or 0)


def _users(scenario: Scenario) -> dict[str, list[str]]:
    """Object -> the tasks whose programs name it."""
    users: dict[str, list[str]] = {}
    for task in scenario.tasks:
        for name in {arguments[0] for _, arguments, _ in task.program if arguments and isinstance(arguments[0], str)}:
            users.setdefault(name, []).append(task.name)
    return users


def _handler(spec: InterruptSpec, handles: Mapping[str | None, Any]) -> Callable[[Any], Any]:
    target = handles[spec.target]
    if spec.op == "send":
        return lambda isr: isr.send(target, spec.value)
    return lambda isr: getattr(isr, spec.op)(target)


def _body(spec: TaskSpec, handles: Mapping[str | None, Any]) -> Callable[[Services], Generator[Any, Any, None]]:
    """A task body that interprets a program."""

    def body(os: Services) -> Generator[Any, Any, None]:
        call: dict[str, Callable[..., Any]] = {
            "burn": os.compute,
            "delay": os.delay,
            "delay_until": os.delay_until,
            "yield": os.yield_cpu,
            "take": os.take,
            "give": os.give,
            "rtake": os.take,
            "rgive": os.give,
            "send": os.send,
            "send_front": os.send_front,
            "overwrite": os.overwrite,
            "recv": os.receive,
            "peek": os.peek,
            "notify_give": os.notify_give,
            "notify_take": os.notify_take,
            "suspend": os.suspend,
            "resume": os.resume,
            "set_prio": os.set_priority,
        }
        at = sequence = last = 0
        while at < len(spec.program):
            step, arguments, skip = spec.program[at]
            words = STEPS[step]
            if words and words[0] not in ("ticks", "period", "clear"):
                arguments = (handles[arguments[0]], *arguments[1:])
            if "item" in words:
                item = {"seq": sequence, "last": last}.get(arguments[1], arguments[1])
                sequence += arguments[1] == "seq"
                arguments = (arguments[0], item, *arguments[2:])
            answer = yield call[step](*arguments)
            at += 1
            if step == "notify_take" or (step in ("recv", "peek") and answer is not None):
                last = answer
            if answer is None or answer is False or (step == "notify_take" and answer == 0):
                at += skip
            if at == len(spec.program) and spec.loop_from is not None:
                at = spec.loop_from

    return body


def write_timeline(run: Run, file: TextIO) -> None:
    """Who used each tick, as CSV rows `start,end,task`."""
    names = run.trace.names
    out = csv.writer(file, lineterminator="\n")
    out.writerow(("start", "end", "task"))
    out.writerows((start, end, names[task]) for task, start, end in _lists(runs(run.trace)))


def write_events(run: Run, file: TextIO) -> None:
    """Every event that the real kernel's recordings have, as CSV rows `tick,event,task,detail`."""
    names = (*run.trace.names, "-")
    states = (*STATES, "-")
    out = csv.writer(file, lineterminator="\n")
    out.writerow(("tick", "event", "task", "detail"))
    for time, kind, task, other, value, extra in _lists(run.trace.rows()):
        event = KINDS[kind]
        if event not in DETAILS:
            continue
        fields = {"task": names[task], "other": names[other], "value": value, "extra": extra, "ticks": value - time}
        if event == "switch":
            fields["state"] = states[extra]
        elif event == "isr":
            fields["op"] = ISR_OPS[extra]
        subject = "ISR" if event == "isr" else fields["other"] if event in ABOUT_OTHER else fields["task"]
        out.writerow((time, event.removesuffix("_timeout"), subject, DETAILS[event].format_map(fields)))


def _lists(rows: np.ndarray) -> Iterator[list[int]]:
    """The rows as lists, made a part at a time: as Python objects they take ten times the memory."""
    for start in range(0, len(rows), 100_000):
        yield from rows[start : start + 100_000].tolist()


_COUNT, _ITEM = "obj={other};count_before={value}", "obj={other};value={extra};count_before={value}"

#: The recorded events and their details, made of the columns of the trace.
DETAILS = {
    "switch": "from={other};from_state={state};prio={value}",
    **dict.fromkeys(("ready", "create"), "prio={value}"),
    **dict.fromkeys(("done", "yield"), ""),
    "inherit": "to={value};base={extra};by={other}",
    "disinherit": "from={extra};to={value};cause=give",
    "disinherit_timeout": "from={extra};to={value};cause=timeout",
    **dict.fromkeys(("take", "take_block", "take_fail", "give", "give_fail"), _COUNT),
    **dict.fromkeys(("recv_block", "recv_fail", "peek_block", "peek_fail"), _COUNT),
    **dict.fromkeys(("send", "send_front", "overwrite", "send_block", "send_fail", "recv", "peek"), _ITEM),
    **dict.fromkeys(("notify", "notify_take"), "value={value};by={task}"),
    **dict.fromkeys(("notify_take_block", "suspend", "resume"), "by={task}"),
    "delay": "ticks={ticks};wake={value}",
    "delay_until": "wake={value};block={extra}",
    "prio_set": "new={value};by={task}",
    "isr": "op={op};target={other};interrupted={task}",
}

#: Events recorded under the name of the task they are about; the trace has that one in `other` and the caller in `task`.
ABOUT_OTHER = ("notify", "suspend", "resume", "prio_set")
