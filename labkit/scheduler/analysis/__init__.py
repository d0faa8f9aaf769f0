"""Schedulability analysis: answers about all schedules at once, where a simulation shows one."""

from labkit.scheduler.analysis.blocking import CriticalSection, HeldSection, blocking_bounds, deadlock_locks
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
from labkit.scheduler.analysis.edf import (
    busy_period,
    demand_bound,
    demand_limit,
    edf_job_response,
    edf_response_times,
    processor_demand_test,
    qpa_test,
)
from labkit.scheduler.analysis.fixed_priority import Overheads, job_responses, response_time_test, response_times, utilization
from labkit.scheduler.analysis.taft import (
    latest_slots,
    taft_demand_test,
    taft_period_test,
    taft_plan_test,
    taft_test,
    taft_utilization,
)
from labkit.scheduler.analysis.verdict import UndecidedError, Verdict

__all__ = [
    "CriticalSection",
    "HeldSection",
    "Overheads",
    "UndecidedError",
    "Verdict",
    "accept_edf",
    "accept_hyperbolic",
    "accept_liu_layland",
    "blocking_bounds",
    "busy_period",
    "deadlock_locks",
    "demand_bound",
    "demand_limit",
    "edf_job_response",
    "edf_response_times",
    "edf_utilization_test",
    "hyperbolic_bound",
    "hyperbolic_test",
    "job_responses",
    "latest_slots",
    "liu_layland_bound",
    "liu_layland_test",
    "processor_demand_test",
    "qpa_test",
    "response_time_test",
    "response_times",
    "taft_demand_test",
    "taft_period_test",
    "taft_plan_test",
    "taft_test",
    "taft_utilization",
    "utilization",
]
