"""FreeRTOS on one core, rule by rule: the kernel model, scenarios, and the tables the real kernel prints."""

from labkit.kernel.costs import Costs
from labkit.kernel.kernel import Kernel
from labkit.kernel.objects import FOREVER
from labkit.kernel.report import RuntimeStats, TaskList, runtime_stats, task_list
from labkit.kernel.run import Run, TaskInfo, Wait
from labkit.kernel.scenario import Scenario, read_scenario, run_scenario, write_events, write_timeline

__all__ = [
    "FOREVER",
    "Costs",
    "Kernel",
    "Run",
    "RuntimeStats",
    "Scenario",
    "TaskInfo",
    "TaskList",
    "Wait",
    "read_scenario",
    "run_scenario",
    "runtime_stats",
    "task_list",
    "write_events",
    "write_timeline",
]
