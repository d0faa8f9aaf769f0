"""The laser chain per scan of 361 beams: making the scan, segmentation, every stage, the whole chain; ratios to a bare pass.

Goals on an idle machine: segmentation at most 0.2 ms, the whole chain at most 15 ms.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np
import pytest

from labkit.fusion import (
    Pose,
    Scanner,
    Settings,
    Straight,
    ball,
    element_filter,
    extract_edges,
    field,
    groups,
    object_filter,
    points,
    robot,
    run_chain,
    scan,
    search_arcs,
)

ROBOTS = [
    robot(name, Straight(Pose(x, y, turn))) for name, x, y, turn in (("B", 4, 1.2, 0.4), ("C", 5, 3.9, 0.9), ("D", 6.5, 2, 0.1))
]
WORLD = field(8, 5, [robot("A", Straight(Pose(0.5, 2.5))), ball(Straight(Pose(2.5, 2.8))), *ROBOTS])
SCANNER, SETTINGS = Scanner(), Settings()
SEEN = points(scan(WORLD, SCANNER, "A", 0, np.random.default_rng(1)))
CHAIN = run_chain(SEEN)

CASES: dict[str, Callable[[], object]] = {
    "making a scan": lambda: scan(WORLD, SCANNER, "A", 0, np.random.default_rng(1)),
    "segmentation": lambda: groups(SEEN, SETTINGS),
    "edges": lambda: list(extract_edges(SEEN)),
    "arcs": lambda: list(search_arcs(SEEN)),
    "objects": lambda: list(object_filter(CHAIN.contours)),
    "elements": lambda: list(element_filter(CHAIN.objects)),
    "whole chain": lambda: run_chain(SEEN),
}


def best_ms(work: Callable[[], object], repeats: int = 15) -> float:
    """The shortest of some runs: the others were disturbed."""
    best = float("inf")
    for _ in range(repeats):
        start = perf_counter()
        work()
        best = min(best, perf_counter() - start)
    return 1000 * best


def bare() -> object:
    """The yardstick: the distance of every point to every other once, in numpy."""
    return np.hypot(*(SEEN.xy[:, None] - SEEN.xy).transpose(2, 0, 1)).min()


@pytest.mark.parametrize("case", CASES)
def test_stage(benchmark, case):
    """`bare_ratio`: how many times all distances between 361 points it takes."""
    assert len(SEEN.xy) == SCANNER.values == 361
    milliseconds = best_ms(CASES[case])
    benchmark.extra_info["ms"] = round(milliseconds, 3)
    benchmark.extra_info["bare_ratio"] = round(milliseconds / best_ms(bare), 3)
    print(f"\n{case}: {milliseconds:.3f} ms, {benchmark.extra_info['bare_ratio']} times all distances")
    benchmark.pedantic(CASES[case], rounds=5)
