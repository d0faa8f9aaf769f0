"""Notebook 01: a task that holds two mutexes, and when it gives an inherited priority back (source 1, 2.1.1)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit
from typing_extensions import Doc

from labkit.experiment import Experiment, Feedback, Labels, Metric, View
from labkit.experiments.answers import refused
from labkit.experiments.contest import KEYS, Contest, raised_for_nobody
from labkit.experiments.priority_inversion import BASE
from labkit.figures import Panel, axis, held, lock_keys, stack
from labkit.kernel import Kernel, Run


class NestedMutexes(Experiment[dict[str, Contest]]):
    """When does FreeRTOS take an inherited priority back?

    L holds two mutexes, A and B; H wants A only. Above: FreeRTOS, which lets L drop only when it holds no mutex at all.
    Below: textbook inheritance, which drops as soon as nobody waits for what L still holds.
    """

    both: Annotated[int, Interval(ge=1, le=10), Unit("ms"), Doc("work of L while it holds A and B")] = 5
    second: Annotated[int, Interval(ge=1, le=15), Unit("ms"), Doc("work of L between its first and its second give")] = 8
    first_given: Annotated[
        Literal["A", "B"],
        Labels({"A": "A, the one H waits for", "B": "B, which nobody wants"}),
        Doc("which mutex L gives back first"),
    ] = "A"
    release_H: Annotated[int, Interval(ge=0, le=12), Unit("ms"), Doc("when H starts")] = 2
    release_M: Annotated[int, Interval(ge=0, le=12), Unit("ms"), Doc("when M starts")] = 4
    at: Annotated[int, Interval(ge=0, le=50), Unit("ms"), View(play=True), Doc("a time to look at, in both runs")] = 0

    def simulate(self, protocol: str) -> Run:
        """One run under a protocol of `Kernel.mutex`."""
        k = Kernel()
        a, b = k.mutex("A", protocol), k.mutex("B", protocol)
        first, last = (a, b) if self.first_given == "A" else (b, a)

        def low(os: Any) -> Any:
            yield os.take(a)
            yield os.take(b)
            yield os.compute(self.both * os.ms)
            yield os.give(first)
            yield os.compute(self.second * os.ms)
            yield os.give(last)
            yield os.compute(2 * os.ms)

        def middle(os: Any) -> Any:
            if self.release_M:
                yield os.delay_until(self.release_M)
            yield os.compute(4 * os.ms)

        def high(os: Any) -> Any:
            if self.release_H:
                yield os.delay_until(self.release_H)
            yield os.take(a)
            yield os.compute(3 * os.ms)
            yield os.give(a)

        for name, body in (("L", low), ("M", middle), ("H", high)):
            k.task(name, body, BASE[name])
        return k.run(until=self.horizon() * k.ms)

    def horizon(self) -> int:
        """Length of the run in ms: everybody has ended."""
        return max(self.release_H, self.release_M) + self.both + self.second + 2 + 4 + 3 + 1

    def run(self) -> dict[str, Contest]:
        simulated = {p: self.simulate(p) for p in ("freertos", "inheritance")}
        return {p: Contest.of(run, "M", self.release_M, raised_for_nobody(run.trace, BASE)) for p, run in simulated.items()}

    def figure(self, result: dict[str, Contest]) -> dict[str, Any]:
        titles = ("FreeRTOS: L drops at its last give", "Textbook inheritance: L drops when nobody waits")
        panels: list[Panel] = []
        for title, contest in zip(titles, result.values(), strict=True):
            panels += contest.panels(title, BASE, ("A", "B"), self.horizon(), f"responds after {contest.response:g} ms")
        says = ". ".join(
            f"{name}: {contest.doing(BASE, self.at)}"
            for name, contest in zip(("FreeRTOS", "Textbook"), result.values(), strict=True)
        )
        return stack(
            *panels,
            height=480,
            shared=axis("time [ms]", range=[0, held(self.horizon())]),
            keys=(*KEYS, *lock_keys(("A", "B")), "raised for nobody"),
            at=self.at,
            says=f"At {self.at} ms. {says}.",
        )

    def metrics(self, result: dict[str, Contest]) -> list[Metric]:
        ours, textbook = result["freertos"], result["inheritance"]
        high = {p: Contest.of(c.run, "H", self.release_H, c.wrong).response for p, c in result.items()}
        return [
            Metric("response of M, FreeRTOS", ours.response, "ms"),
            Metric("response of M, textbook", textbook.response, "ms"),
            Metric(
                "M delayed by the late drop", ours.response - textbook.response, "ms", good=ours.response <= textbook.response
            ),
            Metric("response of H, FreeRTOS", high["freertos"], "ms"),
            Metric(
                "response of H, textbook",
                high["inheritance"],
                "ms",
                note="H has the same priority as L until L drops: they share the CPU tick by tick",
            ),
        ]


def check_prompt_middle(answer: NestedMutexes) -> Feedback:
    """Exercise 3: keep L's work, but let M answer under FreeRTOS as early as under the textbook's protocol."""
    wrong = refused(answer, NestedMutexes(), "first_given")
    if wrong:
        return wrong
    late = answer.measure("M delayed by the late drop")
    return Feedback(late <= 0, f"the late drop costs M {late:g} ms.")
