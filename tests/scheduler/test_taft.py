"""TAFT: the engine against its rules executed unit by unit, and the guarantees on random sets."""

from itertools import product
from math import gcd, lcm

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.scheduler import taft
from labkit.scheduler.analysis import taft_demand_test, taft_plan_test, taft_test, taft_utilization
from labkit.scheduler.jobs import SUFFIX, release_jobs
from labkit.scheduler.periodic import simulate
from labkit.scheduler.tasksets import TaskPair
from labkit.trace import jobs as jobs_of
from labkit.trace import slices
from labkit.trace.jobs import MAIN, PARTS
from labkit.trace.kinds import KINDS


def pairs(*rows):
    """(ECET, SUFFIX, T[, D[, offset]]) rows as pairs p0, p1, ..."""
    return [TaskPair(f"p{i}", *row) for i, row in enumerate(rows)]


def events(trace, *kinds):
    """(time, kind, name, job) of these rows, in order."""
    return [(t, KINDS[k], trace.names[who], job) for t, k, who, _, _, job in trace.rows(*kinds).tolist()]


def ran(trace):
    rows = slices(trace).rows().tolist()
    return [(trace.names[who] + SUFFIX * part, job, start, end) for who, part, job, start, end in rows]


# ----------------------------------------------------------------------------------------------- one rule at a time


def test_expected_time_first_then_what_is_beyond_it_and_the_exception_last():
    trace = simulate(pairs((2, 1, 10), (3, 2, 10)), "taft", 10, {"p0": [9], "p1": [9]})
    assert ran(trace) == [("p0", 0, 0, 2), ("p1", 0, 2, 5), ("p0", 0, 5, 7), ("p0.ep", 0, 7, 8), ("p1.ep", 0, 8, 10)]
    assert events(trace, "abort", "complete") == [
        (7, "abort", "p0", 0),
        (8, "complete", "p0.ep", 0),
        (8, "abort", "p1", 0),
        (10, "complete", "p1.ep", 0),
    ]


def test_a_completion_moves_the_other_exception_parts_later():
    trace = simulate(pairs((2, 1, 10), (3, 2, 10)), "taft", 10, {"p0": [9], "p1": [3]})
    assert ran(trace) == [("p0", 0, 0, 2), ("p1", 0, 2, 5), ("p0", 0, 5, 9), ("p0.ep", 0, 9, 10)]


def test_completing_at_the_instant_of_the_abort_is_completing():
    for time, what in ((8, "complete"), (9, "abort")):
        assert events(simulate(pairs((2, 2, 10)), "taft", 10, {"p0": [time]}), "complete", "abort")[0] == (8, what, "p0", 0)


def test_an_empty_exception_part_aborts_at_the_deadline():
    trace = simulate(pairs((2, 0, 6, 5)), "taft", 6, {"p0": [9]})
    assert not jobs_of(trace).missed.any()
    assert events(trace, "abort", "complete") == [(5, "abort", "p0", 0), (5, "complete", "p0.ep", 0)]
    assert ran(trace) == [("p0", 0, 0, 5)]


def test_exception_parts_of_jobs_still_to_come_are_in_the_plan():
    """p1's part could go into 9..11 if p0's next job, due at 10, were not sure to need 9..10 itself."""
    trace = simulate(pairs((3, 1, 5), (1, 2, 20, 11)), "taft", 20, {"p0": [9], "p1": [99]})
    assert ("p1.ep", 0, 8, 9) in ran(trace) and ("p0.ep", 1, 9, 10) in ran(trace) and ("p1.ep", 0, 10, 11) in ran(trace)


def test_equal_deadlines_go_by_the_order_in_the_list():
    assert ran(simulate(pairs((2, 1, 10), (2, 1, 10)), "taft", 10)) == [("p0", 0, 0, 2), ("p1", 0, 2, 4)]


