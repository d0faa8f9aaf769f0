"""Spans: from begin to end of a task's run or of a scope, how they nest, and what each used for itself.

A log and a simulation meet here: both become begin and end events, so one set of statistics and one picture serve both.
"""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from labkit.trace.kinds import CODE
from labkit.trace.trace import Trace

if TYPE_CHECKING:
    import pandas as pd


#: The name of what the kernel does for itself: ticks, switches, services, interrupts.
KERNEL = "(kernel)"


class Pairs(NamedTuple):
    """Positions of matching events: `begin[i]` (-1: before the recording) belongs to `end[i]` (-1: after it)."""

    begin: np.ndarray
    end: np.ndarray
    lost: np.ndarray  # positions of events whose partner is missing in the middle of the recording


class Nesting(NamedTuple):
    """Per span: index of the enclosing span (-1: none), number of spans around it, and time used by itself alone."""

    parent: np.ndarray
    depth: np.ndarray
    self: np.ndarray


def pair(name: np.ndarray, begin: np.ndarray) -> Pairs:
    """Match each begin with the next event of the same name, if that is an end.

    A name whose first event is an end was open when the recording started, one whose last event is a begin was open
    when it stopped: these spans are cut. Any other begin or end without a partner is lost. A name does not nest in
    itself, because a lost end is far more common in a log than a recursive scope.

    Args:
        name, begin: arrays of shape (n,), the events in order of time; `begin` is True for a begin.
    """
    order = np.argsort(name, kind="stable").astype(_small(len(name)))
    sorted_name, opens = name[order], begin[order].astype(bool)
    change = sorted_name[1:] != sorted_name[:-1]
    first = np.concatenate([[True], change])[: len(order)]
    last = np.concatenate([change, [True]])[-len(order) :] if len(order) else first
    ended = np.zeros(len(order), bool)  # a begin directly followed by an end of its own name
    ended[:-1] = opens[:-1] & ~opens[1:] & ~change
    closing = np.zeros(len(order), bool)
    closing[1:] = ended[:-1]
    before, after = ~opens & first, opens & last
    at = np.flatnonzero(ended)
    lost = ~(ended | closing | before | after)
    outside = np.full(max(before.sum(), after.sum()), -1, order.dtype)
    return Pairs(
        begin=np.concatenate([order[at], outside[: before.sum()], order[after]]),
        end=np.concatenate([order[at + 1], order[before], outside[: after.sum()]]),
        lost=np.sort(order[lost]),
    )


def nest(name: np.ndarray, opened: np.ndarray, closed: np.ndarray, begin: np.ndarray, end: np.ndarray) -> Nesting:
    """Who encloses whom on one core, and exclusive times.

    The innermost open span owns the CPU. When a span ends while others inside it are still open, and the same name begins
    again before they end, then it was a task switched out in the middle of its scopes: they sleep until it runs again.

    Args:
        name: per span, shape (n,).
        opened, closed: per span the order of its begin and end among all events; equal keys are begins before the recording
            or ends after it, which open outermost first and close innermost first.
        begin, end: per span, times.
    """
    count = len(name)
    small = _small(4 * count)  # of a large log every array here is tens of megabytes
    tie = np.concatenate([closed, opened])
    order: np.ndarray = np.lexsort((np.negative(tie, out=tie), np.concatenate([opened, closed]))).astype(small)
    del tie
    is_end = order >= count
    order[is_end] -= count
    span = order
    level: np.ndarray = np.cumsum(np.where(is_end, np.int8(-1), np.int8(1)), dtype=small)
    level += is_end  # of a span at its begin and its end
    by_level = np.argsort(level, kind="stable").astype(small)
    opening, closing = by_level[0::2], by_level[1::2]  # on one level begins and ends take turns
    parent: np.ndarray = np.full(count, -1, small)
    depth: np.ndarray = np.zeros(count, small)
    at = level[opening]
    depth[span[opening]] = at - 1
    inner = np.flatnonzero(at > 1)
    if len(inner):
        key = at * np.int64(2 * count)
        key += opening
        around = np.searchsorted(key, key[inner] - 2 * count) - 1  # the latest begin one level up
        parent[span[opening[inner]]] = span[opening[around]]
        del key, around
    del at, inner
    own = end - begin
    enclosed = np.flatnonzero(parent >= 0)
    np.subtract.at(own, parent[enclosed], end[enclosed] - begin[enclosed])

    crossed = span[opening] != span[closing]
    if crossed.any():  # what ends in another order than it began is walked through, from idle to idle
        stretch = np.cumsum((level == 1) & ~is_end)
        begun_in = np.empty(count, np.int64)
        begun_in[span[opening]] = stretch[opening]
        some = np.flatnonzero(np.isin(begun_in, stretch[opening[crossed]]))
        walked = _walk(*(column[some] for column in (name, opened, closed, begin, end)))
        parent[some] = np.where(walked.parent >= 0, some[walked.parent], -1)
        depth[some], own[some] = walked.depth, walked.self
    return Nesting(parent, depth, own)


