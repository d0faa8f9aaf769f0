"""Several stations and what connects them: local clocks, a radio that loses messages, and what is built on both."""

from labkit.network.adversary import OUTCOMES, Adversary, Found, Lost, Turn, every_pattern, horizon, play
from labkit.network.clocks import MOST_PPM, Clock
from labkit.network.fragments import MOST_BYTES, Message, Reassembly, fragment_count, fragments
from labkit.network.groups import DELIVERIES, AccessPoint, Broadcast, Delivery, Group, Offer, Packet, Station, reaches_all
from labkit.network.loss import GilbertElliott, Independent, Loss, Scripted
from labkit.network.mail import GroupMail
from labkit.network.periods import CORRECTIONS, Correction, Plan, Starts, centred, largest_shift, period_starts, start_at
from labkit.network.polling import BYTE_NS, FRAME_NS, WAYS, Way, converse
from labkit.network.radio import Counts, Radio, at
from labkit.network.report import Conversation, Sent
from labkit.network.sync import MODES, Indication, Master, Mode, Rule, Slave, Tally, precision_bound
from labkit.network.sync_run import Member, SyncRun, synchronise
from labkit.network.virtual import VirtualClock

__all__ = [
    "BYTE_NS",
    "CORRECTIONS",
    "DELIVERIES",
    "FRAME_NS",
    "MODES",
    "MOST_BYTES",
    "MOST_PPM",
    "OUTCOMES",
    "WAYS",
    "AccessPoint",
    "Adversary",
    "Broadcast",
    "Clock",
    "Conversation",
    "Correction",
    "Counts",
    "Delivery",
    "Found",
    "GilbertElliott",
    "Group",
    "GroupMail",
    "Independent",
    "Indication",
    "Loss",
    "Lost",
    "Master",
    "Member",
    "Message",
    "Mode",
    "Offer",
    "Packet",
    "Plan",
    "Radio",
    "Reassembly",
    "Rule",
    "Scripted",
    "Sent",
    "Slave",
    "Starts",
    "Station",
    "SyncRun",
    "Tally",
    "Turn",
    "VirtualClock",
    "Way",
    "at",
    "centred",
    "converse",
    "every_pattern",
    "fragment_count",
    "fragments",
    "horizon",
    "largest_shift",
    "period_starts",
    "play",
    "precision_bound",
    "reaches_all",
    "start_at",
    "synchronise",
]
