"""Acceptance tests for TAFT: is every main part sure of its ECET, and every exception part of meeting the deadline?

The scheduler they speak of keeps three classes, highest first:
1. exception parts, each in slots planned as late as its deadline allows: EDF on the reversed time axis, that is, going back in
   time, of the parts whose deadline has been passed the one released latest. All jobs that may yet need their exception part
   are in the plan, also those still to be released;
2. main parts that have had less than their ECET, by EDF;
3. the other main parts, by EDF.
A main part still running when the first slot of its exception part comes is aborted then; one that completes takes its exception
part out of the plan.

Source: the diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.1, and equation 4.6 for pairs of one period
and release. It gives no test for others. The sum of (ECET + EP) / T <= 1, though necessary, is *not* sufficient for them. Take
the pairs (ECET, EP, T) = (1, 1, 5) and (1, 5, 11) with utilisation 0.945: the second's exception part is planned into 5..9 and
10..11, around the first's in 9..10, so that the first's job released at 5 gets nothing before it is aborted at 9.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from heapq import heappop, heappush
from math import ceil, lcm

import numpy as np

from labkit.scheduler.analysis.shares import compared_to_one, total
from labkit.scheduler.analysis.verdict import Budget, UndecidedError, Verdict
from labkit.scheduler.tasksets import TaskPair, check_names

#: Jobs that `taft_plan_test` places; a second or two.
MAX_JOBS = 200_000

#: Times beyond this one would not fit into 64 bits when work is added up.
FAR = 1 << 60

#: Pairs times lengths of interval that are judged at once, at most; it begins with a 64th of them, as most rejections come soon.
BLOCK = 1 << 16


def taft_utilization(pairs: Iterable[TaskPair]) -> Fraction:
    """Sum of (ECET + EP) / T, exact. Above 1 no scheduler can give the guarantees; up to 1 TAFT may or may not."""
    return total(Fraction(pair.ecet + pair.ep_wcet, pair.period) for pair in pairs)


def _level(pairs: Sequence[TaskPair]) -> int:
    """That sum below (-1), at (0) or above 1 (1)."""
    return compared_to_one([(pair.ecet + pair.ep_wcet, pair.period) for pair in pairs])


def taft_period_test(pairs: Iterable[TaskPair]) -> Verdict:
    """Period >= sum of (ECET + EP), equation 4.6: exact for pairs of one period and release, due at the end of the period.

    In the plan all exception parts stand packed at the end of the period, and the main parts have all the time before.

    Raises:
        ValueError: the pairs differ in period or offset, or a deadline is not the period; use `taft_test` for those.
    """
    pairs = check_names(pairs)
    first = pairs[0]
    for pair in pairs:
        if (pair.period, pair.deadline, pair.offset) != (first.period, first.period, first.offset):
            raise ValueError(f"task {pair.name!r}: (4.6) is for pairs with the period, release and deadline of {first.name!r}")
    needed = sum(pair.ecet + pair.ep_wcet for pair in pairs)
    spare = first.period - needed
    why = f"expected times and exception parts take {needed} of the period {first.period}, {abs(spare)} "
    return Verdict(spare >= 0, "TAFT period (4.6)", why + ("to spare" if spare >= 0 else "too much"), True)


def taft_demand_test(pairs: Iterable[TaskPair]) -> Verdict:
    """Sufficient for any offsets: in every interval the expected times due within it and the exception parts that can be planned
    into it together take at most its length t.

    Proof. Suppose some main part gets less than its ECET before s, the first slot of its exception part (its deadline, if that
    part is empty). Take the job with the earliest such s, released at r and due at d. Let t0 <= r be the last instant at which
    no main part due by d and released earlier is short of its ECET. From t0 to s every instant is either a planned slot or
    goes to main parts released from t0 on and due by d, and does not satisfy them all. From s to d every instant is a
    planned slot, since the plan leaves no gap, going back from d, until this exception part is complete. So t = d - t0 is less
    than the sum of (a) the ECETs of the jobs released from t0 on and due by d and (b) the exception parts of the jobs whose time
    from release to deadline overlaps t0..d, as a plan that keeps deadlines puts each of them there. The test excludes
    that. The plan does keep deadlines, because (b) is at least the processor demand of the exception parts. And early completions
    do no harm: with a part taken out, the planned instants are a subset of what they were. QED

    A task has n jobs inside an interval and at most one more overlapping each end. As the interval begins with a release and ends
    with a deadline, two tasks have none at one end, or one task has none at both.

    Raises:
        UndecidedError: more than `MAX_STEPS` steps, one for each task and length of interval. The nearer the utilisation is to
            1, the longer the intervals that matter.
    """
    pairs, budget = check_names(pairs), Budget("TAFT demand")
    if _level(pairs) > 0:
        return _overload(pairs)
    used = taft_utilization(pairs)
    most = total(Fraction((p.period - p.deadline) * (p.ecet + p.ep_wcet), p.period) + 2 * p.ep_wcet for p in pairs)
    if used == 1 and most > 0:
        return Verdict(False, "TAFT demand", "at full utilisation this test cannot tell", False)
    judged = 0
    for times in _jumps(pairs, ceil(most / (1 - used)) if used < 1 else 0, budget):
        needed = _most_planned(pairs, times)
        over = needed > times
        if over.any():
            time, work = int(times[over][0]), int(needed[over][0])
            why = f"{work} may be asked for within {time}, {work - time} too much for this test"
            return Verdict(False, "TAFT demand", why, False)
        judged += len(times)
    return Verdict(True, "TAFT demand", f"all is within the time in each of {judged} lengths of interval", False)


def taft_plan_test(pairs: Iterable[TaskPair]) -> Verdict:
    """Exact for periodic pairs with the offsets given: plan a round of releases in which every main part is aborted.

    Equal deadlines go by the order of the list, as do equal releases in the plan (earlier pairs in earlier slots). Takes time in
    proportion to the jobs in the least common multiple of the periods.

    Raises:
        UndecidedError: that is more than `MAX_JOBS` jobs.
    """
    pairs = check_names(pairs)
    if _level(pairs) > 0:
        return _overload(pairs)
    cycle = 1
    for pair in pairs:
        cycle = lcm(cycle, pair.period)
        if cycle // pair.period > MAX_JOBS:
            raise _too_many_jobs()
    begun = max(pair.offset for pair in pairs)
    first = min(pair.offset for pair in pairs)
    # Released together, all is over before the next common release. Otherwise the plan, built from its end, and the schedule,
    # built from its start, each settle within one cycle in which all tasks take part.
    judged, end = (begun + cycle,) * 2 if begun == first else (begun + 2 * cycle, begun + 5 * cycle)
    if sum((end - pair.offset) // pair.period for pair in pairs) > MAX_JOBS:
        raise _too_many_jobs()
    jobs = sorted((release, i) for i, pair in enumerate(pairs) for release in range(pair.offset, end, pair.period))
    windows = [(release, release + pairs[i].deadline, pairs[i].ep_wcet) for release, i in jobs]
    slots = latest_slots(windows)
    aborts = [due for _, due, _ in windows]
    for start, _, job in reversed(slots):
        aborts[job] = start
    late = [
        (aborts[job], pairs[i].name, release, finish - aborts[job])
        for job, ((release, i), finish) in enumerate(zip(jobs, _expected_finishes(pairs, jobs, slots), strict=True))
        if release < judged and finish > aborts[job]
    ]
    if not late:
        return Verdict(True, "TAFT plan", f"every main part has its ECET before its last moment, through {judged}", True)
    when, name, release, over = min(late)
    why = f"task {name!r}: the main part released at {release} must give way to its exception part at {when}"
    why += f", {over} before it can have had its ECET"
    return Verdict(False, "TAFT plan", why, True)


def _too_many_jobs() -> UndecidedError:
    return UndecidedError(f"TAFT plan: undecided, with more than {MAX_JOBS} jobs until the releases repeat")


def taft_test(pairs: Iterable[TaskPair]) -> Verdict:
    """The sharpest answer at hand: the demand test if it accepts, else the plan itself where it can be built.

    Raises:
        UndecidedError: neither test can tell within its budget.
    """
    pairs = check_names(pairs)
    try:
        verdict = taft_demand_test(pairs)
    except UndecidedError:
        return taft_plan_test(pairs)
    if verdict.accepted or verdict.exact:
        return verdict
    try:
        return taft_plan_test(pairs)
    except UndecidedError:
        return verdict


def latest_slots(windows: Sequence[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Place work as late as possible: EDF on the reversed time axis.

    Args:
        windows: (release, deadline, length) of each job, in order of release.

    Returns:
        (start, end, index into windows) in order of time, contiguous slots of one job merged. Of equal releases the one later in
        the list comes later. If the work does not fit, some slot starts before its release.
    """
    order = sorted(range(len(windows)), key=lambda job: windows[job][1])
    waiting: list[tuple[int, int]] = []  # (-release, -job) of parts whose deadline has been passed, going back
    left = [length for _, _, length in windows]
    slots: list[tuple[int, int, int]] = []
    now = 0
    while order or waiting:
        if not waiting:
            now = windows[order[-1]][1]
        while order and windows[order[-1]][1] >= now:
            job = order.pop()
            if left[job]:
                heappush(waiting, (-windows[job][0], -job))
        if not waiting:
            continue
        job = -waiting[0][1]
        start = max(now - left[job], windows[order[-1]][1]) if order else now - left[job]
        if slots and slots[-1][2] == job and slots[-1][0] == now:
            slots[-1] = (start, slots[-1][1], job)
        else:
            slots.append((start, now, job))
        left[job] -= now - start
        now = start
        if not left[job]:
            heappop(waiting)
    return slots[::-1]


