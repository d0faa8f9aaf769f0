"""Loss of messages: a model makes a channel for each pair of sender and receiver, which says of each reception if it fails."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Protocol

import numpy as np

from labkit.checks import shown

#: Asked once for every reception, in order; True: lost.
Channel = Callable[[], bool]


class Loss(Protocol):
    """A model of loss."""

    def channel(self, sender: int, receiver: int, rng: np.random.Generator) -> Channel:
        """The channel from one station to another; `rng` is its own."""
        ...


@dataclass(frozen=True)
class Independent:
    """Every reception fails with the same probability, whatever happened before."""

    loss: float = 0.0

    def __post_init__(self) -> None:
        _probability(self.loss, "the loss")

    def channel(self, sender: int, receiver: int, rng: np.random.Generator) -> Channel:
        if self.loss in (0, 1):
            return lambda: bool(self.loss)
        following, loss = _uniform(rng).__next__, self.loss
        return lambda: following() < loss


@dataclass(frozen=True)
class GilbertElliott:
    """A channel with a good and a bad state; it may change its state after every reception.

    Attributes:
        to_bad, to_good: probability that it leaves the good state, the bad one.
        in_good, in_bad: probability that a reception fails there.

    It starts in the state that is likely in the long run. Sources: E. N. Gilbert, Capacity of a burst-noise channel (1960);
    E. O. Elliott, Estimates of error rates for codes on burst-noise channels (1963).
    """

    to_bad: float
    to_good: float
    in_good: float = 0.0
    in_bad: float = 1.0

    def __post_init__(self) -> None:
        for name in ("to_bad", "to_good", "in_good", "in_bad"):
            _probability(getattr(self, name), f"Gilbert-Elliott: {name}")

    @classmethod
    def bursts(cls, loss: float, longer: float = 1.0) -> GilbertElliott:
        """The share `loss` of all receptions fails, in runs that are `longer` times as long as those of independent loss.

        Independent loss makes runs of 1 / (1 - loss) on average, so `longer` = 1 is the same as `Independent`.

        Raises:
            ValueError: a loss that is no probability, or a factor below 1.
        """
        _probability(loss, "the loss")
        if not isfinite(longer) or longer < 1:
            raise ValueError(f"bursts are {shown(longer)} times as long as those of independent loss; at least 1 is allowed")
        return cls(loss / longer, (1 - loss) / longer)

    @property
    def loss(self) -> float:
        """The share of receptions that fails in the long run."""
        bad = self._bad()
        return bad * self.in_bad + (1 - bad) * self.in_good

    def _bad(self) -> float:
        """How likely the bad state is in the long run; a channel that never changes is a good one."""
        change = self.to_bad + self.to_good
        return self.to_bad / change if change else 0.0

    def channel(self, sender: int, receiver: int, rng: np.random.Generator) -> Channel:
        def receptions() -> Iterator[bool]:
            numbers = _uniform(rng)
            bad = next(numbers) < self._bad()
            while True:
                yield next(numbers) < (self.in_bad if bad else self.in_good)
                bad = next(numbers) >= self.to_good if bad else next(numbers) < self.to_bad

        return receptions().__next__


@dataclass(frozen=True)
class Scripted:
    """Loss by plan, for worst cases and enumeration: `lost(sender, receiver, n)` of the n-th reception of a pair, from 0."""

    lost: Callable[[int, int, int], bool]

    def channel(self, sender: int, receiver: int, rng: np.random.Generator) -> Channel:
        count = iter(range(1 << 62))
        return lambda: bool(self.lost(sender, receiver, next(count)))


def _uniform(rng: np.random.Generator) -> Iterator[float]:
    """Numbers from 0 to 1, drawn by the hundred: one at a time costs several times as much."""
    while True:
        yield from rng.random(256).tolist()


def _probability(value: float, what: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise ValueError(f"{what} is {shown(value)}; a number from 0 to 1 is allowed")
