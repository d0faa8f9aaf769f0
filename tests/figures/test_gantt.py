"""The Gantt chart draws what the trace says: exact bars of any window, and shares where there are too many."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.figures.cursor import happening
from labkit.figures.gantt import MOST, gantt
from labkit.figures.history import BEYOND, EXCEPTION, MAIN, History
from labkit.figures.style import MISS, READY, TASK_COLOURS, colours
from labkit.kernel import Costs, Kernel
from labkit.scheduler.periodic import simulate
from labkit.scheduler.tasksets import PeriodicTask, TaskPair
from labkit.trace import jobs, slices

UNTIL = 400
tasks = st.lists(st.tuples(st.integers(1, 8), st.integers(5, 30), st.integers(0, 20)), min_size=1, max_size=4)
seeds = st.integers(0, 99)


def periodic(rows, policy="rm"):
    return simulate([PeriodicTask(f"t{i}", min(c, t), t, offset=o) for i, (c, t, o) in enumerate(rows)], policy, UNTIL)


def taft(rows, seed):
    pairs = [TaskPair(f"t{i}", min(c, t // 2), min(2, t // 2), t, offset=o) for i, (c, t, o) in enumerate(rows)]
    rng = np.random.default_rng(seed)
    return simulate(pairs, "taft", UNTIL, {p.name: rng.integers(1, 3 * p.ecet, 90, endpoint=True) for p in pairs})


def kernel(rows, seed):
    """Tasks that compute, wait, and share a mutex; every other time ticks and switches cost something, which cuts runs."""
    k = Kernel(costs=Costs(tick=2000, switch=300) if seed % 2 else Costs())
    lock, rng = k.mutex("S"), np.random.default_rng(seed)

    def body(work, period):
        def forever(os):
            while True:
                yield os.compute(work * os.us * 400)
                if rng.random() < 0.5:
                    yield os.take(lock)
                    yield os.compute(os.us * int(rng.integers(1, 900)))
                    yield os.give(lock)
                yield os.delay_until(period)

        return forever

    for i, (work, period, _) in enumerate(rows):
        k.task(f"t{i}", body(work, period), i + 1, deadline=period * k.ms)
    return k.run(until=120 * k.ms).trace


traces = st.one_of(
    st.builds(periodic, tasks, st.sampled_from(["rm", "edf"])), st.builds(taft, tasks, seeds), st.builds(kernel, tasks, seeds)
)


@settings(max_examples=60)
@given(traces, st.floats(0, 1), st.floats(0.01, 1))
def test_a_part_of_the_trace_tells_the_same_of_its_window_as_the_whole(trace, where, size):
    low = int(trace.end * where * 0.99)
    high = min(trace.end, low + max(1, int(trace.end * size)))
    whole = History(trace)
    names = [trace.code(name) for name in ("t0", "t1", "t2", "t3") if name in trace.names]
    part = whole.part(names, low, high)
    for kind in ("runs", "ready", "waits"):
        cut = []
        for table in (getattr(whole, kind), getattr(part, kind)):
            table = table[np.isin(table[:, 0], names) & (table[:, -1] > low) & (table[:, -2] < high)].copy()
            table[:, -2:] = np.clip(table[:, -2:], low, high)
            if kind == "runs":
                table = np.delete(table, 2, axis=1)  # the job is told by its end, which may be after the window
            cut.append(sorted(table.tolist()))
        assert cut[0] == cut[1], kind


@pytest.mark.parametrize("low", range(16_000, 3_000_000, 100_000))
def test_a_run_that_a_tick_has_cut_is_seen_from_a_window_behind_the_tick(low):
    trace = kernel([(8, 20, 0)], 1)
    whole, code = History(trace), trace.code("t0")
    part = whole.part([code], low, low + 50_000)
    wanted, found = (table[(table[:, -2] <= low) & (table[:, -1] > low), 0].tolist() for table in (whole.runs, part.runs))
    assert wanted == found
    assert ("runs" in happening(trace, ("t0",), low * 1e3 / trace.hz)) == (code in wanted)


@settings(max_examples=60)
@given(traces)
def test_misses_are_those_of_the_jobs(trace):
    found = jobs(trace)
    wanted = np.stack([found.task, found.job, found.deadline], axis=1)[found.missed]
    assert sorted(History(trace).misses.tolist()) == sorted(wanted.tolist())


@settings(max_examples=40)
@given(st.builds(taft, tasks, seeds))
def test_runs_are_the_slices_cut_where_the_expected_time_ends(trace):
    runs, ran = History(trace).runs, slices(trace)
    for task in range(len(trace.names)):
        for part, kinds in ((0, (MAIN, BEYOND)), (1, (EXCEPTION,))):
            mine = runs[(runs[:, 0] == task) & np.isin(runs[:, 1], kinds)]
            whole = (ran.task == task) & (ran.part == part)
            assert (mine[:, -1] - mine[:, -2]).sum() == (ran.end - ran.start)[whole].sum()
    table = jobs(trace)
    main = np.zeros(len(table), np.int64)
    for task, _, job, start, end in runs[runs[:, 1] == MAIN].tolist():
        main[(table.task == task) & (table.job == job)] += end - start
    assert (main <= table.main).all()


def bars(panel):
    return [trace for trace in panel.traces if trace["type"] == "bar"]


@settings(max_examples=30)
@given(tasks, seeds)
def test_the_number_of_traces_depends_on_the_rows_only(rows, seed):
    names = ("t0", "t1", "t2", "t3")
    shown = gantt(taft(rows, seed), names, 0, 100, pairs=True)
    other = gantt(taft([(1, 5, 0)], 0), names, 0, 400, pairs=True)
    assert [t["type"] for t in shown.traces] == [t["type"] for t in other.traces]


def test_bars_stand_where_the_jobs_ran():
    panel = gantt(periodic([(2, 5, 0), (4, 7, 0)]), ("t0", "t1"), 0, 35)
    _, plain = bars(panel)
    ready, main = (np.flatnonzero(chosen) for chosen in (plain["width"] < 0.2, plain["width"] > 0.2))
    first, second = colours(("t0", "t1")).values()
    assert plain["base"][main[:3]].tolist() == [0, 2, 5] and plain["y"][main[:3]].tolist() == [0, -1, 0]
    assert [plain["marker"]["color"][at] for at in main[:3]] == [first, second, first]
    at = ready[0]
    assert (plain["base"][at], plain["x"][at], plain["y"][at], plain["customdata"][at]) == (0, 2, -1, "ready")
    assert plain["marker"]["color"][at] == READY["color"]


@pytest.mark.parametrize("window", [(0, 200), (50, 150)])
def test_too_many_slices_become_shares_that_say_the_same(window):
    trace = simulate([PeriodicTask("a", 1, 4), PeriodicTask("b", 2, 8), PeriodicTask("c", 9, 11)], "rm", 200_000, {}, 1_000_000)
    panel = gantt(trace, ("a", "b", "c", "not there"), *window)
    assert sum(len(t["x"]) for t in bars(panel)) == 0
    shares = panel.traces[:4]
    low, high = shares[0]["x"][0], shares[0]["x"][-1]
    ran = slices(trace)
    for row, share in enumerate(shares[:3]):
        assert share["line"]["shape"] == "hv", "up or down first at the next edge"
        height = np.asarray(share["y"])[1:-1] + row + 0.3
        width = np.diff(np.asarray(share["x"])[1:])
        busy = (np.clip(ran.end, low * 1e3, high * 1e3) - np.clip(ran.start, low * 1e3, high * 1e3))[ran.task == row].sum()
        assert (height / 0.6 * width).sum() == pytest.approx(busy / 1e3)
    assert not len(shares[3]["x"])
    miss = panel.traces[-1]
    count = len(miss["x"]) // 14  # once round each, and the way back
    crosses = [miss[axis][: 13 * count].reshape(-1, 13)[:, :12] for axis in "xy"]
    assert crosses[1].mean(axis=1) == pytest.approx(-2) and 0 < count <= MOST // 2
    assert crosses[0].mean(axis=1) == pytest.approx(miss["customdata"][: 13 * count : 13, 1])
    assert all(t["mode"] == "none" for t in [*shares, miss]), "one outline each, no element per point"


@settings(max_examples=20)
@given(st.builds(periodic, tasks, st.just("rm")), st.floats(0, 300), st.floats(1, 300))
def test_never_more_than_the_marks_that_a_page_can_draw(trace, start, size):
    panel = gantt(trace, ("t0", "t1", "t2", "t3"), start, start + size)
    assert sum(len(t["x"]) for t in bars(panel)) <= MOST
    points = sum(len(t["x"]) for t in panel.traces if t["type"] == "scatter" and t["mode"] == "markers")
    assert points <= MOST


def test_no_task_has_the_colour_of_a_miss():
    given_out = set(TASK_COLOURS.values()) | set(colours(f"task {n} of many" for n in range(30)).values())
    assert len(given_out) > 10 and MISS["color"] not in given_out
    alone = {colours([f"t{n}"])[f"t{n}"] for n in range(200)}  # where nothing is taken yet, a name alone decides
    assert MISS["color"] not in alone