def _expected_finishes(
    pairs: Sequence[TaskPair], jobs: Sequence[tuple[int, int]], slots: Sequence[tuple[int, int, int]]
) -> list[int]:
    """When each main part has had its ECET, by EDF in the time outside the slots."""
    finishes = [0] * len(jobs)
    left = [pairs[i].ecet for _, i in jobs]
    ready: list[tuple[int, int, int]] = []  # (deadline, pair, job)
    gaps = [*((start, end) for start, end, _ in slots), (1 << 62, 1 << 62)]
    now = upcoming = 0
    for start, end in gaps:
        while now < start:
            while upcoming < len(jobs) and jobs[upcoming][0] <= now:
                release, i = jobs[upcoming]
                heappush(ready, (release + pairs[i].deadline, i, upcoming))
                upcoming += 1
            until = min(start, jobs[upcoming][0]) if upcoming < len(jobs) else start
            if not ready:
                now = until
                continue
            job = ready[0][2]
            run = min(left[job], until - now)
            left[job] -= run
            now += run
            if not left[job]:
                heappop(ready)
                finishes[job] = now
        now = max(now, end)
    return finishes


def _jumps(pairs: Sequence[TaskPair], last: int, budget: Budget) -> Iterator[np.ndarray]:
    """Lengths at which `_most_planned` can jump, from the least deadline to `last`, rising, in blocks; at least the former."""
    start = min(pair.deadline for pair in pairs)
    yield np.array([start])
    if last > FAR:
        raise UndecidedError(f"{budget.analysis}: undecided, with intervals of up to {last}")
    period = np.array([pair.period for pair in pairs])
    deadline = np.array([pair.deadline for pair in pairs])
    residues = np.concatenate([deadline, np.ones_like(deadline), 2 - deadline])
    steps = np.tile(period, 3)
    wanted = BLOCK // 64
    while start < last:
        stop = min(last, start + max(1, int(wanted / len(pairs) / float(np.sum(1 / steps)))))
        first = start + 1 + (residues - start - 1) % steps
        count = np.maximum(0, (stop - first) // steps + 1)
        nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        times = np.unique(np.repeat(first, count) + nth * np.repeat(steps, count))
        budget.spend(len(pairs) * (len(times) + 1))
        if len(times):
            yield times
        start, wanted = stop, min(BLOCK, 2 * wanted)


def _most_planned(pairs: Sequence[TaskPair], times: np.ndarray) -> np.ndarray:
    """Most work, as `taft_demand_test` counts it, in an interval of each of these lengths."""
    ecet, ep, period, deadline = (
        np.array([[getattr(pair, field)] for pair in pairs]) for field in ("ecet", "ep_wcet", "period", "deadline")
    )

    def work(inside: np.ndarray, ends: int) -> np.ndarray:
        """ECETs and exception parts of `inside` jobs, and the exception parts of jobs overlapping at most so many ends."""
        slack = times - deadline - (inside - 1) * period
        pause = period - deadline
        overlapping = (slack >= pause + 1).astype(np.int64) + (slack >= 2 * pause + 2)
        return inside * ecet + (inside + np.minimum(overlapping, ends)) * ep

    inside = np.maximum(0, (times - deadline) // period + 1)
    most = np.maximum(work(inside, 2), np.where(inside > 0, work(inside - 1, 2), 0))  # one job less may let two overlap
    fits, never = times >= deadline, np.iinfo(np.int64).max // 4
    least = np.where(fits, most - work(inside, 0), never).min(axis=0)
    if len(pairs) > 1:
        saved_one = np.where(fits, most - work(inside, 1), never)
        least = np.minimum(least, np.partition(saved_one, 1, axis=0)[:2].sum(axis=0))
    return most.sum(axis=0) - least


def _overload(pairs: Sequence[TaskPair]) -> Verdict:
    why = f"expected times and exception parts ask for {float(taft_utilization(pairs)):.4f} of the processor"
    return Verdict(False, "TAFT utilisation", why, True)
