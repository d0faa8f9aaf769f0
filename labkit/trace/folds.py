"""Folds over a kernel's trace: who ran, who held, who waited, at which priority, from when to when.

Each returns an int64 array of shape (n, m), one row per interval, in order of start; an interval still open at the end of the
trace is cut there. Tasks, locks and queues are indices into `Trace.names`.
"""

from __future__ import annotations

import numpy as np

from labkit.trace.jobs import outside
from labkit.trace.kinds import CODE, STATES
from labkit.trace.trace import Trace

TAKE, DONE, READY, SUSPEND, PRIO_SET = CODE["take"], CODE["done"], CODE["ready"], CODE["suspend"], CODE["prio_set"]
BLOCKS = {CODE[kind] for kind in ("take_block", "send_block", "recv_block", "peek_block", "notify_take_block")}


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
    takes: dict[tuple[int, int], list[int]] = {}
    signals = set()
    rows = []
    for time, kind, task, lock, *_ in trace.rows("take", "give").tolist():
        if kind == TAKE:
            takes.setdefault((task, lock), []).append(time)
        elif takes.get((task, lock)):
            rows.append((task, lock, takes[task, lock].pop(), time))
        else:
            signals.add(lock)
    rows += [(task, lock, time, trace.end) for (task, lock), times in takes.items() if lock not in signals for time in times]
    return _table(rows, 4, by=2)


def waits(trace: Trace) -> np.ndarray:
    """Waiting for an object, columns (task, object, start, end): from the block to the moment the task is ready or suspended.

    A wait for a notification has object -1. A task that finds nothing when it retries (no hand-off) begins a new interval.
    """
    open_waits: dict[int, tuple[int, int]] = {}
    rows = []
    for time, kind, task, other, *_ in trace.rows().tolist():
        if kind in BLOCKS:
            open_waits[task] = other, time
        elif kind == READY and task in open_waits:
            rows.append((task, *open_waits.pop(task), time))
        elif kind == SUSPEND and other in open_waits:
            rows.append((other, *open_waits.pop(other), time))
    rows += [(task, target, start, trace.end) for task, (target, start) in open_waits.items()]
    return _table(rows, 4, by=2)


def ready(trace: Trace) -> np.ndarray:
    """Ready but not running, columns (task, start, end): preempted, sliced out, or not yet chosen."""
    since: dict[int, int] = {}
    running, rows = -1, []
    for time, kind, task, other, _, extra in trace.rows("ready", "switch", "suspend").tolist():
        if kind == CODE["switch"]:
            running = task
            if extra == STATES.index("ready") and other >= 0:
                since.setdefault(other, time)
        elif kind == CODE["ready"]:
            if task != running:
                since.setdefault(task, time)
            continue
        gone = task if kind == CODE["switch"] else other
        if since.get(gone, time) < time:
            rows.append((gone, since[gone], time))
        since.pop(gone, None)
    rows += [(task, start, trace.end) for task, start in since.items() if start < trace.end]
    return _table(rows, 3, by=1)


def priorities(trace: Trace) -> np.ndarray:
    """Current priorities as steps, columns (task, start, end, priority), from each task's creation to its end."""
    kinds = ("create", "ready", "switch", "inherit", "disinherit", "disinherit_timeout", "prio_set", "done")
    steps: dict[int, tuple[int, int]] = {}  # the open step of each task: since when, which priority
    rows = []
    for time, kind, task, other, value, extra in trace.rows(*kinds).tolist():
        if kind == PRIO_SET:
            task, value = other, extra
        since, priority = steps.get(task, (time, None))
        if kind != DONE and value == priority:
            continue
        if time > since:
            rows.append((task, since, time, priority))
        if kind == DONE:
            steps.pop(task, None)
        else:
            steps[task] = time, value
    rows += [(task, since, trace.end, priority) for task, (since, priority) in steps.items()]
    return _table(rows, 4, by=1)


def _table(rows: list[tuple[int, ...]], columns: int, by: int) -> np.ndarray:
    table = np.array(rows, dtype=np.int64).reshape(-1, columns)
    return table[np.argsort(table[:, by], kind="stable")]
