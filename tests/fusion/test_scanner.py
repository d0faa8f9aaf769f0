"""The LMS 200: its numbers, its errors, and what motion does to a scan."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.fusion import SECOND, Pose, Scan, Scanner, Straight, World, ball, field, points, robot, scan
from labkit.fusion.laser.scanner import ROTATION_NS

STILL = Straight(Pose(0.5, 2.5))
EXACT = {"noise_m": 0.0, "step_m": 0.0, "spot_deg": 0.0}


def one(scanner=None, others=(), motion=STILL, seed=1, start=0) -> Scan:
    world = field(8, 5, [robot("A", motion), *others])
    return scan(world, scanner or Scanner(), "A", start, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("resolution", "values", "rotations", "link_ms"), [(1.0, 181, 1, 97), (0.5, 361, 2, 191), (0.25, 721, 4, 378)]
)
def test_the_numbers_of_the_data_sheet(resolution, values, rotations, link_ms):
    """13.32 ms per rotation; 372 and 732 bytes at 38 400 baud take 97 and 191 ms (the fourfold one is arithmetic)."""
    scanner = Scanner(resolution_deg=resolution)
    made = one(scanner)
    assert (scanner.values, scanner.scan_ns, round(scanner.link_ns / 1e6)) == (values, rotations * ROTATION_NS, link_ms)
    assert np.rad2deg(made.angles[[0, -1]]) == pytest.approx([-90, 90])
    assert made.ready_ns == scanner.scan_ns + scanner.link_ns
    later = np.diff(made.beam_ns[::rotations])
    assert np.abs(later - ROTATION_NS / 360).max() <= 1  # within a rotation, one degree after the other
    assert np.array_equal(np.diff(made.beam_ns)[: rotations - 1] > 0.99 * ROTATION_NS, [True] * (rotations - 1))


def test_the_link_bounds_the_scans_per_second():
    """Source 2 gets about 3 scans per second at 38 400 baud; rotation and link leave room for fewer than 5."""
    scanner = Scanner()
    assert 4 < SECOND / (scanner.scan_ns + scanner.link_ns) < 5


def test_noise_offset_and_rounding_are_what_they_say():
    exact = one(Scanner(**EXACT)).ranges
    noisy = one(Scanner(noise_m=0.005, step_m=0, spot_deg=0)).ranges - exact
    assert abs(noisy.std() - 0.005) < 0.0006 and abs(noisy.mean()) < 0.0008
    assert one(Scanner(noise_m=0, step_m=0, spot_deg=0, offset_m=0.015)).ranges - exact == pytest.approx(0.015)
    rounded = one(Scanner(noise_m=0, spot_deg=0)).ranges
    assert rounded * 100 == pytest.approx(np.rint(rounded * 100)) and np.abs(rounded - exact).max() <= 0.005 + 1e-12


def test_exact_ranges_are_the_walls():
    made = points(one(Scanner(**EXACT)))
    off = np.stack([made.xy[:, 0] - 8, made.xy[:, 1], made.xy[:, 1] - 5])
    assert np.abs(off).min(axis=0).max() < 1e-9


def test_occlusion_and_range_limit():
    behind = ball(Straight(Pose(4.5, 2.5)), "behind")
    made = one(others=[robot("R", Straight(Pose(2.5, 2.5))), behind])
    assert (made.seen == 2).any() and not (made.seen == 3).any()
    short = one(Scanner(range_m=3))
    assert np.isinf(short.ranges).any() and short.ranges[np.isfinite(short.ranges)].max() < 3.05
    assert (short.seen[np.isinf(short.ranges)] == -1).all()


def test_mixed_pixels_lie_between_near_and_far():
    others = [robot("R", Straight(Pose(3, 2.5, 0.3)))]
    sharp, spot = one(Scanner(noise_m=0, step_m=0, spot_deg=0), others), one(Scanner(noise_m=0, step_m=0, spot_deg=0.5), others)
    ghosts = np.flatnonzero(np.abs(sharp.ranges - spot.ranges) > 1e-9)
    assert 1 <= len(ghosts) <= 4
    for i in ghosts:
        near, far = sharp.ranges[max(0, i - 1) : i + 2].min(), sharp.ranges[max(0, i - 1) : i + 2].max()
        assert near - 1e-9 <= spot.ranges[i] <= far + 1e-9 and far - near > 1 and spot.seen[i] == -1


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0])
def test_what_moves_combs(speed):
    """A robot that comes nearer: the beams of the second rotation see it speed x 13.32 ms nearer than those of the first."""
    made = one(Scanner(**EXACT), [robot("R", Straight(Pose(3, 2.5), vx=-speed))])
    front = np.flatnonzero(made.seen == 2)
    depth = made.ranges[front] * np.cos(made.angles[front])
    depth += speed * (made.beam_ns[front] % ROTATION_NS) / SECOND  # what it moves within a rotation
    first, second = depth[front % 2 == 0], depth[front % 2 == 1]
    assert first.mean() - second.mean() == pytest.approx(speed * ROTATION_NS / SECOND, abs=1e-6)
    assert np.ptp(first) < 1e-6 and np.ptp(second) < 1e-6
    smooth = one(Scanner(**EXACT, resolution_deg=1.0), [robot("R", Straight(Pose(3, 2.5), vx=-speed))])
    assert (np.diff(np.sign(np.diff(smooth.ranges[smooth.seen == 2]))) != 0).sum() <= 1  # one rotation has no teeth


def test_its_own_motion_bends_a_scan():
    moving = points(one(Scanner(**EXACT), motion=Straight(Pose(0.5, 2.5), vx=2)))
    wall = moving.xy[moving.xy[:, 0] > 7.9, 0]
    assert 0.01 < np.ptp(wall) < 2 * 2 * ROTATION_NS / SECOND


def test_one_seed_one_scan_and_a_switch_changes_no_other_draw():
    assert np.array_equal(one(seed=3).ranges, one(seed=3).ranges)
    assert not np.array_equal(one(seed=3).ranges, one(seed=4).ranges)
    same = one(Scanner(spot_deg=0)).ranges == one(Scanner(spot_deg=0.25)).ranges
    assert same.mean() > 0.95


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([0.25, 0.5, 1.0]),
    st.integers(1, 180),
    st.floats(0.5, 80),
    st.integers(0, 2**55),
    st.floats(-3, 3),
    st.floats(-9, 9),
)
def test_any_setting_gives_a_scan(resolution, view, far, start, speed, x):
    scanner = Scanner(resolution_deg=resolution, view_deg=view, range_m=far)
    world = World((robot("A", Straight(Pose(0, 0))), ball(Straight(Pose(x, 0.4), vy=speed))))
    made = scan(world, scanner, "A", start, np.random.default_rng(0))
    assert len(made.angles) == len(made.ranges) == len(made.seen) == len(made.beam_ns) == scanner.values
    assert made.beam_ns.min() <= made.time_ns <= made.beam_ns.max() <= made.ready_ns
    assert not np.isnan(made.ranges).any() and (made.ranges >= 0).all()
    assert len(points(made).xy) == (np.isfinite(made.ranges) & (made.ranges > 0)).sum()


def test_points_leave_out_what_is_no_distance():
    made = one()
    bad = made.ranges.copy()
    bad[:5] = [np.nan, -1, 0, np.inf, -np.inf]
    assert len(points(dataclasses.replace(made, ranges=bad)).xy) == len(bad) - 5


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("resolution_deg", 0.3),
        ("view_deg", 0),
        ("noise_m", float("nan")),
        ("range_m", 0),
        ("baud", 0),
        ("spot_deg", 2),
        ("offset_m", np.inf),
    ],
)
def test_impossible_settings_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f"the scanner's {name} is .* is allowed"):
        Scanner(**{name: value})
