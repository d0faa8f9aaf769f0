"""Several stations and what connects them: local clocks, a radio that loses messages, and what is built on both."""

from labkit.network.clocks import MOST_PPM, Clock
from labkit.network.loss import GilbertElliott, Independent, Loss, Scripted
from labkit.network.periods import CORRECTIONS, Correction, Plan, Starts, centred, largest_shift, period_starts, start_at
from labkit.network.radio import Counts, Radio, at
from labkit.network.sync import MODES, Indication, Master, Mode, Rule, Slave, Tally, precision_bound
from labkit.network.sync_run import Member, SyncRun, synchronise
from labkit.network.virtual import VirtualClock

__all__ = [
    "CORRECTIONS",
    "MODES",
    "MOST_PPM",
    "Clock",
    "Correction",
    "Counts",
    "GilbertElliott",
    "Independent",
    "Indication",
    "Loss",
    "Master",
    "Member",
    "Mode",
    "Plan",
    "Radio",
    "Rule",
    "Scripted",
    "Slave",
    "Starts",
    "SyncRun",
    "Tally",
    "VirtualClock",
    "at",
    "centred",
    "largest_shift",
    "period_starts",
    "precision_bound",
    "start_at",
    "synchronise",
]
