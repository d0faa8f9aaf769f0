"""Notebook 01, second half: what gets from one task to another, and what gets lost on the way (source 1, 2.1.1 and table 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, MultipleOf, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import refused
from labkit.figures import BLUE, INK, VERMILION, History, Marks, Steps, axis, cursor, gantt, happening, stack, steps
from labkit.kernel import Costs, Kernel, Run
from labkit.trace import CODE, Trace

WINDOW = 60  # ms simulated
FIRST, BURST = 1, 3000  # ms at which the first burst of interrupts begins; us of it that are shown
KEYS = ("ready", "waits for lock, queue, signal", "release")


def times(trace: Trace, *kinds: str) -> np.ndarray:
    """Times of the events of these kinds, in ms."""
    return trace.rows(*kinds)[:, 0] * (1e3 / trace.hz)


@dataclass(frozen=True)
class Delivery:
    """What became of the items: sent and received as (n, 2) arrays of (ms, item), and when one was dropped; who ran when."""

    history: History
    sent: np.ndarray
    received: np.ndarray
    dropped: np.ndarray


class QueueLab(Experiment[Delivery]):
    """Does every message arrive, and how old is it then?

    A producer sends a counter every few milliseconds, a consumer needs time for each item. The modes are those of the robot: the
    encoder overwrites a mailbox for the odometry, and sends without waiting to the wheel control.
    """

    headline: ClassVar[tuple[str, ...]] = ("dropped or overwritten", "oldest at receipt", "mean age at receipt")

    mode: Annotated[
        Literal["drop", "wait", "overwrite"],
        Labels({"drop": "send, drop when full", "wait": "send, wait for room", "overwrite": "overwrite a mailbox"}),
        Doc("what the producer does when the queue is full"),
    ] = "drop"
    length: Annotated[int, Interval(ge=1, le=12), Unit("items"), Doc("room in the queue (a mailbox always has 1)")] = 3
    produce_every: Annotated[int, Interval(ge=1, le=10), Unit("ms"), Doc("period of the producer")] = 2
    consume_in: Annotated[int, Interval(ge=1, le=10), Unit("ms"), Doc("work of the consumer for each item")] = 3
    urgent: Annotated[Literal["producer", "consumer"], Doc("which of the two has the higher priority")] = "producer"
    at: Annotated[float, Interval(ge=0, le=WINDOW), MultipleOf(0.5), Unit("ms"), View(play=True), Doc("a time to look at")] = 0.0

    def without_effect(self) -> Mapping[str, str]:
        return {"length": "for a queue; a mailbox has room for 1"} if self.mode == "overwrite" else {}

    def run(self) -> Delivery:
        k = Kernel()
        queue = k.queue("Q", 1 if self.mode == "overwrite" else self.length)

        def producer(os: Any) -> Any:
            for item in range(WINDOW):
                if self.mode == "overwrite":
                    yield os.overwrite(queue, item)
                else:
                    yield os.send(queue, item, timeout=0 if self.mode == "drop" else None)
                yield os.compute(os.ms // 10)
                yield os.delay_until(self.produce_every)

        def consumer(os: Any) -> Any:
            while True:
                yield os.receive(queue)
                yield os.compute(self.consume_in * os.ms)

        high, low = (2, 1) if self.urgent == "producer" else (1, 2)
        k.task("producer", producer, high)
        k.task("consumer", consumer, low)
        run = k.run(until=WINDOW * k.ms)

        def items(*kinds: str) -> np.ndarray:
            rows = run.trace.rows(*kinds)
            return np.stack([rows[:, 0] * (1e3 / run.trace.hz), rows[:, 5]], axis=1)

        return Delivery(History(run.trace), items("send", "overwrite"), items("recv"), times(run.trace, "send_fail"))

    def overwritten(self, result: Delivery) -> np.ndarray:
        """Times in ms at which a newer item replaced one before anybody had read it."""
        rows = result.history.trace.rows("overwrite")
        return rows[rows[:, 4] > 0, 0] * (1e3 / result.history.trace.hz)

    def lost(self, result: Delivery) -> np.ndarray:
        """Times in ms at which an item was lost, in whichever way."""
        return np.concatenate([result.dropped, self.overwritten(result)])

    def ages(self, result: Delivery) -> np.ndarray:
        """Age of each received item at its receipt in ms: from when the producer had it ready, period times number."""
        return result.received[:, 0] - result.received[:, 1] * self.produce_every

    def fill(self, result: Delivery) -> tuple[np.ndarray, np.ndarray]:
        """Times in ms and the items in the queue from then on."""
        rows = result.history.trace.rows("send", "overwrite", "recv")
        after = np.where(rows[:, 1] == CODE["recv"], rows[:, 4] - 1, rows[:, 4] + 1)
        after[rows[:, 1] == CODE["overwrite"]] = 1
        return np.append(0.0, rows[:, 0] * (1e3 / result.history.trace.hz)), np.append(0, after)

    def figure(self, result: Delivery) -> dict[str, Any]:
        when, fill = self.fill(result)
        room = 1 if self.mode == "overwrite" else self.length
        lost = Marks("lost", self.lost(result), room + 0.5, "x", VERMILION)
        items = [Steps("items in the queue", when, fill, BLUE), Steps("room", np.zeros(1), np.full(1, room), INK, "dot")]
        return stack(
            gantt(result.history, ("producer", "consumer"), 0, WINDOW),
            steps(items, "items", WINDOW, [lost], top=5 if room < 5 else 14, height=2.4),
            height=400,
            shared=axis("time [ms]", range=[0, WINDOW]),
            keys=KEYS,
            at=self.at,
            says=self.says(result, int(fill[np.searchsorted(when, self.at, side="right") - 1])),
        )

    def says(self, result: Delivery, waiting: int) -> str:
        """What happens at the time looked at, as a sentence."""
        got = result.received[result.received[:, 0] <= self.at]
        last = (
            f"Last received: item {got[-1, 1]:g}, {got[-1, 0] - got[-1, 1] * self.produce_every:.1f} ms old"
            if len(got)
            else "Nothing received yet"
        )
        doing = happening(result.history, ("producer", "consumer"), self.at)
        return f"At {self.at:g} ms: {doing}. {waiting} in the queue, {(self.lost(result) <= self.at).sum()} lost. {last}."

    def metrics(self, result: Delivery) -> list[Metric]:
        ages = self.ages(result)
        lost = len(self.lost(result))
        rate = 1000 / max(self.produce_every, self.consume_in)
        return [
            Metric("sent", len(result.sent), "items"),
            Metric("received", len(result.received), "items"),
            Metric("dropped or overwritten", lost, "items", good=not lost),
            Metric("oldest at receipt", float(ages.max()) if len(ages) else None, "ms"),
            Metric("mean age at receipt", float(ages.mean()) if len(ages) else None, "ms"),
            Metric("the slower side allows", rate, "items/s", note="in the long run no queue makes this larger"),
        ]


@dataclass(frozen=True)
class Service:
    """Events raised and served over time (ms), and the latency of each wake-up of the handler in us; who ran when."""

    history: History
    raised: np.ndarray
    served: np.ndarray
    counts: np.ndarray
    latencies: np.ndarray


MECHANISMS = {
    "binary": "binary semaphore",
    "counting": "counting semaphore, length 8",
    "notify_clear": "notification, take clears",
    "notify_decrement": "notification, take decrements",
}


class SignalLab(Experiment[Service]):
    """Semaphore or notification: what does an interrupt's signal cost, and can it get lost?

    A device interrupts in bursts; a handler task serves the events. The cost of a semaphore call is a parameter, the
    notification's is given relative to it: FreeRTOS's own documentation claims that unblocking by notification is up to 45 %
    faster, that is 1/1.45 of the time. Above the whole time, below the first burst.
    """

    headline: ClassVar[tuple[str, ...]] = ("lost", "interrupt to handler, idle CPU", "not yet served at the end")

    mechanism: Annotated[
        Literal["binary", "counting", "notify_clear", "notify_decrement"],
        Labels(MECHANISMS),
        Doc("how the interrupt tells the task"),
    ] = "binary"
    burst: Annotated[int, Interval(ge=1, le=10), Unit("events"), Doc("interrupts in a row, 100 us apart")] = 4
    burst_every: Annotated[int, Interval(ge=2, le=20), Unit("ms"), Doc("distance of the bursts")] = 10
    serve_in: Annotated[
        int, Interval(ge=100, le=3000), MultipleOf(100), Unit("us"), Doc("work of the handler for each event")
    ] = 600
    semaphore_call: Annotated[
        int, Interval(ge=100, le=2000), MultipleOf(50), Unit("cycles"), Doc("cost of a semaphore's give or take")
    ] = 400
    notification_faster: Annotated[
        int, Interval(ge=0, le=100), MultipleOf(5), Unit("%"), Doc("how much faster a notification's calls are")
    ] = 45
    at: Annotated[
        int, Interval(ge=0, le=BURST), MultipleOf(50), Unit("us"), View(play=True), Doc("a time in the first burst to look at")
    ] = 0

    def without_effect(self) -> Mapping[str, str]:
        return {} if self.notifies else {"notification_faster": "for a notification"}

    @property
    def notifies(self) -> bool:
        """Whether the mechanism is a notification."""
        return self.mechanism.startswith("notify")

    @property
    def call(self) -> int:
        """Cost of a give or take of the mechanism in cycles."""
        return round(self.semaphore_call / (1 + self.notification_faster / 100)) if self.notifies else self.semaphore_call

    def run(self) -> Service:
        notification, call = self.notifies, self.call
        # a give from an interrupt is charged with its entry; a take when it is called, so before the handler sleeps
        k = Kernel(costs=Costs(switch=200, service={"take": call, "notify_take": call}, isr_entry=100 + call, isr_exit=50))
        semaphore = k.counting("S", 8 if self.mechanism == "counting" else 1)
        clears = self.mechanism == "notify_clear"
        signal = [0]

        def handler(os: Any) -> Any:
            while True:
                if notification:
                    count = yield os.notify_take(clear=clears)
                    events = count if clears else 1
                else:
                    yield os.take(semaphore)
                    events = 1
                for _ in range(events):
                    signal[0] += 1
                    yield os.mark(signal[0])
                    yield os.compute(self.serve_in * os.us)

        task = k.task("handler", handler, 3)
        raised = []
        for start in range(FIRST, WINDOW, self.burst_every):
            for n in range(self.burst):
                raised.append(start * k.ms + n * 100 * k.us)
                k.interrupt(
                    raised[-1], (lambda isr: isr.notify_give(task)) if notification else (lambda isr: isr.give(semaphore))
                )
        run = k.run(until=WINDOW * k.ms)
        marks = run.trace.rows("mark")
        first = np.array([at for at in raised if (at - raised[0]) % (self.burst_every * k.ms) == 0])
        after = np.searchsorted(marks[:, 0], first)
        known = after < len(marks)
        ms = 1e3 / run.trace.hz
        idle = np.array([self._asleep(run, at) for at in first], dtype=bool)
        latencies = (marks[after[known], 0] - first[known])[idle[known]] * ms * 1e3
        return Service(History(run.trace), np.array(raised) * ms, marks[:, 0] * ms, marks[:, 4], latencies)

    @staticmethod
    def _asleep(run: Run, at: int) -> bool:
        """Whether nobody but the idle task ran at that time, so that the latency is the mechanism's and not the backlog's."""
        switches = run.trace.rows("switch")
        before = switches[switches[:, 0] < at]
        return len(before) > 0 and run.trace.names[before[-1, 2]] == "IDLE"

    def figure(self, result: Service) -> dict[str, Any]:
        lost = times(result.history.trace, "give_fail")
        lines = [
            Steps("raised", np.append(0.0, result.raised), np.arange(len(result.raised) + 1), INK),
            Steps("served", np.append(0.0, result.served), np.append(0, result.counts), BLUE),
        ]
        marks = Marks("lost", lost, np.searchsorted(result.raised, lost, side="right"), "x", VERMILION)
        begin, end = FIRST - 0.1, FIRST + BURST / 1000
        looked = [cursor(FIRST + self.at / 1000, "y domain")]
        whole, part = axis("", range=[0, WINDOW]), axis("time [ms]", range=[begin, end])
        tops = ((32, 100, 320), (6, 12, 25))  # of the counts, in all bursts and in what is shown of the first
        most = [
            next(top for top in some if top > (result.raised <= till).sum())
            for some, till in zip(tops, (WINDOW, end), strict=True)
        ]
        burst = steps(lines, "events", WINDOW, [marks], top=most[1], height=2.2, x=part, shapes=looked)
        named = [{**trace, "showlegend": False} for trace in burst.traces]
        return stack(
            replace(steps(lines, "events", WINDOW, [marks], top=most[0], height=2, x=whole), title="All bursts"),
            gantt(
                result.history.trace,
                ("handler",),
                begin,
                end,
                title="The first burst",
                x={**part, "visible": False},
                shapes=looked,
            ),
            replace(burst, traces=named),
            height=430,
            keys=KEYS[1:2],
            meta={"says": self.says(result, lost), "ended": self.at >= BURST},
        )

    def says(self, result: Service, lost: np.ndarray) -> str:
        """What happens at the time looked at, as a sentence."""
        now = FIRST + self.at / 1000
        counts = [int((when <= now + 1e-9).sum()) for when in (result.raised, result.served, lost)]
        doing = happening(result.history, ("handler",), now)
        said = f"{counts[0]} raised, {counts[1]} begun to be served, {counts[2]} lost"
        return f"At {now:g} ms, {self.at} us after the first interrupt: {doing}. {said}."

    def metrics(self, result: Service) -> list[Metric]:
        lost = len(result.history.trace.rows("give_fail"))
        waiting = len(result.raised) - len(result.served) - lost
        return [
            Metric("raised", len(result.raised), "events"),
            Metric("served", len(result.served), "events"),
            Metric("lost", lost, "events", good=not lost, note="the semaphore was full when the interrupt gave it"),
            Metric("not yet served at the end", waiting, "events"),
            Metric(
                "interrupt to handler, idle CPU",
                float(result.latencies.max()) if len(result.latencies) else None,
                "us",
                note="longest of the first events of a burst that found the CPU idle"
                if len(result.latencies)
                else "the handler never slept",
            ),
        ]


def check_shortest_queue(answer: QueueLab) -> Feedback:
    """Exercise 4: the shortest queue that loses nothing in 60 ms for a producer of 2 ms and a consumer of 3 ms."""
    wrong = refused(answer, QueueLab(), "length")
    if wrong:
        return wrong
    lost = len(answer.run().dropped)
    if lost:
        return Feedback(False, f"a queue of {answer.length} loses {lost} items.")
    shorter = answer.length > 1 and not len(QueueLab(length=answer.length - 1).run().dropped)
    more = "but a shorter one neither" if shorter else "and one less loses something"
    return Feedback(not shorter, f"a queue of {answer.length} loses nothing, {more}.")
