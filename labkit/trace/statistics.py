"""Per-task statistics of a trace, recorded or simulated, and the table of them for reading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from labkit.trace.jobs import Jobs, jobs
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
    "gaps": ("", "intervals of about two or more periods where most are regular: activations skipped, or their stamps lost"),
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
    length = (trace.end - trace.start) or np.nan
    cores = trace.cores()
    size = len(names) * len(cores)  # a row is a name on a core; its code is that of the name, and len(names) more per core
    tables, active, done = [], [], []
    for first, part in zip(range(0, size, len(names)), cores.values(), strict=True):
        table = span_table(part)
        table["name"] = table["name"] + np.int32(first) if first else table["name"]
        active.append(_activations(part, table, first))
        tables.append((table["name"], table["duration"], table["self"], table["complete"], table["run"]))
        del table  # of a large log this and what follows are hundreds of megabytes
        done.append((jobs(part), first))
    activations, of_activations = _of_activations(active, size)
    del active
    seen, of_spans = _of_spans(_joined(tables), size)
    count, of_jobs = _of_jobs(done, size)
    columns = {**of_spans, **of_activations, **of_jobs}
    columns["rate"] = activations * (trace.hz / length)
    columns["share"] = columns["self"] / length
    shown = np.flatnonzero(seen + activations + count + columns["misses"] > 0)
    shown = shown[np.argsort(-columns["self"][shown], kind="stable")]
    values = {name: columns[name][shown] * us if unit == "us" else columns[name][shown] for name, (unit, _) in COLUMNS.items()}
    core, name = divmod(shown, len(names))
    labels = np.array(names, dtype=object)[name]
    if trace.core is None:
        return pd.DataFrame(values, index=pd.Index(labels, name="name", dtype=object))
    return pd.DataFrame(values, index=pd.MultiIndex.from_arrays([labels, np.array([*cores])[core]], names=["name", "core"]))


def _of_spans(table: Sequence[np.ndarray], size: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """How many spans there are of each row, and the columns that come from name, duration, self, complete and run of them."""
    name, duration, own, whole, run = table
    known = whole | run
    columns = {"cut": np.bincount(name[~whole], minlength=size), "self": np.bincount(name[known], own[known], size)}
    durations = _Groups(name[whole], duration[whole], size)
    columns |= {"count": durations.count, "sum": durations.sum, "mean": durations.mean()}
    columns |= {key: durations.rank(q) for key, q in (("min", 0), ("p50", 0.50), ("p95", 0.95), ("p99", 0.99), ("max", 1))}
    del durations  # there may be millions of spans
    selfs = _Groups(name[whole], own[whole], size)
    return np.bincount(name, minlength=size), {**columns, "self_mean": selfs.mean(), "self_max": selfs.rank(1)}


def _of_activations(active: Sequence[tuple[np.ndarray, ...]], size: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """How many activations there are of each row, and the columns that come from name and time of them."""
    name, time = _joined(active)
    count = np.bincount(name, minlength=size)
    intervals = _intervals(name, time, size)
    median = intervals.median()
    jitter = np.fmax(intervals.rank(1) - median, median - intervals.rank(0))
    gaps = np.bincount(intervals.name[skipping(intervals.name, intervals.value, median)], minlength=size)
    return count, {"period": intervals.mean(), "jitter": jitter, "gaps": gaps, "period_std": intervals.std()}


def skipping(name: np.ndarray, interval: np.ndarray, median: np.ndarray) -> np.ndarray:
    """Which intervals are about two or more of the median interval of their name, to a quarter of it, where more than half of its
    intervals are about one: then it is periodic, and an activation was skipped or its stamp lost.

    Args:
        name, interval: shape (n,); median: by name.
    """
    regular = np.bincount(name[np.abs(interval - median[name]) <= median[name] / 4], minlength=len(median))
    periodic = (2 * regular > np.bincount(name, minlength=len(median))) & (median > 0)
    found = (interval > 1.5 * median[name]) & periodic[name]
    at = np.flatnonzero(found)
    usual = median[name[at]]
    found[at] = np.abs(interval[at] - np.rint(interval[at] / usual) * usual) <= usual / 4
    return found


def _of_jobs(done: list[tuple[Jobs, int]], size: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """How many jobs each row has that were released and completed, and the columns that come from the jobs of each core."""
    task, response, aborted, missed = _joined(
        [(some.task + first, some.response, some.abort >= 0, some.missed) for some, first in done]
    )
    responses = _Groups(task[response >= 0], response[response >= 0], size)
    columns = {"jobs": responses.count, "response_mean": responses.mean()}
    columns |= {"response_p99": responses.rank(0.99), "response_max": responses.rank(1)}
    columns |= {"aborts": np.bincount(task[aborted], minlength=size), "misses": np.bincount(task[missed], minlength=size)}
    return responses.count, columns


def _joined(parts: Sequence[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, ...]:
    """Columns of several cores as one; those of a single core as they are."""
    return parts[0] if len(parts) == 1 else tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def describe(frame: pd.DataFrame) -> str:
    """The statistics as a table for reading: the main columns, without those that tell nothing here."""
    shown = frame.drop(columns=["self_mean", "self_max", "period_std"]).dropna(axis="columns", how="all")
    counts = ("count", "cut", "gaps", "jobs", "aborts", "misses")
    shown = shown[[c for c in shown if c not in counts[1:] or shown[c].any()]]
    layout = ["{:.0f}" if c in counts else "{:.2%}" if c == "share" else "{:.1f}" for c in shown]
    shown = shown.rename(index=lambda name: printable(name) if isinstance(name, str) else name)
    text = shown.to_string(formatters=[column.format for column in layout], index_names=False, na_rep="")
    note = "times in us, rate per second; percentiles are observed values; a max is the largest observed, not a guarantee"
    if "gaps" in shown:
        note += "\ngaps: intervals of two or more periods; the jitter has them in it, so one lost stamp makes it a whole period"
    return f"{text}\n{note}"


class _Groups:
    """Integers or floats grouped by name code, sorted within each group once, so that every statistic is one array operation."""

    def __init__(self, name: np.ndarray, value: np.ndarray, size: int):
        order = np.lexsort((value, name)).astype(np.int32 if len(name) < 1 << 31 else np.int64)
        self.name, self.value = name[order], value[order]
        del order
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


def _activations(trace: Trace, table: dict[str, np.ndarray], first: int) -> tuple[np.ndarray, np.ndarray]:
    """Name, counted from `first` as those of the table, and time of each activation."""
    released = np.flatnonzero(trace.of("release") & (trace.task >= 0))
    if not len(released):
        begun: slice | np.ndarray = slice(None) if (table["opened"] >= 0).all() else table["opened"] >= 0
        return table["name"][begun], table["start"][begun]
    task, release = trace.task[released] + first, trace.value[released]
    periodic = np.isin(table["name"], task)
    begun = (table["opened"] >= 0) & ~periodic
    order = np.lexsort((table["end"][periodic], table["name"][periodic]))
    name, start, end = (table[key][periodic][order] for key in ("name", "start", "end"))  # runs of one task do not overlap
    moments, at = np.unique(np.concatenate([end, release]), return_inverse=True)
    name = name.astype(np.int64)
    key = name * len(moments) + at[: len(end)]
    run = np.searchsorted(key, task * len(moments) + at[len(end) :], side="right")  # the first that goes on after the release
    some = run < len(name)
    some[some] = name[run[some]] == task[some]
    started = np.maximum(start[run[some]], release[some])
    return np.concatenate([table["name"][begun], task[some]]), np.concatenate([table["start"][begun], started])


def _intervals(name: np.ndarray, time: np.ndarray, size: int) -> _Groups:
    order = np.lexsort((time, name)).astype(np.int32 if len(name) < 1 << 31 else np.int64)
    name = name[order]
    same = np.flatnonzero(name[1:] == name[:-1])
    name, interval = name[same], np.diff(time[order])[same]
    del order, same
    return _Groups(name, interval, size)
