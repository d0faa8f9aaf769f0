"""The filter against filterpy, what the source's measurement vector does, and the reader and writer of measurements."""

import csv
import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.fusion import (
    MOTIONS,
    GlobalNearest,
    JointCompatible,
    Measurement,
    PlaneFilter,
    Reorderer,
    SourceFilter,
    process_noise,
    read_measurements,
    start,
    track,
    transition,
)

SIGMA = 0.03


def oracle(model: str, q: float, measurements: list[Measurement]) -> list[tuple[np.ndarray, np.ndarray]]:
    """filterpy's filter, started as the lab says: (x, P) after each measurement, in the order x, y, vx, vy, ..."""
    n = MOTIONS[model].order
    kf = KalmanFilter(dim_x=2 * n, dim_z=2)
    first, time = measurements[0], measurements[0].time
    kf.H = np.eye(2, 2 * n)
    kf.x[:2, 0] = first.z
    kf.P = np.kron(np.diag([0, 4.0, 4.0][:n]), np.eye(2))
    kf.P[:2, :2] = first.R
    found = [(kf.x[:, 0].copy(), kf.P.copy())]
    for m in measurements[1:]:
        dt, time = m.time - time, m.time
        # written out once more, not taken from the lab
        A = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])[:n, :n]
        noise = {
            "cp": [[dt]],
            "cv": [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]],
            "ca": [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]],
        }[model]
        kf.predict(F=np.kron(A, np.eye(2)), Q=q * np.kron(noise, np.eye(2)))
        kf.update(m.z, R=m.R)
        found.append((kf.x[:, 0].copy(), kf.P.copy()))
    return found


def one_object(seed: int, count: int = 60, sigma: float = SIGMA) -> list[Measurement]:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.0, 0.16, 0.17, 0.33], count)) - 3.0
    places = np.stack([0.2 + 0.6 * times, 0.4 - 0.3 * times], axis=-1) + rng.normal(size=(count, 2)) * sigma
    return [Measurement.equal(t, *p, "AB"[i % 2], sigma) for i, (t, p) in enumerate(zip(times.tolist(), places.tolist()))]


@pytest.mark.parametrize("model", MOTIONS)
@pytest.mark.parametrize("q", [0.0, 0.1, 5.0])
def test_the_fast_path_equals_filterpy(model, q):
    measurements = one_object(1)
    filter_ = PlaneFilter(model, q, measurements[0])
    for m, (x, P) in zip(measurements[1:], oracle(model, q, measurements)[1:]):
        filter_.update(m)
        assert np.abs(filter_.x - x).max() < 1e-12
        assert np.abs(filter_.P - P).max() < 1e-12


@pytest.mark.parametrize("model", MOTIONS)
def test_any_covariance_equals_filterpy_and_the_fast_path_hands_over(model):
    rng = np.random.default_rng(2)
    plain = one_object(3, 40)
    measurements = []
    for i, m in enumerate(plain):
        L = rng.normal(size=(2, 2)) * 0.03 + np.eye(2) * 0.02
        R = L @ L.T if i in (5, 6, 20) else m.R
        measurements.append(Measurement(m.time, m.x, m.y, m.station, R[0, 0], R[0, 1], R[1, 1]))
    filter_ = start(model, 0.3, measurements[0])
    assert isinstance(filter_, PlaneFilter)
    for m, (x, P) in zip(measurements[1:], oracle(model, 0.3, measurements)[1:]):
        filter_ = filter_.update(m)
        assert np.abs(filter_.x - x).max() < 1e-12 and np.abs(filter_.P - P).max() < 1e-12
    assert not isinstance(filter_, PlaneFilter)
    assert not isinstance(start(model, 0.3, measurements[5]), PlaneFilter)


