"""Folds over a kernel's trace: who ran, who held, who waited, at which priority, from when to when.

Each returns an int64 array of shape (n, m), one row per interval, in order of start; an interval still open at the end of the
trace is cut there. Tasks, locks and queues are indices into `Trace.names`.
"""

from __future__ import annotations

import numpy as np

from labkit.trace.jobs import outside
from labkit.trace.kinds import STATES
from labkit.trace.trace import Trace

#: The kinds of events with which a task begins to wait for an object.
BLOCKS = (
    *("take_block", "send_block", "recv_block", "peek_block", "notify_take_block", "notify_wait_block", "select_block"),
    *("wait_bits_block", "sync_block", "timer_send_block"),
    *("stream_send_block", "stream_recv_block", "message_send_block", "message_recv_block"),
)
#: Those with which another task stops what a task does.
STOPS = ("suspend", "delete")


def runs(trace: Trace) -> np.ndarray:
    """Exclusive intervals on the CPU, columns (task, start, end), the idle task included.

    A task that runs on without time passing in between is one interval; time the kernel takes for itself is in none.
    """
    switches = trace.rows("switch")
    task, start = switches[:, 2], switches[:, 0]
    end = np.append(start[1:], trace.end)
    costs = trace.rows("overhead")
    if len(costs):
        kept, start, end = outside(start, end, costs[:, 0], costs[:, 0] + costs[:, 4])
        task = task[kept]
    some = end > start
    task, start, end = task[some], start[some], end[some]
    if not len(task):
        return np.empty((0, 3), dtype=np.int64)
    first = np.ones(len(task), dtype=bool)
    first[1:] = (task[1:] != task[:-1]) | (start[1:] != end[:-1])
    last = np.append(first[1:], True)
    return np.stack([task[first], start[first], end[last]], axis=1)


def overheads(trace: Trace) -> np.ndarray:
    """Intervals the kernel takes for itself, columns (cause, start, end); `labkit.trace.kinds.OVERHEADS` names the causes."""
    rows = trace.rows("overhead")
    return np.stack([rows[:, 5], rows[:, 0], np.minimum(rows[:, 0] + rows[:, 4], trace.end)], axis=1)


def holds(trace: Trace) -> np.ndarray:
    """Ownership of locks, columns (task, lock, start, end): from a take to the give by the same task.

    A take whose give has not come by the end counts only if no other task or interrupt ever gives that object: what one takes
    and another gives is a signal, and nobody holds it.
    """
    rows = np.flatnonzero(trace.of("take", "give"))
    owner = np.unique(_pairs(trace.task[rows], trace.other[rows]), return_inverse=True)[1]
    rows, owner = _by(owner, rows)
    takes = trace.of("take")[rows]
    step, first = np.where(takes, 1, -1), _first(owner)
    level = np.cumsum(step)
    level -= (level - step)[first][owner]  # each owner begins at 0
    span = 2 * len(rows) + 2
    floor = np.minimum.accumulate(level - owner * span) + owner * span  # the lowest of this owner so far, since owners rise
    foreign = ~takes & (level < 0) & ((level < np.append(1, floor[:-1])) | first)
    signals = np.isin(trace.other[rows], trace.other[rows[foreign]])
    depth = (level - np.minimum(floor, 0))[~foreign]  # after the event; of one depth a take and its give follow each other
    rows, owner, takes, signals = rows[~foreign], owner[~foreign], takes[~foreign], signals[~foreign]
    order = np.lexsort((rows, depth + ~takes, owner))
    rows, owner, takes, signals = rows[order], owner[order], takes[order], signals[order]
    given = np.append(~takes[1:], False)[: len(takes)]
    end = np.where(given, np.append(rows[1:], -1)[: len(rows)], -1)
    kept = takes & (given | ~signals)
    return _table(trace, (trace.task[rows[kept]], trace.other[rows[kept]]), rows[kept], end[kept])


def waits(trace: Trace) -> np.ndarray:
    """Waiting for an object, columns (task, object, start, end): from the block to when the task is ready, suspended or deleted.

    A wait for a notification has object -1. A task that finds nothing when it retries (no hand-off) begins a new interval.
    """
    blocks, ready, suspend = (np.flatnonzero(trace.of(*kinds)) for kinds in (BLOCKS, ("ready",), STOPS))
    if not len(blocks):
        return np.empty((0, 4), np.int64)
    opened = trace.task[blocks], blocks
    closed = np.concatenate([trace.task[ready], trace.other[suspend]]), np.concatenate([ready, suspend])
    task, begin, end = _intervals(opened, closed)
    return _table(trace, (task, trace.other[begin]), begin, end)


