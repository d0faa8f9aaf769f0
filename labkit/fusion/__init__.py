"""From laser points to moving elements: world and scanner, the stages of the chain, fusion of stations, Kalman tracking."""

from labkit.fusion.association import GATE, GlobalNearest, JointCompatible, NearestFirst, Pairs, Rule, gate_squared, pairs
from labkit.fusion.consistency import Kind as FilterKind
from labkit.fusion.consistency import claimed_and_real, expected_nees, sampled_errors
from labkit.fusion.crossing import FIELD, Crossing
from labkit.fusion.filters import Filter, Forecast, MatrixFilter, PlaneFilter, SourceFilter, start
from labkit.fusion.gates import Gated, gated
from labkit.fusion.joining import fuse_elements, fuse_points
from labkit.fusion.judging import Gospa, consistency_band, gospa, normalised_squares, ospa, rmse, switches
from labkit.fusion.kalman import (
    MOTIONS,
    Model,
    ProcessModel,
    axis_covariance,
    process_noise,
    textbook_predict,
    textbook_update,
    transition,
)
from labkit.fusion.laser import *  # noqa: F403  the door of the room is this one
from labkit.fusion.laser import __all__ as _laser
from labkit.fusion.levels import LEVELS, Fusion, Judged, Level, fuse_at, fuse_levels, judged, sent_bytes
from labkit.fusion.levels_contours import fuse_contours
from labkit.fusion.levels_objects import fuse_objects
from labkit.fusion.measurements import COLUMNS, ESTIMATE, Measurement, Reading, read_measurements, write_estimates
from labkit.fusion.stations import COURSES, Course, Looks, Stations, averages, fuse, place
from labkit.fusion.tracks import Reorderer, Step, Track, Tracked, Tracker, looks, track

__all__ = [
    *_laser,
    "COLUMNS",
    "COURSES",
    "ESTIMATE",
    "FIELD",
    "GATE",
    "LEVELS",
    "MOTIONS",
    "Course",
    "Crossing",
    "Filter",
    "FilterKind",
    "Forecast",
    "Fusion",
    "Gated",
    "GlobalNearest",
    "Gospa",
    "JointCompatible",
    "Judged",
    "Level",
    "Looks",
    "MatrixFilter",
    "Measurement",
    "Model",
    "NearestFirst",
    "Pairs",
    "PlaneFilter",
    "ProcessModel",
    "Reading",
    "Reorderer",
    "Rule",
    "SourceFilter",
    "Stations",
    "Step",
    "Track",
    "Tracked",
    "Tracker",
    "averages",
    "axis_covariance",
    "claimed_and_real",
    "consistency_band",
    "expected_nees",
    "fuse",
    "fuse_at",
    "fuse_contours",
    "fuse_elements",
    "fuse_levels",
    "fuse_objects",
    "fuse_points",
    "gate_squared",
    "gated",
    "gospa",
    "judged",
    "looks",
    "normalised_squares",
    "ospa",
    "pairs",
    "place",
    "process_noise",
    "read_measurements",
    "rmse",
    "sampled_errors",
    "sent_bytes",
    "start",
    "switches",
    "textbook_predict",
    "textbook_update",
    "track",
    "transition",
    "write_estimates",
]
