"""Fusion at four levels: what becomes one and what does not, what it costs, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.fusion import (
    LEVELS,
    NO_ARCS,
    NO_EDGES,
    Arcs,
    Contours,
    Disc,
    Edges,
    Element,
    Elements,
    Objects,
    Polygon,
    Pose,
    Scanner,
    Straight,
    ball,
    field,
    fuse_at,
    fuse_contours,
    fuse_objects,
    judged,
    points,
    robot,
    run_chain,
    scan,
    sent_bytes,
    within,
)
from labkit.fusion.levels_objects import overlap


def edges(*ends, count=10):
    return Edges(np.array(ends, dtype=float).reshape(-1, 2, 2), np.full(len(ends), count))


def arc(x, y, first, last, radius=0.11, count=10):
    return Arcs(np.array([[x, y]]), np.array([radius]), np.array([first]), np.array([last]), np.array([count]))


def contours(name, edges=NO_EDGES, arcs=NO_ARCS, time_ns=0):
    return Contours(name, time_ns, edges, arcs)


def fused(*stations):
    return within(fuse_contours(stations))


def corner(speed=0.0, later_ns=0):
    """Two stations that look at a robot and a ball from opposite corners."""
    others = [robot("R", Straight(Pose(4.0, 2.0, 0.4))), ball(Straight(Pose(3.5, 3.5), vx=speed))]
    places = {"A": Pose(0.8, 1.0, 0.5), "B": Pose(7.2, 4.0, 3.5)}
    world = field(8, 5, [*(robot(name, Straight(pose)) for name, pose in places.items()), *others])
    rng = np.random.default_rng(1)
    return world, [points(scan(world, Scanner(), name, i * later_ns, rng)) for i, name in enumerate(places)]


def test_overlapping_edges_become_one_that_ends_where_the_outermost_does():
    got = fused(contours("A", edges([(0, 0), (2, 0)])), contours("B", edges([(1.5, 0.02), (4, 0.02)])))
    assert len(got.edges) == 1 and got.edges.points.tolist() == [20]
    assert got.edges.ends[0].ravel() == pytest.approx([0, 0, 4, 0.02], abs=0.02)


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ([(4, 0.02), (1.5, 0.02)], "it runs the other way: the other face of something"),
        ([(1.5, 0.2), (4, 0.2)], "20 cm beside it"),
        ([(2.2, 0), (4, 0)], "it begins behind the end"),
        ([(1.5, 0), (4, 0.9)], "20 degrees turned"),
    ],
)
def test_other_edges_stay_two(other, why):
    assert len(fused(contours("A", edges([(0, 0), (2, 0)])), contours("B", edges(other))).edges) == 2, why


def test_two_edges_of_one_station_are_two():
    assert len(fused(contours("A", edges([(0, 0), (2, 0)], [(1, 0.01), (3, 0.01)])), contours("B")).edges) == 2


def test_a_wall_in_two_pieces_becomes_one_by_what_another_station_sees_of_it():
    pieces = edges([(0, 0), (2, 0)], [(3, 0), (5, 0)])
    assert len(fused(contours("A", pieces), contours("B", edges([(1, 0), (4, 0)]))).edges) == 1


def test_an_edge_is_the_line_through_all_points():
    """Joined edges agree with a least squares line through evenly spread points of both."""
    first, second = [(0, 0), (1, 0.1)], [(0.5, 0.0), (2.5, 0.1)]
    got = fused(contours("A", edges(first)), contours("B", edges(second))).edges.ends[0]
    xy = np.concatenate([np.linspace(*ends, 2001) for ends in (first, second)])
    _, vectors = np.linalg.eigh(np.cov(xy.T))
    along = (got[1] - got[0]) / np.hypot(*(got[1] - got[0]))
    assert abs(along @ vectors[:, -1]) == pytest.approx(1, abs=1e-9)


def test_equal_arcs_become_one_that_both_have_seen():
    got = fused(contours("A", arcs=arc(1, 1, 3.0, 4.0)), contours("B", arcs=arc(1.02, 1, -3.0, -1.0, count=30))).arcs
    assert len(got) == 1 and got.centres[0] == pytest.approx([1.015, 1.0])
    assert (got.first[0], got.last[0]) == (3.0, pytest.approx(2 * np.pi - 1.0))


def test_arcs_of_another_size_or_place_stay_two():
    for other in (arc(1, 1, 0, 1, radius=0.2), arc(1.2, 1, 0, 1)):
        assert len(fused(contours("A", arcs=arc(1, 1, 3.0, 4.0)), contours("B", arcs=other)).arcs) == 2


def test_objects_that_overlap_become_one():
    a = Objects("A", 0, (Polygon(np.array([(0, 0), (0.5, 0), (0.5, 0.5)], float), False, 12),), (Disc(2, 2, 0.11, 8),))
    b = Objects("B", 10, (Polygon(np.array([(0.5, 0.52), (0, 0.52), (0, 0)], float), False, 12),), (Disc(2.2, 2, 0.11, 8),))
    got = within(fuse_objects([a, b]))
    assert len(got.polygons) == 1 and got.polygons[0].closed and got.time_ns == 5
    assert [(disc.x, disc.points) for disc in got.discs] == [(pytest.approx(2.1), 16)]
    far = replace(b, discs=(Disc(2.23, 2, 0.11, 8),))
    assert len(within(fuse_objects([a, far])).discs) == 2


def test_outlines_that_cross_overlap():
    one = Polygon(np.array([(0, 0), (2, 0)], float), False, 9)
    assert overlap(one, Polygon(np.array([(1, -1), (1, 1)], float), False, 9), 0.1)
    assert not overlap(one, Polygon(np.array([(1, 0.3), (1, 1)], float), False, 9), 0.1)


@pytest.mark.parametrize("level", LEVELS)
def test_two_stations_find_all_there_is_at_every_level(level):
    world, seen = corner()
    found = fuse_at(level, seen)
    verdict = judged(world, seen, found.elements)
    assert (verdict.things, verdict.ghosts, verdict.missed, verdict.completeness) == (4, (), (), 1.0)
    assert verdict.error < 0.02 and verdict.ospa < 0.02
    assert found.sent_bytes == tuple(sent_bytes(data) for data in found.sent)


@pytest.mark.parametrize("level", LEVELS)
def test_a_fast_ball_seen_at_two_times_is_two_at_every_level(level):
    world, seen = corner(speed=2.0, later_ns=160_000_000)
    (ghost,) = judged(world, seen, fuse_at(level, seen).elements).ghosts
    assert ghost.kind == "ball"


def test_points_are_dearest_on_the_radio_and_contours_next():
    """Objects and elements need about the same: a wall is an element of its own, and a corner of a polygon."""
    _, seen = corner()
    of_points, of_contours, of_objects, of_elements = (max(fuse_at(level, seen).sent_bytes) for level in LEVELS)
    assert of_points == 722 and of_points > 5 * of_contours and of_contours > max(of_objects, of_elements) > 50


def test_opposite_sides_of_one_robot_are_one_robot():
    """Its two faces have no contour in common; the fusion of elements at the end of every chain makes one of them."""
    _, seen = corner()
    for level in LEVELS:
        near = [e for e in fuse_at(level, seen).elements.of("robot") if np.hypot(e.x - 4.0, e.y - 2.0) < 0.1]
        assert len(near) == 1


@pytest.mark.parametrize("level", LEVELS)
def test_one_station_is_fused_with_nobody(level):
    _, (seen, _) = corner()
    assert fuse_at(level, [seen]).elements.elements == run_chain(seen).elements.elements


@pytest.mark.parametrize("level", LEVELS)
def test_time_is_at_most_the_budgets_and_all_can_be_aborted(level):
    _, seen = corner()
    stages = ("edges", "arcs", "objects", "elements", "fusion")
    full = fuse_at(level, seen)
    for budget in (0, 50_000, 500_000, 2_000_000):
        cut = fuse_at(level, seen, budget_ns=dict.fromkeys(stages, budget))
        assert cut.fusion_ns <= budget and cut.station_ns <= min(full.station_ns + 1, 5 * budget)
    assert not fuse_at(level, seen, budget_ns=dict.fromkeys(stages, 0)).elements.elements


def test_judging_counts_ghosts_and_what_is_missed():
    world, seen = corner()
    true = Elements("A", 0, (Element("ball", 3.5, 3.5, 0.22, 1), Element("robot", 4.0, 2.0, 0.5, 1)))
    verdict = judged(world, seen, true)
    assert (verdict.ghosts, verdict.missed, verdict.completeness, verdict.error) == ((), ("A", "B"), 0.5, 0.0)
    swapped = Elements("A", 0, (Element("robot", 3.5, 3.5, 0.5, 1), Element("ball", 4.0, 2.0, 0.22, 1)))
    verdict = judged(world, seen, swapped)
    assert (verdict.ghosts, len(verdict.missed), verdict.ospa) == (swapped.elements, 4, 0.5)


def test_empty_contours_are_fused_with_others():
    assert len(fused(contours("A"), contours("B")).edges) == 0
    assert len(fused(contours("A"), contours("B", edges([(0, 0), (1, 0)]), arc(1, 1, 0, 1))).edges) == 1


def test_an_edge_without_length_is_left_out():
    got = fused(contours("A", edges([(1, 1), (1, 1)], [(0, 0), (1, 0)])), contours("B", edges([(0, 0), (1, 0)])))
    assert len(got.edges) == 1 and got.edges.points.tolist() == [20]


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (contours("B", edges([(0, 0), (np.nan, 0)])), "edge 0 of station B has an end that is no finite number"),
        (contours("B", edges([(0, 0), (1, 0)], count=0)), "edge 0 of station B has no point"),
        (contours("B", Edges(np.zeros((2, 2)), np.ones(2))), r"edges of station B have ends of shape \(2, 2\)"),
        (contours("B", arcs=arc(0, 0, 0, 1, radius=0.0)), "arc 0 of station B has a radius that is not above 0"),
        (contours("B", arcs=arc(np.inf, 0, 0, 1)), "arc 0 of station B has something that is no finite number"),
        (contours("B", arcs=arc(0, 0, 0, 7)), "arc 0 of station B has angles that are no part of one turn"),
        (contours("B", arcs=replace(arc(0, 0, 0, 1), radii=np.ones(2))), "arcs of station B have radii of shape"),
    ],
)
def test_what_is_no_contour_is_refused_by_name(bad, words):
    with pytest.raises(ValueError, match=words):
        fused(contours("A"), bad)


def test_what_is_no_object_level_or_station_is_refused_by_name():
    with pytest.raises(ValueError, match=r"disc 0 of station B is .*radius above 0"):
        next(fuse_objects([Objects("B", 0, (), (Disc(0, 0, -1, 3),))]))
    with pytest.raises(ValueError, match="polygon 0 of station B has corners"):
        next(fuse_objects([Objects("B", 0, (Polygon(np.zeros((1, 2)), False, 3),), ())]))
    with pytest.raises(ValueError, match="no fusion at the level 'tracks'; there are points, contours"):
        fuse_at("tracks", [])
    for fusion in (fuse_contours, fuse_objects, lambda none: iter([fuse_at("points", none)])):
        with pytest.raises(ValueError, match="no station are to be fused; at least one is needed"):
            next(fusion([]))


number = st.floats(-5, 5)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(st.tuples(number, number, number, number), max_size=5), min_size=1, max_size=3))
def test_any_edges_are_fused_soundly(stations):
    """Points are kept, no edge is added, every step costs something, and the result is finite."""
    given = [contours(f"S{i}", edges(*([(a, b), (c, d)] for a, b, c, d in some))) for i, some in enumerate(stations)]
    long = [int((one.edges.lengths > 1e-6).sum()) for one in given]
    steps = list(fuse_contours(given))
    counts = [len(step.edges) for _, step in steps]
    assert counts[0] == sum(long) and counts == sorted(counts, reverse=True) and all(cost > 0 for cost, _ in steps)
    last = steps[-1][1].edges
    assert last.points.sum() == 10 * sum(long) and np.isfinite(last.ends).all()
