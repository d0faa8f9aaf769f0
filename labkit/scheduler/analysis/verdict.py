"""What a schedulability test answers."""

from __future__ import annotations

from dataclasses import dataclass


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
    """The analysis would take more steps than it is allowed; it happens only at utilisations within a hair of 1."""
