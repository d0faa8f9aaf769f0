"""Accesses per second: counting long traces, and the same accesses with bytes and records. Ratios are the result."""

from time import perf_counter

import pytest

from labkit.cache import DCACHE, Cache, count, patterns, replay, stm32f767
from labkit.cache.policies import POLICIES
from labkit.cache.references import References

N = 500_000
TRACES = {
    "sequential": lambda: patterns.sequential(N // 4, rounds=4, op="modify"),
    "strided": lambda: patterns.strided(2048, 128, rounds=N // 2048, op="modify"),
    "random": lambda: patterns.random(N, 64 * 1024, op="modify"),
    "matrix": lambda: patterns.matrix_product(50),
}


def dict_per_set(references: References) -> int:
    """The yardstick: LRU misses the plain way, one dict per set and a loop over all accesses."""
    sets: list[dict[int, bool]] = [{} for _ in range(DCACHE.sets)]
    misses = 0
    for line, op in zip((references.address // DCACHE.line).tolist(), references.op.tolist()):
        held = sets[line % DCACHE.sets]
        if line in held:
            held[line] = held.pop(line) or op != 2
            continue
        misses += 1
        if len(held) == DCACHE.ways:
            del held[next(iter(held))]
        held[line] = op != 2
    return misses


def rate(function, *arguments) -> float:
    """Calls per second, the best of three."""
    times = []
    for _ in range(3):
        start = perf_counter()
        function(*arguments)
        times.append(perf_counter() - start)
    return 1 / min(times)


@pytest.mark.parametrize("name", TRACES)
@pytest.mark.parametrize("policy", POLICIES)
def test_counting(benchmark, name, policy):
    """`plain_ratio`: how many times faster than the yardstick, which does LRU only."""
    trace = TRACES[name]()
    found = benchmark.pedantic(count, (trace, DCACHE, policy), rounds=5, warmup_rounds=1)
    assert found["lines_touched"] == len(trace)
    if policy == "lru":
        assert found["fills"] == dict_per_set(trace)
    benchmark.extra_info["million_accesses_per_second"] = round(len(trace) / benchmark.stats.stats.min / 1e6, 2)
    benchmark.extra_info["plain_ratio"] = round(1 / benchmark.stats.stats.min / rate(dict_per_set, trace), 2)


@pytest.mark.parametrize("name", TRACES)
def test_records(benchmark, name):
    """The byte-holding cache on the first 20 000 accesses; `counting_ratio`: how much faster counting the whole trace is."""
    whole = TRACES[name]()
    trace = References(whole.op[:20_000], whole.address[:20_000], whole.size[:20_000])
    memory = stm32f767()
    records = benchmark.pedantic(lambda: replay(trace, Cache(memory)), rounds=3, warmup_rounds=1)
    assert len(records) == len(trace)
    per_second = len(trace) / benchmark.stats.stats.min
    benchmark.extra_info["million_accesses_per_second"] = round(per_second / 1e6, 3)
    benchmark.extra_info["counting_ratio"] = round(len(whole) * rate(count, whole, DCACHE) / per_second, 1)
