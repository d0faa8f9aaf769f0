"""Caches: a set-associative cache that holds bytes, the memory and DMA master around it, counts, and time.

`Cache` over `stm32f767()` memory shows what the CPU and a `Dma` really see; `count_trace` counts long traces; `patterns` makes
traces; `timing` turns counts into cycles; `violations` finds where a program read a byte that was not the latest one.
"""

from labkit.cache.cache import Cache
from labkit.cache.coherence import CAUSES, Coherence, Violation, violations
from labkit.cache.counting import COUNTS, count, count_trace
from labkit.cache.dma import Dma, evict
from labkit.cache.folds import MissClasses, counts, miss_classes, references_of, replay, timeline
from labkit.cache.geometry import DCACHE, ICACHE, Geometry
from labkit.cache.history import History, history
from labkit.cache.memory import WRITE_BACK, Attribute, Memory, MpuRegion, Region
from labkit.cache.records import Access, Operation, Record, Transfer, data_of
from labkit.cache.references import RecordedReferences, References, TraceFileError, patterns, read_references, read_trace
from labkit.cache.stm32f767 import SOURCE1_MPU, stm32f767
from labkit.cache.timing import Cost, Timing, Work, run_cost, wait_states

__all__ = [
    "CAUSES",
    "COUNTS",
    "DCACHE",
    "ICACHE",
    "SOURCE1_MPU",
    "WRITE_BACK",
    "Access",
    "Attribute",
    "Cache",
    "Coherence",
    "Cost",
    "Dma",
    "Geometry",
    "History",
    "Memory",
    "MissClasses",
    "MpuRegion",
    "Operation",
    "Record",
    "RecordedReferences",
    "References",
    "Region",
    "Timing",
    "TraceFileError",
    "Transfer",
    "Violation",
    "Work",
    "count",
    "count_trace",
    "counts",
    "data_of",
    "evict",
    "history",
    "miss_classes",
    "patterns",
    "read_references",
    "read_trace",
    "references_of",
    "replay",
    "run_cost",
    "stm32f767",
    "timeline",
    "violations",
    "wait_states",
]