def _small(most: int) -> type[np.int32] | type[np.int64]:
    """The smaller type of integers in which numbers up to `most` fit."""
    return np.int32 if most < 1 << 31 else np.int64


def _walk(name: np.ndarray, opened: np.ndarray, closed: np.ndarray, begin: np.ndarray, end: np.ndarray) -> Nesting:
    """`nest` event by event, with a stack of open spans."""
    count = len(name)
    key = np.concatenate([opened, closed])
    tie = -np.concatenate([closed, opened])
    order = np.lexsort((tie, key))
    place = np.empty(2 * count, np.int64)
    place[order] = np.arange(2 * count)
    close = _compact(place[count:])

    by_name = np.lexsort((opened, name))  # the next span of the same name
    again_at = np.full(count, 2 * count)
    same = name[by_name[1:]] == name[by_name[:-1]]
    again_at[by_name[:-1][same]] = place[by_name[1:][same]]
    again, names = _compact(again_at), _compact(name)

    parent, depth, own = (array("q", bytes(8 * count)) for _ in range(3))
    stack: list[int] = []
    asleep: dict[int, list[int]] = {}
    before = 0
    for event, now in zip(_compact(order), _compact(np.concatenate([begin, end])[order]), strict=True):
        s = event % count
        if stack:
            own[stack[-1]] += now - before
        before = now
        if event < count:
            parent[s] = stack[-1] if stack else -1
            depth[s] = len(stack)
            stack.append(s)
            if asleep:
                stack += asleep.pop(names[s], [])
        elif stack and stack[-1] == s:
            stack.pop()
        elif s not in stack:  # it ends in its sleep
            asleep = {name: [c for c in inner if c != s] for name, inner in asleep.items()}
        else:
            at = stack.index(s)
            inside = stack[at + 1 :]
            stack[at:] = [c for c in inside if close[c] < again[s]]
            if sleeping := [c for c in inside if close[c] > again[s]]:
                asleep[names[s]] = sleeping
    return Nesting(*(np.frombuffer(column, np.int64) if count else np.empty(0, np.int64) for column in (parent, depth, own)))


def _compact(values: np.ndarray) -> array[int]:
    """An array to be read one by one, faster than numpy's and smaller than a list."""
    return array("q", values.astype(np.int64).tobytes())


def spans(trace: Trace) -> pd.DataFrame:
    """One row per span of a log or a simulation, in order of `start`.

    Begin and end rows give one span per pair; `switch` rows give one span per run of a task on the CPU, from when it is switched
    in to when another is (runs that used no time are left out); `overhead` rows give spans of the kernel itself, named `KERNEL`,
    inside the runs that they interrupt.

    Columns:
        name: task or scope; start, end: time units of the trace; duration: end - start.
        self: the part of the duration in which no span inside was open, and the task that the span belongs to was not
            switched out; the selfs of all spans never overlap.
        depth: number of spans open around it at its start (0: none).
        complete: False if the edge of the recording cut it, so that its true duration is unknown.
        core: its core, if the trace has several; spans of different cores are not nested in each other.
    """
    import pandas as pd

    tables = {core: span_table(part) for core, part in trace.cores().items()}
    table = {key: np.concatenate([some[key] for some in tables.values()]) for key in next(iter(tables.values()))}
    order = np.lexsort((table["depth"], table["opened"], table["start"]))
    columns = {key: table[key][order] for key in ("start", "end", "duration", "self", "depth", "complete")}
    if trace.core is not None:
        columns["core"] = np.repeat(list(tables), [len(some["name"]) for some in tables.values()])[order]
    names = np.array([*trace.names, KERNEL], dtype=object)[table["name"][order]]
    return pd.DataFrame({"name": pd.Series(names, dtype=object), **columns})