def test_priorities_in_the_trace_tell_the_class():
    switch = simulate(pairs((2, 1, 5)), "taft", 5, {"p0": [9]}).rows("switch")
    assert switch[:, [0, 2, 4]].tolist() == [[0, 0, 1], [2, 0, 0], [4, 1, 2]]


def test_overload_of_exception_parts_is_a_miss_and_ends_with_the_deadline():
    trace = simulate(pairs((1, 4, 5), (1, 4, 5)), "taft", 10)
    assert not taft_plan_test(pairs((1, 4, 5), (1, 4, 5)))
    assert jobs_of(trace).missed.any()
    assert slices(trace).end[-1] <= 10


def test_what_cannot_be_scheduled_is_refused():
    with pytest.raises(ValueError, match=r"'p0\.ep', the name of the exception part"):
        simulate([TaskPair("p0", 1, 1, 9), TaskPair("p0.ep", 1, 1, 9)], "taft", 9)
    with pytest.raises(ValueError, match="task 'p0': execution time 0 of job 1; it must be at least 1"):
        simulate(pairs((1, 1, 9)), "taft", 9, {"p0": [3, 0]})


# ----------------------------------------------------------------------------- the rules, executed unit by unit


def by_the_rules(pair_list, until, times):
    """TAFT by its six rules, deciding anew in every unit; returns (runs per unit, events) to compare with the engine's."""
    far = until + 40
    jobs = [
        {
            "task": i,
            "job": k,
            "release": r,
            "due": r + p.deadline,
            "had": 0,
            "need": times[i][min(k, len(times[i]) - 1)],
            "ecet": p.ecet,
            "ep": p.ep_wcet,
            "state": "mp",
        }
        for i, p in enumerate(pair_list)
        for k, r in enumerate(range(p.offset, far, p.period))
    ]
    units, told = [], set()
    for now in range(until + 1):
        open_jobs = [j for j in jobs if j["state"] in ("mp", "ep")]
        for j in open_jobs:
            if j["due"] <= now and j["ep"] and j["state"] == "ep":
                told.add((now, "miss", j["task"], j["job"]))
                j["state"] = "missed"
        plan, left = {}, {id(j): j["ep"] for j in jobs if j["state"] in ("mp", "ep")}
        for unit in range(far + 12, now - 12, -1):  # unit: the one that ends there
            waiting = [j for j in jobs if left.get(id(j)) and j["due"] >= unit]
            if waiting:
                chosen = max(waiting, key=lambda j: (j["release"], j["task"]))
                left[id(chosen)] -= 1
                plan[unit - 1] = chosen
        for j in jobs:
            if j["state"] == "mp" and j["release"] <= now and (j["release"] < until or j["release"] < now):
                first = min((at for at, who in plan.items() if who is j), default=j["due"])
                if first <= now:
                    told.add((now, "abort", j["task"], j["job"]))
                    j["state"] = "ep"
                    if not j["ep"]:
                        told.add((now, "recover", j["task"], j["job"]))
                        j["state"] = "done"
                    elif j["due"] <= now:
                        told.add((now, "miss", j["task"], j["job"]))
                        j["state"] = "missed"
        if now == until:
            break
        slot = plan.get(now)
        if slot is None or slot["release"] > now or slot["state"] != "ep":
            slot = min((j for j in jobs if j["state"] == "ep"), key=lambda j: (j["due"], j["task"]), default=None)
        if slot is not None:
            slot["ep"] -= 1
            units.append((slot["task"], slot["job"], "ep"))
            if not slot["ep"]:
                told.add((now + 1, "recover", slot["task"], slot["job"]))
                slot["state"] = "done"
            continue
        ready = [j for j in jobs if j["state"] == "mp" and j["release"] <= now]
        if not ready:
            units.append(None)
            continue
        j = min(ready, key=lambda j: (j["had"] >= j["ecet"], j["due"], j["task"]))
        j["had"] += 1
        units.append((j["task"], j["job"], "mp"))
        if j["had"] == j["need"]:
            told.add((now + 1, "complete", j["task"], j["job"]))
            j["state"] = "done"
    return units, told


