"""A failure as one history: who did what to which variable, what was there, and which earlier step had written it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from labkit.sink.accesses import Kind
from labkit.sink.machine import Machine, State


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a history.

    Attributes:
        number: from 1.
        who: "P1", ..., "consumer", "DMA"; "tick" for what ends a sleep.
        access: "read", "write", "cas", "fetch-add"; "take" and "give" of a mutex or a notification; "disable" and "enable" of
            interrupts; "wake" by the tick; "assert".
        variable: what is accessed, as in "write", "buf[0]"; for "wake" who is woken; for "assert" empty.
        value: what was read or stored; elements of the ring by their label, as in "P1/2", or "never written".
        before: what the variable held before, where the access changes it (for a compare-and-swap that fails, `value`).
        succeeded: False for a compare-and-swap that fails and for an assertion.
        source: for what looks at the variable: number of the step that wrote what it saw, 0 for the first value. Else None.
    """

    number: int
    who: str
    access: str
    variable: str
    value: int | str | None
    before: int | str | None
    succeeded: bool
    source: int | None

    def __str__(self) -> str:
        match self.access:
            case "read":
                act = f"reads {self.variable}: {self.value}"
            case "write":
                act = f"writes {self.variable}: {self.value}"
            case "cas" if self.succeeded:
                act = f"compares and swaps {self.variable}: {self.before} -> {self.value}"
            case "cas":
                act = f"fails to compare and swap {self.variable}, which is {self.value}"
            case "fetch-add":
                act = f"adds to {self.variable}: {self.before} -> {self.value}"
            case "wake":
                act = f"wakes {self.variable}"
            case "assert":
                act = "fails its assertion"
            case "disable" | "enable":
                act = f"{self.access}s interrupts"
            case _:
                act = f"{self.access}s {self.variable}"
        return f"{self.who} {act}"


def history(machine: Machine, schedule: Sequence[int]) -> tuple[Step, ...]:
    """The steps of the threads in this order, from the first state on."""
    state, steps, writer = machine.initial, list[Step](), dict[int, int]()
    for number, thread in enumerate(schedule, 1):
        steps.append(_step(machine, state, thread, number, writer))
        state, _ = machine.step(state, thread)
    return tuple(steps)


def _step(machine: Machine, state: State, thread: int, number: int, writer: dict[int, int]) -> Step:
    """The step in words; `writer`, the last one who wrote each variable, is kept up to date."""
    node, who = machine.node(state, thread), machine.names[thread]
    kind, at, word = node.access.kind, node.variable, node.access.word
    if kind in (Kind.SLEEP, Kind.RELEASE):
        return Step(number, "tick", word, who, None, None, True, None)
    if kind == Kind.FAIL:
        return Step(number, who, word, "", None, None, False, None)
    looks = kind not in (Kind.WRITE, Kind.PUT)
    source = writer.get(at, 0) if looks else None
    after, _ = machine.step(state, thread)
    stores = kind not in (Kind.READ, Kind.TAKE)
    succeeded = kind != Kind.CAS or state[at] == node.a
    if stores and succeeded:
        writer[at] = number
    slot = node.access.variable.startswith("buf")
    before, value = (machine.ring.label(v) if slot else v for v in (state[at], after[at]))
    return Step(number, who, word, node.access.variable, value, before if stores and succeeded else None, succeeded, source)
