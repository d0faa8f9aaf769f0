"""The whole chain per scan and station with the fusion at each level, teams of two and four; ratios to one station on its own.

Every station computes the picture for itself, so a station's share is the part before it sends, once, and all that comes after.
The scans of the seeds 1 to 3 of the experiment are used in turn. Modelled times stand beside.
"""

from time import process_time

import pytest

from labkit.experiments import FusionLevels
from labkit.fusion import LEVELS, fuse_at, run_chain

SEEDS = (1, 2, 3)


def best_ms(work, repeats: int = 7) -> float:
    """The least processor time of some runs: the others were disturbed."""
    best = float("inf")
    for _ in range(repeats):
        start = process_time()
        work()
        best = min(best, process_time() - start)
    return 1000 * best


@pytest.mark.parametrize("stations", [2, 4])
@pytest.mark.parametrize("level", LEVELS)
def test_chain_per_scan_and_station(benchmark, level, stations):
    """`alone_ratio`: how many times the chain of one station without fusion one scan of one station takes."""
    teams = [FusionLevels(stations=stations, seed=seed).run().points for seed in SEEDS]

    def chains() -> None:
        for points in teams:
            fuse_at(level, points)

    def alone() -> None:
        for points in teams:
            run_chain(points[0])

    # what all stations do before they send is in `chains` once for each, what every station does afterwards once for all of them
    whole, one = best_ms(chains) / len(teams), best_ms(alone) / len(teams)
    modelled = [fuse_at(level, points) for points in teams]
    before = sum(sum(fused.before_ns) / sum((*fused.before_ns, fused.fusion_ns, fused.after_ns)) for fused in modelled) / len(
        teams
    )
    milliseconds = whole * (before / stations + 1 - before)
    model = sum(fused.station_ns for fused in modelled) / len(teams) / 1e6
    benchmark.extra_info |= {
        "ms": round(milliseconds, 2),
        "alone_ratio": round(milliseconds / one, 2),
        "modelled_ms": round(model, 1),
    }
    print(f"\n{level}, {stations} stations: {milliseconds:.2f} ms, {milliseconds / one:.2f} times alone, modelled {model:.1f} ms")
    benchmark.pedantic(chains, rounds=2)
