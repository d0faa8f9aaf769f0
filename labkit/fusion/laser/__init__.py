"""One station: a world and a scanner in it, or a recorded log, and the stages from points to elements."""

from labkit.fusion.laser.arcs import search_arcs
from labkit.fusion.laser.chain import Chain, contour_filter, from_contours, run_chain, within
from labkit.fusion.laser.circles import kasa, known_radius, taubin
from labkit.fusion.laser.edges import extract_edges, groups
from labkit.fusion.laser.elements import element_filter
from labkit.fusion.laser.formats import (
    NO_ARCS,
    NO_EDGES,
    Arcs,
    Contours,
    Disc,
    Edges,
    Element,
    Elements,
    Objects,
    Points,
    Polygon,
    Pose,
    Scan,
)
from labkit.fusion.laser.objects import object_filter
from labkit.fusion.laser.quality import arc_quality, edge_quality, element_quality, object_quality, seen_bodies
from labkit.fusion.laser.scanlog import ScanReport, read_scans
from labkit.fusion.laser.scanner import Scanner, points, scan
from labkit.fusion.laser.settings import VISIT_NS, Settings
from labkit.fusion.laser.world import (
    BALL_RADIUS,
    ROBOT_SIDE,
    SECOND,
    Body,
    Circle,
    StopAndGo,
    Straight,
    Waypoints,
    World,
    ball,
    border,
    field,
    robot,
)

__all__ = [
    "BALL_RADIUS",
    "NO_ARCS",
    "NO_EDGES",
    "ROBOT_SIDE",
    "SECOND",
    "VISIT_NS",
    "Arcs",
    "Body",
    "Chain",
    "Circle",
    "Contours",
    "Disc",
    "Edges",
    "Element",
    "Elements",
    "Objects",
    "Points",
    "Polygon",
    "Pose",
    "Scan",
    "ScanReport",
    "Scanner",
    "Settings",
    "StopAndGo",
    "Straight",
    "Waypoints",
    "World",
    "arc_quality",
    "ball",
    "border",
    "contour_filter",
    "edge_quality",
    "element_filter",
    "element_quality",
    "extract_edges",
    "field",
    "from_contours",
    "groups",
    "kasa",
    "known_radius",
    "object_filter",
    "object_quality",
    "points",
    "read_scans",
    "robot",
    "run_chain",
    "scan",
    "search_arcs",
    "seen_bodies",
    "taubin",
    "within",
]
