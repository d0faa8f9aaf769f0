"""Rounds per second of group communication on the radio, and situations per second of the search through all losses."""

from time import process_time

import pytest

from labkit.network import Group, Independent, converse, every_pattern


@pytest.mark.parametrize("stations", [4, 10])
def test_rounds(benchmark, stations):
    """`plain_ratio`: how many times as long a round takes as one of plain broadcast on the same radio."""
    rounds = 100

    def took(way: str) -> float:
        start = process_time()
        converse(way, stations, 2, rounds=rounds, loss=Independent(0.1))
        return process_time() - start

    plain, group = (min(took(way) for _ in range(3)) for way in ("plain", "agreed"))
    said = benchmark.pedantic(converse, ("agreed", stations, 2, 722, rounds), {"loss": Independent(0.1)}, rounds=3)
    assert said.disagreements() == 0
    benchmark.extra_info["rounds_per_cpu_second"] = round(rounds / group)
    benchmark.extra_info["plain_ratio"] = round(group / plain, 2)
    print(f"\n{stations} stations: {rounds / group:,.0f} rounds per CPU second, {group / plain:.1f} times plain broadcast")


def test_all_patterns(benchmark):
    """Three stations, an omission degree of 1, anything may be lost: patterns settled and situations looked at per second."""
    found = benchmark.pedantic(every_pattern, (Group(3, 1),), rounds=3)
    assert found.outcomes["disagreement"] == 0
    rate = round(found.situations / benchmark.stats.stats.min)
    benchmark.extra_info["situations_per_second"] = rate
    print(f"\n{found.patterns:.2e} patterns in {found.situations:,} situations, {rate:,} per second")
