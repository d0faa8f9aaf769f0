"""Notebook 01: all callbacks of software timers run in one task, of one priority (rules 34 to 41 of the recorded kernel)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import refused
from labkit.figures import INK, VERMILION, History, Marks, Steps, axis, gantt, happening, stack, steps
from labkit.kernel import Kernel, Run

END = 60  # ms simulated
BEAT, REPORT, CONTROL = 5, 20, 10  # ms: periods of the two timers and of wheel_ctrl
CONTROL_PRIORITY, REPORT_PRIORITY = 3, 1
BY = {
    "callback": "the callback, which computes",
    "waiting callback": "the callback, which waits for it",
    "task": "a task that the callback notifies",
}


#: Rows of the picture, by the name in the trace.
ROWS = {"wheel_ctrl": "wheel_ctrl", "TIMER": "timer task", "report": "report"}
KEYS = ("ready", "waits for lock, queue, signal")
LATEST = 20  # ms: end of the axis
DUE: dict[str, Any] = {"symbol": "triangle-down", "colour": INK}
CALLED: dict[str, Any] = {"symbol": "triangle-down-open", "colour": INK}


@dataclass(frozen=True)
class Beats:
    """What became of the fast timer; times in ms.

    Attributes:
        history: who ran when.
        due, called: when each of its callbacks was due, and when it came.
        control: longest response of wheel_ctrl.
    """

    history: History
    due: np.ndarray
    called: np.ndarray
    control: float

    @property
    def late(self) -> np.ndarray:
        """How late each came."""
        return self.called - self.due


class TimerTask(Experiment[Beats]):
    """Which priority does the timer task need, and what may a callback do?

    A fast timer calls back every 5 ms and needs no time: the beat, which serves a watchdog, say. A slow one asks for a report
    every 20 ms. Both callbacks run in the timer task. The task wheel_ctrl works every 10 ms. The kernel itself takes no time.
    """

    headline: ClassVar[tuple[str, ...]] = ("latest beat", "beats at once", "wheel_ctrl, longest response")

    priority: Annotated[int, Interval(ge=1, le=5), Doc("of the timer task; wheel_ctrl has 3, report 1")] = 5
    report: Annotated[int, Interval(ge=1, le=8), Unit("ms"), Doc("what a report takes")] = 6
    made_by: Annotated[Literal["callback", "waiting callback", "task"], Labels(BY), Doc("who makes the report")] = "callback"
    control: Annotated[int, Interval(ge=1, le=5), Unit("ms"), Doc("work of wheel_ctrl, every 10 ms")] = 3
    at: Annotated[int, Interval(ge=0, le=END), Unit("ms"), View(play=True), Doc("a time to look at")] = 0

    def simulate(self) -> Run:
        k = Kernel(timer_priority=self.priority)

        def made(os: Any) -> Any:
            if self.made_by == "callback":
                yield os.compute(self.report * os.ms)
            elif self.made_by == "waiting callback":
                yield os.delay(self.report)
            else:
                yield os.notify_give(reporter)

        def reports(os: Any) -> Any:
            while True:
                yield os.notify_take()
                yield os.compute(self.report * os.ms)

        def control(os: Any) -> Any:
            while True:
                yield os.compute(self.control * os.ms)
                yield os.delay_until(CONTROL)

        k.timer("slow", REPORT, made, auto_reload=True, started=True)
        k.timer("beat", BEAT, lambda os: None, auto_reload=True, started=True)
        k.task("wheel_ctrl", control, CONTROL_PRIORITY, released=True)
        reporter = k.task("report", reports, REPORT_PRIORITY)
        return k.run(until=(END + REPORT) * k.ms)  # what is due in time has come by then

    def run(self) -> Beats:
        trace = self.simulate().trace
        ms = trace.hz / 1e3
        expired, completed = trace.rows("timer_expired"), trace.rows("complete")
        called = expired[expired[:, 3] == trace.code("beat"), 0] / ms
        due = np.arange(BEAT, END, BEAT, dtype=float)  # each is called once, in order, however late
        ends = completed[completed[:, 2] == trace.code("wheel_ctrl"), 0] / ms
        response = ends - CONTROL * np.arange(len(ends))
        return Beats(History(trace), due, called[: len(due)], float(response.max()))

    def figure(self, result: Beats) -> dict[str, Any]:
        rows = gantt(result.history, tuple(ROWS), 0, END, labels=ROWS)
        above = rows.y["tickvals"][1] + 0.4  # the timer task's row
        marks = [Marks("beat is due", result.due, above, **DUE), Marks("beat is called", result.called, above, **CALLED)]
        limit = Steps("the next one is due", np.zeros(1), np.full(1, BEAT), INK, "dot")
        some = result.late > 0
        late = Marks("how late it came", result.due[some], result.late[some], "circle", VERMILION)
        return stack(
            replace(rows, traces=[*rows.traces, *steps([], "", END, marks).traces]),
            steps([limit], "beat late [ms]", END, [late], top=LATEST, height=2.2),
            height=430,
            shared=axis("time [ms]", range=[0, END]),
            keys=KEYS,
            at=self.at,
            says=f"At {self.at} ms: {self.says(result)}.",
        )

    def says(self, result: Beats) -> str:
        """What happens at the time looked at, in words."""
        waiting = int(((result.due <= self.at) & (result.called > self.at)).sum())
        doing = happening(result.history, tuple(ROWS), self.at, ROWS)
        return f"{doing}. {waiting} beats are due and have not come"

    def metrics(self, result: Beats) -> list[Metric]:
        latest, together = float(result.late.max()), int(np.unique(result.called, return_counts=True)[1].max())
        work = f"of which {self.control} ms are work"
        return [
            Metric("latest beat", latest, "ms", good=latest < BEAT, note="after it was due; 5 ms later the next one is"),
            Metric("beats at once", together, "beats", good=together == 1, note="what has been missed is made up for"),
            Metric("wheel_ctrl, longest response", result.control, "ms", good=result.control <= CONTROL, note=work),
            Metric("beats that were late", int((result.late > 0).sum()), "beats", note=f"of {len(result.due)}"),
        ]


def check_prompt_beats(answer: TimerTask) -> Feedback:
    """Exercise 5: no beat late and wheel_ctrl never held up, with the same work, by priority and who makes the report."""
    wrong = refused(answer, TimerTask(), "priority", "made_by")
    if wrong:
        return wrong
    result = answer.run()
    late, held = float(result.late.max()), result.control - answer.control
    return Feedback(not late and not held, f"the latest beat is {late:g} ms late, and wheel_ctrl is held up for {held:g} ms.")
