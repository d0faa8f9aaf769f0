"""A run of a scenario as the two CSV files in which the real kernel's recordings are kept."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from typing import Any, TextIO

import numpy as np

from labkit.kernel.run import Run
from labkit.kernel.scenario.steps import ACTIONS, STEP_NAMES
from labkit.trace import ISR_OPS, KINDS, NOTIFY_ACTIONS, STATES, TIMER_COMMANDS, runs


def write_timeline(run: Run, file: TextIO) -> None:
    """Who used each tick, as CSV rows `start,end,task`."""
    names = run.trace.names
    out = csv.writer(file, lineterminator="\n")
    out.writerow(("start", "end", "task"))
    out.writerows((start, end, names[task]) for task, start, end in _lists(runs(run.trace)))


def write_events(run: Run, file: TextIO) -> None:
    """Every event that the real kernel's recordings have, as CSV rows `tick,event,task,detail`."""
    names = (*run.trace.names, "-")
    out = csv.writer(file, lineterminator="\n")
    out.writerow(("tick", "event", "task", "detail"))
    for time, kind, task, other, value, extra in _lists(run.trace.rows()):
        event = KINDS[kind]
        if event not in DETAILS:
            continue
        detail = DETAILS[event]
        fields = {"task": names[task], "other": names[other], "value": value, "extra": extra}
        if event in NAMED:
            fields["named"] = names[extra]
        subject = "ISR" if event == "isr" else fields["other"] if event in ABOUT_OTHER else fields["task"]
        text = detail(fields) if callable(detail) else detail.format_map(fields)
        out.writerow((time, "result" if event == "mark" else event.removesuffix("_timeout"), subject, text))


def _lists(rows: np.ndarray) -> Iterator[list[int]]:
    """The rows as lists, made a part at a time: as Python objects they take ten times the memory."""
    for start in range(0, len(rows), 100_000):
        yield from rows[start : start + 100_000].tolist()


ENUMERATORS = {ours: theirs for theirs, ours in ACTIONS.items()} | {"buffer": "stream"}


def _notify(fields: dict[str, Any]) -> str:
    refused, rest = divmod(fields["extra"], 4096)
    index, action = divmod(rest, 8)
    text = "value={value};by={task}".format_map(fields)
    if NOTIFY_ACTIONS[action] == "give":
        return text + _index(index)
    return f"{text};action={ENUMERATORS[NOTIFY_ACTIONS[action]]};index={index};ok={1 - refused}"


def _index(index: int) -> str:
    return f";index={index}" if index else ""


def _bits_waited(fields: dict[str, Any]) -> str:
    bits, met = divmod(fields["extra"], 2)
    return f"obj={fields['other']};bits={bits};value={fields['value']};ok={met}"


def _timer(text: str) -> Callable[[dict[str, Any]], str]:
    return lambda fields: text.format(command=TIMER_COMMANDS[fields["extra"]], **fields)


_COUNT, _ITEM = "obj={other};count_before={value}", "obj={other};value={extra};count_before={value}"
_BLOCKED_ON_BUFFER = dict.fromkeys(("stream_send_block", "stream_recv_block", "message_send_block", "message_recv_block"))

#: The recorded events and their details, made of the columns of the trace.
DETAILS: dict[str, str | Callable[[dict[str, Any]], str]] = {
    "switch": lambda of: f"from={of['other']};from_state={(*STATES, '-')[of['extra']]};prio={of['value']}",
    "ready": "prio={value}",
    "create": lambda of: f"prio={of['value']}" + (f";by={of['other']}" if of["other"] != "-" else ""),
    **dict.fromkeys(("done", "yield", "suspend_all", "resume_all"), ""),
    **dict.fromkeys(("enter_critical", "exit_critical"), "nest={value}"),
    "tick_lost": "count={value}",
    "inherit": "to={value};base={extra};by={other}",
    "disinherit": "from={extra};to={value};cause=give",
    "disinherit_timeout": "from={extra};to={value};cause=timeout",
    **dict.fromkeys(("take", "take_block", "take_fail", "give", "give_fail", "queue_reset"), _COUNT),
    **dict.fromkeys(("recv_block", "recv_fail", "peek_block", "peek_fail", "select_block", "select_fail"), _COUNT),
    **dict.fromkeys(("send", "send_front", "overwrite", "send_block", "send_fail", "recv", "peek"), _ITEM),
    **dict.fromkeys(("select", "set_send"), "obj={other};member={named};count_before={value}"),
    "notify": _notify,
    "notify_take": lambda of: f"value={of['value']};by={of['task']}" + _index(of["extra"]),
    "notify_take_block": lambda of: f"by={of['task']}" + _index(of["extra"]),
    "notify_wait": lambda of: f"index={of['extra'] >> 1};value={of['value']};ok={of['extra'] & 1}",
    "notify_wait_block": "index={extra}",
    **dict.fromkeys(("set_bits", "clear_bits"), "obj={other};bits={extra};before={value}"),
    **dict.fromkeys(("wait_bits_block", "sync_block"), "obj={other};bits={extra};now={value}"),
    **dict.fromkeys(("wait_bits", "sync"), _bits_waited),
    **dict.fromkeys(_BLOCKED_ON_BUFFER, "obj={other}"),
    **dict.fromkeys(
        ("timer_send", "timer_send_block", "timer_send_fail"), _timer("cmd={command};timer={other};count_before={value}")
    ),
    "timer_command": _timer("timer={other};cmd={command};value={value}"),
    "timer_expired": "timer={other}",
    "pend_call": "call={value}",
    **dict.fromkeys(("suspend", "resume", "delete"), "by={task}"),
    "abort_delay": "ok={value};by={task}",
    "delay": "ticks={extra};wake={value}",
    "delay_until": "wake={value};block={extra}",
    "prio_set": "new={value};by={task}",
    "isr": lambda of: f"op={ISR_OPS[of['extra']]};target={of['other']};interrupted={of['task']}",
    "mark": lambda of: f"step={STEP_NAMES[of['extra']]};value={of['value']}",
}

#: Events recorded under the name of the task they are about; the trace has that one in `other` and the caller in `task`.
ABOUT_OTHER = ("notify", "suspend", "resume", "prio_set", "delete", "abort_delay")

#: Events with a name in `extra`.
NAMED = ("select", "set_send")
