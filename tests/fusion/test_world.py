"""World and motions: rays against an independent brute force, motions against what they say."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.fusion import SECOND, Circle, Pose, StopAndGo, Straight, Waypoints, World, ball, border, field, robot

coordinate = st.floats(-6, 6)
poses = st.builds(Pose, coordinate, coordinate, st.floats(-4, 4))
motions = st.one_of(
    st.builds(Straight, poses, st.floats(-3, 3), st.floats(-3, 3)),
    st.builds(Circle, coordinate, coordinate, st.floats(0.3, 3), st.floats(-3, 3), st.floats(-4, 4)),
    st.builds(StopAndGo, poses, st.floats(-3, 3), st.floats(-3, 3), st.floats(0.1, 2), st.floats(0.1, 2)),
)
worlds = st.lists(motions, min_size=1, max_size=5).map(
    lambda found: field(9, 6, [(ball(m, f"b{i}") if i % 2 else robot(f"r{i}", m)) for i, m in enumerate(found)])
)


def nearest(world, x, y, angle, time_ns):
    """One ray, one body, one side at a time, in the frame of the field: circles by the roots of a polynomial, sides by solving a
    linear system.
    """
    best, hit = math.inf, -1
    for i, body in enumerate(world.bodies):
        bx, by, heading = map(float, body.motion.at(time_ns))
        ux, uy = math.cos(angle), math.sin(angle)
        if body.radius:
            dx, dy = x - bx, y - by
            roots = np.roots([1, 2 * (dx * ux + dy * uy), dx * dx + dy * dy - body.radius**2])
            found = [t.real for t in roots if abs(t.imag) < 1e-12 and t.real > 0]
        else:
            turned = [
                (bx + cx * math.cos(heading) - cy * math.sin(heading), by + cx * math.sin(heading) + cy * math.cos(heading))
                for cx, cy in body.corners
            ]
            found = []
            for (ax, ay), (ex, ey) in zip(turned, turned[1:] + turned[:1], strict=True):
                matrix = np.array([[ux, ax - ex], [uy, ay - ey]])
                if abs(np.linalg.det(matrix)) > 1e-12:
                    t, w = np.linalg.solve(matrix, [ax - x, ay - y])
                    if t > 0 and 0 <= w <= 1:
                        found.append(t)
        if found and min(found) < best:
            best, hit = min(found), i
    return best, hit


@settings(max_examples=60, deadline=None)
@given(worlds, st.floats(0.1, 8.9), st.floats(0.1, 5.9), st.integers(0, 5 * SECOND), st.integers(0, 40_000_000))
def test_rays_hit_what_a_brute_force_hits(world, x, y, start, step):
    angles = np.linspace(-3, 3, 13) + 0.01234
    times = start + step * np.arange(13)
    found, seen = world.cast(np.tile([x, y], (13, 1)), angles, times)
    for i in range(13):
        distance, hit = nearest(world, x, y, float(angles[i]), int(times[i]))
        near_a_rim = any(
            abs(nearest(world, x, y, float(angles[i]) + e, int(times[i]))[0] - distance) > 1e-3 for e in (-1e-7, 1e-7)
        )
        if not near_a_rim:  # there the last bit decides
            assert found[i] == pytest.approx(distance, abs=1e-6)
            assert seen[i] == hit or distance == pytest.approx(found[i], abs=1e-9)


def test_a_ray_into_nothing_and_a_body_left_out():
    world = World((ball(Straight(Pose(3, 0))),))
    origin, angle, time = np.zeros((2, 2)), np.array([0.0, 1.0]), np.zeros(2, np.int64)
    found, seen = world.cast(origin, angle, time)
    assert found[0] == pytest.approx(2.89) and math.isinf(found[1]) and seen.tolist() == [0, -1]
    assert np.isinf(world.cast(origin, angle, time, without=0)[0]).all()


def test_motions_are_where_they_say():
    way = Waypoints(((0, 0), (2, 0), (2, 1)), speed=1)
    assert way.at(SECOND).tolist() == [1, 0, 0]
    assert way.at(np.array([2.5, 9]) * SECOND) == pytest.approx(np.array([[2, 0.5, np.pi / 2], [2, 1, np.pi / 2]]))
    stop = StopAndGo(Pose(0, 0), 2, 0, go_s=1, stop_s=0.5)
    assert [stop.at(int(t * SECOND))[0] for t in (0.5, 1, 1.4, 1.5, 2)] == pytest.approx([1, 2, 2, 2, 3])
    circle = Circle(1, 1, 2, speed=np.pi)
    assert circle.at(SECOND) == pytest.approx([1, 3, np.pi])
    assert Circle(1, 1, 2, speed=-np.pi).at(SECOND) == pytest.approx([1, -1, -np.pi])
    assert Straight(Pose(1, 2, 0.5)).at(SECOND).tolist() == [1, 2, 0.5]


@given(motions, st.integers(0, 10 * SECOND))
def test_one_time_and_many_times_agree(motion, time_ns):
    assert motion.at(np.array([time_ns, 0]))[0] == pytest.approx(motion.at(time_ns))


def test_outlines_lie_where_rays_end():
    world = field(9, 6, [robot("a", Straight(Pose(4, 3, 0.7))), ball(Straight(Pose(6, 3)))])
    assert np.hypot(*(world.bodies[1].outline(0) - (4, 3)).T) == pytest.approx(np.sqrt(0.125))
    assert np.hypot(*(world.bodies[2].outline(0) - (6, 3)).T) == pytest.approx(0.11)
    assert world.bodies[0].outline(0).tolist() == [[0, 0], [9, 0], [9, 6], [0, 6], [0, 0]]


def test_a_world_needs_names_and_knows_them():
    with pytest.raises(ValueError, match="each needs a name of its own"):
        World((border(1, 1), border(1, 1)))
    with pytest.raises(ValueError, match="no body 'x'; it has border"):
        field(1, 1, []).index("x")
