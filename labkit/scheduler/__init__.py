"""The FreeRTOS kernel as a model, periodic and TAFT scheduling, phases in windows, and the analysis of task sets beside them."""

from labkit.scheduler.costs import Costs
from labkit.scheduler.framework import Organiser, Unit
from labkit.scheduler.jobs import job_table, slices, totals
from labkit.scheduler.kernel import Kernel
from labkit.scheduler.laser_chain import experiment_1, laser_chain
from labkit.scheduler.periodic import POLICIES, simulate
from labkit.scheduler.phases import DESIGNS, run_design, run_designs
from labkit.scheduler.report import RuntimeStats, TaskList, runtime_stats, task_list
from labkit.scheduler.run import Run, TaskInfo, Wait
from labkit.scheduler.scenario import Scenario, read_scenario, replay, write_events, write_timeline
from labkit.scheduler.taskfile import read_schedule, schedule, schedule_rows, write_schedule
from labkit.scheduler.tasksets import PeriodicTask, TaskPair
from labkit.scheduler.windows import Part, Window, check_windows, read_chain

__all__ = [
    "Costs",
    "DESIGNS",
    "Kernel",
    "Organiser",
    "POLICIES",
    "Part",
    "PeriodicTask",
    "Run",
    "RuntimeStats",
    "Scenario",
    "TaskInfo",
    "TaskList",
    "TaskPair",
    "Unit",
    "Wait",
    "Window",
    "check_windows",
    "experiment_1",
    "job_table",
    "laser_chain",
    "read_chain",
    "read_scenario",
    "read_schedule",
    "replay",
    "run_design",
    "run_designs",
    "runtime_stats",
    "schedule",
    "schedule_rows",
    "simulate",
    "slices",
    "task_list",
    "totals",
    "write_events",
    "write_schedule",
    "write_timeline",
]