@pytest.mark.parametrize("model", MOTIONS)
def test_a_thousand_tracks_at_once_are_the_same_as_one_by_one(model):
    motion = MOTIONS[model]
    rng = np.random.default_rng(4)
    z = rng.normal(size=(6, 1000)) + 1j * rng.normal(size=(6, 1000))
    together = motion.start(z[0], SIGMA**2)
    alone = [motion.start(complex(one), SIGMA**2) for one in z[0]]
    for row in z[1:]:
        together = motion.update(motion.predict(together, 0.2, 0.1), row, SIGMA**2)
        alone = [motion.update(motion.predict(state, 0.2, 0.1), complex(one), SIGMA**2) for state, one in zip(alone, row)]
    for i, part in enumerate(together):
        assert np.array_equal(np.broadcast_to(part, 1000), np.array([state[i] for state in alone]))


@pytest.mark.parametrize("model", MOTIONS)
@settings(max_examples=30)
@given(first=st.floats(0, 3), second=st.floats(0, 3), q=st.floats(0, 10))
def test_two_predictions_are_one_long_prediction(model, first, second, q):
    """A Q that is not the integral of its noise fails this."""
    A1, A2, A = (transition(model, dt) for dt in (first, second, first + second))
    Q1, Q2, Q = (process_noise(model, q, dt) for dt in (first, second, first + second))
    assert np.allclose(A2 @ A1, A) and np.allclose(A2 @ Q1 @ A2.T + Q2, Q)


@pytest.mark.parametrize("trust", ["sigma", "own P"])
def test_the_innovation_of_the_sources_first_half_is_zero(trust):
    measurements = one_object(5)
    filter_ = SourceFilter(0.1, measurements[0], trust)
    for m in measurements[1:]:
        filter_.update(m)
        assert np.abs(filter_.pseudo).max() < 1e-13  # rounding: the filter never learns anything from it


def test_the_sources_vector_makes_the_claim_smaller():
    measurements = [Measurement.equal(0.165 * k, 0.0, 0.0, "A", SIGMA) for k in range(101)]
    textbook, source = PlaneFilter("cv", 0.0, measurements[0]), SourceFilter(0.0, measurements[0])
    for m in measurements[1:]:
        textbook.update(m)
        source.update(m)
    assert np.linalg.det(source.P) < 0.1 * np.linalg.det(textbook.P)


# ------------------------------------------------------------------------------------------------------------ whole files


def write(path, measurements: list[Measurement], order=None) -> None:
    rows = [(m.station, m.time, m.x, m.y) for m in measurements]
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["station", "t_s", "x_m", "y_m"])
        writer.writerows(rows if order is None else [rows[i] for i in order])


@pytest.mark.parametrize("model", MOTIONS)
@pytest.mark.parametrize("rule", [GlobalNearest(), JointCompatible()])
def test_one_object_in_a_file_equals_filterpy(model, rule, tmp_path):
    measurements = one_object(7, 200)
    assert len({(m.time, m.station) for m in measurements}) < 200  # a station that repeats a time is looking twice
    write(tmp_path / "m.csv", measurements)
    found = track(read_measurements(tmp_path / "m.csv", SIGMA).measurements, model, 0.2, rule)
    assert len(found.tracks) == 1 and found.unused == 0
    wanted = oracle(model, 0.2, [step.measurement for step in found.tracks[0].steps])
    for row, (x, P) in zip(found.rows(), wanted, strict=True):
        v = x[2:4] if model != "cp" else (0, 0)
        assert np.abs(np.array(row[2:]) - [*x[:2], *v, P[0, 0], P[1, 1]]).max() < 1e-9


def test_rows_in_any_order_are_the_same_file(tmp_path):
    measurements = [Measurement.equal(m.time + 1e-3 * i, m.x, m.y, m.station, SIGMA) for i, m in enumerate(one_object(8, 80))]
    write(tmp_path / "a.csv", measurements)
    write(tmp_path / "b.csv", measurements, np.random.default_rng(1).permutation(80))
    a, b = (read_measurements(tmp_path / name, SIGMA) for name in ("a.csv", "b.csv"))
    assert a.measurements == b.measurements and (a.moved, a.copies) == (0, 0) and b.moved > 10
    assert track(a.measurements, "cv", 0.1).rows() == track(b.measurements, "cv", 0.1).rows()


