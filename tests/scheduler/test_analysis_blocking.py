"""Blocking bounds: textbook figures, and the kernel model run against them over random tasks, locks and nestings."""

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from labkit.kernel.kernel import Kernel
from labkit.scheduler.analysis import CriticalSection, blocking_bounds, deadlock_locks, response_times, utilization
from labkit.scheduler.tasksets import PeriodicTask


def tasks(*rows):
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


def section(task, text, **lengths):
    """`section("t3", "A(B)", A=5, B=2)`: t3 holds A for 5, the last 2 of which with B as well."""
    outer, *inner = text.rstrip(")").replace("(", " ").split()
    return CriticalSection(task, outer, lengths[outer], tuple(CriticalSection(task, lock, lengths[lock]) for lock in inner))


# --- textbook figures --------------------------------------------------------------------------------

# Four tasks and three locks, nothing nested; the arithmetic of Buttazzo's worked example.
#         A  B  C
TABLE = {"t1": (1, 2, 0), "t2": (0, 9, 3), "t3": (8, 7, 0), "t4": (6, 5, 4)}
FOUR = tasks((10, 100), (20, 200), (30, 300), (40, 400))
TABLE_SECTIONS = [
    CriticalSection(task, lock, length) for task, row in TABLE.items() for lock, length in zip("ABC", row, strict=True) if length
]


@pytest.mark.parametrize(
    ("protocol", "bounds"),
    [
        # t1: by tasks 9 + 8 + 6 = 23, by locks A 8 + B 9 = 17; t2: 8 + 6 = 14 against 8 + 7 + 4; t3: 6; t4: nobody is lower
        ("inheritance", [17, 14, 6, 0]),
        ("freertos", [17, 14, 6, 0]),
        ("ceiling", [9, 8, 6, 0]),
        ("non-preemptive", [9, 8, 6, 0]),
    ],
)
def test_buttazzo_four_tasks_three_locks(protocol, bounds):
    assert list(blocking_bounds(FOUR, TABLE_SECTIONS, protocol).values()) == bounds


def test_non_preemptive_sections_block_tasks_that_use_no_lock():
    alone = [section("t3", "A", A=5)]
    assert blocking_bounds(tasks((1, 10), (2, 20), (6, 40)), alone, "non-preemptive") == {"t1": 5, "t2": 5, "t3": 0}
    assert blocking_bounds(tasks((1, 10), (2, 20), (6, 40)), alone, "ceiling") == {"t1": 0, "t2": 0, "t3": 0}


def test_inheritance_pushes_through_to_tasks_without_locks():
    bounds = blocking_bounds(tasks((2, 10), (2, 20), (6, 40)), [section("t1", "A", A=1), section("t3", "A", A=5)], "inheritance")
    assert bounds == {"t1": 5, "t2": 5, "t3": 0}


def test_inheritance_counts_a_chain_of_holders():
    """t1 needs A; its holder t3 may first have to wait for B, which t4 holds and t1 never touches."""
    chain = [section("t1", "A", A=1), section("t3", "A(B)", A=5, B=2), section("t4", "B", B=7)]
    four = tasks((3, 50), (4, 100), (6, 200), (9, 400))
    assert blocking_bounds(four, chain, "inheritance")["t1"] == 5 + 7
    assert blocking_bounds(four, chain, "ceiling")["t1"] == 5
    assert blocking_bounds(four, chain, "freertos")["t1"] is None


def test_freertos_keeps_the_inherited_priority_for_the_whole_outer_section():
    nested = [section("t1", "B", B=1), section("t3", "A(B)", A=9, B=2)]
    three = tasks((3, 50), (4, 100), (10, 200))
    assert blocking_bounds(three, nested, "inheritance") == {"t1": 2, "t2": 2, "t3": 0}
    assert blocking_bounds(three, nested, "freertos") == {"t1": 9, "t2": 9, "t3": 0}


def test_deadlock_is_no_bound_except_under_a_ceiling():
    crossed = [section("t1", "A(B)", A=2, B=1), section("t2", "B(A)", B=2, A=1)]
    pair = tasks((3, 10), (3, 20))
    assert deadlock_locks(crossed) == {"A", "B"}
    assert deadlock_locks(crossed[:1]) == frozenset()
    assert blocking_bounds(pair, crossed, "inheritance")["t1"] is None
    assert blocking_bounds(pair, crossed, "freertos")["t1"] is None
    assert blocking_bounds(pair, crossed, "none")["t1"] is None
    assert blocking_bounds(pair, crossed, "ceiling")["t1"] == 2


# --- the three-task inversion ------------------------------------------------------------------------

INVERSION = tasks((2, 100), (30, 60), (10, 400))
SHARED = [section("t1", "A", A=2), section("t3", "A", A=6)]


