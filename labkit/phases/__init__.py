"""Chains of phases in every period: windows, six designs and their guarantees, the framework, the laser chain of source 2."""

from labkit.phases.chainfile import read_chain
from labkit.phases.designs import DESIGNS, DesignRun, phase_times, run_design, run_designs
from labkit.phases.distributed import CommunicationUnit, DataObject, Fused, FusionUnit, Team
from labkit.phases.framework import Organiser, Unit
from labkit.phases.laser_chain import (
    BELOW_NS,
    CONTOUR,
    LONGEST_NS,
    MS,
    SHARE,
    Experiment1,
    contour_model,
    experiment_1,
    laser_chain,
    laser_load,
)
from labkit.phases.laser_team import LaserTeam, laser_team
from labkit.phases.windows import Part, Window, check_windows, phases_of, windows

__all__ = [
    "BELOW_NS",
    "CONTOUR",
    "DESIGNS",
    "LONGEST_NS",
    "MS",
    "SHARE",
    "CommunicationUnit",
    "DataObject",
    "DesignRun",
    "Experiment1",
    "Fused",
    "FusionUnit",
    "LaserTeam",
    "Organiser",
    "Part",
    "Team",
    "Unit",
    "Window",
    "check_windows",
    "contour_model",
    "experiment_1",
    "laser_chain",
    "laser_load",
    "laser_team",
    "phase_times",
    "phases_of",
    "read_chain",
    "run_design",
    "run_designs",
    "windows",
]
