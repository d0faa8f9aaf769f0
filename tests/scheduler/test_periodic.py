"""RM, DM and EDF on one core: published schedules, agreement with the analyses, and the rules executed unit by unit."""

import io
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.scheduler.analysis import edf_response_times, processor_demand_test, response_times
from labkit.scheduler.execution import constant, empirical, fit_log_normal, from_quantiles, log_normal, two_mode, uniform
from labkit.scheduler.periodic import simulate
from labkit.scheduler.taskfile import ROW, read_schedule, schedule, schedule_rows, write_schedule
from labkit.scheduler.tasksets import PeriodicTask, TaskPair, deadline_monotonic, rate_monotonic
from labkit.trace import jobs, slices
from labkit.trace.folds import priorities


def tasks(*rows):
    """(C, T[, D[, offset]]) rows as tasks t0, t1, ..."""
    return [
        PeriodicTask(f"t{i}", c, t, *more[:1], offset=more[1] if len(more) > 1 else 0) for i, (c, t, *more) in enumerate(rows)
    ]


def line(trace):
    """One character per unit: the number of the task from 1, or - for idle."""
    units = ["-"] * trace.end
    for who, _, _, start, end in slices(trace).rows().tolist():
        units[start:end] = str(who + 1) * (end - start)
    return "".join(units)


# --------------------------------------------------------------------------------------------- published schedules


def test_rtschedule_rm_timeline():
    assert line(simulate(tasks((1, 5), (2, 10), (5, 15)), "rm", 30)) == "122331333-122--133331223-1----"


def test_buttazzo_rm_misses_where_edf_does_not():
    pair = tasks((2, 5), (4, 7))
    rm, edf = (jobs(simulate(pair, policy, 35)) for policy in ("rm", "edf"))
    late = np.flatnonzero(rm.missed)
    assert [[c[i] for c in (rm.task, rm.job, rm.deadline, rm.response, rm.tardiness)] for i in late] == [[1, 0, 7, 8, 1]]
    assert not edf.missed.any()


def test_lehoczky_responses_of_jobs_that_outlive_their_period():
    table = jobs(simulate(tasks((26, 70), (62, 100, 200)), "rm", 700))
    assert table.response[table.task == 1].tolist() == [114, 102, 116, 104, 118, 106, 94]


def test_equal_priorities_go_by_the_order_in_the_list():
    assert line(simulate(tasks((2, 6), (2, 6)), "rm", 6)) == "1122--"
    assert line(simulate(tasks((4, 8), (1, 6, 6, 2)), "edf", 8)) == "11112---"


def test_a_job_may_take_less_than_its_worst_case_and_the_last_time_repeats():
    assert line(simulate(tasks((3, 5)), "edf", 20, {"t0": [1, 3, 2]})) == "1----111--11---11---"


def test_ends_at_the_end_of_the_schedule_count_and_releases_do_not():
    trace = simulate(tasks((5, 5)), "edf", 10)
    assert trace.rows("complete")[:, 0].tolist() == [5, 10]
    assert len(trace.rows("release")) == 2 and not jobs(trace).missed.any()


def test_nothing_released_is_an_idle_schedule():
    for policy in ("rm", "dm", "edf"):
        assert line(simulate(tasks((1, 5, 5, 9)), policy, 9)) == "---------"
    assert line(simulate([TaskPair("x", 1, 1, 5, offset=9)], "taft", 9)) == "---------"


def test_jobs_and_idle_time_add_up():
    trace = simulate(tasks((1, 5), (2, 10), (5, 15)), "rm", 30)
    table, ran = jobs(trace), slices(trace)
    assert np.bincount(table.task, table.main).tolist() == [6, 6, 10]
    assert np.bincount(table.task[table.completion >= 0]).tolist() == [6, 3, 2]
    assert trace.end - np.sum(ran.end - ran.start) == 8 == line(trace).count("-")


