"""Spans and statistics: nesting, preemption, percentiles, periods, response times; the same for logs and simulations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.trace import Trace, describe, read_log, spans, statistics
from labkit.trace.folds import runs
from labkit.trace.kinds import CODE
from labkit.trace.spans import _walk, nest

LOGS = Path(__file__).parents[1] / "oracle" / "logs"


def log_of(*named_spans):
    """A log of (name, start, end), span by span: out of order, as real ones are."""
    return "".join(f"{name} {start} 1\n{name} {end} 0\n" for name, start, end in named_spans)


def stats_of(*named_spans):
    return statistics(read_log(log_of(*named_spans))[0])


def simulation(rows, names="A B IDLE", *, hz=1000, end):
    """A trace of (time, kind, task, value, extra)."""
    names = names.split()
    table = [(time, CODE[kind], names.index(task), -1, value, extra) for time, kind, task, value, extra in rows]
    return Trace.from_rows(table, names, hz, end=end)


# Published numbers


def test_wheel_control_takes_10_to_11_us_in_listing_38():
    wheel = statistics(read_log(LOGS / "xu2025_listing38_10000_5000hz.log")[0]).loc["wheel_ctrl"]
    assert (wheel["count"], wheel["min"], wheel["max"], wheel["mean"], wheel["sum"]) == (2, 10, 11, 10.5, 21)
    assert wheel["period"] == 154 - 65
    assert 10 <= 10.69 <= wheel["max"]  # the mean over 18 s at 100 Hz, table 9


def test_pose_control_repeats_after_about_200_us_in_listing_38():
    pose = statistics(read_log(LOGS / "xu2025_listing38_10000_5000hz.log")[0]).loc["pose_control"]
    assert pose["period"] == 237 - 41 and pose["min"] == pose["max"] == 9


def test_a_begin_whose_end_was_not_printed_has_no_share_in_listing_37():
    frame = statistics(read_log(LOGS / "xu2025_listing37_5000_2000hz.log")[0])
    assert frame.loc["wheel_ctrl", ["count", "cut", "self"]].tolist() == [1, 1, 10]
    assert frame.loc["odometry", "period"] == 788 - 289  # 2000 Hz
    assert frame.loc["IDLE", "self"] == 61 + 181


# Nesting and preemption


def test_self_time_leaves_out_what_is_nested():
    frame = stats_of(("uros", 0, 100), ("w_ctrl", 10, 40), ("inner", 20, 25))
    assert frame["self"].to_dict() == {"uros": 70, "w_ctrl": 25, "inner": 5}
    assert frame["sum"].to_dict() == {"uros": 100, "w_ctrl": 30, "inner": 5}
    assert frame["share"].sum() == pytest.approx(1)


def test_a_scope_sleeps_while_its_task_is_switched_out():
    """`w_ctrl` belongs to `uros`, which is preempted by `tsink` in the middle of it."""
    trace, _ = read_log(log_of(("uros", 0, 20), ("w_ctrl", 10, 40), ("tsink", 21, 25), ("uros", 26, 50)))
    frame = spans(trace)
    assert frame["name"].tolist() == ["uros", "w_ctrl", "tsink", "uros"]
    assert frame["self"].tolist() == [10, 24, 4, 10] and frame["depth"].tolist() == [0, 1, 0, 0]


def test_without_context_switches_an_overlap_belongs_to_the_span_begun_last():
    frame = stats_of(("A", 0, 20), ("B", 10, 30))
    assert frame["self"].to_dict() == {"A": 10, "B": 20}


def test_two_scopes_of_one_task_sleep_and_wake_together():
    trace, _ = read_log(log_of(("T", 0, 10), ("outer", 2, 30), ("inner", 5, 25), ("U", 10, 20), ("T", 20, 40)))
    own = spans(trace).groupby("name")["self"].sum()
    assert own.to_dict() == {"T": 2 + 10, "outer": 3 + 5, "inner": 5 + 5, "U": 10}


@given(st.lists(st.tuples(st.sampled_from("abcdef"), st.integers(0, 60), st.integers(0, 20)), min_size=1, max_size=25))
def test_selfs_partition_the_time_in_which_anything_is_open(drawn):
    last = {}
    chosen = []
    for name, start, length in sorted(drawn, key=lambda s: s[1]):
        if start > last.get(name, -1):
            chosen.append((name, start, start + length))
            last[name] = start + length
    trace, _ = read_log(log_of(*chosen))
    frame = spans(trace)
    assert sorted(zip(frame["name"], frame["start"].tolist(), frame["end"].tolist())) == sorted(chosen)
    busy = np.zeros(100, bool)
    for _, start, end in chosen:
        busy[start:end] = True
    if not any(a[0] == b[0] and a[1] < c[1] < a[2] < b[1] < c[2] for a in chosen for b in chosen for c in chosen):
        assert frame["self"].sum() == busy.sum()  # no scope sleeps
    assert frame["self"].sum() <= busy.sum()


# Distribution and period


@given(st.lists(st.integers(0, 50), min_size=1, max_size=120))
def test_statistics_agree_with_numpy(durations):
    begins = np.arange(len(durations)) * 60
    row = stats_of(*(("t", int(b), int(b) + d) for b, d in zip(begins, durations))).loc["t"]
    want = np.array(durations)
    assert (row["count"], row["sum"], row["min"], row["max"]) == (len(want), want.sum(), want.min(), want.max())
    assert row["mean"] == pytest.approx(want.mean())
    for column, percent in (("p50", 50), ("p95", 95), ("p99", 99)):
        assert row[column] == np.percentile(want, percent, method="inverted_cdf")


@given(st.lists(st.integers(1, 1000), min_size=1, max_size=60))
def test_period_and_jitter_agree_with_their_definition(gaps):
    begins = np.concatenate([[0], np.cumsum(gaps)])
    row = stats_of(*(("t", int(b), int(b)) for b in begins)).loc["t"]
    assert row["period"] == pytest.approx(np.mean(gaps))
    assert row["jitter"] == pytest.approx(np.abs(gaps - np.median(gaps)).max())
    assert row["period_std"] == pytest.approx(np.std(gaps), abs=1e-6)
    assert row["rate"] == pytest.approx(len(begins) / sum(gaps) * 1e6)


# Simulations


RUNS = [(time, "switch", task, 0, 0) for time, task in [(0, "A"), (3, "B"), (5, "A"), (6, "B"), (9, "IDLE")]]


def test_runs_come_from_switch_rows_and_the_last_is_cut():
    frame = spans(simulation(RUNS, end=12))
    assert frame[["name", "start", "end", "complete"]].values.tolist() == [
        ["A", 0, 3, True],
        ["B", 3, 5, True],
        ["A", 5, 6, True],
        ["B", 6, 9, True],
        ["IDLE", 9, 12, False],
    ]
    table = statistics(simulation(RUNS, end=12))
    assert table["self"].to_dict() == {"B": 5000, "A": 4000, "IDLE": 3000}  # 1000 us per unit; a cut run counts
    assert table["share"].sum() == pytest.approx(1) and table.loc["IDLE", "count"] == 0
    assert np.isnan(table.loc["A", "response_max"])


def test_runs_that_use_no_time_are_no_runs():
    rows = [(0, "switch", "A", 2, -1), (4, "switch", "B", 1, 1), (4, "switch", "A", 2, 1), (7, "switch", "IDLE", 0, 1)]
    assert spans(simulation(rows, end=9))[["name", "start", "end"]].values.tolist() == [["A", 0, 7], ["IDLE", 7, 9]]


def test_scopes_inside_a_simulated_task_sleep_with_it():
    names = "A B IDLE f"
    rows = [*RUNS, (4, "begin", "f", 0, 0), (7, "end", "f", 0, 0)]
    own = spans(simulation(sorted(rows), names, end=12)).groupby("name")["self"].sum()
    assert own.to_dict() == {"A": 4, "B": 1 + 2, "IDLE": 3, "f": 1 + 1}


def test_the_kernels_own_time_belongs_to_no_task():
    rows = [
        (0, "switch", "A", 2, -1),
        (2, "overhead", "A", 1, 0),
        (4, "begin", "f", 0, 0),
        (4, "overhead", "A", 2, 2),
        (7, "end", "f", 0, 0),
        (8, "overhead", "A", 1, 1),
        (9, "switch", "IDLE", 0, 1),
        (11, "overhead", "IDLE", 5, 0),
    ]
    frame = statistics(simulation(rows, "A IDLE f", end=12))
    assert frame["self"].to_dict() == {"(kernel)": 4000, "A": (2 + 1 + 1) * 1000, "IDLE": 2000, "f": 1000}
    assert frame.loc["A", ["sum", "count"]].tolist() == [9000, 1] and frame.loc["(kernel)", ["count", "cut"]].tolist() == [3, 1]
    assert spans(simulation(rows, "A IDLE f", end=12)).query("name == '(kernel)'")["depth"].tolist() == [1, 2, 1, 1]


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3), st.sampled_from("ABC")), max_size=40), st.integers(0, 3))
def test_self_times_agree_with_the_exclusive_intervals_of_the_folds(steps, rest):
    now, running, rows = 0, "IDLE", [(0, "switch", "IDLE", 0, -1)]
    for pause, cost, task in steps:
        now += pause
        if cost:
            rows.append((now, "overhead", running, cost, 1))
        now += cost
        if task != running:
            rows.append((now, "switch", task, 0, 0))
            running = task
    trace = simulation(rows, "A B C IDLE", end=now + rest)
    exclusive = runs(trace)
    want = np.bincount(exclusive[:, 0], exclusive[:, 2] - exclusive[:, 1], 4)
    own = spans(trace).groupby("name")["self"].sum()
    assert [own.get(name, 0) for name in trace.names] == want.tolist()


def test_two_tasks_may_run_the_same_scope_at_once_in_a_simulation():
    rows = [(1, "begin", 0, 3), (2, "begin", 1, 3), (4, "end", 1, 3), (7, "end", 0, 3)]
    table = [(time, CODE[kind], scope, task, 0, 0) for time, kind, task, scope in rows]
    frame = spans(Trace.from_rows(table, ["A", "B", "IDLE", "f"], 1000, end=9))
    assert frame[["name", "start", "end"]].values.tolist() == [["f", 1, 7], ["f", 2, 4]]


def test_a_window_cuts_its_first_run():
    frame = spans(simulation(RUNS, end=12).window(4, 8))
    rows = frame[["name", "start", "end", "complete"]].values.tolist()
    assert rows == [["B", 4, 5, False], ["A", 5, 6, True], ["B", 6, 8, False]]


def test_response_time_runs_from_nominal_release_to_completion():
    rows = [
        (1, "release", "A", 0, 0),
        (2, "release", "B", 2, 0),
        (2, "switch", "A", 2, -1),
        (4, "complete", "A", 10, 0),
        (4, "switch", "B", 1, 1),
        (10, "release", "A", 10, 1),
        (10, "switch", "A", 2, 0),
        (13, "complete", "A", 20, 1),
        (13, "switch", "B", 1, 1),
        (14, "complete", "B", -1, 0),
        (14, "switch", "IDLE", 0, 1),
        (20, "release", "A", 20, 2),
        (20, "deadline", "A", 21, 2),
    ]
    frame = statistics(simulation(rows, end=22))
    a, b = frame.loc["A"], frame.loc["B"]
    assert (a["jobs"], a["response_mean"], a["response_max"], a["misses"]) == (2, 3500, 4000, 1)
    assert (b["jobs"], b["response_max"]) == (1, 12_000)
    assert a["period"] == (10 - 2) * 1000 and np.isnan(b["period"])  # B is preempted, but it is one activation
    assert b["count"] == 2 and b["rate"] == pytest.approx(1 / 0.022)


def test_a_job_released_while_its_task_runs_starts_at_its_release():
    rows = [
        (0, "release", "A", 0, 0),
        (0, "switch", "A", 2, -1),
        (5, "release", "A", 5, 1),
        (8, "complete", "A", -1, 0),
        (9, "complete", "A", -1, 1),
        (9, "switch", "IDLE", 0, 1),
    ]
    frame = statistics(simulation(rows, end=10))
    assert frame.loc["A", "response_max"] == 8000 and frame.loc["A", "period"] == 5000


# Table


def test_description_says_units_and_that_a_maximum_is_no_guarantee():
    text = describe(stats_of(("uros", 0, 100), ("w_ctrl", 10, 40)))
    assert "not a guarantee" in text and "us" in text and "w_ctrl" in text and "response" not in text


def test_an_empty_trace_has_no_rows():
    empty = Trace.from_rows([], ["A"], 1000, end=0)
    assert len(statistics(empty)) == 0 and len(spans(empty)) == 0
    assert describe(statistics(empty))


# Several cores


def two_cores():
    """f runs on core 0 from 0 to 10, g on core 1 from 2 to 6, f again on core 1 from 7 to 9."""
    rows = [(0, "begin", 0), (2, "begin", 1), (6, "end", 1), (7, "begin", 0), (9, "end", 0), (10, "end", 0)]
    table = [(time, CODE[kind], name, -1, 0, 0) for time, kind, name in rows]
    trace = Trace.from_rows(table, ["f", "g"], 1_000_000, end=10)
    return replace(trace, core=np.array([0, 1, 1, 1, 1, 0]))


def test_what_runs_at_once_on_two_cores_is_not_nested():
    frame = spans(two_cores())
    assert frame[["name", "core", "start", "end", "self", "depth"]].values.tolist() == [
        ["f", 0, 0, 10, 10, 0],
        ["g", 1, 2, 6, 4, 0],
        ["f", 1, 7, 9, 2, 0],
    ]


def test_self_and_share_are_told_core_by_core():
    frame = statistics(two_cores())
    assert frame["self"].to_dict() == {("f", 0): 10, ("g", 1): 4, ("f", 1): 2}
    assert frame["share"].to_dict() == pytest.approx({("f", 0): 1, ("g", 1): 0.4, ("f", 1): 0.2})
    assert frame.loc["f", "count"].to_dict() == {0: 1, 1: 1}
    assert "g" in describe(frame)


def test_a_window_of_two_cores_keeps_who_runs_on_each():
    rows = [(0, CODE["switch"], 0, -1, 1, -1), (1, CODE["switch"], 1, -1, 1, -1), (8, CODE["switch"], 1, 0, 1, 0)]
    trace = replace(Trace.from_rows(rows, ["f", "g"], 1_000_000, end=10), core=np.array([0, 1, 0]))
    frame = spans(trace.window(5, 9))
    assert frame[["name", "core", "start", "end"]].values.tolist() == [["f", 0, 5, 8], ["g", 1, 5, 9], ["g", 0, 8, 9]]


# Nesting in whole columns, against the walk over the events


@settings(max_examples=400, deadline=None)
@given(st.data())
def test_nesting_is_that_of_a_walk_with_a_stack(data):
    count = data.draw(st.integers(0, 12))
    places = np.array(data.draw(st.permutations(range(2 * count))), dtype=np.int64).reshape(-1, 2)
    opened, closed = np.sort(places, axis=1).T
    time = np.cumsum(data.draw(st.lists(st.integers(0, 3), min_size=2 * count, max_size=2 * count)) or [0])
    name = np.array(data.draw(st.lists(st.integers(0, 3), min_size=count, max_size=count)), dtype=np.int64)
    columns = name, opened, closed, time[opened], time[closed]
    for fast, walked in zip(nest(*columns), _walk(*columns), strict=True):
        assert fast.tolist() == walked.tolist()


def test_names_with_control_characters_stay_in_the_data_and_are_escaped_in_the_table():
    trace = Trace.from_rows([(0, CODE["begin"], 0, -1, 0, 0), (5, CODE["end"], 0, -1, 0, 0)], ["a\r\nb\x1b"], 1_000_000, end=9)
    assert statistics(trace).index.tolist() == ["a\r\nb\x1b"]
    text = describe(statistics(trace))
    assert "\r" not in text and "\x1b" not in text and "a\\r\\nb\\x1b" in text
    with pytest.raises(ValueError, match=r"^[^\n\r]+$"):
        trace.code("x")
