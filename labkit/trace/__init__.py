"""What happened: one columnar trace type, its slices and jobs, statistics, readers, exporters, sums for pictures."""

from labkit.trace.export import export_chrome
from labkit.trace.files import export_csv, export_npz, read_csv, read_npz
from labkit.trace.jobs import Jobs, Slices, jobs, slices
from labkit.trace.log import LogError, Problem, Report, read_log
from labkit.trace.occupancy import Occupancy, occupancy
from labkit.trace.spans import spans
from labkit.trace.statistics import describe, statistics
from labkit.trace.trace import Trace

__all__ = [
    "Jobs",
    "LogError",
    "Occupancy",
    "Problem",
    "Report",
    "Slices",
    "Trace",
    "describe",
    "export_chrome",
    "export_csv",
    "export_npz",
    "jobs",
    "occupancy",
    "read_csv",
    "read_log",
    "read_npz",
    "slices",
    "spans",
    "statistics",
]
