"""From laser points to moving elements: world and scanner, the stages of the chain, fusion of stations, Kalman tracking."""

from labkit.fusion.association import GATE, GlobalNearest, JointCompatible, NearestFirst, Pairs, Rule, gate_squared, pairs
from labkit.fusion.filters import Filter, Forecast, MatrixFilter, PlaneFilter, SourceFilter, start
from labkit.fusion.kalman import (
    MOTIONS,
    Model,
    Motion,
    axis_covariance,
    process_noise,
    textbook_predict,
    textbook_update,
    transition,
)
from labkit.fusion.measurements import COLUMNS, ESTIMATE, Measurement, Reading, read_measurements, write_estimates
from labkit.fusion.tracks import Reorderer, Step, Track, Tracked, Tracker, looks, track

__all__ = [
    "COLUMNS",
    "ESTIMATE",
    "GATE",
    "MOTIONS",
    "Filter",
    "Forecast",
    "GlobalNearest",
    "JointCompatible",
    "MatrixFilter",
    "Measurement",
    "Model",
    "Motion",
    "NearestFirst",
    "Pairs",
    "PlaneFilter",
    "Reading",
    "Reorderer",
    "Rule",
    "SourceFilter",
    "Step",
    "Track",
    "Tracked",
    "Tracker",
    "axis_covariance",
    "gate_squared",
    "looks",
    "pairs",
    "process_noise",
    "read_measurements",
    "start",
    "textbook_predict",
    "textbook_update",
    "track",
    "transition",
    "write_estimates",
]
