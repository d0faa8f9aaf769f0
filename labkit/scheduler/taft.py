"""TAFT, time-aware fault-tolerant scheduling of task pairs, on one core in integer time: the rules and the engine.

A job has a main part, which needs some execution time nobody knows beforehand, and an exception part, which takes exactly
`ep_wcet` if it is needed at all. Rules 1, 2 and 5 of `labkit.scheduler.periodic` hold; deadlines do not exceed periods. Then:

1. *Plan.* At every instant the exception parts of all jobs that may still need them are planned: those of released jobs whose
   main part is not complete (what is left of them, if they have begun) and those of all jobs still to be released. Going back
   in time, every instant goes to the part whose job was released latest among those whose deadline has been passed and that
   are not yet complete; of equal releases, to the later in the list. That is EDF on the reversed time axis (latest release time).
2. *Exception parts have the highest priority*, and run in their planned slots only.
3. *Abort.* A main part still running when the first slot of its exception part begins is aborted at that instant: it is the last
   one from which the plan still keeps all deadlines. With `ep_wcet` 0 it is aborted at its deadline. A main part that
   completes at that very instant is complete, and not aborted.
4. *Main parts* that have had less than their `ecet` come next, by EDF; then those that have had it, by EDF. Equal deadlines go by
   the order in the list. A main part that reaches its `ecet` loses its rank at that instant.
5. *Completion* of a main part takes its exception part out of the plan; the others' slots then move later or stay. The time
   goes to main parts: the processor idles only if none is released and unfinished, and no slot is due.
6. *Overload.* If the exception parts themselves do not fit (no acceptance test allows that), a plan may reach back before the
   present: main parts with such slots are aborted at once. If the present instant is then in the slot of no released job, the
   exception part that has been begun by an abort and has the earliest deadline (equals: the order in the list) runs. One that is
   not complete at its deadline misses, and the rest of it is dropped.

A plan reaches into the future without end. `_plan` builds it from a horizon and looks for an instant at which all work may rest
even if everything up to the horizon is pressed before it; what lies before that instant is the endless plan itself. If the
exception parts leave no such instant within a long look-ahead (they alone load the processor almost fully), the plan is the
pressed one.

Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.1, which gives the three classes, EDF, and the
latest release time; the tie rules and rules 5 and 6 are this model's. Not modelled: the cost of switching and of aborting.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from functools import lru_cache
from heapq import heapify, heappop, heappush
from math import lcm

import numpy as np

from labkit.scheduler.analysis.taft import latest_slots
from labkit.scheduler.dispatch import dispatch
from labkit.scheduler.jobs import BEYOND, EP, Outcome, Releases, release_jobs, trace_of
from labkit.scheduler.tasksets import TaskPair
from labkit.trace import Trace

NEVER = 1 << 62


def schedule_pairs(pairs: Sequence[TaskPair], jobs: Releases, until: int, hz: int) -> Trace:
    """The TAFT schedule of these jobs from 0 to `until`; names are those of the pairs, then each with `.ep` behind it."""
    names = [pair.name for pair in pairs]
    jobs, outcome = run_pairs(pairs, jobs, until)
    return trace_of(jobs, outcome, names, PRIORITY[outcome.part], until, hz, exceptions=True)


def run_pairs(pairs: Sequence[TaskPair], jobs: Releases, until: int) -> tuple[Releases, Outcome]:
    """The jobs in EDF order, and what became of them."""
    jobs = jobs.ordered(np.lexsort((jobs.number, jobs.task, jobs.deadline)))
    return jobs, _Run(pairs, jobs, until).outcome()


#: Priority in the trace of a slice of MP, BEYOND and EP.
PRIORITY = np.array([1, 0, 2])


class _Run:
    """One run of the engine. Jobs are known by their rank, that is by their place in EDF order.

    The heap of ready main parts holds the rank of a job within its expected time, and the rank plus `n` beyond it. The plan of
    all jobs, as if none ever completed, is built once; completions only move slots later, so the first slot of a job in it is
    a lower bound of its abort. Only when such a bound is reached are the slots of the released jobs near it planned anew, and
    their bounds raised.
    """

    def __init__(self, pairs: Sequence[TaskPair], jobs: Releases, until: int):
        self.jobs, self.until, self.n = jobs, until, len(jobs)
        ecet = np.array([pair.ecet for pair in pairs])[jobs.task]
        ep = np.array([pair.ep_wcet for pair in pairs])[jobs.task]
        expected = np.minimum(jobs.time, ecet)
        self.left = [*expected.tolist(), *(jobs.time - expected).tolist()]
        self.ep_left = ep.tolist()
        self.task, self.release, self.deadline = jobs.task.tolist(), jobs.release.tolist(), jobs.deadline.tolist()
        *slots, first = _plan(pairs, jobs, until)
        self.slot_starts, self.slot_ends, self.slot_jobs = (column.tolist() for column in slots)
        self.release.append(NEVER)
        self.task.append(-1)
        first = np.where(ep > 0, np.maximum(first, jobs.release), jobs.deadline)
        self.bound = first.tolist()
        self.order = np.argsort(first, kind="stable")
        self.alarms: list[tuple[int, int]] = [(NEVER, -1)]  # (bound, job), for the jobs whose bound was raised
        self.ready: list[int] = []
        self.excepting: list[int] = []
        self.aborted: dict[int, int] = {}
        self.recovered: dict[int, int] = {}
        self.keys: list[int] = []
        self.starts: list[int] = []
        self.ends: list[int] = []

    def outcome(self) -> Outcome:
        self._run()
        n = self.n
        keys, start, end = (np.array(column, dtype=np.int64) for column in (self.keys, self.starts, self.ends))
        part, job = np.divmod(keys, max(1, n))
        left = np.array(self.left, dtype=np.int64)
        main = part <= BEYOND
        completed = np.full(n, -1)
        completed[job[main]] = end[main]  # of repeated indices the last one counts
        completed[(left[:n] > 0) | (left[n:] > 0)] = -1
        aborted, recovered = (np.full(n, -1) for _ in range(2))
        for column, events in ((aborted, self.aborted), (recovered, self.recovered)):
            column[list(events)] = list(events.values())
        return Outcome(job, part, start, end, completed, aborted, recovered)

    def _run(self) -> None:
        n, left, ready, alarms = self.n, self.left, self.ready, self.alarms
        settled = [False] * (n + 1)  # complete, or its bound is among the alarms
        order, first = [*self.order.tolist(), n], [*np.array(self.bound, np.int64)[self.order].tolist(), NEVER]
        keys, starts, ends = self.keys.append, self.starts.append, self.ends.append
        at = alarm = 0  # `alarm`: nothing is due before; raised when it is reached, for jobs settle without telling
        arrivals = self.jobs.arrivals
        releases = self.jobs.release[arrivals].tolist()
        for arrived, now, upcoming in zip(arrivals.tolist(), releases, [*releases[1:], self.until]):
            heappush(ready, arrived)
            while now < upcoming:
                key = ready[0] if ready else -1
                end = now + left[key] if ready else upcoming
                if end > alarm:
                    while settled[order[at]]:
                        at += 1
                    alarm = first[at] if first[at] < alarms[0][0] else alarms[0][0]
                    if alarm <= now:
                        now, alarm = self._except(now, upcoming, settled), 0
                        continue
                stop = alarm if alarm < upcoming else upcoming
                if key < 0:
                    now = stop
                    continue
                keys(key)
                starts(now)
                if end <= stop:
                    heappop(ready)
                    left[key] = 0
                    if key < n and left[key + n]:
                        heappush(ready, key + n)
                    else:
                        settled[key % n] = True
                    now = end
                else:
                    left[key] = end - stop
                    now = stop
                ends(now)
        self._except(self.until, self.until, settled)  # what is due at the end of the schedule

    def _except(self, now: int, upcoming: int, settled: list[bool]) -> int:
        """Plan anew, abort what is due, and run the exception part whose slot it is; returns the time when that is done."""
        while self.alarms[0][0] <= now:
            heappop(self.alarms)
        slots = self._slots(now)
        if len(slots) == 1 and slots[0][0] > now and not self.excepting:  # by far the most frequent case: a bound is raised
            ((start, _, job),) = slots
            settled[job], self.bound[job] = True, start
            heappush(self.alarms, (start, job))
            return now
        first: dict[int, int] = {}
        for start, _, job in slots:
            first.setdefault(job, start)
        for job, start in first.items():
            settled[job] = True
            if start <= now and job not in self.aborted:
                self._abort(job, now)
        turn = next(((end, job) for start, end, job in slots if start <= now < end), None)
        if turn is None and self.excepting:  # rule 6: only in overload is there one whose slots have passed
            job = min(self.excepting)
            turn = now + self.ep_left[job], job
        if turn is not None and now < upcoming:
            end, job = turn
            end = min(end, upcoming, *(start for start, _, _ in slots if start > now))
            self.keys.append(job + EP * self.n)
            self.starts.append(now)
            self.ends.append(end)
            self.ep_left[job] -= end - now
            now = end
            if not self.ep_left[job]:
                self.recovered[job] = now
                self.excepting.remove(job)
        coming = {job: max(start, now) for start, end, job in reversed(slots) if end > now or start == now}  # the first one stays
        for job in {*coming, *self.excepting}:
            if job not in self.aborted or job in self.excepting:
                self.bound[job] = coming.get(job, now)
                heappush(self.alarms, (self.bound[job], job))
        return now

    def _abort(self, job: int, now: int) -> None:
        self.ready.remove(job if job in self.ready else job + self.n)
        heapify(self.ready)
        self.aborted[job] = now
        if not self.ep_left[job]:
            self.recovered[job] = now
        elif self.deadline[job] > now:
            self.excepting.append(job)

    def _slots(self, now: int) -> list[tuple[int, int, int]]:
        """(start, end, job) of the planned slots, in order of time, of the released jobs with a bound that is reached and of
        those that share time with them. An empty exception part has a slot of length 0.
        """
        bound, deadline, release, n = self.bound, self.deadline, self.release, self.n
        waiting = [key if key < n else key - n for key in self.ready]
        if self.excepting:
            self.excepting = [job for job in self.excepting if deadline[job] > now]
            waiting += self.excepting
        windows, horizon = [], now + 1
        for job in sorted(waiting, key=bound.__getitem__):
            if bound[job] >= horizon:  # its slots, and those of all that follow, lie behind
                break
            horizon = max(horizon, deadline[job])
            windows.append((release[job], self.task[job], deadline[job], self.ep_left[job], job))
        if not windows:
            return []
        empty = [(due, due, job) for _, _, due, length, job in windows if not length]
        for i in range(bisect_left(self.slot_ends, now), len(self.slot_ends)):
            start, end, job = self.slot_starts[i], self.slot_ends[i], self.slot_jobs[i]
            if start >= horizon:
                break
            if release[job] > now:  # it stays where it is, whatever happens before its release
                windows.append((release[job], self.task[job], end, end - start, -1))
        if len(windows) == 1:  # it needs no plan
            _, _, due, length, job = windows[0]
            return [(due - length, due, job)]
        windows.sort()
        planned = latest_slots([(released, due, length) for released, _, due, length, _ in windows])
        return sorted([*((start, end, windows[i][4]) for start, end, i in planned if windows[i][4] >= 0), *empty])


def _plan(pairs: Sequence[TaskPair], jobs: Releases, until: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The plan of rule 1 as if no job ever completed, int64 arrays.

    From the last offset on it repeats after the least common multiple of the periods: a shift by that moves every job due after
    an instant onto another one, and the plan before an instant follows from these alone. Where it repeats often, one round is
    planned and copied.

    Returns:
        start, end and job of the slots in order of time, len(jobs) standing for every job that is released later; and the start
        of the first slot of each job (anything for an empty exception part).
    """
    ep = np.array([pair.ep_wcet for pair in pairs])
    if not ep.any():
        return *np.empty((3, 0), np.int64), jobs.deadline.copy()
    begun, cycle = max(pair.offset for pair in pairs), 1
    for pair in pairs:
        cycle = min(lcm(cycle, pair.period), until)
    slots, settled = _endless_slots(tuple(pairs), min(until, begun + cycle), len(jobs))
    if settled and begun + 2 * cycle < until:
        slots = _repeated(pairs, slots, begun, cycle, until)
    elif begun + cycle < until:
        slots, _ = _endless_slots(tuple(pairs), until, len(jobs))
    start, end, task, number = slots
    shape = len(pairs), int(max(number.max(initial=0), jobs.number.max(initial=0))) + 1
    first, rank = np.full(shape, NEVER), np.full(shape, len(jobs))
    np.minimum.at(first, (task, number), start)
    rank[jobs.task, jobs.number] = np.arange(len(jobs))
    return start, end, rank[task, number], first[jobs.task, jobs.number]


