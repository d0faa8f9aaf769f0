"""Response-time analysis and the kernel model, which share no code, give the same figures."""

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.kernel.kernel import Costs, Kernel
from labkit.scheduler.analysis import Overheads, response_times, utilization
from labkit.scheduler.tasksets import PeriodicTask
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
