"""Notebook 00: the first bench, three control tasks of the robot under rate-monotonic priorities, simulation beside analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Metric, View
from labkit.experiments.answers import refused
from labkit.figures import History, axis, gantt, happening, stack
from labkit.kernel import Kernel, Run
from labkit.scheduler import PeriodicTask, response_times, utilization
from labkit.trace import jobs

PRIORITY = {"wheel_ctrl": 3, "odometry": 2, "pose_ctrl": 1}
HORIZON, SHOWN = 240, 80  # ms simulated, where the least common multiple of the periods may be longer; ms in the picture


@dataclass(frozen=True)
class Schedule:
    """Who ran when; for each task, in ms, the longest response (None: no job ended) and its bound (None: it overloads)."""

    history: History
    longest: dict[str, float | None]
    bound: dict[str, float | None]


class ThreeTasks(Experiment[Schedule]):
    """Does every job finish before the next one comes?

    Three control tasks with the robot's names, the shorter the period the higher the priority. All start at 0, which is the worst
    case, so the longest response of the simulation is the one that response-time analysis computes.
    """

    headline: ClassVar[tuple[str, ...]] = ("utilisation", "odometry, longest response", "pose_ctrl, longest response")

    wheel_work: Annotated[
        float, Interval(ge=0.5, le=9.5), MultipleOf(0.5), Unit("ms"), Doc("work of each job of wheel_ctrl, period 10 ms")
    ] = 3.0
    odometry_work: Annotated[
        float, Interval(ge=0.5, le=19.5), MultipleOf(0.5), Unit("ms"), Doc("work of each job of odometry, period 20 ms")
    ] = 5.0
    pose_work: Annotated[float, Interval(ge=0.5, le=39.5), MultipleOf(0.5), Unit("ms"), Doc("work of each job of pose_ctrl")] = (
        9.0
    )
    pose_period: Annotated[int, Interval(ge=20, le=60), Unit("ms"), Doc("period of pose_ctrl")] = 40
    at: Annotated[float, Interval(ge=0, le=SHOWN), MultipleOf(0.5), Unit("ms"), View(play=True), Doc("a time to look at")] = 0.0

    def tasks(self, us: int = 1) -> list[PeriodicTask]:
        """The task set in priority order, in units of a microsecond (or `us` of a finer unit each)."""
        work = {"wheel_ctrl": self.wheel_work, "odometry": self.odometry_work, "pose_ctrl": self.pose_work}
        period = {"wheel_ctrl": 10, "odometry": 20, "pose_ctrl": self.pose_period}
        return [
            PeriodicTask(name, round(work[name] * 1000) * us, period[name] * 1000 * us, deadline=10**9 * us) for name in PRIORITY
        ]

    def run(self) -> Schedule:
        k = Kernel()
        tasks = self.tasks()

        def body(task: PeriodicTask) -> Any:
            def forever(os: Any) -> Any:
                while True:
                    yield os.compute(task.wcet * os.us - 1)  # its last cycle is the call below, else a tick comes between the two
                    yield os.delay_until(task.period // 1000)

            return forever

        for task in reversed(tasks):
            k.task(task.name, body(task), PRIORITY[task.name], deadline=task.period * k.us, released=True)
        run = k.run(until=HORIZON * k.ms)
        bounds = response_times(tasks)
        return Schedule(
            History(run.trace), self._longest(run), {name: None if r is None else r / 1000 for name, r in bounds.items()}
        )

    @staticmethod
    def _longest(run: Run) -> dict[str, float | None]:
        found = jobs(run.trace)
        ended = found.response >= 0
        response = {name: found.response[ended & (found.task == run.trace.code(name))] for name in PRIORITY}
        return {name: float(times.max()) * 1e3 / run.trace.hz if len(times) else None for name, times in response.items()}

    def figure(self, result: Schedule) -> dict[str, Any]:
        return stack(
            gantt(result.history, tuple(PRIORITY), 0, SHOWN, title=f"The first {SHOWN} ms"),
            height=320,
            shared=axis("time [ms]", range=[0, SHOWN]),
            keys=("ready", "release", "deadline", "missed"),
            at=self.at,
            says=f"At {self.at:g} ms: {happening(result.history, tuple(PRIORITY), self.at)}.",
        )

    def metrics(self, result: Schedule) -> list[Metric]:
        load = float(utilization(self.tasks()))
        found = [
            Metric("utilisation", 100 * load, "%", good=load <= 1, note="above 100 % the lowest task falls behind without end")
        ]
        for task in self.tasks():
            bound, longest = result.bound[task.name], result.longest[task.name]
            found.append(
                Metric(
                    f"{task.name}, longest response",
                    longest,
                    "ms",
                    bound=bound,
                    good=bound is not None and bound <= task.period / 1000,
                    note=f"deadline {task.period // 1000} ms"
                    + ("" if bound is not None else "; no bound: it overloads")
                    + ("" if longest is not None else f"; no job ended in {HORIZON} ms"),
                )
            )
        return found

    def in_time(self) -> bool:
        """Whether analysis says that every job of every task ends by its next release."""
        bounds = response_times(tasks := self.tasks())
        return all((bound := bounds[task.name]) is not None and bound <= task.period for task in tasks)


def _most_work(answer: ThreeTasks, given: ThreeTasks) -> Feedback:
    """Whether pose_ctrl has the longest jobs with which everything is in time."""
    wrong = refused(answer, given, "pose_work")
    if wrong:
        return wrong
    if not answer.in_time():
        late = [f"{name} {'without end' if r is None else f'{r:g} ms'}" for name, r in answer.run().bound.items()]
        return Feedback(False, f"not everything is in time; longest responses: {', '.join(late)}.")
    longer = answer.replace(pose_work=answer.pose_work + 0.5)
    return Feedback(
        not longer.in_time(),
        f"everything is in time at {100 * float(utilization(answer.tasks())):.1f} % utilisation, "
        f"{'and still is' if longer.in_time() else 'and no longer'} with {longer.pose_work:g} ms.",
    )


def check_most_work(answer: ThreeTasks) -> Feedback:
    """Exercise 1: the longest job of pose_ctrl with which everything is in time."""
    return _most_work(answer, ThreeTasks())


def check_most_work_at_30(answer: ThreeTasks) -> Feedback:
    """Exercise 2: the same with a period of 30 ms, which is no multiple of the others."""
    return _most_work(answer, ThreeTasks(pose_period=30))
