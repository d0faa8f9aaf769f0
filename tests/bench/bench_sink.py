"""States per second of the search through all interleavings, and its ratio to the least that such a search must do."""

import pytest

from labkit.sink import Ring
from labkit.sink.explorer import search
from labkit.sink.machine import Machine

CASES = {
    "sequence": ("sequence", Ring(messages=3, capacity=4, modulus=32)),
    "ready flags": ("ready-flag", Ring(messages=3, capacity=4, modulus=32)),
    "with DMA": ("interrupts-off", Ring(messages=3, capacity=4, modulus=32, dma=True)),
}
WIDTH = 25  # numbers of a state


def bare(count: int) -> int:
    """The yardstick: so many states made, hashed, looked up and kept, three steps from each, without asking what a step does."""
    number, states = {}, []
    state = (0,) * WIDTH
    for i in range(count):
        for step in range(3):
            after = list(state)
            after[step], after[-1] = i, i * (step == 0)
            number.setdefault(tuple(after), len(states))
        states.append(state)
    return count


def explore(variant: str, ring: Ring) -> int:
    return search(Machine(variant, ring)).states


@pytest.mark.parametrize("case", CASES)
def test_exploring(benchmark, case):
    """`bare_ratio`: how many bare states one explored state is worth."""
    from time import process_time

    def rate(work, *arguments) -> float:
        start = process_time()
        return work(*arguments) / (process_time() - start)

    explored = max(rate(explore, *CASES[case]) for _ in range(3))
    benchmark.extra_info["states_per_cpu_second"] = round(explored)
    benchmark.extra_info["bare_ratio"] = round(max(rate(bare, 50_000) for _ in range(3)) / explored, 2)
    print(f"\n{case}: {explored:,.0f} states per CPU second, {benchmark.extra_info['bare_ratio']} bare states each")
    benchmark.pedantic(explore, CASES[case], rounds=1)
