"""What the benchmarks of the schedulers are compared with, in the same process: the cheapest thing SimPy does."""

import time
from collections.abc import Callable

import pytest
import simpy


def timeouts(count: int) -> int:
    """Ten processes that wait, again and again, `count` times in all."""
    env = simpy.Environment()

    def wait():
        while True:
            yield env.timeout(1)

    for _ in range(10):
        env.process(wait())
    env.run(until=count // 10)
    return count


def best_rate(work: Callable[..., int], *arguments, repeats: int = 5) -> float:
    """Best of some repeats, in units per CPU second; `work` returns how many it did."""
    best = 0.0
    for _ in range(repeats):
        start = time.process_time()
        done = work(*arguments)
        best = max(best, done / (time.process_time() - start))
    return best


@pytest.fixture
def compare(benchmark) -> Callable[..., None]:
    """`compare({name: (work, *arguments)})` notes units per CPU second of each, and the ratio to raw SimPy timeouts."""

    def run(cases: dict[str, tuple]) -> None:
        simpy_rate = best_rate(timeouts, 50_000)
        benchmark.extra_info["raw SimPy timeouts per CPU second"] = round(simpy_rate)
        print(f"\n{simpy_rate:,.0f} raw SimPy timeouts per CPU second")
        for name, case in cases.items():
            rate = best_rate(*case)
            benchmark.extra_info[f"jobs per timeout, {name}"] = round(rate / simpy_rate, 3)
            print(f"{name}: {rate / simpy_rate:.2f} jobs per raw SimPy timeout, {rate:,.0f} jobs per CPU second")
        benchmark.pedantic(timeouts, (50_000,))

    return run
