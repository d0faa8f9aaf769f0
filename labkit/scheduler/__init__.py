"""The FreeRTOS kernel as a model, its scenarios and reports, and the analysis of task sets beside it."""

from labkit.scheduler.costs import Costs
from labkit.scheduler.kernel import Kernel
from labkit.scheduler.report import RuntimeStats, TaskList, runtime_stats, task_list
from labkit.scheduler.run import Run, TaskInfo, Wait
from labkit.scheduler.scenario import Scenario, read_scenario, replay, write_events, write_timeline

__all__ = [
    "Costs",
    "Kernel",
    "Run",
    "RuntimeStats",
    "Scenario",
    "TaskInfo",
    "TaskList",
    "Wait",
    "read_scenario",
    "replay",
    "runtime_stats",
    "task_list",
    "write_events",
    "write_timeline",
]
