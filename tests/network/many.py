"""Thousands of settings at little cost."""

import random
from collections.abc import Callable
from typing import Any

from hypothesis import Phase, given, settings
from hypothesis import strategies as st

EACH = 100


def many(draw: Callable[[random.Random], tuple], count: int = 2000) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Calls a test with `count` settings, each of them what `draw` makes of random numbers of its own; one that fails is named.

    Every hundred come from one number, which hypothesis draws, and draws again if it failed. Were it to draw each setting by
    itself, that would cost more than what is tested, and most of them would be another one with a part repeated.
    """

    def decorate(test: Callable[..., Any]) -> Callable[..., Any]:
        def hundred(seed: int) -> None:
            for n in range(EACH):
                drawn = draw(random.Random(f"{seed} {n}"))
                try:
                    test(*drawn)
                except Exception as error:
                    error.add_note(f"with {drawn!r}")
                    raise

        hundred.__name__ = test.__name__
        hundred.__doc__ = test.__doc__
        phases = (Phase.reuse, Phase.generate)  # a smaller number makes no simpler settings
        return settings(max_examples=count // EACH, phases=phases, deadline=None)(given(st.integers(0, 2**64 - 1))(hundred))

    return decorate
