"""The framework: anytime parts, last action, explicit output, and the organiser's checks."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.phases.framework import Organiser, Unit
from labkit.trace import jobs, slices
from labkit.trace.jobs import MAIN


def steps(costs, mark=None):
    """A main part that yields (cost, number of the step), and says in `mark` when it is closed."""

    def main(data):
        try:
            for number, cost in enumerate(costs):
                yield cost, (number, data)
        finally:
            if mark is not None:
                mark.append(data)

    return main


def unit(name, *parts, publish=True, log=None):
    """Parts are (costs, ECET, EP); the last action publishes all results and writes them down."""
    made = Unit(name)
    for i, (costs, ecet, ep) in enumerate(parts):
        made.add(steps(costs), ecet, ep, name=f"m{i}")

    @made.last_action
    def last(self, results):
        if log is not None:
            log.append(results)
        if publish:
            self.make_output_available(results)

    return made


def test_a_chain_hands_results_on():
    scan = Unit("scan")

    @scan.part(ecet_ns=40, wcet_ep_ns=1)
    def read(number):
        yield 30, number * 10

    @scan.last_action
    def publish(self, results):
        self.make_output_available(results["read"])

    seen = []
    fuse = unit("fuse", ([5], 10, 1), log=seen)
    chain = Organiser([scan, fuse], 52)
    assert [(w.phase, w.release_ns, w.deadline_ns) for w in chain.start()] == [("scan", 0, 41), ("fuse", 41, 11)]
    done = chain.run([1, 2])
    assert seen == [{"m0": (0, 10)}, {"m0": (0, 20)}]
    assert [(a.period, a.unit, a.finished_ns) for a in done] == [
        (0, "scan", 52 + 30),
        (0, "fuse", 52 + 46),
        (1, "scan", 52 + 82),
        (1, "fuse", 52 + 98),
    ]


def test_an_abort_keeps_the_last_result_in_time_and_closes_the_generator():
    closed = []
    u = Unit("u")
    u.add(steps([4] * 9, closed), 10, 2, exception=lambda result: ("saved", result))
    o = Organiser([u], 16)
    o.start()
    (done,) = o.run(["x"])
    assert done.aborted == ("main",) and done.finished_ns == 16 + 16
    assert done.results == {"main": ("saved", (2, "x"))}  # steps end at 4, 8, 12; the abort comes at 14
    assert closed == ["x"]


def test_a_step_that_ends_at_the_abort_counts_and_completes():
    u = unit("u", ([7, 7], 10, 2))
    o = Organiser([u], 16)
    o.start()
    (done,) = o.run(["x"])
    assert done.aborted == () and done.results == {"m0": (1, "x")} and done.finished_ns == 16 + 14


def test_nothing_in_time_gives_none():
    o = Organiser([unit("u", ([99], 10, 2))], 16)
    o.start()
    assert o.run(["x"])[0].results == {"m0": None}


def test_the_last_finisher_runs_the_last_action_once_per_period():
    log = []
    o = Organiser([unit("u", ([2] * 30, 8, 2), ([3], 6, 1), log=log)], 20)
    o.start()
    done = o.run(["a", "b", "c"])
    assert len(log) == 3 and [a.last for a in done] == ["m0"] * 3 and done[0].aborted == ("m0",)
    assert log[0] == {"m0": (6, "a"), "m1": (0, "a")}  # m1 leaves 3 of its 6: m0 gets 15


def test_without_available_output_the_successor_is_not_activated():
    log = []
    o = Organiser([unit("a", ([5], 10, 0), publish=False), unit("b", ([5], 10, 0), log=log)], 20)
    o.start()
    assert [a.unit for a in o.run([1, 2])] == ["a", "a"]
    assert log == []


def test_no_data_no_activation_and_outputs_do_not_linger():
    log = []
    o = Organiser([unit("a", ([5], 10, 0)), unit("b", ([5], 10, 0), log=log)], 20)
    o.start()
    assert [(a.period, a.unit) for a in o.run([1, None, 3])] == [(0, "a"), (0, "b"), (2, "a"), (2, "b")]
    assert len(log) == 2


def test_starts_at_a_multiple_of_the_period_and_stops():
    o = Organiser([unit("a", ([5], 10, 0))], 20)
    with pytest.raises(ValueError, match="not running; start it first"):
        o.run([1])
    o.start(now_ns=33)
    assert o.start_ns == 40 and o.run([1])[0].finished_ns == 45
    with pytest.raises(ValueError, match="running already"):
        o.start()
    o.stop()
    with pytest.raises(ValueError, match="not running"):
        o.run([1])


@pytest.mark.parametrize(("now", "start"), [(0, 20), (1, 20), (19, 20), (20, 40), (33, 40), (40, 60)])
def test_the_start_is_the_next_multiple_of_the_period_and_never_now(now, start):
    """Equation 5.2, now + period - now mod period."""
    o = Organiser([unit("a", ([5], 10, 0))], 20)
    o.start(now)
    assert o.start_ns == start and o.run([1])[0].finished_ns == start + 5


def test_a_start_in_the_past_of_all_clocks_is_refused():
    with pytest.raises(ValueError, match="the time of the start in ns is -1; a whole number of at least 0 is allowed"):
        Organiser([unit("a", ([5], 10, 0))], 20).start(-1)


def test_the_trace_shows_every_slice():
    o = Organiser([unit("a", ([2] * 30, 8, 2), ([3], 6, 1)), unit("b", ([5], 5, 0))], 30, reserve_ns=8)
    o.start()
    o.run([1, None, 3])
    trace = o.trace()
    rows = slices(trace).rows().tolist()
    assert [(trace.names[who] + ".ep" * part, job, start, end) for who, part, job, start, end in rows if job == 0] == [
        ("a.m0", 0, 0, 8),
        ("a.m1", 0, 8, 11),
        ("a.m0", 0, 11, 15),
        ("a.m0.ep", 0, 15, 17),
        ("b.m0", 0, 17, 22),
    ]
    assert sorted(set(slices(trace).job.tolist())) == [0, 2]
    assert not jobs(trace).missed.any() and trace.end == 90


def test_the_checks_of_the_organiser():
    with pytest.raises(
        ValueError, match="phase 'b' does not fit: the period of 20 ns less the reserve of 1 ns is 1 ns too short"
    ):
        Organiser([unit("a", ([5], 10, 0)), unit("b", ([5], 10, 0))], 20, reserve_ns=1).start()
    with pytest.raises(ValueError, match="unit 'a' has no parts"):
        Organiser([Unit("a")], 20).start()
    with pytest.raises(ValueError, match="the chain is empty"):
        Organiser([], 20).start()
    with pytest.raises(ValueError, match="unit 'a' has two parts called 'm0'"):
        unit("a", ([1], 1, 0)).add(steps([1]), 1, 0, name="m0")


@pytest.mark.parametrize("main", [lambda data: data, lambda data: iter([3]), lambda data: (step for step in [(0, 1)])])
def test_main_parts_that_are_none_are_refused(main):
    u = Unit("u")
    u.add(main, 5, 1, name="main")
    o = Organiser([u], 20)
    o.start()
    with pytest.raises(ValueError, match="unit 'u', part 'main': the main part"):
        o.run([1])


def test_an_endless_main_part_is_aborted():
    u = Unit("u")

    @u.part(ecet_ns=500, wcet_ep_ns=10)
    def main(data):
        n = 0
        while True:
            n += 1
            yield 7, n

    o = Organiser([u], 1000)
    o.start()
    assert o.run([1])[0].results["main"] == 990 // 7


@settings(max_examples=80, deadline=None)
@given(
    st.lists(
        st.lists(
            st.tuples(st.lists(st.integers(1, 9), min_size=1, max_size=8), st.integers(1, 12), st.integers(0, 3)),
            min_size=1,
            max_size=3,
        ),
        min_size=1,
        max_size=4,
    ),
    st.integers(0, 40),
)
def test_whatever_the_parts_do_the_period_is_kept(units, spare):
    log = []
    made = [unit(f"u{i}", *parts, log=log) for i, parts in enumerate(units)]
    period = sum(ecet + ep for parts in units for _, ecet, ep in parts) + spare
    o = Organiser(made, period)
    plan = o.start()
    done = o.run(["x", "y"])
    assert len(log) == len(done) == 2 * len(units)  # the last action exactly once per period and unit
    for a, window in zip(done, plan * 2, strict=True):
        begin = (1 + a.period) * period
        assert begin + window.release_ns < a.finished_ns <= begin + window.end_ns
    granted = {}
    trace = o.trace()
    for who, part, job, start, end in slices(trace).rows().tolist():
        if part == MAIN:
            granted[trace.names[who], job] = granted.get((trace.names[who], job), 0) + end - start
    for parts, u in zip(units, made, strict=True):
        for (costs, ecet, _), part in zip(parts, u.parts, strict=True):
            name = f"{u.name}.{part.name}"
            assert all(granted[name, job] >= min(sum(costs), ecet) for job in (0, 1))
