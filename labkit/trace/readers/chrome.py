"""A trace as Chrome/Perfetto JSON, for ui.perfetto.dev."""

from __future__ import annotations

import json
import os
from typing import IO, Any

import numpy as np

from labkit.trace.kinds import KINDS
from labkit.trace.readers.files import opened
from labkit.trace.spans import KERNEL, span_table
from labkit.trace.trace import Trace

_SPAN_KINDS = ("switch", "begin", "end", "overhead")


def export_chrome(trace: Trace, target: str | os.PathLike[str] | IO[str]) -> None:
    """Write the trace as Chrome trace-event JSON; open the file in ui.perfetto.dev or chrome://tracing.

    Each core is a process. Each name is a thread with its spans as complete ("X") events; every other kind of event is an
    instant ("i") on the thread of its task, with `other`, `value` and `extra` as arguments. Times are microseconds from time 0
    of the trace.

    Args:
        target: path, or a file open for text.
    """
    events = [event for core, part in trace.cores().items() for event in _process(part, core)]
    with opened(target, "w") as file:
        file.write(json.dumps({"displayTimeUnit": "ns", "traceEvents": events}, allow_nan=False))


def _process(trace: Trace, core: int) -> list[dict[str, Any]]:
    """The events of one core."""
    us, pid = 1e6 / trace.hz, core + 1
    names = [*trace.names, KERNEL]
    table = span_table(trace)
    instants = trace.rows()[~trace.of(*_SPAN_KINDS)]
    threads = set(table["name"].tolist()) | set(instants[:, 2].tolist())
    title = f"CPU {core}" if core else "CPU"
    events: list[dict[str, Any]] = [{"ph": "M", "pid": pid, "name": "process_name", "args": {"name": title}}]
    for code in sorted(threads):
        who = {"ph": "M", "pid": pid, "tid": code + 1}
        events.append({**who, "name": "thread_name", "args": {"name": names[code] if code >= 0 else "system"}})
        events.append({**who, "name": "thread_sort_index", "args": {"sort_index": code}})
    order = np.lexsort((table["opened"], table["start"]))
    spans = zip(*(table[key][order].tolist() for key in ("name", "start", "duration", "self", "complete")), strict=True)
    for name, start, duration, own, complete in spans:
        event = {"ph": "X", "pid": pid, "tid": name + 1, "name": names[name], "ts": start * us, "dur": duration * us}
        events.append({**event, "args": {"self_us": own * us} if complete else {"self_us": own * us, "cut": True}})
    for time, kind, task, other, value, extra in instants.tolist():
        args = {"other": trace.names[other] if other >= 0 else None, "value": value, "extra": extra}
        events.append({"ph": "i", "s": "t", "pid": pid, "tid": task + 1, "name": KINDS[kind], "ts": time * us, "args": args})
    return events
