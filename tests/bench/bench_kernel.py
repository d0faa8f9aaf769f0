"""How fast the kernel model is: jobs per second with full trace, beside raw SimPy timeouts per second in the same process;
what it costs to take it along in small steps; and the memory of a long run.
"""

import time
import tracemalloc

import pytest

from labkit.kernel import Kernel

JOBS = 20_000


def kernel_of(periods: list[int], tick_hz: int = 1000) -> Kernel:
    """Periodic tasks of distinct priorities at 80 % utilisation; periods in ticks."""
    tasks = len(periods)
    k = Kernel(cpu_hz=216_000_000, tick_hz=tick_hz, priorities=tasks + 1)

    def periodic(period):
        def body(os):
            cycles = period * os.tick * 4 // (5 * tasks)
            while True:
                yield os.compute(cycles)
                yield os.delay_until(period)

        return body

    for number, period in enumerate(periods):
        k.task(f"task{number}", periodic(period), priority=tasks - number)
    return k


def simulate(tasks: int) -> int:
    """JOBS jobs or a few more; returns their number."""
    periods = [5 + (7 * i) % 3 * 5 + 5 * (i // 10) for i in range(tasks)]
    k = kernel_of(periods)
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


FIVE = [1, 2, 3, 4, 5]  # ticks


def in_steps(steps: int, seconds: int = 5) -> float:
    """CPU seconds of simulating five tasks, the fastest once a millisecond, in so many calls of `advance`, and one trace."""
    k = kernel_of(FIVE)
    end = seconds * k.cpu_hz
    begin = time.process_time()
    for step in range(1, steps + 1):
        k.advance(end * step // steps)
    assert k.trace.end == end
    return time.process_time() - begin


def test_ratio_of_many_small_steps_to_one(benchmark):
    """Goal: at most 1.5."""
    ratios = sorted(in_steps(5000) / in_steps(1) for _ in range(7))
    benchmark.extra_info["5,000 steps to one"] = round(ratios[3], 2)
    print(f"\n5,000 calls of advance: {ratios[3]:.2f} times one call ({ratios[0]:.2f} to {ratios[-1]:.2f})")
    benchmark.pedantic(in_steps, (5000,))


def test_ten_kilohertz_for_twenty_seconds(benchmark):
    """Goal: at most 3 s."""

    def simulated():
        k = kernel_of(FIVE, tick_hz=10_000)
        return k.run(20 * k.cpu_hz).trace

    trace = benchmark.pedantic(simulated, rounds=2)
    benchmark.extra_info["million events"] = round(len(trace) / 1e6, 2)


def test_memory_per_million_events(benchmark):
    """While simulating, and at most while the trace is read (packed pages beside columns)."""
    tracemalloc.start()
    k = kernel_of(FIVE, tick_hz=10_000)
    k.advance(2 * k.cpu_hz)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    millions = len(k.trace) / 1e6
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    sizes = {"simulated": held, "trace read": after, "peak while reading": peak}
    for name, size in sizes.items():
        benchmark.extra_info[f"MB per million events, {name}"] = round(size / 1e6 / millions)
        print(f"{name}: {size / 1e6 / millions:.0f} MB per million events")
    benchmark.pedantic(in_steps, (1, 1))
