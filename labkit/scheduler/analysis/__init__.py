"""Schedulability analysis: answers about all schedules at once, where a simulation shows one."""

from labkit.scheduler.analysis.blocking import CriticalSection, blocking_bounds, deadlock_locks
from labkit.scheduler.analysis.fixed_priority import Overheads, job_responses, response_time_test, response_times, utilization
from labkit.scheduler.analysis.bounds import (
    accept_edf,
    accept_hyperbolic,
    accept_liu_layland,
    edf_utilization_test,
    hyperbolic_bound,
    hyperbolic_test,
    liu_layland_bound,
    liu_layland_test,
)
from labkit.scheduler.analysis.verdict import UndecidedError, Verdict

__all__ = [
    "CriticalSection",
    "Overheads",
    "UndecidedError",
    "Verdict",
    "accept_edf",
    "accept_hyperbolic",
    "accept_liu_layland",
    "blocking_bounds",
    "deadlock_locks",
    "edf_utilization_test",
    "hyperbolic_bound",
    "hyperbolic_test",
    "job_responses",
    "liu_layland_bound",
    "liu_layland_test",
    "response_time_test",
    "response_times",
    "utilization",
]
