"""The steps of a scenario's programs and the calls of its interrupts: what they take, and the check of each argument.

The format is that of tests/oracle/freertos and freertos2, whose READMEs say what each step means.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any, NamedTuple

from labkit.checks import shown, whole
from labkit.kernel.objects import FOREVER, NOTIFICATIONS
from labkit.kernel.requests import MOST_BITS, MOST_TICKS
from labkit.kernel.services.notifications import VALUES

LOCK, BUFFER, COUNTED = "binary counting mutex", "stream_buffer message_buffer", "binary counting mutex queue"

#: Steps and their arguments: kinds of object, or words that `checked_argument` knows; one with a `?` may be left out.
#: `skip` counts the steps to jump over on failure.
STEPS: dict[str, tuple[str, ...]] = {
    "burn": ("ticks",),
    "delay": ("ticks",),
    "delay_until": ("period", "skip?"),
    "set_last_wake": ("offset",),
    "tick_count": (),
    "yield": (),
    "take": (LOCK, "timeout", "skip"),
    "give": (LOCK,),
    "rtake": ("recursive", "timeout", "skip"),
    "rgive": ("recursive",),
    "send": ("queue", "item", "timeout", "skip"),
    "send_front": ("queue", "item", "timeout", "skip"),
    "overwrite": ("queue", "item"),
    "recv": ("queue", "timeout", "skip"),
    "peek": ("queue", "timeout", "skip"),
    "queue_reset": ("queue",),
    "messages_waiting": (COUNTED,),
    "spaces_available": ("queue",),
    "select": ("queue_set", "timeout", "skip"),
    "recv_selected": ("skip",),
    "notify_give": ("task", "index?"),
    "notify_take": ("clear", "timeout", "skip", "index?"),
    "notify": ("task", "action", "value", "index", "skip"),
    "notify_wait": ("value", "value", "timeout", "skip", "index"),
    "notify_state_clear": ("task or self", "index", "skip"),
    "notify_value_clear": ("task or self", "value", "index"),
    "set_bits": ("event_group", "bits"),
    "clear_bits": ("event_group", "bits"),
    "get_bits": ("event_group",),
    "wait_bits": ("event_group", "some bits", "any or all", "clear or keep", "timeout", "skip"),
    "sync": ("event_group", "bits", "some bits", "timeout", "skip"),
    "stream_send": ("stream_buffer", "bytes", "timeout", "skip"),
    "stream_recv": ("stream_buffer", "bytes", "timeout", "skip"),
    "message_send": ("message_buffer", "bytes", "timeout", "skip"),
    "message_recv": ("message_buffer", "bytes", "timeout", "skip"),
    "stream_available": (BUFFER,),
    "stream_spaces": (BUFFER,),
    "timer_start": ("timer", "timeout", "skip"),
    "timer_stop": ("timer", "timeout", "skip"),
    "timer_reset": ("timer", "timeout", "skip"),
    "timer_change_period": ("timer", "period", "timeout", "skip"),
    "timer_active": ("timer", "skip"),
    "pend_call": ("steps", "timeout", "skip"),
    "suspend": ("task or self",),
    "resume": ("task",),
    "set_prio": ("task or self", "priority"),
    "get_prio": ("task or self",),
    "get_base_prio": ("task or self",),
    "create": ("task",),
    "delete": ("task or self",),
    "abort_delay": ("task", "skip"),
    "enter_critical": (),
    "exit_critical": (),
    "suspend_all": (),
    "resume_all": (),
}

#: Names of steps in a fixed order; a `mark` row that notes what a step returned has the index here.
STEP_NAMES = tuple(STEPS)

#: What an interrupt may call, on which kinds of object, and the word for its value.
CALLS: dict[str, tuple[str, str]] = {
    "notify_give": ("task", ""),
    "notify": ("task", "value"),
    "resume": ("task", ""),
    "give": ("binary counting", ""),
    "take": ("binary counting", ""),
    "send": ("queue", ""),
    "send_front": ("queue", ""),
    "overwrite": ("queue", ""),
    "recv": ("queue", ""),
    "set_bits": ("event_group", "bits"),
    "clear_bits": ("event_group", "bits"),
    "stream_send": ("stream_buffer", "bytes"),
    "message_send": ("message_buffer", "bytes"),
    "timer_start": ("timer", ""),
    "timer_stop": ("timer", ""),
    "timer_reset": ("timer", ""),
    "timer_change_period": ("timer", "period"),
}

#: FreeRTOS's names of what a notification does -> the kernel model's.
ACTIONS = {
    "eNoAction": "none",
    "eSetBits": "set_bits",
    "eIncrement": "increment",
    "eSetValueWithOverwrite": "overwrite",
    "eSetValueWithoutOverwrite": "keep",
}

MOST_STEPS = 10_000  #: of a program


class Step(NamedTuple):
    """A step that has been checked; `arguments` without `skip`, names still names, what was left out filled in."""

    name: str
    arguments: tuple[Any, ...]
    skip: int


class Known(NamedTuple):
    """What arguments are checked against. `timers`: there is a timer task; `calls` numbers the pend_call steps."""

    kinds: Mapping[str, str]  # name -> kind of object, or "task"
    lengths: Mapping[str, int]
    priorities: int
    timers: bool
    calls: Iterator[int]


def known(kinds: Mapping[str, str], lengths: Mapping[str, int], priorities: int, timers: bool) -> Known:
    return Known(kinds, lengths, priorities, timers, count())


def compiled(program: Any, whose: str, known: Known) -> tuple[Step, ...]:
    """The steps of a program; ValueError for the first one that cannot be."""
    steps = []
    for at, step in enumerate(program):
        where = f"{whose}, step {at}"
        if not isinstance(step, list | tuple) or not step or not isinstance(step[0], str) or step[0] not in STEPS:
            raise ValueError(f"{where}: unknown step {shown(step)}; there are {', '.join(STEPS)}")
        steps.append(_step(step[0], step[1:], where, known, len(program) - 1 - at))
    return tuple(steps)


def _step(name: str, given: Any, where: str, known: Known, left: int) -> Step:
    words = STEPS[name]
    needed = sum(not word.endswith("?") for word in words)
    if not needed <= len(given) <= len(words):
        takes = f"{len(words)}" if needed == len(words) else f"{needed} to {len(words)}"
        listed = f": {', '.join(word.removesuffix('?') for word in words)}" if words else ""
        raise ValueError(f"{where}: {name} has {len(given)} arguments; it takes {takes}{listed}")
    arguments: list[Any] = []
    skip = 0
    for value, word in zip([*given, *[0] * (len(words) - len(given))], words, strict=True):
        word = word.removesuffix("?")
        if word == "skip":
            skip = whole(value, 0, f"{where}: {name}: skip", left)
        elif word == "steps":
            timers_needed(name, where, known)
            arguments += [next(known.calls), _nested(value, f"{where}: {name}", known)]
        else:
            arguments.append(checked_argument(value, word, f"{where}: {name}", known))
    if name == "overwrite":
        of_length_one(arguments[0], where, known)
    return Step(name, tuple(arguments), skip)


def _nested(program: Any, where: str, known: Known) -> tuple[Step, ...]:
    if not isinstance(program, list | tuple) or len(program) > MOST_STEPS:
        raise ValueError(f"{where}: steps are {shown(program)}; a list of at most {MOST_STEPS} steps is allowed")
    return compiled(program, where, known)


def timers_needed(name: str, where: str, known: Known) -> None:
    """ValueError if there is nobody to carry out a command."""
    if not known.timers:
        raise ValueError(f"{where}: {name} is for the timer task, and the scenario has none; config: timers 1 is needed")


def of_length_one(queue: str, where: str, known: Known) -> None:
    """ValueError if a queue cannot be overwritten."""
    if (length := known.lengths[queue]) != 1:
        raise ValueError(f"{where}: overwrite on queue {queue!r} of length {length}; only length 1 is allowed")


#: Words for whole numbers, and their bounds.
NUMBERS: dict[str, tuple[int, int]] = {
    "ticks": (0, FOREVER),
    "period": (1, FOREVER),
    "offset": (-MOST_TICKS, MOST_TICKS),
    "value": (0, VALUES),
    "index": (0, NOTIFICATIONS - 1),
    "bits": (0, MOST_BITS),
    "some bits": (1, MOST_BITS),
    "bytes": (0, FOREVER),
}

#: Words for one of some texts, and what each stands for.
CHOICES: dict[str, dict[str, Any]] = {
    "clear": {"clear": True, "decrement": False},
    "clear or keep": {"clear": True, "keep": False},
    "any or all": {"any": False, "all": True},
    "action": ACTIONS,
}


def checked_argument(value: Any, word: str, where: str, known: Known) -> Any:
    """One argument of a step or interrupt, checked against its word."""
    if word in NUMBERS:
        least, most = NUMBERS[word]
        return whole(value, least, f"{where}: {word}", most)
    if word in CHOICES:
        choices = CHOICES[word]
        if not isinstance(value, str) or value not in choices:
            *others, last = map(repr, choices)
            raise ValueError(f"{where}: {shown(value)} is not allowed; {', '.join(others)} or {last} is")
        return choices[value]
    match word:
        case "timeout":
            return None if value is None else whole(value, 0, f"{where}: timeout", FOREVER)
        case "priority":
            return whole(value, 0, f"{where}: priority", known.priorities - 1)
        case "item":
            named = isinstance(value, str) and value in ("seq", "last")
            return value if named else whole(value, -FOREVER, f"{where}: item (or 'seq' or 'last')", FOREVER)
        case "task or self" if value == "self":
            return None
    return _named(value, word.removesuffix(" or self").split(), where, known.kinds)


def _named(value: Any, kinds: list[str], where: str, known: Mapping[str, str]) -> str:
    kind = known.get(value) if isinstance(value, str) else None
    if kind is None:
        some = ", ".join(list(known)[:20]) + (", ..." if len(known) > 20 else "")
        raise ValueError(f"{where}: there is no {' or '.join(kinds)} {shown(value)}; known names are {some}")
    if kind not in kinds:
        raise ValueError(f"{where}: {value!r} is {_a(kind)}; {_a(' or '.join(kinds))} is allowed")
    return value


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
