"""The button that starts and stops the recording of stamps (S6): an interrupt, and contacts that bounce.

A contact that closes does so several times within a few milliseconds, and each time there is an interrupt. The handler takes
the first one and is deaf for the debounce time; each press it takes turns the recording on or off. Times in the text count from
the first stamp ever recorded.

Model's own: a contact that opens makes no interrupt, and the deaf time begins with the edge that was taken, not with the last.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from labkit.checks import whole

DEBOUNCE = 100  # ms, in the text of source 1; 50 in its public branch


@dataclass
class Button:
    """Off at first.

    Args:
        hz: times are in cycles of this clock. debounce: in ms.

    Attributes:
        edges: interrupts so far. taken: when the recording began, ended, began, ...
        zero: cycle of the first stamp recorded; None if there is none yet.
    """

    hz: int
    debounce: int = DEBOUNCE
    edges: int = 0
    taken: list[int] = field(default_factory=list)
    zero: int | None = None

    def __post_init__(self) -> None:
        whole(self.debounce, 0, "the debounce time of the button", 60_000)

    def edge(self, now: int) -> None:
        """An interrupt of the contact at cycle `now`."""
        self.edges += 1
        if not self.taken or now - self.taken[-1] >= self.debounce * self.hz // 1000:
            self.taken.append(now)

    def count_from(self, times: np.ndarray) -> int:
        """The cycle at which the text's times begin: that of the first stamp, which is among these if there was none before."""
        if self.zero is None and len(kept := times[self.recorded(times)]):
            self.zero = int(kept[0])
        return self.zero or 0

    def on(self, at: int) -> bool:
        """Whether what happens at cycle `at` is recorded."""
        return bisect_right(self.taken, at) % 2 == 1

    def recorded(self, times: np.ndarray) -> np.ndarray:
        """The same for many cycles."""
        return np.searchsorted(self.taken, times, side="right") % 2 == 1