def span_table(trace: Trace) -> dict[str, np.ndarray]:
    """The columns of `spans` of one core as arrays, in no order; names as codes, the kernel's being one more than there are."""
    runs = _runs(trace)
    kinds = [spans for spans in (runs, _overheads(trace), _paired(trace)) if len(spans[0])] or [runs]
    name, opened, closed, begin, end, complete = (
        np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in zip(*kinds, strict=True)
    )
    nesting = nest(name, opened, closed, begin, end)
    return {
        "name": name,
        "start": begin,
        "end": end,
        "duration": end - begin,
        "self": nesting.self,
        "depth": nesting.depth,
        "complete": complete,
        "opened": opened,
        "closed": closed,
        "run": np.arange(len(name)) < len(runs[0]),
    }


def _paired(trace: Trace) -> tuple[np.ndarray, ...]:
    wanted = ((trace.kind == CODE["begin"]) | (trace.kind == CODE["end"])) & (trace.task >= 0)
    rows = slice(None) if wanted.all() else np.flatnonzero(wanted)  # of a log that is everything, and large
    time, owner = trace.time[rows], trace.other[rows]
    name = trace.task[rows].astype(np.int32)
    who = name if np.any(owner < 0) else trace.task[rows] * len(trace.names) + owner  # the kernel names the task
    pairs = pair(who, trace.kind[rows] == CODE["begin"])
    del owner, who
    cut_before, cut_after = pairs.begin < 0, pairs.end < 0
    opened, closed = (
        2 * (at if isinstance(rows, slice) else rows[at]).astype(_small(2 * len(trace) + 1)) + 1
        for at in (pairs.begin, pairs.end)
    )
    opened[cut_before], closed[cut_after] = -1, 2 * len(trace) + 1
    begin, end = time[pairs.begin], time[pairs.end]
    begin[cut_before], end[cut_after] = trace.start, trace.end
    return name[np.where(cut_before, pairs.end, pairs.begin)], opened, closed, begin, end, ~(cut_before | cut_after)


def _overheads(trace: Trace) -> tuple[np.ndarray, ...]:
    """They begin at their row and end before the first row that is not earlier than their end."""
    rows = np.flatnonzero((trace.kind == CODE["overhead"]) & (trace.value > 0))
    begin = trace.time[rows]
    end = np.minimum(begin + trace.value[rows], trace.end)
    closed = 2 * np.maximum(np.searchsorted(trace.time, end), rows + 1)
    return (np.full(len(rows), len(trace.names)), 2 * rows + 1, closed, begin, end, begin + trace.value[rows] <= trace.end)


def _runs(trace: Trace) -> tuple[np.ndarray, ...]:
    """From `switch` to `switch`; the end of one run (even key) comes before the begin of the next (odd key)."""
    rows = np.flatnonzero(trace.kind == CODE["switch"])
    last = np.ones(len(rows), bool)  # the last decision of an instant counts
    last[:-1] = trace.time[rows[1:]] > trace.time[rows[:-1]]
    rows = rows[last]
    task = trace.task[rows]
    change = np.ones(len(rows), bool)
    change[1:] = task[1:] != task[:-1]
    rows, task = rows[change], task[change]
    begin = trace.time[rows]
    end = np.append(begin[1:], trace.end)[: len(rows)]
    opened, closed = 2 * rows + 1, np.append(2 * rows[1:], 2 * len(trace) + 1)[: len(rows)]
    complete = np.ones(len(rows), bool)
    complete[-1:] = False
    if len(rows) and trace.other[rows[0]] == task[0]:
        complete[0] = False  # from itself: so a window and a recording say that the run began before
    keep = (task >= 0) & (end > begin)
    return tuple(column[keep] for column in (task, opened, closed, begin, end, complete))
