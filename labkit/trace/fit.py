"""What a recording tells of its tasks as parameters: worst execution time, period and jitter, as a scheduler wants them."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from labkit.trace.jobs import jobs, owners
from labkit.trace.spans import span_table
from labkit.trace.statistics import skipping
from labkit.trace.trace import Trace

#: An idle task competes with nobody: names that begin so are left out.
IDLE = ("idle", "<idle", "(idle")


@dataclass(frozen=True)
class Measured:
    """A task as it was observed; times in time units of the trace.

    Attributes:
        jobs: how many whole jobs were seen. activations: how many begin in the recording.
        c_max, c_p95: processor time of a job, largest and 95th percentile (nearest rank). No bound: a longer one may come.
        period: median interval between releases, or where the recording has none between begins.
        jitter: largest deviation from it, without gaps. gaps: intervals of two or more periods, see `statistics`.
    """

    name: str
    jobs: int
    activations: int
    c_max: int
    c_p95: int
    period: float
    jitter: float
    gaps: int


def measured(trace: Trace) -> tuple[list[Measured], dict[str, str]]:
    """The tasks of a trace of one core, and why other names are none.

    Jobs are those of the trace. Where it has no releases of a task, as in a log of stamps, every run counts as a job, scopes
    within it included. A task that is preempted then has several runs per job: its intervals are no periods, and it is left out.

    Raises:
        ValueError: the trace has several cores.
    """
    if trace.core is not None:
        raise ValueError(f"it has {len(trace.cores())} cores; choose one of {', '.join(map(str, trace.cores()))}")
    table, spans, owner = jobs(trace), span_table(trace), owners(trace)[0]
    whole = (table.release >= 0) & (table.completion >= 0)
    top = spans["complete"] & (spans["depth"] == 0)
    found, left = [], dict[str, str]()
    for code, name in enumerate(trace.names):
        mine = table.task == code
        if name.lower().startswith(IDLE):
            left[name] = "an idle task"
        elif owner[code] != code:
            left[name] = "an exception part, counted with its task"
        elif (table.release[mine] >= 0).any():
            used = (table.main + table.exception)[mine & whole]
            found.append(_task(name, used, np.sort(table.release[mine & (table.release >= 0)])))
        elif (top & (spans["name"] == code)).any():
            mine = spans["name"] == code
            begun = mine & (spans["opened"] >= 0) & (spans["depth"] == 0)
            found.append(_task(name, spans["duration"][mine & top], np.sort(spans["start"][begun])))
        elif (spans["name"] == code).any():
            left[name] = "a scope within a task, or never seen from begin to end"
    kept = []
    for task in found:
        if not task.jobs or task.activations < 3 or not task.period:
            left[task.name] = f"{task.activations} activations and {task.jobs} whole jobs, too few for a period"
        elif task.jitter >= task.period or task.c_max > task.period:
            left[task.name] = f"not periodic: the median interval is {task.period:g}, the jitter {task.jitter:g}"
        else:
            kept.append(task)
    return kept, left


def _task(name: str, used: np.ndarray, begins: np.ndarray) -> Measured:
    used, intervals = np.sort(used), np.diff(begins)
    median = float(np.median(intervals)) if len(intervals) else 0.0
    none = np.zeros(len(intervals), np.int64)
    gaps = skipping(none, intervals, np.array([median]))
    usual = intervals[~gaps]
    return Measured(
        name,
        jobs=len(used),
        activations=len(begins),
        c_max=int(used[-1]) if len(used) else 0,
        c_p95=int(used[ceil(0.95 * len(used)) - 1]) if len(used) else 0,
        period=median,
        jitter=float(np.abs(usual - median).max()) if len(usual) else 0.0,
        gaps=int(gaps.sum()),
    )
