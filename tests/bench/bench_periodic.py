"""How fast periodic scheduling is: jobs per CPU second with full trace, beside raw SimPy timeouts per second in the same
process.
"""

import numpy as np
import pytest

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


@pytest.mark.parametrize(("policy", "tasks"), CASES)
def test_jobs_with_full_trace(benchmark, policy, tasks):
    made, until, times = job_set(policy, tasks)
    jobs = benchmark(run, policy, made, until, times)
    assert jobs >= 0.9 * JOBS
    benchmark.extra_info["jobs per second"] = round(jobs / benchmark.stats.stats.min)


def test_ratio_of_jobs_to_simpy_timeouts(compare):
    sets = {(policy, tasks): job_set(policy, tasks) for policy, tasks in CASES}
    compare({f"{policy}, {tasks} tasks": (run, policy, *sets[policy, tasks]) for policy, tasks in CASES})
