"""Reading scenarios: every mistake is one sentence that says what is wrong, where, and what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from labkit.checks import whole
from labkit.kernel.kernel import IDLE, ISR, TIMER
from labkit.kernel.objects import FOREVER
from labkit.kernel.requests import MOST_TICKS
from labkit.kernel.scenario.steps import (
    CALLS,
    MOST_STEPS,
    Known,
    Step,
    checked_argument,
    compiled,
    known,
    of_length_one,
    timers_needed,
)
from labkit.outside import Name, a_list, a_whole, checked, read_json

#: The longest run of a scenario.
LAST_TICK = 10_000_000

KINDS = (
    *("binary", "counting", "mutex", "recursive", "queue"),
    *("event_group", "stream_buffer", "message_buffer", "queue_set", "timer"),
)
RESERVED = (IDLE, TIMER, ISR, "self", "-")


class _Data(BaseModel):
    """Part of a scenario as its file has it; what recordings note beside it, such as a title, is let be."""

    model_config = ConfigDict(frozen=True, extra="ignore")


def _not_the_kernels(name: str) -> str:
    if name in RESERVED:
        raise ValueError("taken")
    return name


def _one_of(some: tuple[str, ...]) -> Any:
    def check(value: Any) -> Any:
        if not isinstance(value, str) or value not in some:
            raise ValueError("none of them")
        return value

    return Annotated[Any, AfterValidator(check), Field(description=f"one of {', '.join(some)}")]


_Name = Annotated[
    Name,
    AfterValidator(_not_the_kernels),
    Field(description=f"a text of 1 to 100 printable characters, other than {', '.join(RESERVED[:-1])} and {RESERVED[-1]},"),
]
_On = Annotated[Literal[1], Field(description="only 1, which the model covers,")]
_Off = Annotated[Literal[0], Field(description="only 0, which the model covers,")]
_Switch = Annotated[int, a_whole(0, 1)]
_Program = Annotated[tuple[Any, ...], a_list("steps", MOST_STEPS)]


class _Object(_Data):
    """What tasks share; which of the fields count follows from the kind."""

    name: _Name
    kind: _one_of(KINDS)  # type: ignore[valid-type]
    length: Annotated[int, a_whole(1)] = 1
    init: Annotated[int | None, a_whole(0)] = None
    trigger: Annotated[int, a_whole(1)] = 1
    members: Annotated[tuple[Any, ...], a_list("names", 1000)] = ()
    period: Annotated[int, a_whole(1, MOST_TICKS)] = 1
    auto_reload: _Switch = 0
    started: _Switch = 0
    callback: _Program = ()


class _Interrupt(_Data):
    """A device interrupt at a tick: a call on a target, with a value to send, notify, set or wait."""

    tick: Annotated[int, a_whole(1)]
    op: _one_of(tuple(CALLS))  # type: ignore[valid-type]
    target: Any = None
    value: Annotated[int, a_whole(-FOREVER)] = 0
    action: Any = None
    index: Any = 0


class _Task(_Data):
    """A task as its file has it; `_task` checks what depends on the rest of the scenario."""

    name: _Name
    priority: Any = None
    created: _Switch = 1
    loop_from: Any = None
    program: _Program


class _Config(_Data):
    preemption: _On = 1
    tickless: _Off = 0
    cores: _On = 1
    max_priorities: Annotated[int, a_whole(2, 64)] = 8
    time_slicing: _Switch = 1
    idle_should_yield: _Switch = 1
    timers: _Switch = 0
    timer_task_priority: Any = None
    timer_queue_length: Annotated[int, a_whole(1, 1_000_000)] = 10
    pending_ticks: _one_of(("all", "one")) = "all"  # type: ignore[valid-type]


class _File(_Data):
    name: Any = "scenario"
    config: _Config = _Config()
    end_tick: Annotated[int, a_whole(1, LAST_TICK)]
    objects: Annotated[tuple[_Object, ...], a_list("objects", 1000)]
    tasks: Annotated[tuple[_Task, ...], a_list("tasks", 1000)]
    isr: Annotated[tuple[_Interrupt, ...], a_list("interrupts", 100_000)] = ()


@dataclass(frozen=True)
class ObjectSpec:
    """An object; which of the fields count follows from its kind. `callback` is what a timer does."""

    name: str
    kind: str
    length: int
    init: int
    trigger: int
    members: tuple[str, ...]
    period: int
    auto_reload: bool
    started: bool
    callback: tuple[Step, ...]


@dataclass(frozen=True)
class TaskSpec:
    """A task: after the last step of its program it goes on at `loop_from`, or ends at None. `created`: from the start."""

    name: str
    priority: int
    created: bool
    loop_from: int | None
    program: tuple[Step, ...]


@dataclass(frozen=True)
class InterruptSpec:
    """A call from an interrupt at a tick; `arguments` follow the target."""

    tick: int
    op: str
    target: str
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Scenario:
    """A task set that `read_scenario` has found to be sound. `timer_priority` is None where there are no timers."""

    name: str
    end_tick: int
    priorities: int
    time_slicing: bool
    idle_should_yield: bool
    pending_ticks: str
    timer_priority: int | None
    timer_queue: int
    objects: tuple[ObjectSpec, ...]
    tasks: tuple[TaskSpec, ...]
    interrupts: tuple[InterruptSpec, ...]


def read_scenario(source: Mapping[str, Any] | str | Path) -> Scenario:
    """Read and check a scenario: a mapping, or a file of JSON of at most `labkit.outside.MOST_BYTES`.

    A scenario has at most 1000 tasks of 10 000 steps, 1000 objects, 100 000 interrupts, and ends by `LAST_TICK`.

    Errors: ValueError, one sentence saying what is wrong, where, and what is allowed. OSError if the file cannot be read.
    """
    data = checked(_File, source if isinstance(source, Mapping) else read_json(source), "the scenario")
    config = data.config
    kinds: dict[str, str] = {}
    for name, kind in [(each.name, each.kind) for each in data.objects] + [(task.name, "task") for task in data.tasks]:
        if name in kinds:
            raise ValueError(f"the name {name!r} is used more than once; every object and task needs its own")
        kinds[name] = kind
    priority = (
        whole(config.timer_task_priority, 0, "config: timer_task_priority", config.max_priorities - 1) if config.timers else None
    )
    those = known(kinds, {each.name: each.length for each in data.objects}, config.max_priorities, bool(config.timers))
    objects: list[ObjectSpec] = []
    for each in data.objects:
        objects.append(_object(each, those, objects))
    return Scenario(
        name=str(data.name),
        end_tick=data.end_tick,
        priorities=config.max_priorities,
        time_slicing=bool(config.time_slicing),
        idle_should_yield=bool(config.idle_should_yield),
        pending_ticks=config.pending_ticks,
        timer_priority=priority,
        timer_queue=config.timer_queue_length,
        objects=tuple(objects),
        tasks=tuple(_task(each, those) for each in data.tasks),
        interrupts=tuple(_interrupt(each, f"isr {at}: {each.op}", those, objects) for at, each in enumerate(data.isr)),
    )


def _object(data: _Object, known: Known, before: list[ObjectSpec]) -> ObjectSpec:
    """The object as it is made; ValueError if its fields do not fit its kind."""
    whose = f"object {data.name!r}"
    one = data.kind in ("binary", "mutex", "recursive")
    whole(data.length, 1, f"{whose}: length", 1 if one else FOREVER)
    least, most = {"mutex": (1, 1), "recursive": (1, 1), "queue": (0, 0)}.get(data.kind, (0, data.length))
    init = least if data.init is None else whole(data.init, least, f"{whose}: init", most)
    match data.kind:
        case "timer":
            timers_needed("a timer", whose, known)
        case "stream_buffer":
            whole(data.trigger, 1, f"{whose}: trigger", data.length)
        case "message_buffer":
            whole(data.length, 5, f"{whose}: length", FOREVER)
        case "queue_set":
            allowed = {each.name: each.kind for each in before if each.kind in ("queue", "binary", "counting")}
            for other in before:
                allowed = {name: kind for name, kind in allowed.items() if name not in other.members}
            for member in data.members:
                kind = "queue binary counting"
                checked_argument(member, kind, f"{whose}: members", known._replace(kinds=allowed))
            if len(set(data.members)) < len(data.members):
                raise ValueError(f"{whose}: members are {', '.join(data.members)}; each is allowed once")
    return ObjectSpec(
        *(data.name, data.kind, data.length, init, data.trigger, data.members, data.period),
        auto_reload=bool(data.auto_reload),
        started=bool(data.started),
        callback=compiled(data.callback, whose, known),
    )


def _task(data: _Task, known: Known) -> TaskSpec:
    whose = f"task {data.name!r}"
    loop_from = None if data.loop_from is None else whole(data.loop_from, 0, f"{whose}: loop_from", len(data.program) - 1)
    program = compiled(data.program, whose, known)
    priority = whole(data.priority, 0, f"{whose}: priority", known.priorities - 1)
    return TaskSpec(data.name, priority, bool(data.created), loop_from, program)


def _interrupt(data: _Interrupt, where: str, known: Known, objects: list[ObjectSpec]) -> InterruptSpec:
    kinds, word = CALLS[data.op]
    target = checked_argument(data.target, kinds, where, known)
    value = checked_argument(data.value, word, where, known) if word else data.value
    arguments: tuple[Any, ...] = ()
    if data.op == "notify":
        action = checked_argument(data.action, "action", where, known)
        arguments = (action, value, checked_argument(data.index, "index", where, known))
    elif data.op == "notify_give":
        arguments = (checked_argument(data.index, "index", where, known),)
    elif word or data.op in ("send", "send_front", "overwrite"):
        arguments = (value,)
    if data.op in ("set_bits", "clear_bits"):
        timers_needed(data.op, where, known)
    if data.op == "overwrite":
        of_length_one(target, where, known)
    return InterruptSpec(data.tick, data.op, target, arguments)