def test_a_task_has_one_priority_from_its_release_on_under_fixed_priorities():
    steps = priorities(simulate(tasks((1, 5, 4), (2, 10), (1, 20, 20, 3)), "dm", 20)).tolist()
    assert steps == [[0, 0, 20, 2], [1, 0, 20, 1], [2, 3, 20, 0]]


def test_every_release_is_followed_by_its_deadline():
    trace = simulate(tasks((1, 5, 4), (2, 10)), "dm", 20)
    at = np.flatnonzero(trace.of("release"))
    assert trace.of("deadline")[at + 1].all() and (trace.task[at + 1] == trace.task[at]).all()
    assert (trace.value[at + 1] - trace.value[at]).tolist() == [4, 10, 4, 4, 10, 4]


# ------------------------------------------------------------------------------------- the rules, unit by unit; bounds


def by_the_rules(task_list, policy, until, times):
    jobs = [
        {"task": i, "job": k, "release": r, "due": r + t.deadline, "left": times[i][min(k, len(times[i]) - 1)]}
        for i, t in enumerate(task_list)
        for k, r in enumerate(range(t.offset, until, t.period))
    ]
    urgency = {
        "rm": lambda j: (task_list[j["task"]].period, j["task"], j["job"]),
        "dm": lambda j: (task_list[j["task"]].deadline, j["task"], j["job"]),
        "edf": lambda j: (j["due"], j["task"], j["job"]),
    }[policy]
    units, missed = [], set()
    for now in range(until):
        missed |= {(now, j["task"], j["job"]) for j in jobs if j["due"] == now and j["left"]}
        ready = [j for j in jobs if j["release"] <= now and j["left"]]
        if ready:
            chosen = min(ready, key=urgency)
            chosen["left"] -= 1
        units.append((chosen["task"], chosen["job"]) if ready else None)
    missed |= {(until, j["task"], j["job"]) for j in jobs if j["due"] == until and j["left"]}
    return units, missed


@st.composite
def small_sets(draw):
    rows = []
    for _ in range(draw(st.integers(1, 4))):
        period = draw(st.integers(1, 12))
        deadline = draw(st.integers(1, 16))
        rows.append((draw(st.integers(1, deadline)), period, deadline, draw(st.integers(0, 12))))
    return tasks(*rows), [draw(st.lists(st.integers(1, 7), min_size=1, max_size=5)) for _ in rows]


@settings(max_examples=200, deadline=None)
@given(small_sets(), st.sampled_from(["rm", "dm", "edf"]), st.integers(1, 60))
def test_the_engine_does_what_the_rules_say_unit_by_unit(drawn, policy, until):
    task_list, times = drawn
    trace = simulate(task_list, policy, until, {t.name: some for t, some in zip(task_list, times, strict=True)})
    units = [None] * until
    for who, _, job, start, end in slices(trace).rows().tolist():
        units[start:end] = [(who, job)] * (end - start)
    table = jobs(trace)
    missed = set(zip(*(c[table.missed].tolist() for c in (table.deadline, table.task, table.job)), strict=True))
    assert (units, missed) == by_the_rules(task_list, policy, until, times)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 5), st.sampled_from([8, 10, 12, 20, 24, 40])), min_size=1, max_size=5),
    st.sampled_from(["rm", "dm", "edf"]),
)
def test_released_together_the_worst_response_is_the_analysis(rows, policy):
    task_list = tasks(*rows)
    if sum(t.wcet / t.period for t in task_list) > 1:
        return
    ordered = {"rm": rate_monotonic, "dm": deadline_monotonic, "edf": list}[policy](task_list)
    trace = simulate(ordered, policy, 240)
    seen = {task.name: 0 for task in ordered}
    for time, _, who, _, due, _ in trace.rows("complete").tolist():
        seen[ordered[who].name] = max(seen[ordered[who].name], time - due + ordered[who].deadline)
    if policy == "edf":
        bounds = edf_response_times(ordered)
        assert processor_demand_test(ordered) and all(seen[name] <= bounds[name] for name in seen)
    else:
        bounds = response_times(ordered)
        assert all(seen[t.name] == bounds[t.name] for t in ordered if bounds[t.name] is not None and bounds[t.name] <= t.period)


