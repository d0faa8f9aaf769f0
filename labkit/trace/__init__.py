"""What happened: one columnar trace type, its slices and jobs, statistics, readers, exporters, sums for pictures."""

from labkit.trace.fit import Measured, measured
from labkit.trace.folds import holds, overheads, priorities, ready, runs, waits
from labkit.trace.jobs import EXCEPTION, MAIN, PARTS, Jobs, Slices, jobs, owners, slices
from labkit.trace.kinds import CODE, ISR_OPS, KINDS, NOTIFY_ACTIONS, OVERHEADS, STATES, TIMER_COMMANDS
from labkit.trace.occupancy import Occupancy, occupancy
from labkit.trace.readers.chrome import export_chrome
from labkit.trace.readers.files import export_csv, export_npz, read_csv, read_npz
from labkit.trace.readers.log import read_log
from labkit.trace.readers.recording import read_recording
from labkit.trace.readers.report import LogError, Problem, Report
from labkit.trace.readers.source import MOST_BYTES
from labkit.trace.spans import spans
from labkit.trace.statistics import describe, statistics
from labkit.trace.trace import COLUMNS, Trace

__all__ = [
    "CODE",
    "COLUMNS",
    "EXCEPTION",
    "ISR_OPS",
    "KINDS",
    "MAIN",
    "MOST_BYTES",
    "NOTIFY_ACTIONS",
    "OVERHEADS",
    "PARTS",
    "STATES",
    "TIMER_COMMANDS",
    "Jobs",
    "LogError",
    "Measured",
    "Occupancy",
    "Problem",
    "Report",
    "Slices",
    "Trace",
    "describe",
    "export_chrome",
    "export_csv",
    "export_npz",
    "holds",
    "jobs",
    "measured",
    "occupancy",
    "overheads",
    "owners",
    "priorities",
    "read_csv",
    "read_log",
    "read_npz",
    "read_recording",
    "ready",
    "runs",
    "slices",
    "spans",
    "statistics",
    "waits",
]
