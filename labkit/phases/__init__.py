"""Chains of phases in every period: windows, six designs and their guarantees, the framework, the laser chain of source 2."""

from labkit.phases.chainfile import read_chain
from labkit.phases.designs import DESIGNS, run_design, run_designs
from labkit.phases.framework import Organiser, Unit
from labkit.phases.laser_chain import experiment_1, laser_chain
from labkit.phases.windows import Part, Window, check_windows, windows

__all__ = [
    "DESIGNS",
    "Organiser",
    "Part",
    "Unit",
    "Window",
    "check_windows",
    "experiment_1",
    "laser_chain",
    "read_chain",
    "run_design",
    "run_designs",
    "windows",
]