# --------------------------------------------------------------------------------------------------- anybody's sets


SET = {
    "tasks": [
        {"name": "a", "period": 10, "ecet": 2, "ep_wcet": 1, "wcet": 5, "times": [9]},
        {"name": "b", "period": 10, "deadline": 10, "offset": 0, "ecet": 3, "ep_wcet": 2, "wcet": 4, "times": [9, 3]},
    ]
}


def test_rows_of_a_taft_schedule():
    verdict, trace = schedule(SET, "taft", 10)
    assert verdict["accepted"] is True and {"test", "why"} <= set(verdict)
    assert json.loads(json.dumps(verdict)) == verdict
    assert schedule_rows(trace) == [
        ("a", 0, "mp", "release", 0, 0),
        ("b", 0, "mp", "release", 0, 0),
        ("a", 0, "mp", "run", 0, 2),
        ("b", 0, "mp", "run", 2, 5),
        ("a", 0, "mp", "run", 5, 7),
        ("a", 0, "mp", "abort", 7, 7),
        ("a", 0, "ep", "run", 7, 8),
        ("a", 0, "ep", "complete", 8, 8),
        ("b", 0, "mp", "abort", 8, 8),
        ("b", 0, "ep", "run", 8, 10),
        ("b", 0, "ep", "complete", 10, 10),
    ]


def test_the_same_set_under_edf_and_the_file_reads_back():
    verdict, trace = schedule(SET, "edf", 20)
    assert verdict["accepted"] is True
    assert "not covered: job 0 of task 'a' takes 9, more than its wcet 5" in verdict["why"]
    file = io.StringIO(newline="")
    write_schedule(trace, file)
    file.seek(0)
    assert file.readline() == ",".join(ROW) + "\n"
    file.seek(0)
    assert read_schedule(file) == schedule_rows(trace)
    assert {row[2] for row in schedule_rows(trace)} == {"mp"}


@pytest.mark.parametrize(
    ("change", "policy", "message"),
    [
        ({"period": 0}, "edf", "task 'a': period is 0; a whole number from 1"),
        ({"wcet": 11}, "rm", "task 'a': wcet 11 exceeds its deadline 10 by 1"),
        ({"wcet": 1}, "taft", "task 'a': ecet 2 exceeds the wcet 1 of its main part by 1"),
        ({"ep_wcet": 9}, "taft", "task 'a': ecet 2 and ep_wcet 9 exceed its deadline 10 by 1"),
        ({"deadline": 12}, "taft", "task 'a': deadline 12 exceeds its period 10"),
        ({"period": 2.5}, "edf", "task 'a': period is 2.5; a whole number from 1 to 1125899906842624 is allowed"),
        ({"times": [3, 0]}, "edf", "task 'a': time 1 is 0; a whole number from 1 to 1125899906842624 is allowed"),
        ({"times": []}, "edf", "task 'a': times is []; a list of 1 to 1000000 execution times is allowed"),
        ({"name": "b"}, "edf", "two tasks are called 'b'"),
        ({"name": ""}, "edf", "task 0: name is ''; a text of 1 to 100 printable characters is allowed"),
        ({"priority": 3}, "edf", "task 'a' has a field 'priority'"),
        (
            {"period": 1 << 60, "deadline": 10},
            "edf",
            "task 'a': period is 1152921504606846976; a whole number from 1 to 1125899906842624 is allowed",
        ),
        ({"times": [1 << 70]}, "edf", "task 'a': time 0 is 1180591620717411303424; a whole number from 1 to 1125899906842624"),
        ({"period": None}, "edf", "task 'a': period is None; a whole number from 1"),
        ({"wcet": None}, "edf", "task 'a' has no wcet; policy edf needs period, wcet"),
        ({"wcet": 1e400}, "edf", "task 'a': wcet is inf; a whole number from 1"),
        ({"wcet": True}, "edf", "task 'a': wcet is True; a whole number from 1"),
        ({"name": "a\r\nb"}, "edf", r"task 0: name is 'a\r\nb'; a text of 1 to 100 printable characters is allowed"),
    ],
)
def test_bad_sets_are_told_in_one_sentence(change, policy, message):
    bad = json.loads(json.dumps(SET))
    bad["tasks"][0] |= change
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        schedule(bad, policy, 20)
    assert message in str(error.value)


