"""Scenarios: task sets as data, in the JSON format of tests/oracle/freertos, and a run of one as the two CSV files used there.

A tick is one cycle here, so all times are ticks.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from labkit.kernel.kernel import Kernel
from labkit.kernel.objects import FOREVER
from labkit.kernel.requests import Services
from labkit.kernel.run import Run
from labkit.trace.folds import runs
from labkit.trace.kinds import ISR_OPS, KINDS, STATES


@dataclass(frozen=True)
class ObjectSpec:
    """A semaphore, mutex or queue: `kind` is one of OBJECT_KINDS."""

    name: str
    kind: str
    length: int
    init: int


@dataclass(frozen=True)
class TaskSpec:
    """A task: steps as (name, arguments, steps to skip on failure); after the last it goes on at `loop_from`, or ends at None."""

    name: str
    priority: int
    loop_from: int | None
    program: tuple[tuple[str, tuple, int], ...]


@dataclass(frozen=True)
class InterruptSpec:
    """A device interrupt at a tick: one of ISR_OPS on a target, with a value to send."""

    tick: int
    op: str
    target: str
    value: int


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


OBJECT_KINDS = ("binary", "counting", "mutex", "recursive", "queue")

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
    """Read and check a scenario: a mapping, or a file of JSON.

    Errors: ValueError, one sentence saying what is wrong, where, and what is allowed. OSError if the file cannot be read.
    """
    if isinstance(source, Mapping):
        return _scenario(source)
    try:
        data = json.loads(Path(source).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{source} is no JSON: {error}") from None
    return _scenario(data)


def _scenario(data: Any) -> Scenario:
    top = _mapping(data, "the scenario")
    config = _mapping(top.get("config", {}), "config")
    for key, only in {"preemption": 1, "tickless": 0, "timers": 0, "cores": 1}.items():
        if config.get(key, only) != only:
            raise ValueError(f"config: {key} is {config[key]!r}; the model covers {only} only")
    priorities = _integer(config.get("max_priorities", 8), "config: max_priorities", 2, 64)
    objects = tuple(_object(each, f"object {at}") for at, each in enumerate(_list(top, "objects", "the scenario")))
    entries = [_mapping(each, f"task {at}") for at, each in enumerate(_list(top, "tasks", "the scenario"))]
    names = [each.name for each in objects] + [_name(each, f"task {at}") for at, each in enumerate(entries)]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"the name {name!r} is used more than once; every object and task needs its own")
    known = {each.name: each for each in objects} | {each["name"]: "task" for each in entries}
    tasks = tuple(_task(each, known, priorities) for each in entries)
    isr = _list(top, "isr", "the scenario") if "isr" in top else []
    return Scenario(
        name=str(top.get("name", "scenario")),
        end_tick=_integer(top.get("end_tick"), "end_tick", 1, 10_000_000),
        priorities=priorities,
        time_slicing=bool(_integer(config.get("time_slicing", 1), "config: time_slicing", 0, 1)),
        objects=objects,
        tasks=tasks,
        interrupts=tuple(_interrupt(_mapping(each, f"isr {at}"), f"isr {at}", known) for at, each in enumerate(isr)),
    )


def _object(data: Any, where: str) -> ObjectSpec:
    entry = _mapping(data, where)
    name = _name(entry, where)
    kind = entry.get("kind")
    if kind not in OBJECT_KINDS:
        raise ValueError(f"object {name!r} has kind {kind!r}; there are {', '.join(OBJECT_KINDS)}")
    full = 1 if kind in ("binary", "mutex", "recursive") else FOREVER
    length = _integer(entry.get("length", 1), f"object {name!r}: length", 1, full)
    least, most = {"mutex": (1, 1), "recursive": (1, 1), "queue": (0, 0)}.get(kind, (0, length))
    return ObjectSpec(name, kind, length, _integer(entry.get("init", least), f"object {name!r}: init", least, most))


def _task(entry: Mapping[str, Any], known: Mapping[str, Any], priorities: int) -> TaskSpec:
    name = entry["name"]
    program = _list(entry, "program", f"task {name!r}")
    loop_from = entry.get("loop_from")
    if loop_from is not None:
        _integer(loop_from, f"task {name!r}: loop_from", 0, len(program) - 1)
    steps = []
    for at, step in enumerate(program):
        where = f"task {name!r}, step {at}"
        if not isinstance(step, list | tuple) or not step or not isinstance(step[0], str) or step[0] not in STEPS:
            raise ValueError(f"{where}: unknown step {step!r}; there are {', '.join(STEPS)}")
        words = STEPS[step[0]]
        if len(step) != 1 + len(words):
            raise ValueError(f"{where}: {step[0]} has {len(step) - 1} arguments; it takes {len(words)}: {', '.join(words)}")
        limits = {"skip": len(program) - 1 - at, "priority": priorities - 1}
        where = f"{where}: {step[0]}"
        arguments = [_argument(value, word, where, known, limits) for value, word in zip(step[1:], words, strict=True)]
        if step[0] == "overwrite" and (length := known[arguments[0]].length) != 1:
            raise ValueError(f"{where} on queue {arguments[0]!r} of length {length}; only length 1 is allowed")
        skip = arguments.pop() if words and words[-1] == "skip" else 0
        steps.append((step[0], tuple(arguments), skip))
    priority = _integer(entry.get("priority"), f"task {name!r}: priority", 1, priorities - 1)
    return TaskSpec(name, priority, loop_from, tuple(steps))


def _interrupt(entry: Mapping[str, Any], where: str, known: Mapping[str, Any]) -> InterruptSpec:
    op = entry.get("op")
    if op not in ISR_OPS:
        raise ValueError(f"{where}: unknown op {op!r}; there are {', '.join(ISR_OPS)}")
    target = _argument(entry.get("target"), TARGETS[op], f"{where}: {op}", known, {})
    tick = _integer(entry.get("tick"), f"{where}: tick", 1, FOREVER)
    return InterruptSpec(tick, op, target, _integer(entry.get("value", 0), f"{where}: value", -FOREVER, FOREVER))


def _argument(value: Any, word: str, where: str, known: Mapping[str, Any], limits: Mapping[str, int]) -> Any:
    """One argument of a step, checked against its word in STEPS."""
    match word:
        case "ticks":
            return _integer(value, f"{where}: ticks", 0, FOREVER)
        case "period":
            return _integer(value, f"{where}: period", 1, FOREVER)
        case "timeout":
            return None if value is None else _integer(value, f"{where}: timeout", 0, FOREVER)
        case "skip":
            return _integer(value, f"{where}: skip", 0, limits["skip"])
        case "priority":
            return _integer(value, f"{where}: priority", 1, limits["priority"])
        case "item":
            named = isinstance(value, str) and value in ("seq", "last")
            return value if named else _integer(value, f"{where}: item (or 'seq' or 'last')", -FOREVER, FOREVER)
        case "clear":
            if value not in ("clear", "decrement"):
                raise ValueError(f"{where}: {value!r} is not allowed; 'clear' or 'decrement' is")
            return value == "clear"
        case "task or self" if value == "self":
            return None
    kinds = word.removesuffix(" or self").split()
    target = known.get(value) if isinstance(value, str) else None
    if target is None:
        raise ValueError(f"{where}: there is no {' or '.join(kinds)} {value!r}; known names are {', '.join(known)}")
    kind = target if target == "task" else target.kind
    if kind not in kinds:
        raise ValueError(f"{where}: {value!r} is a {kind}; a {' or '.join(kinds)} is allowed")
    return value


def _mapping(data: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise ValueError(f"{where} is {type(data).__name__}; a JSON object is allowed")
    return data


def _list(entry: Mapping[str, Any], key: str, where: str) -> list:
    if not isinstance(entry.get(key), list | tuple):
        raise ValueError(f"{where}: {key!r} is missing or no list; a JSON array is allowed")
    return entry[key]


def _name(entry: Mapping[str, Any], where: str) -> str:
    name = entry.get("name")
    if not isinstance(name, str) or not name or name in ("IDLE", "ISR", "self"):
        raise ValueError(f"{where}: name {name!r}; a text other than IDLE, ISR and self is allowed")
    return name


def _integer(value: Any, what: str, least: int, most: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        allowed = f"{least} to {most}" if most < FOREVER else "any" if least < 0 else f"at least {least}"
        raise ValueError(f"{what} is {value!r}; a whole number is allowed, {allowed}")
    return value


def run_scenario(scenario: Scenario, protocol: str = "freertos") -> Run:
    """Run a scenario to its end tick, under one protocol for all its mutexes; ceilings are those of the tasks that use them.

    Errors: ValueError as from `Kernel.run`.
    """
    k = Kernel(cpu_hz=1000, tick_hz=1000, priorities=scenario.priorities, time_slicing=scenario.time_slicing)
    handles: dict[str | None, Any] = {None: None}
    for each in scenario.objects:
        ceiling = {"ceiling": 1, "users": _users(scenario, each.name)} if protocol == "ceiling" else {}
        match each.kind:
            case "mutex":
                handles[each.name] = k.mutex(each.name, protocol, **ceiling)
            case "recursive":
                handles[each.name] = k.recursive_mutex(each.name, protocol, **ceiling)
            case "queue":
                handles[each.name] = k.queue(each.name, each.length)
            case _:
                handles[each.name] = k.counting(each.name, each.length, each.init)
    for task in scenario.tasks:
        handles[task.name] = k.task(task.name, _body(task, handles), task.priority)
    for each in scenario.interrupts:
        k.interrupt(each.tick, _handler(each, handles))
    return k.run(scenario.end_tick)


def _users(scenario: Scenario, name: str) -> list[str]:
    return [task.name for task in scenario.tasks if any(name in arguments for _, arguments, _ in task.program)]


def _handler(spec: InterruptSpec, handles: Mapping[str | None, Any]) -> Callable[[Any], Any]:
    target = handles[spec.target]
    if spec.op == "send":
        return lambda isr: isr.send(target, spec.value)
    return lambda isr: getattr(isr, spec.op)(target)


def _body(spec: TaskSpec, handles: Mapping[str | None, Any]) -> Callable[[Services], Generator[Any, Any, None]]:
    """A task body that interprets a program."""

    def body(os: Services) -> Generator[Any, Any, None]:
        call = {
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
    out.writerows((start, end, names[task]) for task, start, end in runs(run.trace).tolist())


def write_events(run: Run, file: TextIO) -> None:
    """Every event that the real kernel's recordings have, as CSV rows `tick,event,task,detail`."""
    names = (*run.trace.names, "-")
    states = (*STATES, "-")
    out = csv.writer(file, lineterminator="\n")
    out.writerow(("tick", "event", "task", "detail"))
    for time, kind, task, other, value, extra in run.trace.rows().tolist():
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
