"""The trace sink: its algorithms under an explorer of all interleavings, cycle stamps, and what goes over the wire.

`check_sink("published-first")` finds the shortest way to a failure of one variant; the other modules make, lose and read stamps.
"""

from labkit.sink.check import Check, check_sink, default_ring
from labkit.sink.explorer import BUDGET, VERDICTS
from labkit.sink.history import Step
from labkit.sink.ring import SCHEDULES, Ring
from labkit.sink.variants import VARIANTS, Variant

__all__ = ["BUDGET", "SCHEDULES", "VARIANTS", "VERDICTS", "Check", "Ring", "Step", "Variant", "check_sink", "default_ring"]
