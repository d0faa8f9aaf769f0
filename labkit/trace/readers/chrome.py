"""Chrome's trace-event JSON: written for ui.perfetto.dev and chrome://tracing, read back, and read from others.

What the lab writes says in `otherData` that it is the lab's, and with every event where it stood; reading it gives the same
spans, jobs and statistics. JSON of others has threads that run side by side, and does not say on which core: each thread is read
as a core of its own, its complete ("X") and begin and end ("B", "E") events as spans.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from typing import IO, Any, NamedTuple

import numpy as np

from labkit.trace.kinds import CODE, KINDS
from labkit.trace.readers.files import checked_trace, head_of, opened, read_head
from labkit.trace.readers.log import trace_of
from labkit.trace.readers.report import LogError, Problems, Report, told
from labkit.trace.readers.source import Source
from labkit.trace.readers.stamps import MOST_CORE, MOST_NAMES, Stamps
from labkit.trace.spans import KERNEL, Pairs, span_table
from labkit.trace.trace import COLUMNS, Trace

#: Longest JSON in bytes; one of this size takes about a gigabyte of memory.
MOST_BYTES = 64 << 20

LATEST = 9e15  # us; that is 285 years, and in nanoseconds it fits 64 bits

_SPAN_KINDS = ("switch", "begin", "end", "overhead")


def export_chrome(trace: Trace, target: str | os.PathLike[str] | IO[str]) -> None:
    """Write the trace as Chrome trace-event JSON; open the file in ui.perfetto.dev or chrome://tracing.

    Each core is a process. Each name is a thread with its spans as complete ("X") events, of category run, scope or kernel; every
    other kind of event is an instant ("i") on the thread of its task. The arguments are `other`, `value` and `extra`, and
    `order`, the place among all events. Times are microseconds from time 0 of the trace.

    Args:
        target: path, or a file open for text.
    """
    events = [event for core, part in trace.cores().items() for event in _process(part, core)]
    head = {**head_of(trace), "cores": trace.core is not None}
    with opened(target, "w") as file:
        file.write(json.dumps({"displayTimeUnit": "ns", "otherData": {"labkit": head}, "traceEvents": events}, allow_nan=False))


def _process(trace: Trace, core: int) -> list[dict[str, Any]]:
    """The events of one core."""
    us, pid = 1e6 / trace.hz, core + 1
    names = [*trace.names, KERNEL]
    table = span_table(trace)
    instants = np.flatnonzero(~trace.of(*_SPAN_KINDS))
    threads = set(table["name"].tolist()) | set(trace.task[instants].tolist())
    title = f"CPU {core}" if core else "CPU"
    events: list[dict[str, Any]] = [{"ph": "M", "pid": pid, "name": "process_name", "args": {"name": title}}]
    for code in sorted(threads):
        who = {"ph": "M", "pid": pid, "tid": code + 1}
        events.append({**who, "name": "thread_name", "args": {"name": names[code] if code >= 0 else "system"}})
        events.append({**who, "name": "thread_sort_index", "args": {"sort_index": code}})

    def more(row: int) -> dict[str, Any]:
        other = int(trace.other[row])
        return {
            "other": trace.names[other] if other >= 0 else None,
            "value": int(trace.value[row]),
            "extra": int(trace.extra[row]),
        }

    order = np.lexsort((table["opened"], table["start"]))
    columns = ("name", "start", "duration", "self", "complete", "run", "opened", "closed")
    for name, start, duration, own, complete, run, opens, closes in zip(*(table[key][order].tolist() for key in columns)):
        args = {"self_us": own * us, "order": [opens, closes], **more((opens if opens >= 0 else closes) // 2)}
        sort = "run" if run else "kernel" if name == len(trace.names) else "scope"
        if sort == "kernel":
            args["task"] = int(trace.task[opens // 2])
        elif sort == "scope" and opens >= 0 and closes < 2 * len(trace) and trace.other[closes // 2] >= 0:
            args["ended_for"] = trace.names[trace.other[closes // 2]]
        event = {"ph": "X", "pid": pid, "tid": name + 1, "name": names[name], "ts": start * us, "dur": duration * us}
        events.append({**event, "cat": sort, "args": args if complete else {**args, "cut": True}})
    for row in instants.tolist():
        task, time = int(trace.task[row]), int(trace.time[row])
        event = {"ph": "i", "s": "t", "pid": pid, "tid": task + 1, "name": KINDS[trace.kind[row]], "ts": time * us}
        events.append({**event, "args": {**more(row), "order": [2 * row + 1]}})
    return events


def chrome_of(source: Source) -> tuple[Trace, Report]:
    """The trace in a JSON of trace events, an object with the list `traceEvents` or that list alone.

    Raises:
        LogError: it is none, or longer than `MOST_BYTES`.
    """
    data = source.bytes(MOST_BYTES)
    try:
        made = json.loads(data)
    except RecursionError:
        raise LogError(f"{source.title}: it is nested too deeply for trace events") from None
    except ValueError as error:
        raise LogError(f"{source.title}: not JSON ({told(str(error))})") from None
    events = made.get("traceEvents") if isinstance(made, dict) else made
    if not isinstance(events, list) or not all(isinstance(event, dict) for event in events):
        raise LogError(f"{source.title}: trace events are a list of objects, or an object with such a list as traceEvents")
    other = made.get("otherData") if isinstance(made, dict) else None
    if isinstance(other, dict) and isinstance(other.get("labkit"), dict):
        return _own(source.title, events, other["labkit"])
    return _foreign(source.title, events)


# ------------------------------------------------------------------------------------------------------------------ the lab's own


def _own(title: str, events: list[dict[str, Any]], given: dict[str, Any]) -> tuple[Trace, Report]:
    try:
        head = read_head(json.dumps(given))
        codes = {**{name: code for code, name in enumerate(head["names"])}, None: -1}
        if len(codes) <= len(head["names"]):
            raise LogError("the names must be different from each other")
        rows = [row for event in events for row in _rows(event, codes, head["hz"] / 1e6, head["end"])]
        table = np.array(rows, dtype=np.int64).reshape(-1, len(COLUMNS) + 2)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"{title}: not as export_chrome wrote it ({type(error).__name__}: {told(str(error))})") from None
    table = table[np.lexsort((table[:, 0], table[:, -1], table[:, 1]))]
    columns = {name: table[:, at] for at, name in enumerate(COLUMNS, 1)}
    if given.get("cores") is True:
        columns["core"] = table[:, -1]
    trace = checked_trace(head, columns)
    return trace, Report.of(title, len(trace.cores()), Problems(), "lab JSON", len(events))


def _rows(event: dict[str, Any], codes: dict[str | None, int], scale: float, end: int) -> Iterator[tuple[int, ...]]:
    """Rows of an event: place in the order, the columns of a trace, core."""
    if event["ph"] == "M":
        return
    args, core, task = event["args"], int(event["pid"]) - 1, int(event["tid"]) - 1
    start, more = round(event["ts"] * scale), (codes[args["other"]], int(args["value"]), int(args["extra"]))
    if event["ph"] == "i":
        yield args["order"][0], start, CODE[event["name"]], task, *more, core
        return
    (first, last), stop, cut = args["order"], round((event["ts"] + event["dur"]) * scale), args.get("cut", False)
    if event["cat"] == "run":
        yield first, start, CODE["switch"], task, task if cut and stop < end else more[0], *more[1:], core
        if not cut or stop < end:  # who comes next has the next place
            yield last, stop, CODE["switch"], -1, task, 0, 0, core
    elif event["cat"] == "kernel":
        yield first, start, CODE["overhead"], int(args["task"]), *more, core
    else:
        if first >= 0:
            yield first, start, CODE["begin"], task, *more, core
        if not cut or first < 0:
            yield last, stop, CODE["end"], task, codes[args.get("ended_for")] if first >= 0 else more[0], 0, 0, core


# ------------------------------------------------------------------------------------------------------------------ from others


class _Span(NamedTuple):
    """Of a thread, in microseconds; an end of None is that of the recording. `number` is that of the event."""

    thread: int
    name: str
    begin: float
    end: float | None
    number: int


def _foreign(title: str, events: list[dict[str, Any]]) -> tuple[Trace, Report]:
    problems, threads, skipped = Problems(), dict[tuple[str, str], int](), 0
    spans: list[_Span] = []
    open_: dict[int, list[tuple[str, float, int]]] = {}
    for number, event in enumerate(events, 1):
        if event.get("ph") not in ("X", "B", "E"):
            skipped += 1
            continue
        time, length = (_us(event.get(key, 0 if key == "dur" else None)) for key in ("ts", "dur"))
        name = event.get("name", "") if event["ph"] != "E" else "-"
        if time is None or length is None or not isinstance(name, str) or not name or not name.isprintable():
            problems.rejected(number, f"event {told(json.dumps(event))} has no name, or no time from 0 to {LATEST:g} us")
            continue
        thread = threads.setdefault((repr(event.get("pid")), repr(event.get("tid"))), len(threads))
        begun = open_.setdefault(thread, [])
        if event["ph"] == "X":
            spans.append(_Span(thread, name, time, time + length, number))
        elif event["ph"] == "B":
            begun.append((name, time, number))
        elif begun:
            spans.append(_Span(thread, *begun.pop()[:2], time, number))
        else:
            problems.rejected(number, f"an end at {time:.15g} us has no begin")
    for thread, begun in open_.items():
        for name, time, number in begun:
            problems.repaired(
                number, f"begin of {told(name)} at {time:.15g} us has no end", "taken as open until the recording stopped"
            )
            spans.append(_Span(thread, name, time, None, number))
    if not spans:
        raise LogError(f"{title}: {len(events)} trace events, none of them a span (X, or B and E)")
    if len(threads) > MOST_CORE + 1:
        raise LogError(f"{title}: {len(threads)} threads; at most {MOST_CORE + 1} are read")
    notes = ["each thread is read as a core of its own: the file does not say on which one it ran"] if len(threads) > 1 else []
    trace = _of_spans(spans, len(threads))
    return trace, Report.of(title, len(threads), problems, "Chrome JSON", len(events), skipped=skipped, notes=notes)


def _us(value: Any) -> float | None:
    """A time in microseconds, None if it is none; some write numbers as text."""
    try:
        time = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return time if 0 <= time <= LATEST and not isinstance(value, bool) else None


def _of_spans(spans: list[_Span], threads: int) -> Trace:
    """The trace of spans; one within another of the same name on its thread gets the number of its depth: f, f#2."""
    spans.sort(key=lambda span: (span.thread, span.begin, -(math.inf if span.end is None else span.end), span.number))
    names: dict[str, int] = {}
    around: list[tuple[str, float]] = []
    last = -1
    named = []
    for thread, name, begin, stop, _ in spans:
        around = [(other, until) for other, until in around if until > begin] if thread == last else []
        depth = 1 + sum(other == name for other, _ in around)
        around.append((name, math.inf if stop is None else stop))
        last = thread
        named.append(names.setdefault(name if depth == 1 else f"{name}#{depth}", len(names)))
    if len(names) > MOST_NAMES:
        raise LogError(f"{len(names)} names; a recording has at most {MOST_NAMES}")
    closed = [place for place, span in enumerate(spans) if span.end is not None]
    times = [span.begin for span in spans] + [spans[place].end for place in closed]
    time = np.rint(np.array(times, float) * 1000).astype(np.int64)
    order = np.argsort(time, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    stamps = Stamps(
        line=order,
        time=time[order],
        name=np.array([*named, *(named[at] for at in closed)])[order],
        begin=(order < len(spans)),
        core=np.array([span.thread for span in spans] + [spans[at].thread for at in closed])[order],
    )
    ends = np.full(len(spans), -1)
    ends[closed] = place[len(spans) :]
    pairs = Pairs(begin=place[: len(spans)], end=ends, lost=np.empty(0, np.int64))
    return trace_of(stamps, pairs, list(names), threads > 1)
