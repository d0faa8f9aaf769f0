"""Device interrupts that are still to come, and which of them may interrupt what.

Priorities are those of a Cortex-M: 0 is the most urgent, LOWEST that of the tick. An interrupt preempts only what is less urgent:
tasks, and handlers of a higher number. A critical section holds back the numbers from the kernel's mask on, FreeRTOS's
configMAX_SYSCALL_INTERRUPT_PRIORITY; those below it are never held, and may not call the kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Any

from labkit.kernel.objects import FOREVER

Handler = Callable[[Any], Any]

LOWEST = 15  #: the priority of the tick, and of interrupts that are given none
TASKS = LOWEST + 1  #: what every interrupt preempts


@dataclass(frozen=True, slots=True)
class Device:
    """An interrupt: what it does, how often in cycles (None: once), how urgent it is, and the cycles its handler computes."""

    handler: Handler
    every: int | None = None
    priority: int = LOWEST
    cycles: int = 0


class Devices:
    """The interrupts to come.

    Attributes:
        lowest: heap of (cycle, order, device) of those of the lowest priority, which interrupt nothing but tasks.
        urgent: heap of the others.
    """

    __slots__ = ("_order", "lowest", "urgent")

    def __init__(self) -> None:
        self.lowest: list[tuple[int, int, Device]] = []
        self.urgent: list[tuple[int, int, Device]] = []
        self._order = 0

    def __bool__(self) -> bool:
        return bool(self.lowest or self.urgent)

    def add(self, at: int, device: Device) -> None:
        """An interrupt at a cycle; those of one instant and priority keep the order in which they were added."""
        self._order += 1
        heappush(self.lowest if device.priority == LOWEST else self.urgent, (at, self._order, device))

    def next_urgent(self, below: int) -> int:
        """The cycle of the first interrupt of a priority below that number, the lowest ones apart; FOREVER if there is none."""
        return min((at for at, _, device in self.urgent if device.priority < below), default=FOREVER)

    def take_urgent(self, now: int, below: int) -> tuple[int, int, Device] | None:
        """The most urgent one that is due and of a priority below that number, the lowest ones apart."""
        due = [entry for entry in self.urgent if entry[0] <= now and entry[2].priority < below]
        if not due:
            return None
        first = min(due, key=lambda entry: (entry[2].priority, *entry[:2]))
        self.urgent.remove(first)
        heapify(self.urgent)
        return first

    def take_lowest(self) -> tuple[int, int, Device]:
        """The first of the lowest priority."""
        return heappop(self.lowest)
