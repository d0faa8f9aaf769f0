"""TAFT acceptance tests against a scheduler that plans and decides anew in every unit of time."""

from math import lcm

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import (
    latest_slots,
    taft_demand_test,
    taft_period_test,
    taft_plan_test,
    taft_test,
    taft_utilization,
)
from labkit.scheduler.analysis.taft import _jumps, _most_planned
from labkit.scheduler.analysis.verdict import Budget
from labkit.scheduler.tasksets import TaskPair


def pairs(*rows):
    """(ECET, EP, T[, D[, offset]]) rows as pairs p1, p2, ..."""
    return [TaskPair(f"p{i}", *row) for i, row in enumerate(rows, start=1)]


def simulate(pair_list, until, needs):
    """TAFT unit by unit by its rules. `needs(i, k)`: what job k of pair i would need to complete.

    Returns the broken guarantees as (what, pair, release): "ecet" for an abort before the ECET, "deadline" for an unfinished job.
    """
    end = until + 3 * max(p.period for p in pair_list)
    jobs = [
        {"pair": i, "release": r, "due": r + p.deadline, "ecet": p.ecet, "need": needs(i, k), "had": 0, "ep": p.ep_wcet}
        | {"state": "main"}
        for i, p in enumerate(pair_list)
        for k, r in enumerate(range(p.offset, end, p.period))
    ]
    broken = []
    for now in range(until):
        while True:  # decisions at this instant, until none changes anything
            slot = planned(jobs, now, end)
            for job in jobs:
                lost = job["state"] == "main" and (job is slot or job["due"] == now)
                if lost and job["release"] <= now and job["had"] < job["need"]:
                    if job["had"] < job["ecet"]:
                        broken.append(("ecet", job["pair"], job["release"]))
                    job["state"] = "exception" if job["ep"] else "done"
                    break
            else:
                break
        broken += [("deadline", job["pair"], job["release"]) for job in jobs if job["due"] == now and job["state"] != "done"]
        if slot is not None:
            slot["ep"] -= 1
            if not slot["ep"]:
                slot["state"] = "done"
            continue
        ready = [job for job in jobs if job["state"] == "main" and job["release"] <= now]
        if ready:
            job = min(ready, key=lambda job: (job["had"] >= job["ecet"], job["due"], job["pair"]))
            job["had"] += 1
            if job["had"] == job["need"]:
                job["state"] = "done"
    return broken


def planned(jobs, now, end):
    """The job whose exception part has the unit that starts at `now`, planning back from `end` one unit at a time."""
    left = {id(job): job["ep"] for job in jobs if job["state"] != "done" and job["due"] > now}
    chosen = None
    for time in range(end + 40, now, -1):
        waiting = [job for job in jobs if left.get(id(job)) and job["due"] >= time]
        chosen = max(waiting, key=lambda job: (job["release"], job["pair"]), default=None)
        if chosen is not None:
            left[id(chosen)] -= 1
    return chosen


# --- the tests of the source, and their limit ------------------------------------------------------------


def test_period_test_is_equation_4_6():
    chain = pairs((4, 1, 20), (8, 1, 20), (5, 1, 20))
    assert taft_period_test(chain).why == "expected times and exception parts take 20 of the period 20, 0 to spare"
    verdict = taft_period_test(pairs((4, 1, 20), (8, 1, 20), (6, 1, 20)))
    assert not verdict
    assert verdict.why.endswith("take 21 of the period 20, 1 too much")
    with pytest.raises(ValueError, match=r"task 'p2': \(4.6\) is for pairs with the period, release and deadline of 'p1'"):
        taft_period_test(pairs((1, 1, 5), (1, 1, 6)))


def test_utilisation_up_to_one_is_not_enough():
    starved = pairs((1, 1, 5), (1, 5, 11))
    assert float(taft_utilization(starved)) == pytest.approx(0.945, abs=0.001)
    verdict = taft_plan_test(starved)
    assert not verdict
    assert verdict.exact
    assert verdict.why.startswith("task 'p1': the main part released at 5 must give way to its exception part at 9")
    assert ("ecet", 0, 5) in simulate(starved, 11, lambda i, k: 99)
    assert not taft_test(starved)


def test_utilisation_above_one_is_refused_by_all():
    for test in (taft_demand_test, taft_plan_test, taft_test):
        verdict = test(pairs((3, 3, 10), (4, 1, 10)))
        assert not verdict
        assert verdict.exact
        assert verdict.why == "expected times and exception parts ask for 1.1000 of the processor"


