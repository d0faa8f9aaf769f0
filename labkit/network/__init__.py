"""Several stations and what connects them: local clocks, a radio that loses messages, and what is built on both."""

from labkit.network.clocks import MOST_PPM, Clock
from labkit.network.loss import GilbertElliott, Independent, Loss, Scripted
from labkit.network.radio import Counts, Radio, at

__all__ = ["MOST_PPM", "Clock", "Counts", "GilbertElliott", "Independent", "Loss", "Radio", "Scripted", "at"]
