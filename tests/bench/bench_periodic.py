"""How fast periodic scheduling is: jobs per CPU second with full trace, beside raw SimPy timeouts per second in the same
process.
"""

import time

import numpy as np
import pytest
import simpy

from labkit.scheduler import PeriodicTask, TaskPair, simulate

JOBS = 50_000
CASES = [(policy, tasks) for policy in ("rm", "edf", "taft") for tasks in (3, 10, 50)]


def job_set(policy, tasks):
    """Tasks at 80 % utilisation with random execution times, up to twice the ECET under taft; and the end of JOBS jobs."""
    rng = np.random.default_rng(1)
    periods = [5000 * (1 + (7 * i) % 3 + i // 10) for i in range(tasks)]
    demand = [period * 4 // (5 * tasks) for period in periods]
    if policy == "taft":
        made = [TaskPair(f"t{i}", d - d // 10, d // 10, p) for i, (d, p) in enumerate(zip(demand, periods, strict=True))]
    else:
        made = [PeriodicTask(f"t{i}", d, p) for i, (d, p) in enumerate(zip(demand, periods, strict=True))]
    times = {t.name: rng.integers(1, 2 * t.ecet if policy == "taft" else t.wcet, JOBS, endpoint=True) for t in made}
    return made, int(JOBS / sum(1 / p for p in periods)), times


def run(policy, tasks, until, times):
    return len(simulate(tasks, policy, until, times).rows("release"))


def timeouts(count):
    """The cheapest thing SimPy does: processes that wait, again and again."""
    env = simpy.Environment()

    def wait():
        while True:
            yield env.timeout(1)

    for _ in range(10):
        env.process(wait())
    env.run(until=count // 10)
    return count


def rate(work, *arguments, repeats=5):
    """Best of some repeats, in units per CPU second."""
    best = 0.0
    for _ in range(repeats):
        start = time.process_time()
        done = work(*arguments)
        best = max(best, done / (time.process_time() - start))
    return best


@pytest.mark.parametrize(("policy", "tasks"), CASES)
def test_jobs_with_full_trace(benchmark, policy, tasks):
    made, until, times = job_set(policy, tasks)
    jobs = benchmark(run, policy, made, until, times)
    assert jobs >= 0.9 * JOBS
    benchmark.extra_info["jobs per second"] = round(jobs / benchmark.stats.stats.min)


def test_ratio_of_jobs_to_simpy_timeouts(benchmark):
    simpy_rate = rate(timeouts, JOBS)
    benchmark.extra_info["raw SimPy timeouts per CPU second"] = round(simpy_rate)
    print(f"\n{simpy_rate:,.0f} raw SimPy timeouts per CPU second")
    for policy, tasks in CASES:
        made, until, times = job_set(policy, tasks)
        jobs_rate = rate(run, policy, made, until, times)
        benchmark.extra_info[f"jobs per timeout, {policy}, {tasks} tasks"] = round(jobs_rate / simpy_rate, 3)
        print(f"{policy}, {tasks} tasks: {jobs_rate / simpy_rate:.2f} jobs per raw SimPy timeout, {jobs_rate:,.0f} jobs per CPU second")
    benchmark(run, "taft", *job_set("taft", 3))
