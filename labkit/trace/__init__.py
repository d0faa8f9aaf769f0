"""What happened: one columnar trace type, readers of logs, statistics, exporters."""

from labkit.trace.trace import Trace

__all__ = ["Trace"]
