"""Several stations and what connects them: local clocks, a radio that loses messages, and what is built on both."""

from labkit.network.clocks import MOST_PPM, Clock
from labkit.network.loss import GilbertElliott, Independent, Loss, Scripted
from labkit.network.radio import Counts, Radio, at
from labkit.network.sync import MODES, Indication, Master, Mode, Rule, Slave, Tally, precision_bound
from labkit.network.sync_run import Member, SyncRun, synchronise
from labkit.network.virtual import VirtualClock

__all__ = [
    "MODES",
    "MOST_PPM",
    "Clock",
    "Counts",
    "GilbertElliott",
    "Independent",
    "Indication",
    "Loss",
    "Master",
    "Member",
    "Mode",
    "Radio",
    "Rule",
    "Scripted",
    "Slave",
    "SyncRun",
    "Tally",
    "VirtualClock",
    "at",
    "precision_bound",
    "synchronise",
]
