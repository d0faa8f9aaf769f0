"""The laser-scan chain of the diploma thesis and its first experiment: 400 periods of 100 ms, and how often the contour filter is
aborted.

What is published: the windows (table 5); of the contour filter's run times that the longest took 140 ms and 90 % less than 50 ms;
a new scan every 200 ms; 121 and 123 aborts in 400 periods on two stations; no deadline missed.

What that does not determine, and the abort count depends on; each is a parameter here, none is fitted to the 121:
- The law between those two numbers. `contour_model` takes a log-normal one, and for that the number of runs of which 140 ms was
  the longest; the more runs, the narrower the law and the more mass between 35 and 50 ms.
  `labkit.scheduler.execution.from_quantiles` makes others.
- Whether the filter works on the old scan again in a period without a new one. "A new scan every 200 ms" at a period of 100 ms
  means a new one in every second period; the source says that main parts are activated when there are data. With `reprocess`
  False the parts have next to nothing to do in the other periods, so that at most 200 of the 400 can be aborted.
- How the time divides between the two parts, arc search and edge extraction. The source says that the arc search makes the
  variation: here edges take a uniform time within their ECET, and arcs the rest. Time that edges leave goes to arcs, as both
  share the window.
- The other phases; here uniform from a quarter of the ECET to nine tenths of it. And both stations processed the same recorded
  scans; draws here are independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labkit.checks import whole
from labkit.phases.designs import DesignRun, PhaseTimes, run_design
from labkit.phases.windows import Part
from labkit.scheduler import ExecutionModel, fit_log_normal, log_normal
from labkit.trace import Jobs, jobs

MS = 1_000_000
PERIOD_NS, RESERVE_NS = 100 * MS, 2 * MS
CONTOUR = "LMSContourFilter"

#: What is published of the contour filter's run times: nine of ten are below `BELOW_NS`, the longest of all is `LONGEST_NS`.
SHARE, BELOW_NS, LONGEST_NS = 0.9, 50 * MS, 140 * MS
#: Among how many runs that was the longest is not published.
RUNS = 1000


def laser_chain(arcs_ecet_ns: int = 30 * MS, edges_ecet_ns: int = 4 * MS) -> list[Part]:
    """The chain of table 5. Worst cases: 140 ms for the contour filter, of which the edges take 4 ms at most; for the rest, the
    ECET.
    """

    def short(phase: str) -> Part:
        return Part(phase, phase, 4 * MS, MS // 10, 4 * MS)

    return [
        short("LMSInput"),
        Part(CONTOUR, "arcs", arcs_ecet_ns, MS // 5, max(136 * MS, arcs_ecet_ns)),
        Part(CONTOUR, "edges", edges_ecet_ns, MS // 5, edges_ecet_ns),
        Part("LMSCommunication", "LMSCommunication", 35 * MS, MS // 10, 35 * MS),
        *(short(f"LMS{name}") for name in ("ContourFusion", "ObjectFilter", "ElementFilter", "ElementFusion", "Output")),
    ]


def contour_model(runs: int = RUNS, share: float = SHARE, below: float = BELOW_NS, longest: float = LONGEST_NS) -> ExecutionModel:
    """Run times of the whole contour filter: log-normal with `share` below `below`, `longest` the median of the longest of
    `runs`, and none longer than that. The one law of the lab for it; times are in ns, or in the unit of those given.
    """
    return log_normal(*fit_log_normal(share, below, longest, runs), longest=longest)


def laser_load(
    chain: list[Part], periods: int, contour: ExecutionModel, reprocess: bool, seed: int, new_scan_every: int = 2
) -> np.ndarray:
    """What every part of the chain needs in every period, int64 ns of shape (periods, parts).

    The scans' run times are drawn first and do not depend on `periods` beyond their number. With `reprocess` the filter takes the
    same time again for the same scan, without it 0.1 ms where there is no new one.
    """
    periods, new_scan_every = whole(periods, 1, "the number of periods"), whole(new_scan_every, 1, "the periods per scan")
    rng = np.random.default_rng(seed)
    scan = np.arange(periods) // new_scan_every
    scans = contour(int(scan[-1]) + 1, rng)
    load = np.stack([rng.integers(part.ecet_ns // 4, part.ecet_ns * 9 // 10, periods, endpoint=True) for part in chain], axis=1)
    arcs, edges = (
        next(i for i, part in enumerate(chain) if (part.phase, part.part) == (CONTOUR, name)) for name in ("arcs", "edges")
    )
    total = scans[scan]
    edge_time = np.minimum(load[::new_scan_every, edges][scan], total // 2)
    load[:, arcs], load[:, edges] = total - edge_time, edge_time
    if not reprocess:
        old = np.arange(periods) % new_scan_every > 0
        load[old, arcs] = load[old, edges] = MS // 10
    return np.maximum(load, 1)


@dataclass(frozen=True, eq=False)
class Experiment1:
    """One station's 400 periods: the run, what happened to each part in each period, and the counts.

    `aborted_periods` counts periods in which the contour filter was aborted, `aborted_parts` its aborts (two parts may be in one
    period), `other_aborts` those of all other phases, `missed` deadlines missed. `jobs`: what became of each job of the run.
    """

    run: DesignRun
    times: PhaseTimes
    jobs: Jobs
    chain: list[Part]
    load: np.ndarray
    aborted_periods: int
    aborted_parts: int
    other_aborts: int
    missed: int


def experiment_1(
    periods: int = 400,
    contour: ExecutionModel | None = None,
    reprocess: bool = True,
    seed: int = 1,
    arcs_ecet_ns: int = 30 * MS,
    edges_ecet_ns: int = 4 * MS,
    period_ns: int = PERIOD_NS,
    reserve_ns: int = RESERVE_NS,
) -> Experiment1:
    """Experiment 1 of the source on one station, with windows, seeded."""
    chain = laser_chain(arcs_ecet_ns, edges_ecet_ns)
    load = laser_load(chain, periods, contour or contour_model(), reprocess, seed)
    run = run_design(chain, "taft windows", load, period_ns, reserve_ns)
    mine = np.array([part.phase == CONTOUR for part in chain])
    aborted = run.times.aborted >= 0
    table = jobs(run.trace)
    return Experiment1(
        run,
        run.times,
        table,
        chain,
        load,
        int(aborted[:, mine].any(axis=1).sum()),
        int(aborted[:, mine].sum()),
        int(aborted[:, ~mine].sum()),
        int(np.sum(table.missed & (table.job < periods))),
    )
