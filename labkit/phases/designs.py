"""Six ways to run a chain of phases in every period, and the four guarantees, checked in the trace.

The designs, in the order of the source, each run under the same load:
- `edf thread`: one EDF thread calls the phases one after the other; planned with the sum of the worst cases (4.3);
- `taft thread`: one TAFT thread, planned with the sum of the expected times (4.4);
- `taft thread, wcet`: one TAFT thread, planned with worst cases but for the last phase (4.5);
- `taft phases`: one TAFT pair per part, all released together, due at the end of the period (4.6);
- `taft releases`: the same, but phase i is released after phase i - 1 (4.7); as releases serve those of the windows. The deadline
  is one period after the release, the default of the source, so that it lies in the next period;
- `taft windows`: releases and deadlines of the windows (4.8 to 4.18), the only one of the last four that gives all guarantees.

A thread has one exception part, whose worst case is taken to be the longest of its phases'; it is shown as that of the phase it
interrupts. A thread whose plan does not fit into the period is run all the same, so that one sees what breaks.

The guarantees, judged for every period k (period P, first release at 0):
- G1, periodic: the first phase begins between k P and (k + 1) P;
- G2, in time: what has begun has ended (exception part included) by (k + 1) P;
- G3, complete: every part gets what it needs or at least its ECET, within one period from its release;
- G4, in order: no part begins before all begun parts of earlier phases have ended.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 4.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labkit.phases.windows import Part, phases_of, windows
from labkit.scheduler import EP, MP, PRIORITY, Outcome, PeriodicTask, Releases, TaskPair, Verdict, simulate, taft_test, trace_of
from labkit.trace import MAIN, Trace, slices

#: The designs, by number from 1.
DESIGNS = ("edf thread", "taft thread", "taft thread, wcet", "taft phases", "taft releases", "taft windows")

NS = 1_000_000_000


@dataclass(frozen=True)
class Guarantee:
    """One guarantee of one run. Of a broken one: the first period in which it is, the phase, and one sentence why."""

    name: str
    kept: bool
    period: int | None = None
    phase: str | None = None
    why: str = ""


@dataclass(frozen=True, eq=False)
class DesignRun:
    """A design under a load: whether its plan was accepted, the trace (names: the parts, then each with `.ep`), what happened to
    each part in each period, and the guarantees G1..G4.
    """

    design: str
    verdict: Verdict
    trace: Trace
    times: PhaseTimes
    guarantees: tuple[Guarantee, ...]


@dataclass(frozen=True, eq=False)
class PhaseTimes:
    """What happened to each part in each period, from the trace; int64 arrays of shape (periods, parts), -1 for never.

    `release` of the part, `start` of the main part (or its abort, if it got nothing), `end` of the main or exception part, `main`
    and `exception` the time granted within one period from the release, `aborted` the instant of the abort.
    """

    release: np.ndarray
    start: np.ndarray
    end: np.ndarray
    main: np.ndarray
    exception: np.ndarray
    aborted: np.ndarray


def run_design(chain: Sequence[Part], design: str, load: np.ndarray, period_ns: int, reserve_ns: int = 0) -> DesignRun:
    """Run one design under a load and judge it.

    Args:
        design: one of `DESIGNS`.
        load: time each part needs in each period, in ns, whole numbers of at least 1, shape (periods, parts in order of the
            chain).
        reserve_ns: kept free at the end of the period for clock correction; only `taft windows` does that.

    Raises:
        ValueError: unknown design, a load of the wrong shape, or windows that do not fit (also for `taft releases`).
    """
    chain = list(chain)
    phases_of(chain)
    load = np.asarray(load)
    if design not in DESIGNS:
        raise ValueError(f"design {design!r}; there are {', '.join(DESIGNS)}")
    if load.ndim != 2 or load.shape[1] != len(chain) or not len(load) or load.dtype.kind not in "iu":
        raise ValueError(f"a load of shape {load.shape}; it must have a row of whole ns for each period and {len(chain)} columns")
    if design in DESIGNS[:3]:
        verdict, trace = _thread(chain, DESIGNS.index(design), load.astype(np.int64), period_ns)
    else:
        verdict, trace = _threads(chain, design, load, period_ns, reserve_ns)
    times = phase_times(trace, len(chain), len(load), period_ns)
    return DesignRun(design, verdict, trace, times, guarantees(times, chain, load, period_ns))


def run_designs(chain: Sequence[Part], load: np.ndarray, period_ns: int, reserve_ns: int = 0) -> list[DesignRun]:
    """All six designs under the same load."""
    return [run_design(chain, design, load, period_ns, reserve_ns) for design in DESIGNS]


def pairs_of(chain: Sequence[Part], design: str, period_ns: int, reserve_ns: int = 0) -> list[TaskPair]:
    """The task pairs of one of the last three designs, one per part."""
    made = {w.phase: w for w in windows(chain, period_ns, reserve_ns if design == "taft windows" else 0)}
    return [
        TaskPair(
            part.name,
            part.ecet_ns,
            part.wcet_ep_ns,
            period_ns,
            made[part.phase].deadline_ns if design == "taft windows" else period_ns,
            0 if design == "taft phases" else made[part.phase].release_ns,
        )
        for part in chain
    ]


def _threads(chain: list[Part], design: str, load: np.ndarray, period_ns: int, reserve_ns: int) -> tuple[Verdict, Trace]:
    pairs = pairs_of(chain, design, period_ns, reserve_ns)
    times = {pair.name: load[:, i] for i, pair in enumerate(pairs)}
    return taft_test(pairs), simulate(pairs, "taft", (len(load) + 1) * period_ns, times, NS)


def _thread(chain: list[Part], design: int, load: np.ndarray, period_ns: int) -> tuple[Verdict, Trace]:
    """One thread that calls all phases; its slices are cut where one phase ends and the next begins."""
    periods, parts = load.shape
    worst = [part.wcet_ns or int(most) for part, most in zip(chain, load.max(axis=0), strict=True)]
    expected = [part.ecet_ns for part in chain]
    ep = 0 if design == 0 else min(max(part.wcet_ep_ns for part in chain), period_ns - 1)
    planned = (sum(worst), sum(expected), sum(worst[:-1]) + expected[-1])[design]
    needed, equation = planned + ep, ("4.3", "4.4", "4.5")[design]
    spare = period_ns - needed
    why = f"the thread is planned with {needed} ns of the period's {period_ns}, {abs(spare)} ns "
    why += "to spare" if spare >= 0 else "too much"
    verdict = Verdict(spare >= 0, f"one thread ({equation})", why, True)

    until = (periods + 1) * period_ns
    budget = min(planned, period_ns - ep)  # where it is alone, the budget changes nothing but the class of its slices
    thread = PeriodicTask("chain", budget, period_ns) if design == 0 else TaskPair("chain", budget, ep, period_ns)
    run = simulate([thread], "edf" if design == 0 else "taft", until, {"chain": load.sum(axis=1)}, NS)

    ran = slices(run).rows()[:, 1:]  # part, job, start, end
    main, rescue = ran[ran[:, 0] == MAIN], ran[ran[:, 0] != MAIN]
    aborts = run.rows("abort")
    fell = np.full(periods + 2, -1)
    fell[aborts[:, 5]] = aborts[:, 0]
    recovered = np.full(periods + 2, -1)
    ends = run.rows("complete")
    ends = ends[ends[:, 2] == 1]
    recovered[ends[:, 5]] = ends[:, 0]

    number = main[:, 1]  # the jobs that began; a thread alone is not preempted, so each has one slice
    need = load[np.minimum(number, periods - 1)]
    done = np.cumsum(need, axis=1)
    begin = np.minimum(main[:, [2]] + done - need, main[:, [3]])
    stop = np.minimum(main[:, [2]] + done, main[:, [3]])
    whole = main[:, [2]] + done <= main[:, [3]]
    hit = ~whole & (np.cumsum(~whole, axis=1) == 1) & (fell[number] >= 0)[:, None]
    jobs = Releases(
        np.tile(np.arange(parts), len(main)),
        np.repeat(number, parts),
        np.repeat(number * period_ns, parts),
        np.repeat((number + 1) * period_ns, parts),
        need.ravel(),
    )
    index = np.arange(len(main) * parts).reshape(len(main), parts)
    kept = stop > begin
    struck = hit.any(axis=1)
    owner = np.full(periods + 2, -1)  # of the thread's exception part: the phase that it interrupts
    owner[number[struck]] = index[hit]
    rescue = rescue[owner[rescue[:, 1]] >= 0]
    job = np.concatenate([index[kept], owner[rescue[:, 1]]])
    part = np.concatenate([np.full(kept.sum(), MP), np.full(len(rescue), EP)])
    start, end = np.concatenate([begin[kept], rescue[:, 2]]), np.concatenate([stop[kept], rescue[:, 3]])
    order = np.argsort(start, kind="stable")
    outcome = Outcome(
        job[order],
        part[order],
        start[order],
        end[order],
        np.where(whole, stop, -1).ravel(),
        np.where(hit, fell[number][:, None], -1).ravel(),
        np.where(hit, recovered[number][:, None], -1).ravel(),
    )
    names = [part.name for part in chain]
    return verdict, trace_of(jobs, outcome, names, PRIORITY[outcome.part], until, NS, exceptions=True)


def phase_times(trace: Trace, parts: int, periods: int, period_ns: int) -> PhaseTimes:
    """Fold a trace of one of the designs: its first `parts` names are the parts, the next their exception parts."""

    def last(kind: str, values: np.ndarray) -> np.ndarray:
        table, rows = np.full((periods, parts), -1), np.flatnonzero(trace.of(kind) & (trace.extra < periods))
        table[trace.extra[rows], trace.task[rows] % parts] = values[rows]
        return table

    release, end, aborted = last("release", trace.value), last("complete", trace.time), last("abort", trace.time)
    ran = slices(trace)
    mine = (ran.job >= 0) & (ran.job < periods)
    job, task, part, begin = ran.job[mine], ran.task[mine], ran.part[mine], ran.start[mine]
    granted = np.zeros((2, periods, parts), np.int64)
    np.add.at(granted, (part, job, task), np.maximum(0, np.minimum(ran.end[mine], release[job, task] + period_ns) - begin))
    start, first = (
        aborted.copy(),
        np.flatnonzero(part == MAIN)[::-1],
    )  # of repeated indices the last one counts, so the first slice
    start[job[first], task[first]] = begin[first]
    return PhaseTimes(release, start, end, granted[MAIN], granted[1 - MAIN], aborted)


def guarantees(times: PhaseTimes, chain: Sequence[Part], load: np.ndarray, period_ns: int) -> tuple[Guarantee, ...]:
    """G1 to G4 of a run, judged by what happened alone, over the periods of the load."""
    periods = len(load)
    begins = np.arange(periods)[:, None] * period_ns
    ended = np.where(times.end < 0, np.iinfo(np.int64).max, times.end)
    begun = times.start >= 0
    enough = np.minimum(load, [part.ecet_ns for part in chain])

    first = next(iter(phases_of(chain).values()))
    late_start = np.zeros(begun.shape, bool)
    late_start[:, : len(first)] = (
        ~begun[:, : len(first)] | (times.start >= begins + period_ns)[:, : len(first)] | (times.start < begins)[:, : len(first)]
    )
    late_end = begun & (ended > begins + period_ns)
    short = times.main < enough
    disorder = np.zeros(begun.shape, bool)
    before = np.full(periods, -1)
    column = 0
    for parts in phases_of(chain).values():
        mine = slice(column, column + len(parts))
        disorder[:, mine] = begun[:, mine] & (times.start[:, mine] < before[:, None])
        before = np.maximum(before, np.where(begun[:, mine], ended[:, mine], -1).max(axis=1))
        column += len(parts)

    def sentence(name: str, k: int, i: int) -> str:
        if name == "G1":
            return "does not begin within the period"
        if name == "G2":
            return f"ends {times.end[k, i] - (k + 1) * period_ns} ns after the period" if times.end[k, i] >= 0 else "never ends"
        if name == "G3":
            return f"gets {times.main[k, i]} ns of the {enough[k, i]} ns it must have"
        return "begins before an earlier phase has ended"

    made = []
    for name, broken in (("G1", late_start), ("G2", late_end), ("G3", short), ("G4", disorder)):
        if not broken.any():
            made.append(Guarantee(name, True))
            continue
        k, i = (int(x) for x in np.argwhere(broken)[0])
        made.append(Guarantee(name, False, k, chain[i].name, f"period {k}: phase {chain[i].name} {sentence(name, k, i)}"))
    return tuple(made)
