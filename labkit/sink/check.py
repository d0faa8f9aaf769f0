"""One question and its answer: is this variant of the sink correct, and if not, what is the shortest way to a failure?"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from labkit.checks import whole
from labkit.sink.explorer import BUDGET, MOST_BUDGET, Watch, search
from labkit.sink.history import Step, history
from labkit.sink.machine import Machine
from labkit.sink.ring import Ring
from labkit.sink.variants import VARIANTS


@dataclass(frozen=True)
class Check:
    """The answer.

    Attributes:
        variant, schedule, ring, budget: the question.
        verdict: see `explorer.VERDICTS`.
        states: different states that were seen.
        steps: the shortest way to the failure; empty if there is none, or if it is not decided.
        loop: for a livelock, the number of the step with which the circle begins that the last step closes; else None.
    """

    variant: str
    schedule: str
    ring: Ring
    budget: int
    verdict: str
    states: int
    steps: tuple[Step, ...]
    loop: int | None

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        last = self.steps[-1] if self.steps else None
        where, held = (last.variable, last.value) if last else ("", "")
        match self.verdict:
            case "ok":
                return f"all {self.states} states are free of failures, and from each of them everything can still be sent"
            case "undecided":
                return f"not decided: there are more than the {self.budget} states of the budget"
            case "stale":
                old = "it was never written" if held == "never written" else f"it still holds {held}, which was sent before"
                return f"{where} is sent before its byte is stored: {old}"
            case "torn":
                return f"{held} is sent in the middle of another message"
            case "lost" if where.startswith("buf"):
                return f"{held} is sent, and what its producer wrote before it is not"
            case "lost":
                return "everything is written, and not everything will ever be sent"
            case "overwritten" if last and last.access == "write":
                return f"{last.before} is not yet sent when {held} is written over it"
            case "overwritten":
                return f"{held} is sent from a slot that another producer has claimed and whose element it has destroyed"
            case "assert":
                return "an assertion fails: the machine stops"
            case "deadlock":
                return "all who are not through wait for each other, and no tick changes that"
        return f"steps {self.loop} to {len(self.steps)} repeat for ever: who is waited for does not get the processor"

    def as_dict(self) -> dict[str, Any]:
        """For JSON: the question, `verdict`, `reason`, `states`, the number of `steps`, and the steps as `counterexample`."""
        return {
            "variant": self.variant,
            "schedule": self.schedule,
            **asdict(self.ring),
            "budget": self.budget,
            "verdict": self.verdict,
            "reason": self.reason,
            "states": self.states,
            "steps": len(self.steps),
            "loop": self.loop,
            "counterexample": [{**asdict(step), "text": str(step)} for step in self.steps],
        }

    def __str__(self) -> str:
        lines = [f"{self.variant}, {self.schedule}: {self.verdict} ({self.states} states)", f"    {self.reason}"]
        for step in self.steps:
            seen = f"   (written by step {step.source})" if step.source else ""
            lines.append(f"    {step.number:3} {step}{seen}")
        return "\n".join(lines)


def check_sink(
    variant: str,
    ring: Ring | None = None,
    schedule: str = "free",
    budget: int = BUDGET,
    watch: Watch = lambda states, budget: states,
) -> Check:
    """Looks at every interleaving of `variant`.

    Args:
        variant: a name in `VARIANTS`.
        ring: its sizes and its work; without it `default_ring`.
        schedule: see `Machine`.
        budget: states after which the search stops with "undecided".
        watch: see `explorer.Watch`: for whoever shows how far the search is, or wants to end it.

    Raises:
        ValueError: there is no such variant or schedule; the budget is none.
    """
    whole(budget, 1, "the budget of states", MOST_BUDGET)
    machine = Machine(variant, ring or default_ring(variant), schedule)
    found = search(machine, budget, watch)
    steps = history(machine, found.schedule)
    loop = None if found.loop is None else found.loop + 1
    return Check(variant, schedule, machine.ring, budget, found.verdict, found.states, steps, loop)


def sample_run(variant: str, ring: Ring, schedule: str = "free", most: int = 400, seed: int = 1) -> tuple[Step, ...]:
    """A run drawn at random, until all is sent, or a failure, or after `most` steps: what a variant without failures looks like.

    Raises:
        ValueError: there is no such variant or schedule.
    """
    machine, chance, order = Machine(variant, ring, schedule), np.random.default_rng(seed), list[int]()
    state, wrong = machine.initial, ""
    while not wrong and len(order) < most and not machine.finished(state):
        able = machine.can_step(state)
        if not able:
            break
        order.append(int(chance.choice(able)))
        state, wrong = machine.step(state, order[-1])
    return history(machine, order)


def default_ring(variant: str, **changes: Any) -> Ring:
    """Two slots and two producers of two messages, with changes (None is none).

    Messages are as long as the variant needs to show what it is about; indices count to eight times the capacity, a multiple
    of it as on the target.
    """
    known = VARIANTS.get(variant)
    given = {"bytes": known.bytes if known else 1, **{name: value for name, value in changes.items() if value is not None}}
    if "modulus" not in given and isinstance(given.get("capacity"), int):
        given["modulus"] = 8 * max(1, given["capacity"])
    return replace(Ring(), **given)
