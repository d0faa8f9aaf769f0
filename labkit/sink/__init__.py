"""The trace sink: its algorithms under an explorer of all interleavings, cycle stamps, and what goes over the wire.

`check_sink("published-first")` finds the shortest way to a failure of one variant; the other modules make, lose and read stamps.
"""

from labkit.sink.check import Check, check_sink, default_ring, sample_run
from labkit.sink.crc import crc32_mpeg2, crc32_mpeg2_bitwise, crc32_mpeg2_words
from labkit.sink.explorer import BUDGET, VERDICTS
from labkit.sink.formats import Decoded, Stream, decode_records, decode_words, link_load
from labkit.sink.frames import (
    BITS_PER_BYTE,
    FRAME_BYTES,
    VELOCITY_BAUD,
    Reception,
    check_frame,
    encode_frame,
    pieces,
    read_frames,
    read_late,
    receptions,
)
from labkit.sink.history import Step
from labkit.sink.lessons import LESSONS, PREAMBLE, Lesson
from labkit.sink.ring import SCHEDULES, Ring
from labkit.sink.stamps import CLOCK_HZ, Stamp, StampRing, unwrap, wrap, wrap_seconds
from labkit.sink.variants import VARIANTS, Variant

__all__ = [
    "BITS_PER_BYTE",
    "BUDGET",
    "CLOCK_HZ",
    "FRAME_BYTES",
    "LESSONS",
    "PREAMBLE",
    "SCHEDULES",
    "VARIANTS",
    "VELOCITY_BAUD",
    "VERDICTS",
    "Check",
    "Decoded",
    "Lesson",
    "Reception",
    "Ring",
    "Stamp",
    "StampRing",
    "Step",
    "Stream",
    "Variant",
    "check_frame",
    "check_sink",
    "crc32_mpeg2",
    "crc32_mpeg2_bitwise",
    "crc32_mpeg2_words",
    "decode_records",
    "decode_words",
    "default_ring",
    "encode_frame",
    "link_load",
    "pieces",
    "read_frames",
    "read_late",
    "receptions",
    "sample_run",
    "unwrap",
    "wrap",
    "wrap_seconds",
]
