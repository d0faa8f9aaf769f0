"""What a schedulability test answers, and how much work it may take to do so."""

from __future__ import annotations

from dataclasses import dataclass

#: Steps one analysis may take; a step looks at one task once, so that this is about a second.
MAX_STEPS = 4_000_000


@dataclass(frozen=True)
class Verdict:
    """Answer of a schedulability test; true in a condition if the set was accepted.

    Attributes:
        accepted: no job can miss its deadline.
        test: name of the test.
        why: one sentence with the figures that decided; a rejection names the task and says by how much.
        exact: a rejection proves that some arrival pattern the model allows misses a deadline. With False a rejection means
            "not proven".
    """

    accepted: bool
    test: str
    why: str
    exact: bool

    def __bool__(self) -> bool:
        return self.accepted


class UndecidedError(ValueError):
    """The analysis would take more than `MAX_STEPS`: at utilisations within a hair of 1, or for thousands of tasks."""


@dataclass
class Budget:
    """What is left of the steps that `analysis` may take."""

    analysis: str
    left: int = MAX_STEPS

    def spend(self, steps: int) -> None:
        """Take so many steps off; UndecidedError if there are not so many left."""
        self.left -= steps
        if self.left < 0:
            raise UndecidedError(f"{self.analysis}: undecided after {MAX_STEPS} steps")