def as_units(trace, until):
    units = [None] * until
    for who, part, job, start, end in slices(trace).rows().tolist():
        units[start:end] = [(who, job, PARTS[part])] * (end - start)
    told = {
        (t, "recover" if kind == "complete" and name.endswith(SUFFIX) else kind, int(name.removesuffix(SUFFIX)[1:]), job)
        for t, kind, name, job in events(trace, "complete", "abort")
    }
    table = jobs_of(trace)
    late = table.missed
    told |= {
        (due, "miss", who, job) for due, who, job in zip(*(c[late].tolist() for c in (table.deadline, table.task, table.job)))
    }
    return units, told


@st.composite
def small_sets(draw):
    rows = []
    for _ in range(draw(st.integers(1, 4))):
        period = draw(st.sampled_from([3, 4, 5, 6, 8]))
        ep = draw(st.integers(0, max(1, period // 3)))
        ecet = draw(st.integers(1, max(1, period // 2 - ep)))
        deadline = draw(st.integers(min(period, ecet + ep), period))
        rows.append((ecet, ep, period, deadline, draw(st.integers(0, period))))
    times = [draw(st.lists(st.integers(1, 9), min_size=1, max_size=6)) for _ in rows]
    return rows, times


@settings(max_examples=150, deadline=None)
@given(small_sets(), st.integers(6, 20))
def test_the_engine_does_what_the_rules_say_unit_by_unit(drawn, until):
    """Also on sets that no test would accept, as long as the exception parts leave room (else a plan has no beginning)."""
    rows, times = drawn
    pair_list = pairs(*rows)
    if sum(p.ep_wcet / p.period for p in pair_list) > 0.8:
        return
    trace = simulate(pair_list, "taft", until, {p.name: t for p, t in zip(pair_list, times, strict=True)})
    assert as_units(trace, until) == by_the_rules(pair_list, until, times)


@settings(max_examples=150, deadline=None)
@given(small_sets(), st.integers(100, 900))
def test_a_plan_of_copied_rounds_is_the_plan(drawn, until):
    """The plan is the same, instant by instant, as the one built for all of the time at once."""
    pair_list = pairs(*drawn[0])
    ep = np.array([p.ep_wcet for p in pair_list])
    jobs = release_jobs(pair_list, until, {})
    direct, settled = taft._endless_slots(tuple(pair_list), until, len(jobs))
    start, end, rank, first = taft._plan(pair_list, jobs, until)
    if not ep.any() or not settled:
        return

    def by_instant(start, end, task, number):
        owner = [None] * until
        for begin, stop, *who in zip(*(column.tolist() for column in (start, end, task, number))):
            assert begin < stop and owner[max(begin, 0) : stop] == [None] * (min(stop, until) - min(max(begin, 0), until))
            owner[max(begin, 0) : min(stop, until)] = [who] * (min(stop, until) - min(max(begin, 0), until))
        return owner

    known = rank < len(jobs)
    copied = by_instant(start[known], end[known], jobs.task[rank[known]], jobs.number[rank[known]])
    mine = np.array([k < (jobs.task == t).sum() for t, k in zip(direct[2], direct[3])], dtype=bool)
    assert copied == by_instant(*(column[mine] for column in direct))
    for place in np.flatnonzero(ep[jobs.task] > 0).tolist():
        slots = start[rank == place]
        assert first[place] == slots.min()


# ---------------------------------------------------------------- what is promised of accepted sets, on random ones

MINIMUM_JOBS = 100_000


def random_pairs(rng, count, load):
    """Pairs of utilisation `load` together, some with tight deadlines and offsets, that the acceptance test takes."""
    while True:
        periods = rng.choice([200, 250, 400, 500, 800, 1000, 2000], count)
        shares = rng.dirichlet(np.ones(count)) * load
        made = []
        for i, (period, share) in enumerate(zip(periods.tolist(), shares.tolist(), strict=True)):
            demand = max(2, int(period * share))
            ep = int(rng.integers(0, max(1, demand // int(rng.integers(2, 12))) + 1))
            ecet = max(1, demand - ep)
            deadline = int(rng.integers(min(period, ecet + ep), period + 1)) if rng.random() < 0.3 else period
            made.append(TaskPair(f"p{i}", ecet, ep, period, deadline, int(rng.integers(0, period))))
        if taft_test(made):
            return made


def check_promises(pair_list, trace):
    """Every promise, by the trace alone; returns the number of jobs and of aborts."""
    jobs = jobs_of(trace).frame()
    by_name = {p.name: p for p in pair_list}
    ecet = jobs["task"].map({n: p.ecet for n, p in by_name.items()})
    ep = jobs["task"].map({n: p.ep_wcet for n, p in by_name.items()})
    due = jobs["release"] + jobs["task"].map({n: p.deadline for n, p in by_name.items()})
    over = due <= trace.end
    assert not jobs["missed"].any()
    assert (jobs["completion"][over] <= due[over]).all() and jobs["completion"][over].notna().all()
    fell = jobs["abort"].notna()
    assert (jobs["main"][fell] >= ecet[fell]).all()
    assert (jobs["exception"][~fell] == 0).all()
    recovered = fell & jobs["completion"].notna()
    assert (jobs["exception"][recovered] == ep[recovered]).all()
    ran = slices(trace)
    aborted_at = jobs.set_index(["task", "job"])["abort"]
    for who, part, job, start, _ in ran.rows().tolist():
        assert part == MAIN or start >= aborted_at[trace.names[who], job]

    # work conserving: when nothing runs, all released jobs have ended
    busy_until = np.append(0, ran.end)
    next_start = np.append(ran.start, trace.end)
    ends = np.sort(jobs["completion"].dropna().to_numpy(np.int64))
    releases = np.sort(jobs["release"].to_numpy())
    idle = next_start > busy_until
    assert (np.searchsorted(releases, next_start[idle], "left") == np.searchsorted(ends, busy_until[idle], "right")).all()

    check_latest(pair_list, trace, jobs, due.to_numpy(), ep.to_numpy())
    return len(jobs), int(fell.sum())


def check_latest(pair_list, trace, jobs, due, ep):
    """No abort could have come later: from it to some deadline d the exception parts that may be needed fill all the time.

    Those are the parts of jobs due by d that have not completed before; what a part has run before counts as done.
    """
    end = jobs["completion"].fillna(1 << 60).to_numpy(np.int64)
    aborted = jobs["abort"].fillna(1 << 60).to_numpy(np.int64)
    main_end = np.where(aborted < 1 << 60, 1 << 60, end)
    number = {key: i for i, key in enumerate(zip(jobs["task"], jobs["job"], strict=True))}
    done = [[] for _ in range(len(jobs))]
    for who, part, job, start, stop in slices(trace).rows().tolist():
        if part != MAIN:
            done[number[trace.names[who], job]].append((start, stop))
    longest = max(p.period for p in pair_list)
    for i in np.flatnonzero((aborted < 1 << 60) & (ep > 0)):
        now = aborted[i]
        if now + 3 * longest > trace.end:
            continue  # jobs released after the end of the trace are not in it
        near = np.flatnonzero((due > now) & (due <= now + 2 * longest) & (main_end > now) & (end > now))
        left = np.array([ep[k] - sum(min(stop, now) - start for start, stop in done[k] if start < now) for k in near])
        order = np.argsort(due[near], kind="stable")
        demand, room = np.cumsum(left[order]), due[near][order] - now
        last = np.append(np.diff(room) > 0, True)
        assert (demand[last] <= room[last]).all() and (demand[last] == room[last]).any()


@pytest.mark.parametrize("seed", range(4))
def test_accepted_sets_keep_every_promise(seed):
    rng = np.random.default_rng(seed)
    jobs = aborts = 0
    while jobs < MINIMUM_JOBS // 4:
        pair_list = random_pairs(rng, int(rng.integers(2, 9)), rng.uniform(0.5, 0.97))
        times = {p.name: rng.integers(1, int(p.ecet * rng.choice([1.2, 3, 20])) + 1, 300) for p in pair_list}
        trace = simulate(pair_list, "taft", int(2500 / sum(1 / p.period for p in pair_list)), times)
        some_jobs, some_aborts = check_promises(pair_list, trace)
        jobs, aborts = jobs + some_jobs, aborts + some_aborts
    assert aborts > 1000


def test_the_promises_are_checked():
    """The checks see what they must: a schedule of a set that no test accepts breaks them."""
    starved = pairs((1, 1, 5), (1, 5, 11))
    with pytest.raises(AssertionError):
        check_promises(starved, simulate(starved, "taft", 550, {"p0": [9], "p1": [99]}))


# ---------------------------------------------------------------------- how far the acceptance tests are from exact


def keeps(pair_list, until, needs):
    """Whether a run gives every main part what it needs or its ECET, and has no late exception part."""
    trace = simulate(pair_list, "taft", until, {p.name: need for p, need in zip(pair_list, needs, strict=True)})
    table = jobs_of(trace)
    ecet = np.array([pair.ecet for pair in pair_list])[table.task]
    return not table.missed.any() and bool((table.main >= ecet)[table.abort >= 0].all())


ROWS = [(c, e, t) for t in range(2, 7) for c in range(1, t + 1) for e in range(t - c + 1)]
SETS = [pairs(a, b) for a in ROWS for b in ROWS if a[2] <= b[2] and taft_utilization(pairs(a, b)) <= 1]


def test_how_far_the_acceptance_tests_are_from_exact():
    """All sets of two pairs with periods 2 to 6 and a utilisation up to 1, which EDF with C = ECET + SUFFIX could all schedule.

    `together`: TAFT keeps its promises, tried by a run through one cycle with endless main parts, released together. `any`: so it
    does for all offsets, all different ones tried. The plan test is exact for the first, the demand test sufficient for the
    second; at full utilisation (True) it mostly cannot tell.
    """
    sets, count = {}, {}
    for pair_list in SETS:
        full = taft_utilization(pair_list) == 1
        cycle = lcm(*(p.period for p in pair_list))
        a, b = pair_list
        moved = [[a, TaskPair(b.name, b.ecet, b.ep_wcet, b.period, offset=o)] for o in range(1, gcd(a.period, b.period))]
        together = keeps(pair_list, cycle, [[99]] * 2)
        whenever = together and all(keeps(others, 3 * cycle, [[99]] * 2) for others in moved)
        plan, demand = bool(taft_plan_test(pair_list)), bool(taft_demand_test(pair_list))
        assert plan == together and whenever >= demand
        sets[full] = sets.get(full, 0) + 1
        for name, yes in (("together", together), ("any", whenever), ("plan", plan), ("demand", demand)):
            count[full, name] = count.get((full, name), 0) + yes
    assert sets == {True: 89, False: 154}
    assert count == {
        (False, "together"): 154,
        (False, "any"): 154,
        (False, "plan"): 154,
        (False, "demand"): 125,
        (True, "together"): 85,
        (True, "any"): 85,
        (True, "plan"): 85,
        (True, "demand"): 20,
    }


def test_endless_main_parts_are_the_worst_case():
    """Of sets that keep their promises with endless main parts, every mixture of short and long ones does, job by job."""
    for pair_list in SETS:
        cycle = lcm(*(p.period for p in pair_list))
        if cycle > 6 or not keeps(pair_list, cycle, [[99]] * 2):
            continue
        counts = [cycle // p.period for p in pair_list]
        for needs in product((1, 99), repeat=sum(counts)):
            assert keeps(pair_list, cycle, [needs[: counts[0]], needs[counts[0] :]])
