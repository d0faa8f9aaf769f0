"""Fixed-priority response times against published answers and against a scheduler that knows nothing but the rule."""

from itertools import accumulate
from math import lcm

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import Overheads, job_responses, response_time_test, response_times, utilization
from labkit.scheduler.tasksets import PeriodicTask, deadline_monotonic, rate_monotonic


def tasks(*rows):
    """(C, T[, D]) rows as tasks t1, t2, ... in priority order."""
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


def responses(*rows):
    return list(response_times(tasks(*rows)).values())


def simulate(task_list, until, releases=None):
    """Unit by unit the first task in the list with work left runs. Returns who ran (index or None) and each task's responses."""
    releases = releases or [[(a, a) for a in range(t.offset, until, t.period)] for t in task_list]
    queues = [[] for _ in task_list]  # jobs as [arrival, work left], oldest first
    done = [[] for _ in task_list]
    ran = []
    for now in range(until):
        for i, task in enumerate(task_list):
            queues[i] += [[arrival, task.wcet] for arrival, release in releases[i] if release == now]
        active = next((i for i, queue in enumerate(queues) if queue), None)
        ran.append(active)
        if active is not None:
            queues[active][0][1] -= 1
            if not queues[active][0][1]:
                done[active].append(now + 1 - queues[active].pop(0)[0])
    return ran, done


# --- published answers ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "rows", "answer"),
    [
        ("Burns and Wellings", [(3, 7), (3, 12), (5, 20)], [3, 6, 20]),
        ("Burns and Wellings A", [(10, 30), (10, 40), (12, 50)], [10, 20, 52]),
        ("Burns and Wellings B", [(4, 16), (5, 40), (32, 80)], [4, 9, 58]),
        ("Burns and Wellings C", [(5, 20), (10, 40), (40, 80)], [5, 15, 80]),
        ("SEI, Sha", [(40, 100), (40, 150), (100, 350)], [40, 80, 300]),
        ("Buttazzo, deadline monotonic", [(1, 4, 3), (1, 5, 4), (2, 6, 5), (1, 11, 10)], [1, 2, 4, 10]),
        ("schedcat", [(1, 4), (1, 5), (3, 9), (3, 18)], [1, 2, 7, 18]),
    ],
)
def test_published_response_times(source, rows, answer):
    assert responses(*rows) == answer
    ran = simulate(tasks(*rows), 2 * max(row[1] for row in rows))[1]
    assert [jobs[0] for jobs in ran] == answer


def test_burns_and_wellings_a_misses_by_two():
    verdict = response_time_test(tasks((10, 30), (10, 40), (12, 50)))
    assert not verdict
    assert verdict.exact
    assert verdict.why == "task 't3': response time 52 exceeds the deadline 50 by 2"


def test_burns_and_wellings_c_fits_at_full_load():
    full = tasks((5, 20), (10, 40), (40, 80))
    assert utilization(full) == 1
    assert response_time_test(full)


def test_buttazzo_rate_monotonic_misses_at_7():
    late = tasks((2, 5), (4, 7))
    assert not response_time_test(late)
    assert job_responses(late, "t2")[0] > 7
    ran, _ = simulate(late, 7)
    assert ran.count(1) == 3  # of the 4 units the second task needs by its deadline at 7


def test_lehoczky_arbitrary_deadlines():
    assert job_responses(tasks((26, 70), (62, 100, 118)), "t2") == (114, 102, 116, 104, 118, 106, 94)
    assert response_time_test(tasks((26, 70), (62, 100, 118)))
    assert not response_time_test(tasks((26, 70), (62, 100, 117)))


def test_rtschedule_rate_monotonic_timeline():
    ran, _ = simulate(tasks((1, 5), (2, 10), (5, 15)), 30)
    assert "".join("-" if i is None else str(i + 1) for i in ran) == "122331333-122--133331223-1----"


# --- terms of the equation ------------------------------------------------------------------------


def test_blocking_delays_the_blocked_task_only():
    assert response_times(tasks((3, 7), (3, 12), (5, 40)), blocking={"t2": 1}) == {"t1": 3, "t2": 7, "t3": 20}


def test_unbounded_blocking_has_no_response_time():
    verdict = response_time_test(tasks((3, 7), (3, 12)), blocking={"t1": None})
    assert not verdict
    assert "without bound" in verdict.why


def test_jitter_counts_from_the_arrival_and_lets_two_jobs_meet():
    late = [PeriodicTask("t1", 2, 10, jitter=5), PeriodicTask("t2", 6, 30)]
    assert response_times(late) == {"t1": 7, "t2": 10}  # releases of t1 at 0 and 5


def test_overload_is_reported_and_does_not_hang():
    heavy = tasks((6, 10), (5, 10, 100))
    assert response_times(heavy) == {"t1": 6, "t2": None}
    assert "without bound" in response_time_test(heavy).why


def test_full_load_with_blocking_ends_although_the_busy_period_does_not():
    assert job_responses(tasks((10, 10, 20)), "t1", blocking={"t1": 3}) == (13,)


def test_nearly_full_load_with_large_numbers_ends():
    assert response_times(tasks((999_999_999, 10**9 + 1), (1, 10**9)))["t2"] == 10**9


