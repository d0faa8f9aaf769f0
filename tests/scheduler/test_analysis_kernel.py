"""Response-time analysis and the kernel model, which share no code, give the same figures."""

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.kernel import Costs, Kernel
from labkit.scheduler import CriticalSection, HeldSection, Overheads, PeriodicTask, blocking_bounds, response_times, utilization
from labkit.trace.kinds import CODE

TICK = 20


NO_COSTS = Costs()


def run(task_list, until, costs=NO_COSTS, offsets=None):
    """Periodic tasks that use all of their wcet; the time of each job's last cycle, less its release, longest for each task."""
    kernel = Kernel(cpu_hz=1000 * TICK, priorities=len(task_list) + 1, costs=costs)
    for i, task in enumerate(task_list):
        first = (offsets or {}).get(task.name, 0)

        def body(os, task=task, offset=first):
            if offset:
                yield os.delay_until(offset)
            while True:
                yield os.compute(task.wcet)
                yield os.mark()
                yield os.delay_until(task.period // TICK)

        kernel.task(task.name, body, priority=len(task_list) - i)
    trace = kernel.run(until).trace
    return [longest_response(trace, trace.code(task.name)) for task in task_list]


def longest_response(trace, code):
    """A job has answered when it has used its last cycle; its closing call comes later if an interrupt is due at that instant."""
    rows = trace.rows("switch", "overhead", "release", "complete")
    switch, overhead, release, complete = (CODE[kind] for kind in ("switch", "overhead", "release", "complete"))
    released, running, since, last, longest = {}, None, 0, 0, 0
    for time, kind, task, _, value, extra in rows.tolist():
        if running == code and time > since:
            last = time
        if kind == switch:
            running, since = task, time
        elif kind == overhead:
            since = time + value
        elif kind == release and task == code:
            released[extra] = value
        elif kind == complete and task == code:
            longest = max(longest, last - released.get(extra, 0))
    return longest


@st.composite
def task_sets(draw):
    rows = []
    for _ in range(draw(st.integers(1, 4))):
        period = TICK * draw(st.sampled_from([2, 3, 4, 5, 6, 10, 12, 15]))
        rows.append((draw(st.integers(1, period // 2)), period))
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


@settings(max_examples=100, deadline=None)
@given(task_sets())
def test_synchronous_sets_reach_the_bound_exactly(task_list):
    assume(utilization(task_list) < 1)
    assert run(task_list, 121 * TICK) == list(response_times(task_list).values())


@settings(max_examples=100, deadline=None)
@given(task_sets(), st.data())
def test_offsets_and_kernel_costs_stay_within_the_bound(task_list, data):
    tick, switch, service = (data.draw(st.integers(0, 2)) for _ in range(3))
    offsets = {task.name: data.draw(st.integers(0, 9)) for task in task_list}
    bounds = response_times(task_list, overheads=Overheads(switch, tick, TICK, job=service, section=service + switch))
    assume(None not in bounds.values())
    costs = Costs(tick=tick, switch=switch, service={"delay_until": service})
    for seen, bound in zip(run(task_list, 300 * TICK, costs, offsets), bounds.values(), strict=True):
        assert seen <= bound


def test_costs_shift_a_response_by_their_sum():
    """One job: the tick that releases it, the switch to it, its own time. The bound adds the way out and the next tick."""
    alone = [PeriodicTask("t1", 10, 3 * TICK)]
    costs = Costs(tick=2, switch=3, service={"delay_until": 4})
    assert run(alone, 30 * TICK, costs, {"t1": 1}) == [2 + 3 + 10]
    overheads = Overheads(switch=3, tick=2, tick_period=TICK, job=4)
    assert response_times(alone, overheads=overheads) == {"t1": 10 + 2 * 3 + 4 + 2 * 2}


# Sections that hold interrupts or the scheduler, and interrupts


def tasks(*rows):
    return [PeriodicTask(f"t{i}", *row) for i, row in enumerate(rows, start=1)]


THREE = tasks((5, 100), (10, 200), (20, 400))
HELD = [HeldSection("t2", 4), HeldSection("t3", 3), HeldSection("t3", 7)]
LOCKED = [CriticalSection("t1", "A", 1), CriticalSection("t3", "A", 5)]


@pytest.mark.parametrize(
    ("protocol", "locks", "bounds"),
    [
        ("none", [], [7, 7, 0]),
        ("inheritance", [], [7, 7, 0]),
        ("inheritance", LOCKED, [5 + 7, 5 + 7, 0]),
        ("freertos", LOCKED, [5 + 7, 5 + 7, 0]),
        ("ceiling", LOCKED, [7, 7, 0]),
        ("none", LOCKED, [None, None, None]),
    ],
)
def test_the_longest_lower_section_blocks_everybody_once(protocol, locks, bounds):
    assert list(blocking_bounds(THREE, locks, protocol, HELD).values()) == bounds


@pytest.mark.parametrize(
    ("held", "message"),
    [
        (lambda: HeldSection("t1", 0), "task 't1' holds up all others for 0; such a section takes at least 1"),
        (lambda: blocking_bounds(THREE, [], "none", [HeldSection("t4", 1)]), "belongs to task 't4'; the set has t1, t2, t3"),
        (lambda: blocking_bounds(THREE, [], "none", [HeldSection("t1", 6)]), "for 6, longer than its wcet 5"),
    ],
)
def test_a_section_that_cannot_be_says_why(held, message):
    with pytest.raises(ValueError, match=message):
        held()


def test_interrupts_are_the_highest_terms_and_charged_no_switch():
    pair = tasks((3, 20), (5, 50))
    interrupts = [PeriodicTask("radio", 2, 10)]
    as_tasks = response_times([*interrupts, *pair])
    assert response_times(pair, interrupts=interrupts) == {name: as_tasks[name] for name in ("t1", "t2")}


def run_held(task_list, sections, offsets, interrupts=(), until=200 * TICK):
    """Longest response of each task. `sections`: for each task (kind, before, inside), the rest of its wcet behind."""
    k = Kernel(cpu_hz=1000 * TICK, priorities=len(task_list) + 1, time_slicing=False)
    for i, task in enumerate(task_list):

        def body(os, task=task):
            kind, before, inside = sections.get(task.name, ("", task.wcet, 0))
            if offsets.get(task.name):
                yield os.delay_until(offsets[task.name])
            while True:
                yield os.compute(before)
                if kind:
                    yield os.enter_critical() if kind == "critical" else os.suspend_all()
                    yield os.compute(inside)
                    yield os.exit_critical() if kind == "critical" else os.resume_all()
                yield os.compute(task.wcet - before - inside)
                yield os.mark()
                yield os.delay_until(task.period // TICK)

        k.task(task.name, body, priority=len(task_list) - i)
    for number, (interrupt, first) in enumerate(interrupts):
        k.interrupt(first, lambda isr: None, every=interrupt.period, priority=15 - number % 2, cycles=interrupt.wcet)
    trace = k.run(until).trace
    return [longest_response(trace, trace.code(task.name)) for task in task_list]


@pytest.mark.parametrize("kind", ["critical", "suspended"])
def test_the_worst_case_is_a_section_entered_just_before_the_release(kind):
    """The lower task enters one cycle before the tick that releases the higher one, which so loses all of it but that cycle."""
    pair = tasks((5, 10 * TICK), (40, 20 * TICK))
    seen = run_held(pair, {"t2": (kind, TICK - 1, 15)}, {"t1": 1})
    blocking = blocking_bounds(pair, [], "none", [HeldSection("t2", 15)])
    bounds = response_times(pair, blocking=blocking)
    assert seen[0] == bounds["t1"] - 1 == 15 + 5 - 1


@st.composite
def sets_with_sections(draw):
    rows, sections, held = [], {}, []
    for number in range(1, draw(st.integers(2, 4)) + 1):
        period = TICK * draw(st.sampled_from([2, 3, 4, 5, 6, 10]))
        wcet = draw(st.integers(2, period // 2))
        rows.append((wcet, period))
        if draw(st.integers(0, 3)):
            inside = draw(st.integers(1, min(wcet, TICK - 1)))
            sections[f"t{number}"] = (
                draw(st.sampled_from(("critical", "suspended"))),
                draw(st.integers(0, wcet - inside)),
                inside,
            )
            held.append(HeldSection(f"t{number}", inside))
    return tasks(*rows), sections, held


@settings(max_examples=150, deadline=None)
@given(sets_with_sections(), st.data())
def test_no_response_is_longer_than_the_bound(drawn, data):
    task_list, sections, held = drawn
    interrupts = [
        (PeriodicTask(f"i{n}", data.draw(st.integers(1, 4)), data.draw(st.integers(15, 90))), data.draw(st.integers(0, 40)))
        for n in range(data.draw(st.integers(0, 2)))
    ]
    bounds = response_times(
        task_list, blocking=blocking_bounds(task_list, [], "none", held), interrupts=[interrupt for interrupt, _ in interrupts]
    )
    assume(None not in bounds.values() and all(bounds[task.name] <= 50 * task.period for task in task_list))
    offsets = {task.name: data.draw(st.integers(0, 9)) for task in task_list}
    for seen, bound in zip(run_held(task_list, sections, offsets, interrupts), bounds.values(), strict=True):
        assert seen <= bound
