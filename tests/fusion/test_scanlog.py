"""Scan logs: what is read, what is left out and told, and what is refused."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from labkit.data import example
from labkit.fusion import Pose, points, read_scans, run_chain

_spec = importlib.util.spec_from_file_location("make_scans", Path(__file__).parent / "make_scans.py")
make_scans = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(make_scans)


def read(tmp_path, text, **options):
    path = tmp_path / "scans"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_scans(path, **options)


def told(report):
    return [(problem.line, problem.what) for problem in report.problems]


def test_the_samples_are_what_the_lab_writes():
    assert example("scans.csv").read_text(encoding="utf-8") == make_scans.csv()
    assert example("scans_carmen.log").read_text(encoding="utf-8") == make_scans.carmen()
    with pytest.raises(ValueError, match="no sample file 'x'"):
        example("x")


def test_the_ball_of_the_sample_rolls_as_it_was_made_to():
    scans, report = read_scans(example("scans.csv"), range_m=6.0, pose=make_scans.POSE)
    assert (report.scans, report.other, report.rejected, report.moved) == (20, 2, 0, 0)
    true = np.array(make_scans.BALL[:2]) + np.outer([one.time_ns / 1e9 for one in scans], make_scans.SPEED)
    found = [run_chain(points(one)).elements.of("ball") for one in scans]
    seen = np.array([len(balls) == 1 for balls in found])
    assert seen.mean() > 0.8 and not any(len(balls) > 1 for balls in found)
    places = np.array([(balls[0].x, balls[0].y) for balls in found if balls])
    assert np.hypot(*(places - true[seen]).T).max() < 0.04


def test_carmen_and_csv_agree():
    carmen, report = read_scans(example("scans_carmen.log"))
    assert (report.lines, report.scans, report.other) == (7, 4, 3)
    csv, _ = read_scans(example("scans.csv"), pose=make_scans.POSE)
    for one, other in zip(carmen, csv, strict=False):
        assert one.time_ns == other.time_ns and one.pose == other.pose == (1.0, 2.5, 0.0)
        assert one.angles == pytest.approx(other.angles, abs=1e-5)
        back = np.isfinite(one.ranges)
        assert np.array_equal(back, np.isfinite(other.ranges)) or np.array_equal(
            one.ranges[back] < 6, np.isfinite(other.ranges[back])
        )
        assert one.ranges[one.ranges < 6] == pytest.approx(other.ranges[one.ranges < 6])


def test_angles_by_the_number_of_ranges(tmp_path):
    """180 and 181 values are 1 degree, 360 and 361 half a degree (CARMEN); CSV spreads over the field of view."""
    for count, step in ((180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)):
        line = " ".join(["FLASER", str(count), *["2.0"] * count, *["0"] * 6, "5.5", "host", "0"])
        (one,), _ = read(tmp_path, line)
        assert np.rad2deg(one.angles[:2]) == pytest.approx([-90, -90 + step]) and one.time_ns == 5_500_000_000
    (one,), _ = read(tmp_path, "0,1,1,1,1,1", view_deg=100)
    assert np.rad2deg(one.angles) == pytest.approx([-50, -25, 0, 25, 50])


def test_what_did_not_come_back(tmp_path):
    (one,), report = read(tmp_path, "10, 1.5, , nan, -, inf, -2, 0, 80, 81.9, 79.9", pose=Pose(1, 2, 3))
    assert np.isfinite(one.ranges).tolist() == [True] + [False] * 8 + [True] and report.rejected == 0 and one.pose == (1, 2, 3)
    (one,), _ = read(tmp_path, "10,,,")
    assert np.isinf(one.ranges).all() and len(points(one).xy) == 0 and run_chain(points(one)).elements.elements == ()


def test_lines_that_are_cut_or_of_another_length_are_told(tmp_path):
    scans, report = read(tmp_path, "time_ms,a,b,c\n0,1,2,3\n1,1,2\n2,1,2,3\n\n3,1,2,3,4\nx,1,2,3\n5,1,y,3\n6\n7,1,2,3\r\n")
    assert [one.time_ns for one in scans] == [0, 2_000_000, 7_000_000]
    assert (report.lines, report.scans, report.other, report.empty, report.rejected) == (10, 3, 1, 1, 5)
    assert told(report) == [
        (3, "there are 2 ranges, 3 in most lines"),
        (6, "there are 4 ranges, 3 in most lines"),
        (7, "time_ms is 'x', no number"),
        (8, "range 2 is 'y', no number"),
        (9, "there are 0 ranges; 1 to 8000 are allowed"),
    ]
    assert "line 3: there are 2 ranges, 3 in most lines; left out" in str(report)


def test_negative_and_repeated_times_are_left_out_and_a_step_back_is_sorted(tmp_path):
    scans, report = read(tmp_path, "5,1\n-1,1\n7,2\n5,3\n6,4\nnan,1\n1e30,1\n")
    assert [(one.time_ns, one.ranges[0]) for one in scans] == [(5_000_000, 1), (6_000_000, 4), (7_000_000, 2)]
    assert (report.rejected, report.moved) == (4, 1)
    assert told(report) == [
        (2, "the time is -0.001 s; 0 to 4000000000 s is allowed"),
        (4, "the time 0.005000 s is that of an earlier line"),
        (5, "the time goes back by 0.001000 s"),
        (6, "the time is nan s; 0 to 4000000000 s is allowed"),
        (7, "the time is 1e+27 s; 0 to 4000000000 s is allowed"),
    ]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("FLASER", "FLASER ends before its number of ranges"),
        ("FLASER 3 1 1 1 0 0 0", "FLASER with 3 ranges has 8 words instead of 14"),
        ("FLASER x 1 0 0 0 0 0 0 1 h 1", "the number of ranges is 'x', no number of at most six digits"),
        ("FLASER 1 1 nan 0 0 0 0 0 1 h 1", "the pose is nan, 0, 0; numbers up to 1e+06 are allowed"),
        ("ROBOTLASER1 0 -1.5 3 0.1 80 0 0 3 1 1 1", "ROBOTLASER1 announces 3 ranges and ends before their end"),
        (
            "ROBOTLASER1 0 -1.5 3 0.0 80 0 0 1 1 0 0 0 0 0 0 0 0 0 0 0 0 1 h 1",
            "ROBOTLASER1 starts at -1.5 rad with steps of 0 rad and a range of 80 m",
        ),
    ],
)
def test_carmen_messages_that_are_cut(tmp_path, line, what):
    good = "FLASER 1 2.0 0 0 0 0 0 0 9 host 9"
    scans, report = read(tmp_path, f"{good}\n{line} \n")
    assert len(scans) == 1 and told(report) == [(2, what)]


def test_one_beam_is_a_scan(tmp_path):
    (one,), _ = read(tmp_path, "0,2.0")
    assert one.angles.tolist() == [0.0] and points(one).xy.tolist() == [[2.0, 0.0]]
    assert run_chain(points(one)).elements.elements == ()


@pytest.mark.parametrize("text", ["", "\n\n", "time_ms,a\n", "hello", "# 0,1\n", b"\xff\xfe\x00", "FLASER 5\n", "-1,2\n"])
def test_a_file_without_a_scan_is_refused(tmp_path, text):
    with pytest.raises(ValueError, match="has no scan: a line is time_ms and ranges with commas, or a FLASER or ROBOTLASER1"):
        read(tmp_path, text)


def test_limits(tmp_path, monkeypatch):
    monkeypatch.setattr("labkit.fusion.laser.scanlog.MOST_SCANS", 3)
    with pytest.raises(ValueError, match="more scans than 3"):
        read(tmp_path, "1,1\n2,1\n3,1\n4,1\n")
    monkeypatch.setattr("labkit.fusion.laser.scanlog.MOST_BYTES", 10)
    with pytest.raises(ValueError, match="longer than"):
        read(tmp_path, "1,1\n2,1\n3,1\n4,1\n")
    with pytest.raises(ValueError, match="view_deg is 0"):
        read(tmp_path, "1,1", view_deg=0)
    with pytest.raises(OSError):
        read_scans(tmp_path / "none")


def test_only_so_many_problems_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("labkit.fusion.laser.scanlog.MOST_TOLD", 4)
    _, report = read(tmp_path, "0,1\n" + "x,1\n" * 30)
    assert report.rejected == 30 and len(report.problems) == 4 and "and 26 more" in str(report)
