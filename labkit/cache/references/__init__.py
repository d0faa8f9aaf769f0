"""Traces of data references: as columns, from files, and made of access patterns."""

from labkit.cache.references.columns import LOAD, MODIFY, OPS, STORE, References, TraceFileError
from labkit.cache.references.files import RecordedReferences, read_references, read_trace
from labkit.cache.references.npz import MOST_IN_FILE

__all__ = [
    "LOAD",
    "MODIFY",
    "MOST_IN_FILE",
    "OPS",
    "STORE",
    "RecordedReferences",
    "References",
    "TraceFileError",
    "read_references",
    "read_trace",
]