def ready(trace: Trace) -> np.ndarray:
    """Ready but not running, columns (task, start, end): preempted, sliced out, or not yet chosen."""
    switches, readied, suspended = (np.flatnonzero(trace.of(*kinds)) for kinds in (("switch",), ("ready",), STOPS))
    running = np.append(trace.task[switches], -1)[np.searchsorted(switches, readied) - 1]  # -1: before the first switch
    readied = readied[trace.task[readied] != running]
    out = switches[(trace.extra[switches] == STATES.index("ready")) & (trace.other[switches] >= 0)]
    opened = np.concatenate([trace.other[out], trace.task[readied]]), np.concatenate([out, readied])
    closed = np.concatenate([trace.task[switches], trace.other[suspended]]), np.concatenate([switches, suspended])
    task, begin, end = _intervals(opened, closed)
    table = _table(trace, (task,), begin, end)
    return table[table[:, 2] > table[:, 1]]


def priorities(trace: Trace) -> np.ndarray:
    """Current priorities as steps, columns (task, start, end, priority), from each task's creation to its end."""
    kinds = ("create", "ready", "switch", "inherit", "disinherit", "disinherit_timeout", "prio_set", "done", "delete")
    rows = np.flatnonzero(trace.of(*kinds))
    task = np.where(trace.of("prio_set", "delete")[rows], trace.other[rows], trace.task[rows])
    task, rows = _by(task[task >= 0], rows[task >= 0])[::-1]
    set_by_another, done = trace.of("prio_set")[rows], trace.of("done", "delete")[rows]
    priority = np.where(set_by_another, trace.extra[rows], trace.value[rows])
    same = np.zeros(len(rows), bool)
    same[1:] = (task[1:] == task[:-1]) & (priority[1:] == priority[:-1]) & ~done[1:] & ~done[:-1]
    task, rows, priority, done = task[~same], rows[~same], priority[~same], done[~same]
    going_on = np.append(task[1:] == task[:-1], False)[: len(task)]
    end = np.where(going_on, np.append(rows[1:], -1)[: len(rows)], -1)
    kept = ~done & ((end < 0) | (trace.time[end] > trace.time[rows]))
    table = _table(trace, (task[kept], priority[kept]), rows[kept], end[kept])
    return table[:, [0, 2, 3, 1]]


def _intervals(opened: tuple[np.ndarray, np.ndarray], closed: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, ...]:
    """Per task, from the first event that opens an interval to the next that closes it.

    Args:
        opened, closed: task and row of the events; one row may do both, and then opens first.

    Returns:
        (task, row of the opening, row of the closing or -1) of each interval.
    """
    task = np.concatenate([opened[0], closed[0]])
    key = np.concatenate([2 * opened[1], 2 * closed[1] + 1])
    key, task = _by(task, key)
    first, opens = _first(task), key % 2 == 0
    turn = first | np.append(True, opens[1:] != opens[:-1])[: len(key)]  # the first of several that do the same
    task, key, opens = task[turn], key[turn], opens[turn]
    shut = np.append((task[1:] == task[:-1]) & ~opens[1:], False)[: len(key)]
    end = np.where(shut, np.append(key[1:], -2)[: len(key)] // 2, -1)
    return task[opens], key[opens] // 2, end[opens]


def _by(group: np.ndarray, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys and groups in order of group, then key."""
    order = np.lexsort((key, group))
    return key[order], group[order]


def _first(group: np.ndarray) -> np.ndarray:
    """Which elements are the first of their group, in an array in order of group."""
    first = np.ones(len(group), bool)
    first[1:] = group[1:] != group[:-1]
    return first


def _pairs(task: np.ndarray, other: np.ndarray) -> np.ndarray:
    """One number for each pair of name codes, from -1."""
    return (task + 1) * (int(other.max(initial=0)) + 2) + other + 1


def _table(trace: Trace, columns: tuple[np.ndarray, ...], begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Columns, start and end of intervals given by rows, end -1 for the end of the trace, in order of start."""
    stop = np.where(end < 0, trace.end, np.append(trace.time, 0)[end])
    table = np.stack([*columns, np.append(trace.time, 0)[begin], stop], axis=1)
    last = np.where(end < 0, len(trace), end)
    return table[np.lexsort((begin, last, table[:, -2]))]
