"""How fast the kernel model is: jobs per second with full trace, beside raw SimPy timeouts per second in the same process."""

import time

import pytest
import simpy

from labkit.scheduler import Kernel

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


def timeouts(count: int) -> int:
    """The cheapest thing SimPy does: processes that wait, again and again."""
    env = simpy.Environment()

    def wait():
        while True:
            yield env.timeout(1)

    for _ in range(10):
        env.process(wait())
    env.run(until=count // 10)
    return count


def rate(work, argument, repeats: int = 5) -> float:
    """Best of some repeats, in units per second."""
    best = 0.0
    for _ in range(repeats):
        start = time.perf_counter()
        done = work(argument)
        best = max(best, done / (time.perf_counter() - start))
    return best


@pytest.mark.parametrize("tasks", [3, 10, 50])
def test_jobs_with_full_trace(benchmark, tasks):
    jobs = benchmark(simulate, tasks)
    assert jobs >= 0.9 * JOBS
    benchmark.extra_info["jobs per second"] = round(jobs / benchmark.stats.stats.min)


def test_raw_simpy_timeouts(benchmark):
    count = benchmark(timeouts, JOBS)
    benchmark.extra_info["timeouts per second"] = round(count / benchmark.stats.stats.min)


def test_ratio_of_jobs_to_simpy_timeouts(benchmark):
    simpy_rate = rate(timeouts, JOBS)
    ratios = {tasks: rate(simulate, tasks) / simpy_rate for tasks in (3, 10, 50)}
    benchmark.extra_info["raw SimPy timeouts per second"] = round(simpy_rate)
    for tasks, ratio in ratios.items():
        benchmark.extra_info[f"jobs per timeout, {tasks} tasks"] = round(ratio, 3)
        print(f"{tasks} tasks: {ratio:.2f} jobs per raw SimPy timeout ({ratio * simpy_rate:,.0f} jobs/s)")
    benchmark(simulate, 3)