def test_copies_are_left_out_and_other_columns_told(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("t_s,x_m,y_m,station,size\n-1,2,3,A,9\n-1,2,3,A,9\n\n-1,2,3,B,9\n", encoding="utf-8")
    read = read_measurements(path, 0.1)
    assert [m.station for m in read.measurements] == ["A", "B"] and read.copies == 1 and read.ignored == ["size"]


HEAD = "t_s,x_m,y_m,station\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "line 1: no column t_s, x_m, y_m, station"),
        ("t_s,x_m,station\n0,0,A\n", "no column y_m"),
        ("t_s,x_m,y_m,station,x_m\n", "more than one column x_m"),
        (HEAD + "0,0,nan,A\n", "line 2: y_m is 'nan'; a number"),
        (HEAD + "0,0,0,A\n0,inf,0,A\n", "line 3: x_m is 'inf'"),
        (HEAD + "zero,0,0,A\n", "t_s is 'zero'"),
        (HEAD + "0,0,0\n", "3 cells, where the first line names 4 columns"),
        (HEAD + "0,0,0,\n", "station is ''"),
        (HEAD + '0,0,0,"A\n', "unexpected end of data"),
    ],
)
def test_a_bad_file_is_refused_by_name(text, sentence, tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"m\.csv, line") as refused:
        read_measurements(path, 0.1)
    assert sentence in str(refused.value)


def test_a_file_without_a_row_has_no_track(tmp_path):
    (tmp_path / "m.csv").write_text(HEAD, encoding="utf-8")
    assert track(read_measurements(tmp_path / "m.csv", 0.1).measurements, "cv", 0.1).rows() == []


@pytest.mark.parametrize("covariance", [(1.0, 1.0, 1.0), (1.0, -2.0, 1.0), (0.0, 0.0, 1.0), (1.0, 0.0, -1.0), (math.nan, 0, 1)])
def test_a_covariance_that_is_not_positive_definite_is_refused(covariance):
    with pytest.raises(ValueError, match="positive definite"):
        Measurement(0.0, 0.0, 0.0, "A", *covariance)


@pytest.mark.parametrize("change", [{"time": math.nan}, {"x": math.inf}, {"y": -1e13}])
def test_a_measurement_that_is_no_number_is_refused(change):
    values = {"time": 0.0, "x": 0.0, "y": 0.0} | change
    with pytest.raises(ValueError, match=f"a measurement's {next(iter(change))} is"):
        Measurement.equal(station="A", sigma=1.0, **values)


def test_what_double_precision_cannot_hold_is_refused():
    far = [Measurement.equal(1e6 * k, 0.0, 0.0, "A", 1e-6) for k in range(4)]
    with pytest.raises(ValueError, match="double precision"):
        track(far, "cv", 0.0)


# ------------------------------------------------------------------------------------------------------- late arrivals


@given(
    st.lists(st.tuples(st.floats(0, 5), st.floats(0, 1)), max_size=40).map(lambda pairs: sorted(pairs, key=lambda p: sum(p))),
    st.floats(0, 1.2),
)
def test_what_goes_out_is_in_order_and_nothing_is_lost_uncounted(arrivals, delay):
    """Each arrival: when it was measured, and how much later it arrives."""
    buffer = Reorderer(delay)
    out = []
    for time, late in arrivals:
        out += buffer.push(time + late, Measurement.equal(time, 0.0, 0.0, "A", 1.0))
    out += buffer.pop()
    times = [m.time for m in out]
    assert times == sorted(times) and len(times) + buffer.dropped == len(arrivals)
    if all(late <= delay for _, late in arrivals):
        assert buffer.dropped == 0


def test_without_a_delay_what_is_older_is_dropped_and_counted():
    buffer = Reorderer(0.0)
    assert [m.time for m in buffer.push(1.0, Measurement.equal(1.0, 0, 0, "A", 1))] == [1.0]
    assert buffer.push(1.1, Measurement.equal(0.9, 0, 0, "B", 1)) == [] and buffer.dropped == 1
    with pytest.raises(ValueError, match="the delay is -1"):
        Reorderer(-1)