def test_small_exception_parts_are_accepted_for_any_offsets():
    mixed = pairs((30, 1, 100), (35, 1, 150), (40, 1, 200))
    assert taft_demand_test(mixed)
    assert taft_plan_test(mixed)


def test_latest_slots_go_by_the_latest_release():
    assert latest_slots([(0, 11, 3), (5, 10, 3)]) == [(5, 7, 0), (7, 10, 1), (10, 11, 0)]
    assert latest_slots([(0, 10, 2), (0, 10, 3)]) == [(5, 7, 0), (7, 10, 1)]
    assert latest_slots([(0, 10, 0), (2, 5, 1)]) == [(4, 5, 1)]


# --- against the simulated schedule ------------------------------------------------------------------------


@st.composite
def pair_sets(draw, most=3, offsets=True, implicit=False):
    rows = []
    for _ in range(draw(st.integers(1, most))):
        period = draw(st.sampled_from([3, 4, 6, 8, 12]))
        ep = draw(st.integers(0, period // 3))
        ecet = draw(st.integers(1, max(1, period // 2 - ep)))
        deadline = period if implicit else draw(st.integers(ecet + ep, period))
        rows.append((ecet, ep, period, deadline, draw(st.integers(0, period)) if offsets else 0))
    return pairs(*rows)


@settings(max_examples=40, deadline=None)
@given(pair_sets())
def test_the_plan_test_is_exact(pair_list):
    until = max(p.offset for p in pair_list) + 2 * lcm(*(p.period for p in pair_list)) + 12
    assume(until < 50)
    assert taft_plan_test(pair_list).accepted == (not simulate(pair_list, until, lambda i, k: 99))


@settings(max_examples=40, deadline=None)
@given(pair_sets(), st.data())
def test_no_accepted_set_breaks_a_guarantee_whatever_it_needs(pair_list, data):
    assume(taft_plan_test(pair_list))
    longest = data.draw(st.integers(1, 9))
    needs = data.draw(st.lists(st.integers(1, longest), min_size=7, max_size=7))
    assert not simulate(pair_list, 36, lambda i, k: needs[(3 * i + k) % 7])


@settings(max_examples=400, deadline=None)
@given(pair_sets(most=4), st.data())
def test_the_demand_test_never_accepts_what_some_offsets_break(pair_list, data):
    assume(taft_demand_test(pair_list))
    for _ in range(5):
        offsets = [data.draw(st.integers(0, p.period)) for p in pair_list]
        moved = [TaskPair(p.name, p.ecet, p.ep_wcet, p.period, p.deadline, o) for p, o in zip(pair_list, offsets, strict=True)]
        assert taft_plan_test(moved)


@settings(max_examples=100, deadline=None)
@given(pair_sets(offsets=False))
def test_one_period_makes_the_plan_test_equation_4_6(pair_list):
    assume(sum(p.ecet + p.ep_wcet for p in pair_list) <= 30)
    common = [TaskPair(p.name, p.ecet, p.ep_wcet, 12) for p in pair_list]
    assert taft_plan_test(common).accepted == taft_period_test(common).accepted == taft_test(common).accepted


@settings(max_examples=200, deadline=None)
@given(pair_sets(most=4))
def test_the_demand_test_misses_no_interval(pair_list):
    """Between its points nothing gets worse, and beyond its last one neither."""
    assume(taft_utilization(pair_list) < 1)
    least = min(p.deadline for p in pair_list)
    every = np.arange(least, 400)
    assert taft_demand_test(pair_list).accepted == bool(np.all(_most_planned(pair_list, every) <= every))
    points = np.concatenate([*_jumps(pair_list, 399, Budget("test"))])
    assert (np.diff(points) > 0).all() and points[-1] <= 399
    held = _most_planned(pair_list, points)[np.searchsorted(points, every, side="right") - 1]
    np.testing.assert_array_equal(held, _most_planned(pair_list, every))


def test_a_single_pair_needs_only_its_own_time():
    assert taft_demand_test(pairs((2, 2, 5)))
    full = taft_demand_test(pairs((3, 2, 5)))
    assert not full
    assert not full.exact
    assert taft_test(pairs((3, 2, 5))).test == "TAFT plan"