@pytest.mark.parametrize("data", [[], {}, {"tasks": 3}, {"tasks": []}, {"tasks": [7]}, {"tasks": [{"name": "x"}]}, None])
def test_what_is_no_task_set_is_refused(data):
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        schedule(data, "edf", 20)


def test_missing_fields_and_wrong_calls_are_refused():
    with pytest.raises(ValueError, match="policy 'fifo'; there are rm, dm, edf, taft"):
        schedule(SET, "fifo", 20)
    with pytest.raises(ValueError, match="the end of the schedule is 0; a whole number from 1 to"):
        schedule(SET, "edf", 0)
    with pytest.raises(ValueError, match="task 't0' is a PeriodicTask; policy taft schedules TaskPairs"):
        simulate(tasks((1, 2)), "taft", 9)
    with pytest.raises(ValueError, match="jobs until 100000000; at most"):
        simulate(tasks((1, 2)), "rm", 100_000_000)
    with pytest.raises(ValueError, match="execution times for 'x', which is no task"):
        simulate(tasks((1, 2)), "rm", 9, {"x": [1]})


# ----------------------------------------------------------------------------------------------- execution-time models


def test_execution_models_draw_what_they_say():
    rng = np.random.default_rng(5)
    assert constant(7)(3, rng).tolist() == [7, 7, 7]
    assert set(uniform(2, 4)(400, rng)) == {2, 3, 4}
    assert set(empirical([3, 8])(100, rng)) == {3, 8}
    cut = log_normal(1000, 0.5, longest=2000)(20_000, rng)
    assert cut.max() <= 2000 and cut.min() >= 1 and cut.dtype == np.int64
    both = two_mode(constant(1), constant(100), 0.1)(50_000, rng)
    assert np.mean(both == 100) == pytest.approx(0.1, abs=0.01)
    known = from_quantiles([(0, 5_000), (0.5, 20_000), (0.9, 50_000), (1, 140_000)])(100_000, rng)
    assert np.mean(known < 50_000) == pytest.approx(0.9, abs=0.005) and known.max() <= 140_000
    assert np.array_equal(uniform(1, 9)(50, np.random.default_rng(1)), uniform(1, 9)(50, np.random.default_rng(1)))


def test_the_fitted_log_normal_law_has_what_it_was_fitted_to():
    rng = np.random.default_rng(8)
    times = log_normal(*fit_log_normal(0.9, 50_000, 140_000, 400))(400 * 400, rng)
    assert np.mean(times < 50_000) == pytest.approx(0.9, abs=0.005)
    assert np.median(times.reshape(400, 400).max(axis=1)) == pytest.approx(140_000, rel=0.05)


def test_models_refuse_what_makes_no_sense():
    for wrong in (
        lambda: constant(0),
        lambda: uniform(5, 4),
        lambda: log_normal(10, -1),
        lambda: log_normal(10, 1, 5),
        lambda: empirical([]),
        lambda: two_mode(constant(1), constant(2), 1.5),
        lambda: from_quantiles([(0, 5), (0.9, 3), (1, 9)]),
        lambda: fit_log_normal(0.9, 140, 50, 400),
    ):
        with pytest.raises(ValueError, match=r"^[^\n]+$"):
            wrong()