def test_overheads_charge_two_switches_a_job_and_every_tick():
    plain = tasks((20, 100), (50, 400))
    costs = Overheads(switch=2, tick=1, tick_period=10, job=3, section=4)
    charged = response_times([PeriodicTask("tick", 1, 10), *tasks((27, 100), (57, 400))], blocking={"t1": 4, "t2": 4})
    assert response_times(plain, overheads=costs) == {"t1": charged["t1"], "t2": charged["t2"]}


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PeriodicTask("a", 0, 5), "task 'a': wcet is 0; a whole number of at least 1 is allowed"),
        (lambda: PeriodicTask("a", 1, 0, 5), "task 'a': period is 0"),
        (lambda: PeriodicTask("a", 1.5, 5), "task 'a': wcet is 1.5; a whole number of at least 1 is allowed"),
        (lambda: PeriodicTask("a", 6, 10, 5), "task 'a': wcet 6 exceeds its deadline 5 by 1"),
        (lambda: response_times([]), "at least one task"),
        (lambda: response_times([PeriodicTask("a", 1, 5)] * 2), "two tasks are called 'a'"),
        (lambda: job_responses(tasks((1, 5)), "x"), "no task 'x' in this set; it has t1"),
        (lambda: response_times(tasks((1, 5)), blocking={"x": 1}), "no task 'x'"),
        (lambda: Overheads(tick=3), "a tick cost needs a tick_period above 0"),
        (lambda: Overheads(switch=-3), "overhead switch is -3"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        make()


# --- against the simulated schedule -----------------------------------------------------------------


@st.composite
def task_sets(draw, most=4, periods=(2, 3, 4, 5, 6, 8, 10, 12, 15, 20), arbitrary=False):
    rows = []
    for _ in range(draw(st.integers(1, most))):
        period = draw(st.sampled_from(periods))
        wcet = draw(st.integers(1, period))
        rows.append((wcet, period, draw(st.integers(wcet, 4 * period)) if arbitrary else period))
    return tasks(*rows)


@settings(max_examples=150, deadline=None)
@given(task_sets(arbitrary=True))
def test_synchronous_sets_reach_the_bound_exactly(task_list):
    assume(utilization(task_list) <= 1)
    _, done = simulate(task_list, 3 * lcm(*(t.period for t in task_list)))
    assert [max(jobs) for jobs in done] == list(response_times(task_list).values())


@settings(max_examples=150, deadline=None)
@given(task_sets(), st.data())
def test_no_offset_or_jitter_exceeds_the_bound(task_list, data):
    assume(utilization(task_list) <= 1)
    jitters = [data.draw(st.integers(0, t.period + 2)) for t in task_list]
    task_list = [PeriodicTask(t.name, t.wcet, t.period, t.deadline, jitter=j) for t, j in zip(task_list, jitters, strict=True)]
    until = 2 * lcm(*(t.period for t in task_list)) + 40
    releases = []
    for t in task_list:
        arrivals = range(data.draw(st.integers(0, 12)), until, t.period)
        late = data.draw(st.lists(st.integers(0, t.jitter), min_size=len(arrivals), max_size=len(arrivals)))
        in_order = accumulate((a + j for a, j in zip(arrivals, late, strict=True)), max)  # no job overtakes an older one
        releases.append(list(zip(arrivals, in_order, strict=True)))
    _, done = simulate(task_list, until, releases)
    for jobs, bound in zip(done, response_times(task_list).values(), strict=True):
        assert bound is None or max(jobs, default=0) <= bound


@settings(max_examples=100, deadline=None)
@given(task_sets(), st.data())
def test_the_jitter_bound_is_reached(task_list, data):
    jitters = [data.draw(st.integers(0, t.period)) for t in task_list]
    task_list = [PeriodicTask(t.name, t.wcet, t.period, t.deadline, jitter=j) for t, j in zip(task_list, jitters, strict=True)]
    assume(utilization(task_list) < 1)
    busy, before = 1, 0  # the lowest task may be done only at the end of the busy period, which jitter makes long
    while busy != before:
        busy, before = sum(-(-(busy + t.jitter) // t.period) * t.wcet for t in task_list), busy
    until = busy + max(t.period for t in task_list)
    releases = [[(a, max(a, 0)) for a in range(-t.jitter, until, t.period)] for t in task_list]
    _, done = simulate(task_list, until, releases)
    assert [max(jobs) for jobs in done] == list(response_times(task_list).values())


@settings(max_examples=100, deadline=None)
@given(task_sets())
def test_overload_at_a_level_is_unbounded_there_and_only_there(task_list):
    bounds = list(response_times(task_list).values())
    for i, bound in enumerate(bounds, start=1):
        assert (bound is None) == (utilization(task_list[:i]) > 1)


@settings(max_examples=60, deadline=None)
@given(task_sets(most=3, arbitrary=False), st.permutations(range(3)), st.data())
def test_deadline_monotonic_fits_whenever_any_order_does(task_list, order, data):
    task_list = [PeriodicTask(t.name, t.wcet, t.period, data.draw(st.integers(t.wcet, t.period))) for t in task_list]
    other = [task_list[i] for i in order if i < len(task_list)]
    if response_time_test(other):
        assert response_time_test(deadline_monotonic(task_list))


def test_priority_orders():
    mixed = [*tasks((1, 10, 9), (1, 5), (1, 10, 3)), PeriodicTask("t4", 1, 9, 6, jitter=4)]
    assert [t.name for t in rate_monotonic(mixed)] == ["t2", "t4", "t1", "t3"]
    assert [t.name for t in deadline_monotonic(mixed)] == ["t4", "t3", "t2", "t1"]