def test_inversion_without_protocol_is_the_section_and_all_jobs_in_the_middle():
    assert blocking_bounds(INVERSION, SHARED, "none")["t1"] == 6 + 30  # 36 is before the second release of t2 at 60


def test_inversion_grows_job_by_job_and_without_limit():
    def blocked(middle):
        return blocking_bounds(tasks((2, 1000), (middle, 60), (10, 4000)), SHARED, "none")["t1"]

    assert [blocked(c) for c in (54, 55, 56, 57, 58, 59)] == [60, 6 + 2 * 55, 6 + 2 * 56, 6 + 2 * 57, 6 + 3 * 58, 6 + 6 * 59]
    assert blocked(60) is None


def run(task_list, sections, protocol, *, tick=1, offsets=None, starts=None, until=2000, gap=0):
    """The task set on the kernel. `starts`: for each task the time before its first section; `gap`: between sections."""
    kernel = Kernel(cpu_hz=1000 * tick, priorities=len(task_list) + 1, time_slicing=protocol == "freertos")
    names = sorted({s.lock for top in sections for s in top.all()})
    ranks = {task.name: len(task_list) - i for i, task in enumerate(task_list)}
    users = {lock: [top.task for top in sections if any(s.lock == lock for s in top.all())] for lock in names}
    if protocol == "non-preemptive":
        locks = {lock: kernel.mutex(lock, "ceiling", ceiling=len(task_list)) for lock in names}
    elif protocol == "ceiling":
        locks = {lock: kernel.mutex(lock, "ceiling", users=users[lock]) for lock in names}
    else:
        locks = {lock: kernel.mutex(lock, protocol) for lock in names}

    def body(task):
        own = [top for top in sections if top.task == task.name]
        start = (starts or {}).get(task.name, 0)

        def hold(os, part):
            yield os.take(locks[part.lock])
            yield os.compute(part.length - sum(inner.length for inner in part.nested))
            for inner in part.nested:
                yield from hold(os, inner)
            yield os.give(locks[part.lock])

        def program(os):
            if (offsets or {}).get(task.name):
                yield os.delay_until(offsets[task.name])
            while True:
                rest = task.wcet - sum(top.length for top in own) - start
                yield os.compute(start)
                for top in own:
                    yield from hold(os, top)
                    between = min(gap, rest)
                    rest -= between
                    yield os.compute(between)
                yield os.compute(rest)
                yield os.delay_until(task.period // tick)

        return program

    for task in task_list:
        kernel.task(task.name, body(task), priority=ranks[task.name])
    return kernel.run(until)


def observed(finished, task_list):
    """For each task the longest response, and the longest time that lower tasks ran between a release and its completion.

    A job has answered when it has used its last cycle. Its closing call, which the trace has as `complete`, can come later: an
    interrupt of the same instant goes first.
    """
    trace = finished.trace
    ranks = {trace.code(task.name): i for i, task in enumerate(task_list)}
    switches = [(int(row[0]), ranks.get(int(row[2]), len(task_list))) for row in trace.rows("switch")]
    spans = [(start, end, rank) for (start, rank), (end, _) in zip(switches, [*switches[1:], (trace.end, None)], strict=True)]
    released = {(int(row[2]), int(row[5])): int(row[4]) for row in trace.rows("release")}
    response, blocked = [0] * len(task_list), [0] * len(task_list)
    for row in trace.rows("complete"):
        code, called = int(row[2]), int(row[0])
        start, rank = released[code, int(row[5])], ranks[code]
        end = max(min(b, called) for a, b, who in spans if who == rank and a < min(b, called) and b > start)
        lower = sum(max(0, min(b, end) - max(a, start)) for a, b, who in spans if who > rank)
        response[rank], blocked[rank] = max(response[rank], end - start), max(blocked[rank], lower)
    return response, blocked


def test_inversion_on_the_kernel_reaches_the_figure_less_the_instant_of_the_take():
    """t3 takes A at 0 and t1, t2 are released one cycle later, so all but one cycle of the section is left."""
    for middle, jobs in ((54, 1), (57, 2), (58, 3)):
        busy = tasks((2, 1000), (middle, 60), (10, 4000))
        bound = blocking_bounds(busy, SHARED, "none")["t1"]
        response, _ = observed(run(busy, SHARED, "none", offsets={"t1": 1, "t2": 1}), busy)
        assert response[0] - 2 == 5 + jobs * middle == bound - 1


@pytest.mark.parametrize("protocol", ["inheritance", "ceiling", "freertos", "non-preemptive"])
def test_inversion_is_cured_by_each_protocol(protocol):
    busy = tasks((2, 1000), (57, 60), (10, 4000))
    assert blocking_bounds(busy, SHARED, protocol)["t1"] == 6
    response, _ = observed(run(busy, SHARED, protocol, offsets={"t1": 1, "t2": 1}), busy)
    assert response[0] == 2 + 5


def test_late_disinheritance_blocks_on_the_kernel_for_the_outer_section():
    """t3 holds A for 20 and B inside it at the end of the first 4; t1 wants B and has it soon, yet t3 keeps t1's priority."""
    three = tasks((4, 500), (30, 500), (22, 2000))
    inner = CriticalSection("t3", "B", 2)
    tail = CriticalSection("t3", "C", 14)  # a lock of its own, to put time after B
    nested = [section("t1", "B", B=1), CriticalSection("t3", "A", 20, (inner, tail))]
    free, kept = (observed(run(three, nested, p, offsets={"t1": 5, "t2": 5}), three)[1] for p in ("inheritance", "freertos"))
    assert free[0] <= blocking_bounds(three, nested, "inheritance")["t1"] == 2
    assert kept[1] > 2  # t2, which uses no lock, waits for work of t3 done after B was given back
    assert kept[1] <= blocking_bounds(three, nested, "freertos")["t2"] == 20


#: Examples of each protocol and nesting; thousands were drawn when the bounds were made.
MANY = 50

# --- random locks --------------------------------------------------------------------------------------


@st.composite
def systems(draw, nesting):
    """Tasks with sections on up to three locks; nested ones take the locks in alphabetical order, so that none can deadlock."""
    count = draw(st.integers(2, 5))
    sections, rows = [], []
    for i in range(1, count + 1):
        held = 0
        for _ in range(draw(st.integers(0, 2))):
            lock = draw(st.sampled_from("ABC"))
            own, inner = draw(st.integers(1, 5)), ()
            if nesting and lock != "C" and draw(st.booleans()):
                deeper = draw(st.sampled_from("BC" if lock == "A" else "C"))
                inner = (CriticalSection(f"t{i}", deeper, draw(st.integers(1, 4))),)
            sections.append(CriticalSection(f"t{i}", lock, own + sum(s.length for s in inner), inner))
            held += sections[-1].length
        start = draw(st.integers(0, 2))
        wcet = held + start + draw(st.integers(0 if held + start else 1, 6))
        rows.append((wcet, draw(st.sampled_from([30, 40, 60, 80, 120])) * (1 + i // 2)))
    task_list = tasks(*rows)
    return task_list, sections, {t.name: draw(st.integers(0, 2)) for t in task_list}


def scenario(data, task_list, sections, protocol):
    tick = data.draw(st.sampled_from([1, 1, 2, 5]))
    held = {t.name: sum(s.length for s in sections if s.task == t.name) for t in task_list}
    starts = {t.name: data.draw(st.integers(0, min(2, t.wcet - held[t.name]))) for t in task_list}
    offsets = {t.name: data.draw(st.integers(0, 12)) for t in task_list}
    gap = data.draw(st.integers(0, 3))
    return run(task_list, sections, protocol, tick=tick, offsets=offsets, starts=starts, until=600, gap=gap)


@pytest.mark.parametrize("nesting", [False, True], ids=["flat", "nested"])
@pytest.mark.parametrize("protocol", ["none", "inheritance", "ceiling", "freertos", "non-preemptive"])
def test_simulated_blocking_stays_within_the_bound(protocol, nesting):
    @settings(max_examples=MANY, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
    @given(systems(nesting), st.data())
    def check(system, data):
        task_list, sections, _ = system
        assume(sections and utilization(task_list) <= 1)
        bounds = blocking_bounds(task_list, sections, protocol)
        limits = response_times(task_list, blocking=bounds)
        assume(all(limits[t.name] is None or limits[t.name] <= t.period for t in task_list))
        response, blocked = observed(scenario(data, task_list, sections, protocol), task_list)
        for task, answered, lower in zip(task_list, response, blocked, strict=True):
            assert bounds[task.name] is None or lower <= bounds[task.name]
            assert limits[task.name] is None or answered <= limits[task.name]

    check()


# --- bad input -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: blocking_bounds(FOUR, [], "spin"), "no protocol 'spin'; there are none, inheritance, ceiling, freertos"),
        (lambda: blocking_bounds(FOUR, [CriticalSection("t9", "A", 1)], "ceiling"), "belongs to task 't9'; the set has t1, t2"),
        (lambda: blocking_bounds(FOUR, [CriticalSection("t1", "A", 11)], "ceiling"), "'t1' holds locks for 11, longer than its"),
        (lambda: CriticalSection("t1", "A", 0), "holds 'A' for 0; a critical section takes at least 1"),
        (lambda: section("t1", "A(B)", A=1, B=2), "the sections inside 'A' take 2, more than its 1"),
        (lambda: CriticalSection("t1", "A", 3, (CriticalSection("t2", "B", 1),)), "'t2' cannot stand inside one of task 't1'"),
        (lambda: CriticalSection("t1", "A", 3, (CriticalSection("t1", "A", 1),)), "takes 'A' while it holds it already"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
