"""Periodic tasks on one core: RM, DM, EDF and TAFT schedules, execution times, and the analysis of task sets beside them."""

from labkit.scheduler.periodic import POLICIES, simulate
from labkit.scheduler.taskfile import read_schedule, schedule, schedule_rows, write_schedule
from labkit.scheduler.tasksets import PeriodicTask, TaskPair

__all__ = ["POLICIES", "PeriodicTask", "TaskPair", "read_schedule", "schedule", "schedule_rows", "simulate", "write_schedule"]
