"""Per-task statistics of a trace, recorded or simulated, and the table of them for reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labkit.trace.jobs import jobs
from labkit.trace.spans import KERNEL, span_table
from labkit.trace.trace import Trace, printable

if TYPE_CHECKING:
    import pandas as pd

#: The columns of `statistics` in order, with unit and meaning.
COLUMNS: dict[str, tuple[str, str]] = {
    "count": ("", "complete spans: runs of a task, passes through a scope"),
    "cut": ("", "spans cut by the edge of the recording, not in count, sum and durations"),
    "sum": ("us", "durations of the complete spans together"),
    "self": ("us", "exclusive time: without the spans inside and without preemption; together at most the recording"),
    "share": ("", "self / length of the recording"),
    "mean": ("us", "duration, mean"),
    "min": ("us", "duration, smallest observed"),
    "p50": ("us", "duration, median"),
    "p95": ("us", "duration, 95th percentile"),
    "p99": ("us", "duration, 99th percentile"),
    "max": ("us", "duration, largest observed: no guarantee that none is longer"),
    "self_mean": ("us", "exclusive time of a complete span, mean"),
    "self_max": ("us", "exclusive time of a complete span, largest observed"),
    "rate": ("1/s", "activations per second of the recording"),
    "period": ("us", "interval between consecutive activations, mean"),
    "jitter": ("us", "period jitter: largest |interval - median interval|"),
    "period_std": ("us", "standard deviation of the intervals"),
    "jobs": ("", "jobs with both a release and a completion (after an abort, that of the exception part)"),
    "response_mean": ("us", "response time, nominal release to completion, mean"),
    "response_p99": ("us", "response time, 99th percentile"),
    "response_max": ("us", "response time, largest observed: no guarantee"),
    "aborts": ("", "main parts aborted"),
    "misses": ("", "deadlines missed"),
}


def statistics(trace: Trace) -> pd.DataFrame:
    """Statistics per task and scope, and for the kernel itself where its costs are known; the same for logs and simulations.

    An activation is the start of a job where the trace has `release` rows (when the task first runs at or after the nominal
    release), otherwise the begin of a span. Response times need releases and completions; context switches alone cannot give
    them, so their columns are NaN for a log. Percentiles are nearest-rank: always a value that was observed.

    Complete spans count in everything. A run on the CPU that the edge of the recording cuts counts in `self` and `share`, since
    `switch` rows say who has the CPU; a begin without an end does not, since a lost line looks the same. Durations
    include preemption and the kernel's own time, `self` does not.

    An exception part has a row of its own for its time on the processor; its jobs are those of its task.

    Returns:
        A frame indexed by name, or by name and core if the trace has several, by falling `self`; its columns, units and
        meanings are in `COLUMNS` (times in microseconds). A value that the trace cannot tell is NaN.
    """
    import pandas as pd

    us = 1e6 / trace.hz
    names = [*trace.names, KERNEL]
    length = trace.end - trace.start
    cores = trace.cores()
    size = len(names) * len(
        cores
    )  # a row is a name on a core: its code is that of the name, plus len(names) for each core before
    tables, active, tasks = [], [], []
    for first, part in zip(range(0, size, len(names)), cores.values(), strict=True):
        table, done = span_table(part), jobs(part)
        begun, at = _activations(part, table)
        tables.append({**table, "name": table["name"] + first})
        active.append((begun + first, at))
        tasks.append((done.task + first, done))
    table = {key: np.concatenate([some[key] for some in tables]) for key in tables[0]}
    whole = table["complete"]
    name, duration, own = table["name"][whole], table["duration"][whole], table["self"][whole]
    durations, selfs = _Groups(name, duration, size), _Groups(name, own, size)
    known = whole | table["run"]
    total_self = np.bincount(table["name"][known], table["self"][known], size)

    active_name, active_time = (np.concatenate(column) for column in zip(*active, strict=True))
    activations = np.bincount(active_name, minlength=size)
    intervals = _intervals(active_name, active_time, size)
    median = intervals.median()
    deviation = _Groups(intervals.name, np.abs(intervals.value - median[intervals.name]), size)
    response = _Groups(
        np.concatenate([task[done.response >= 0] for task, done in tasks]),
        np.concatenate([done.response[done.response >= 0] for _, done in tasks]),
        size,
    )
    aborts = np.bincount(np.concatenate([task[done.abort >= 0] for task, done in tasks]), minlength=size)
    misses = np.bincount(np.concatenate([task[done.missed] for task, done in tasks]), minlength=size)

    frame = pd.DataFrame(
        {
            "count": durations.count,
            "cut": np.bincount(table["name"][~whole], minlength=size),
            "sum": durations.sum * us,
            "self": total_self * us,
            "share": total_self / length if length else np.full(size, np.nan),
            "mean": durations.mean() * us,
            "min": durations.rank(0) * us,
            "p50": durations.rank(0.50) * us,
            "p95": durations.rank(0.95) * us,
            "p99": durations.rank(0.99) * us,
            "max": durations.rank(1) * us,
            "self_mean": selfs.mean() * us,
            "self_max": selfs.rank(1) * us,
            "rate": activations * trace.hz / length if length else np.full(size, np.nan),
            "period": intervals.mean() * us,
            "jitter": deviation.rank(1) * us,
            "period_std": intervals.std() * us,
            "jobs": response.count,
            "response_mean": response.mean() * us,
            "response_p99": response.rank(0.99) * us,
            "response_max": response.rank(1) * us,
            "aborts": aborts,
            "misses": misses,
        },
        index=pd.MultiIndex.from_product([list(cores), names], names=["core", "name"]).swaplevel(),
    )
    if trace.core is None:
        frame.index = pd.Index(names, name="name", dtype=object)
    seen = np.bincount(table["name"], minlength=size) + activations + response.count + misses > 0
    return frame[seen].sort_values("self", ascending=False, kind="stable")


def describe(frame: pd.DataFrame) -> str:
    """The statistics as a table for reading: the main columns, without those that tell nothing here."""
    shown = frame.drop(columns=["self_mean", "self_max", "period_std"]).dropna(axis="columns", how="all")
    counts = ("count", "cut", "jobs", "aborts", "misses")
    shown = shown[[c for c in shown if c not in counts[1:] or shown[c].any()]]
    layout = ["{:.0f}" if c in counts else "{:.2%}" if c == "share" else "{:.1f}" for c in shown]
    shown = shown.rename(index=lambda name: printable(name) if isinstance(name, str) else name)
    text = shown.to_string(formatters=[column.format for column in layout], index_names=False, na_rep="")
    note = "times in us, rate per second; percentiles are observed values; a max is the largest observed, not a guarantee"
    return f"{text}\n{note}"


class _Groups:
    """Integers or floats grouped by name code, sorted within each group once, so that every statistic is one array operation."""

    def __init__(self, name: np.ndarray, value: np.ndarray, size: int):
        order = np.lexsort((value, name))
        self.name, self.value = name[order], value[order]
        self.count = np.bincount(name, minlength=size)
        self.sum = np.bincount(name, value, size)
        self._first = np.cumsum(self.count) - self.count

    def mean(self) -> np.ndarray:
        return np.divide(self.sum, self.count, out=np.full(len(self.count), np.nan), where=self.count > 0)

    def std(self) -> np.ndarray:
        """Population standard deviation; NaN for an empty group."""
        off = np.bincount(self.name, (self.value - self.mean()[self.name]) ** 2, len(self.count))
        return np.sqrt(np.divide(off, self.count, out=np.full(len(self.count), np.nan), where=self.count > 0))

    def rank(self, fraction: float) -> np.ndarray:
        """The smallest value that at least this fraction of the group does not exceed (nearest rank)."""
        at = self._first + np.maximum(np.ceil(fraction * self.count - 1e-9).astype(np.int64) - 1, 0)
        values = np.append(self.value.astype(float), np.nan)
        return values[np.where(self.count > 0, at, -1)]

    def median(self) -> np.ndarray:
        """The usual median: mean of the middle two."""
        values = np.append(self.value.astype(float), np.nan)
        low, high = self._first + (self.count - 1) // 2, self._first + self.count // 2
        return (values[np.where(self.count > 0, low, -1)] + values[np.where(self.count > 0, high, -1)]) / 2


def _activations(trace: Trace, table: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Name and time of each activation."""
    released = np.flatnonzero(trace.of("release") & (trace.task >= 0))
    task, release = trace.task[released], trace.value[released]
    periodic = np.isin(table["name"], task)
    begun = (table["opened"] >= 0) & ~periodic
    order = np.lexsort((table["end"][periodic], table["name"][periodic]))
    name, start, end = (table[key][periodic][order] for key in ("name", "start", "end"))  # runs of one task do not overlap
    moments, at = np.unique(np.concatenate([end, release]), return_inverse=True)
    key = name * len(moments) + at[: len(end)]
    run = np.searchsorted(key, task * len(moments) + at[len(end) :], side="right")  # the first that goes on after the release
    some = run < len(name)
    some[some] = name[run[some]] == task[some]
    started = np.maximum(start[run[some]], release[some])
    return np.concatenate([table["name"][begun], task[some]]), np.concatenate([table["start"][begun], started])


def _intervals(name: np.ndarray, time: np.ndarray, size: int) -> _Groups:
    order = np.lexsort((time, name))
    name, time = name[order], time[order]
    same = name[1:] == name[:-1]
    return _Groups(name[1:][same], np.diff(time)[same], size)