Slots = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # start, end, task, number of the job


@lru_cache(maxsize=16)  # a chain of phases plans the same windows in every period
def _endless_slots(pairs: tuple[TaskPair, ...], until: int, jobs: int) -> tuple[Slots, bool]:
    """The slots of the endless plan before `until`, in order of time, and some after it; see the text of the module.

    With False they are those of the pressed plan. Not to be written on: whoever asks again gets the same arrays.
    """
    ep = np.array([pair.ep_wcet for pair in pairs])
    lookahead, load = 4 * int(ep.sum()), sum(pair.ep_wcet / pair.period for pair in pairs)
    settled = False
    while not settled:
        horizon = until + lookahead
        ahead = release_jobs(pairs, horizon, {})
        ahead = ahead.ordered(np.lexsort((-ahead.task, -ahead.release)))  # by urgency on the reversed axis
        due = np.minimum(ahead.deadline, horizon)
        kept = np.flatnonzero(ep[ahead.task])
        arrivals = kept[np.argsort(-due[kept], kind="stable")]
        who, start, end = dispatch((-due[arrivals]).tolist(), arrivals.tolist(), ep[ahead.task].tolist(), NEVER)
        before = np.append(-horizon, end[:-1])
        rests = -before[before < start]  # gaps in the plan, by their end in forward time
        settled = not len(who) or bool(len(rests) and rests[0] > until)
        lookahead *= 4
        if load >= 1 or sum(lookahead // pair.period for pair in pairs) > 500_000 + 4 * jobs:
            break
    return (-end[::-1], -start[::-1], ahead.task[who][::-1], ahead.number[who][::-1]), settled


def _repeated(pairs: Sequence[TaskPair], slots: Slots, begun: int, cycle: int, until: int) -> Slots:
    """Slots that are right before `begun + cycle`, with the round from `begun` on copied until two rounds after `until`."""
    start, end, task, number = slots
    opening, one = start < begun, (end > begun) & (start < begun + cycle)
    more = np.array([cycle // pair.period for pair in pairs])[task[one]]  # jobs of the task in a round
    rounds = np.arange((until - begun) // cycle + 3)[:, None]
    columns = (
        (start[opening], np.maximum(start[one], begun) + cycle * rounds),
        (np.minimum(end[opening], begun), np.minimum(end[one], begun + cycle) + cycle * rounds),
        (task[opening], task[one] + 0 * rounds),
        (number[opening], number[one] + more * rounds),
    )
    start, end, task, number = (np.append(before, copies) for before, copies in columns)
    return start, end, task, number
