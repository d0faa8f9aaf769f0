"""The reports, against times worked out by hand and the format of FreeRTOS."""

import pytest

from labkit.kernel import Costs, Kernel, runtime_stats, task_list


def busy(k):
    lock = k.mutex("lock")

    def low(os):
        yield os.take(lock)
        yield os.compute(30)
        yield os.give(lock)
        yield os.suspend()

    def high(os):
        yield os.delay_until(1)
        yield os.take(lock)
        yield os.compute(5)
        yield os.give(lock)
        yield os.delay(9)

    def short(os):
        yield os.compute(1)

    k.task("low", low, priority=1, stack_free=120)
    k.task("high", high, priority=3)
    k.task("short", short, priority=2, stack_free=17)
    return k.run(until=200)


@pytest.fixture
def run():
    return busy(Kernel(cpu_hz=10_000, tick_hz=1000))


def test_the_statistics_add_up_and_print_as_freertos_does(run):
    stats = runtime_stats(run)
    assert {task.name: task.time for task in stats.tasks} == {"low": 30, "high": 5, "short": 1, "IDLE": 164}
    assert stats.tasks[0].share == 0.15
    assert str(stats).splitlines() == [
        "low            \t30\t\t15%",
        "high           \t5\t\t2%",
        "short          \t1\t\t<1%",
        "IDLE           \t164\t\t82%",
    ]


def test_statistics_of_a_window_cut_the_runs_at_its_ends(run):
    stats = runtime_stats(run, window=(20, 40))
    assert {task.name: task.time for task in stats.tasks} == {"low": 11, "high": 5, "short": 0, "IDLE": 4}
    assert stats.switches == 3  # low, high at 31, low to suspend itself at 36, idle


def test_context_switches_leave_out_the_first_start(run):
    assert runtime_stats(run).switches == 9


def test_the_kernels_own_time_has_its_own_row():
    stats = runtime_stats(busy(Kernel(cpu_hz=10_000, tick_hz=1000, costs=Costs(tick=1))))
    assert {task.name: task.time for task in stats.tasks}["kernel"] == 19
    assert sum(task.time for task in stats.tasks) == 200


def test_the_task_list_shows_state_and_current_priority(run):
    assert str(task_list(run, at=15)).splitlines() == [
        "low            \tX\t3\t120\t1",
        "IDLE           \tR\t0\t-\t4",
        "high           \tB\t3\t-\t2",
        "short          \tD\t2\t17\t3",
    ]
    assert [(task.name, task.state, task.priority) for task in task_list(run).tasks] == [
        ("IDLE", "X", 0),
        ("low", "S", 1),
        ("high", "D", 3),
        ("short", "D", 2),
    ]


def test_times_outside_the_run_are_refused(run):
    with pytest.raises(ValueError, match=r"window 20\.\.300 is not inside the run 0\.\.200"):
        runtime_stats(run, window=(20, 300))
    with pytest.raises(ValueError, match="cycle 201 is not inside"):
        task_list(run, at=201)
