"""How fast the kernel model is: jobs per second with full trace, beside raw SimPy timeouts per second in the same process."""

import pytest

from labkit.kernel import Kernel

JOBS = 20_000


def simulate(tasks: int) -> int:
    """Periodic tasks of distinct priorities at 80 % utilisation, JOBS jobs or a few more; returns the number of jobs."""
    k = Kernel(cpu_hz=216_000_000, priorities=tasks + 1)
    periods = [5 + (7 * i) % 3 * 5 + 5 * (i // 10) for i in range(tasks)]  # ticks

    def periodic(period):
        def body(os):
            cycles = period * os.tick * 4 // (5 * tasks)
            while True:
                yield os.compute(cycles)
                yield os.delay_until(period)

        return body

    for number, period in enumerate(periods):
        k.task(f"task{number}", periodic(period), priority=tasks - number)
    ticks = int(JOBS / sum(1 / period for period in periods))
    run = k.run(until=ticks * k.tick)
    return len(run.trace.rows("complete"))


@pytest.mark.parametrize("tasks", [3, 10, 50])
def test_jobs_with_full_trace(benchmark, tasks):
    jobs = benchmark(simulate, tasks)
    assert jobs >= 0.9 * JOBS
    benchmark.extra_info["jobs per second"] = round(jobs / benchmark.stats.stats.min)


def test_ratio_of_jobs_to_simpy_timeouts(compare):
    compare({f"{tasks} tasks": (simulate, tasks) for tasks in (3, 10, 50)})
