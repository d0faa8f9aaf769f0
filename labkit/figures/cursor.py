"""A time cursor: a line through all panels of a picture, and what happens there in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from labkit.figures.history import EXCEPTION, History
from labkit.figures.style import INK, Spec
from labkit.trace import OVERHEADS, Trace, overheads

#: Rows of a trace of which a picture shows all, so that what is asked for here is known already.
SHORT = 5000


def cursor(at: float, yref: str = "paper") -> Spec:
    """The line, as a shape of the picture whose panels share their x axis, or with "y domain" as one of a panel."""
    line = {"color": INK, "width": 1.5, "dash": "dash"}
    return {"type": "line", "xref": "x", "yref": yref, "x0": at, "x1": at, "y0": 0, "y1": 1, "line": line}


def happening(trace: Trace | History, tasks: Sequence[str], at: float, labels: Mapping[str, str] | None = None) -> str:
    """What every one of these tasks does at a time: `H waits for S; M is ready; L runs and holds S`.

    Args:
        trace: of any scheduler of the lab.
        tasks: those that are spoken of.
        at: ms from the start of the trace. A task that begins something at this instant does it already.
        labels: what a task is called, where that is not its name.
    """
    history = trace if isinstance(trace, History) else History(trace)
    trace = history.trace
    now = trace.start + round(at * trace.hz / 1e3)
    if now >= trace.end:
        return "the end of what was simulated"
    known = {trace.names.index(name): (labels or {}).get(name, name) for name in tasks if name in trace.names}
    part = history if len(trace) <= SHORT else history.part(known, now, now + 1)
    events = {"is released": part.releases, "misses its deadline": part.misses, "is aborted": part.aborts}
    said = []
    for task, name in known.items():
        words = [what for what, table in events.items() if np.any((table[:, 0] == task) & (table[:, -1] == now))]
        words += [_running(row) for row in _at(part.runs, task, now)]
        words += [f"waits for {_object(trace, row[1])}" for row in _at(part.waits, task, now)]
        words += ["is ready"] if len(_at(part.ready, task, now)) else []
        words += [f"holds {_object(trace, row[1])}" for row in _at(history.holds, task, now)]
        if words:
            said.append(f"{name} {' and '.join(words)}")
    if said:
        return "; ".join(said)
    kernel = overheads(trace)
    kernel = kernel[(kernel[:, 1] <= now) & (now < kernel[:, 2])]
    return f"the kernel works ({OVERHEADS[kernel[0, 0]]})" if len(kernel) else "idle"


def _at(table: np.ndarray, task: int, now: int) -> np.ndarray:
    """Rows of intervals of the task that hold the instant."""
    return table[(table[:, 0] == task) & (table[:, -2] <= now) & (now < table[:, -1])]


def _running(row: np.ndarray) -> str:
    return "runs its exception part" if row[1] == EXCEPTION else "runs"


def _object(trace: Trace, at: int) -> str:
    return trace.names[at] if at >= 0 else "a notification"
