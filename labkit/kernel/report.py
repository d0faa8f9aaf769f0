"""The kernel's own reports, folded from the trace: run-time statistics and the task list, over a window or at an instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labkit.kernel.run import Run
from labkit.trace import CODE, overheads, runs

NAME_WIDTH = 15  # configMAX_TASK_NAME_LEN - 1
LETTERS = "RBSDX"  # in the order of labkit.trace.kinds.STATES
PRIORITY_KINDS = ("inherit", "disinherit", "disinherit_timeout", "prio_set")
SWITCH, READY, SUSPEND, DELETE, PRIO_SET = (CODE[kind] for kind in ("switch", "ready", "suspend", "delete", "prio_set"))


@dataclass(frozen=True)
class TaskTime:
    """CPU time of a task in cycles, and as a part (0 to 1) of the window."""

    name: str
    time: int
    share: float


@dataclass(frozen=True)
class RuntimeStats:
    """CPU time per task in order of creation; `str` of it is what vTaskGetRunTimeStats prints.

    Attributes:
        window: first cycle and the one after the last.
        tasks: one entry per task, and one named "kernel" if the kernel's own work costs time.
        switches: context switches in the window.
    """

    window: tuple[int, int]
    tasks: tuple[TaskTime, ...]
    switches: int

    def __str__(self) -> str:
        lines = []
        for task in self.tasks:
            percent = int(task.time * 100 // max(self.window[1] - self.window[0], 1))
            lines.append(f"{task.name:<{NAME_WIDTH}}\t{task.time}\t\t{percent or '<1'}%")
        return "\n".join(lines)


@dataclass(frozen=True)
class TaskState:
    """A task at an instant: `state` is X running, R ready, B blocked, S suspended or D ended; the priority is the current one."""

    name: str
    state: str
    priority: int
    stack_free: int | None
    number: int


@dataclass(frozen=True)
class TaskList:
    """All tasks at cycle `at`, ready ones first, as vTaskList orders them; `str` of it is what vTaskList prints."""

    at: int
    tasks: tuple[TaskState, ...]

    def __str__(self) -> str:
        lines = []
        for task in self.tasks:
            stack = "-" if task.stack_free is None else task.stack_free
            lines.append(f"{task.name:<{NAME_WIDTH}}\t{task.state}\t{task.priority}\t{stack}\t{task.number}")
        return "\n".join(lines)


def runtime_stats(run: Run, window: tuple[int, int] | None = None) -> RuntimeStats:
    """CPU time of each task within a window of cycles (None: the whole run), as vTaskGetRunTimeStats counts it.

    Errors: ValueError for a window outside the run.
    """
    start, end = window or (run.trace.start, run.trace.end)
    if not run.trace.start <= start < end <= run.trace.end:
        raise ValueError(f"window {start}..{end} is not inside the run {run.trace.start}..{run.trace.end}")

    def spent(intervals: np.ndarray) -> np.ndarray:
        return np.maximum(np.minimum(intervals[:, 2], end) - np.maximum(intervals[:, 1], start), 0)

    intervals = runs(run.trace)
    time = np.bincount(intervals[:, 0], weights=spent(intervals), minlength=len(run.trace.names)).astype(np.int64)
    times = {task.name: int(time[run.trace.code(task.name)]) for task in run.tasks}
    kernel = overheads(run.trace)
    if len(kernel):
        times["kernel"] = int(spent(kernel).sum())
    switches = run.trace.rows("switch")
    counted = (switches[:, 0] >= start) & (switches[:, 0] < end) & (switches[:, 3] >= 0)
    tasks = tuple(TaskTime(name, cycles, cycles / (end - start)) for name, cycles in times.items())
    return RuntimeStats((start, end), tasks, int(counted.sum()))


def task_list(run: Run, at: int | None = None) -> TaskList:
    """State and current priority of each task after all that happened at cycle `at` (None: at the end of the run)."""
    at = run.trace.end if at is None else at
    if not run.trace.start <= at <= run.trace.end:
        raise ValueError(f"cycle {at} is not inside the run {run.trace.start}..{run.trace.end}")
    state: dict[int, str] = {}
    priority: dict[int, int] = {}
    running = -1
    for time, kind, task, other, value, extra in run.trace.rows("switch", "ready", "suspend", "delete", *PRIORITY_KINDS).tolist():
        if time > at:
            break
        if kind in (SUSPEND, DELETE):
            state[other] = "S" if kind == SUSPEND else "D"
            continue
        if kind == PRIO_SET:
            task, value = other, extra
        if kind == READY:
            state[task] = "R"
        elif kind == SWITCH:
            state[other] = LETTERS[extra]  # the row says what became of the task switched out
            running = task
        priority[task] = value
    state[running] = "X"
    codes = {run.trace.code(info.name): info for info in run.tasks}
    tasks = [
        TaskState(info.name, state[code], priority[code], info.stack_free, info.number)
        for code, info in codes.items()
        if code in state  # it has been created by then
    ]
    return TaskList(at, tuple(sorted(tasks, key=lambda task: ("XRBSD".find(task.state) or 1, -task.priority, task.number))))


@dataclass(frozen=True)
class HeapStats:
    """The heap at cycle `at`: bytes free, the fewest free so far, blocks obtained and given back, requests that failed."""

    at: int
    free: int
    least: int
    obtained: int
    given_back: int
    failed: int


def heap_stats(run: Run, at: int | None = None) -> HeapStats:
    """What the real kernel's vPortGetHeapStats counts, at cycle `at` (None: at the end of the run).

    Errors: ValueError for a cycle outside the run, and for a run without a heap.
    """
    at = run.trace.end if at is None else at
    if not run.trace.start <= at <= run.trace.end:
        raise ValueError(f"cycle {at} is not inside the run {run.trace.start}..{run.trace.end}")
    rows = run.trace.rows("malloc", "malloc_failed", "free")
    rows = rows[rows[:, 0] <= at]
    if not len(rows):
        raise ValueError("the run has no heap; give the kernel one")
    counts = (int((rows[:, 1] == CODE[kind]).sum()) for kind in ("malloc", "free", "malloc_failed"))
    return HeapStats(at, int(rows[-1, 4]), int(rows[:, 4].min()), *counts)
