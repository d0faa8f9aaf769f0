"""The table of incoherent data, consistency, and the measures themselves against their definitions."""

from itertools import permutations

import numpy as np
import pytest
from filterpy.stats import NEES
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from labkit.fusion import (
    Measurement,
    PlaneFilter,
    SourceFilter,
    Stations,
    averages,
    claimed_and_real,
    consistency_band,
    expected_nees,
    fuse,
    gospa,
    normalised_squares,
    ospa,
    place,
    rmse,
    switches,
)

SIGMA, RUNS, PERIODS, WARM = 0.03, 400, 40, 10


def filter_error(setting: Stations, q: float = 0.1, seed: int = 1) -> tuple[float, float]:
    """RMSE in cm of the filter with time stamps at the later look, and the half width of its 99.9 % interval.

    Errors of one run resemble each other, so the interval is that of the mean over runs, which are independent.
    """
    looks = setting.look(RUNS, PERIODS, seed)
    states = fuse("cv", q, looks, setting.sigma)
    later = range(2 * WARM + 1, 2 * PERIODS, 2)
    errors = np.array([states[i][0] - place(setting.course, setting.speed, looks.stamps[i]) for i in later])
    return interval(errors)


def interval(errors: np.ndarray) -> tuple[float, float]:
    """RMSE in cm of errors (times, runs) and the half width of its 99.9 % interval."""
    squares = np.mean(np.abs(errors) ** 2, axis=0)
    mean, spread = squares.mean(), 3.29 * squares.std() / np.sqrt(len(squares))
    return 100 * np.sqrt(mean), 100 * spread / (2 * np.sqrt(mean))


@pytest.mark.parametrize("speed", [0, 1, 2, 3])
@pytest.mark.parametrize("offset", [0.08, 0.16])
def test_averages_follow_the_arithmetic(speed, offset):
    looks = Stations(speed, offset=offset).look(RUNS, PERIODS, 1)
    average, truth = averages(looks)
    found, half = interval((average - truth).T)
    assert found == pytest.approx(100 * np.hypot(SIGMA, speed * offset / 2), abs=half)
    assert half < 0.02 * found


@pytest.mark.parametrize(
    ("offset", "row"), [(0.08, (3.00, 5.00, 8.54, 12.37)), (0.16, (3.00, 8.54, 16.28, 24.19))], ids=["80 ms", "160 ms"]
)
def test_the_arithmetic_is_that_of_the_table(offset, row):
    assert [round(100 * np.hypot(SIGMA, v * offset / 2), 2) for v in range(4)] == list(row)


@pytest.mark.parametrize("speed", [0, 1, 2, 3])
@pytest.mark.parametrize(("offset", "told"), [(0.16, 3.29), (0.0, 2.78)], ids=["with time stamps", "simultaneous"])
def test_the_filter_does_not_care_how_fast_the_element_is(speed, offset, told):
    found, half = filter_error(Stations(speed, offset=offset))
    assert found == pytest.approx(told, abs=half) and half < 0.025 * found


@pytest.mark.parametrize(("error", "told"), [(0.003, 3.30), (0.01, 3.54), (0.02, 4.30), (0.05, 7.87)])
def test_a_clock_that_is_wrong_costs_what_the_table_says(error, told):
    """Told is the size of the error, not its sign; ahead costs more than behind, and told is the root mean square of both."""
    ahead, behind = (filter_error(Stations(2, clock_error=e))[0] for e in (error, -error))
    assert behind < ahead
    assert np.hypot(ahead, behind) / np.sqrt(2) == pytest.approx(told, rel=0.025)


# --------------------------------------------------------------------------------------------------------- consistency


def test_the_textbook_filter_knows_how_good_it_is_and_the_sources_does_not():
    for q in (0.01, 0.03, 0.1, 0.3, 1.0):
        assert expected_nees(*claimed_and_real("textbook", q, 1000))[-1] == pytest.approx(4)
    source = [expected_nees(*claimed_and_real("source", q, 1000))[-1] for q in (0.01, 0.03, 0.1, 0.3, 1.0)]
    assert (round(min(source), 1), round(max(source), 1)) == (5.6, 9.2)


def test_what_is_claimed_and_what_is_real_after_a_hundred_steps():
    for kind, claimed, real, tolerance in (("source", 0.60, 1.25, 0.005), ("own P", 0.0, 52.6, 0.6)):
        P, E = claimed_and_real(kind, 0.0, 100)
        assert 100 * np.sqrt(2 * P[-1, 0, 0]) == pytest.approx(claimed, abs=0.005)
        assert 100 * np.sqrt(2 * E[-1, 0, 0]) == pytest.approx(real, abs=tolerance)


@pytest.mark.parametrize("kind", ["textbook", "source", "own P"])
def test_the_covariance_of_the_error_is_that_of_many_runs(kind):
    """The filters themselves, not their gains: 300 runs from the prior that both assume."""
    steps, runs, q, dt = 12, 300, 0.1, 0.165
    P, E = claimed_and_real(kind, q, steps)
    rng = np.random.default_rng(2)
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    A, L = np.array([[1, dt], [0, 1]]), np.linalg.cholesky(Q)
    errors = []
    for _ in range(runs):
        truth = np.stack([np.zeros(2), 2 * rng.normal(size=2)])  # place and velocity, both axes
        first = Measurement.equal(0.0, *(truth[0] + SIGMA * rng.normal(size=2)), "A", SIGMA)
        trust = "sigma" if kind == "source" else "own P"
        filter_ = PlaneFilter("cv", q, first) if kind == "textbook" else SourceFilter(q, first, trust)
        for k in range(1, steps + 1):
            truth = A @ truth + L @ rng.normal(size=(2, 2))
            filter_.update(Measurement.equal(k * dt, *(truth[0] + SIGMA * rng.normal(size=2)), "A", SIGMA))
        assert np.allclose(filter_.P, np.kron(P[-1], np.eye(2)))
        errors.append(filter_.x.reshape(2, 2) - truth)
    found = np.einsum("nia,nja->ij", errors, errors) / (2 * runs)
    assert np.allclose(found, E[-1], rtol=0.25, atol=1e-6)  # 600 samples: 4 sigma is 0.23


def test_nees_is_that_of_filterpy():
    rng = np.random.default_rng(3)
    true, found = rng.normal(size=(2, 20, 4))
    L = rng.normal(size=(20, 4, 4))
    P = L @ np.swapaxes(L, 1, 2) + np.eye(4)
    assert np.allclose(normalised_squares(true - found, P), np.ravel(NEES(true, found, P)))


def test_the_band_is_that_of_chi_square():
    low, high = consistency_band(4, 50, 0.9)
    assert low == pytest.approx(chi2.ppf(0.05, 200) / 50) and high == pytest.approx(chi2.ppf(0.95, 200) / 50)


# ------------------------------------------------------------------------------------------------- sets and identities

PLACES = st.lists(st.complex_numbers(max_magnitude=3, allow_nan=False), max_size=4)


@given(PLACES, PLACES, st.floats(0.5, 2))
def test_ospa_and_gospa_are_what_their_definitions_say(found, true, cutoff):
    few, many = sorted((found, true), key=len)
    costs = [sum(min(abs(a - b), cutoff) ** 2 for a, b in zip(few, chosen)) for chosen in permutations(many, len(few))]
    n, m = len(few), len(many)
    expected = ((min(costs) + cutoff**2 * (m - n)) / m) ** 0.5 if m else 0.0
    assert ospa(found, true, cutoff) == pytest.approx(expected, abs=1e-9)
    whole = gospa(found, true, cutoff)
    assert whole.squared == pytest.approx(min(costs) + cutoff**2 / 2 * (m - n), abs=1e-9)
    assert whole.squared == pytest.approx(whole.localisation + whole.missed + whole.false)
    assert min(whole) >= 0


@given(PLACES, PLACES, PLACES)
def test_ospa_is_a_metric(a, b, c):
    def distance(one, other):
        return ospa(one, other, 1.0)

    assert distance(a, a) == 0 and distance(a, b) == pytest.approx(distance(b, a))
    assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


def test_gospa_tells_missed_from_false():
    parts = gospa([0, 5], [0.1, 9, 10], 1.0)
    assert parts.localisation == pytest.approx(0.01) and (parts.missed, parts.false) == (1.0, 0.5)


def test_switches_count_changes_of_track_and_nothing_else():
    assert switches([("a", 1), ("b", 2), ("a", 1), ("b", 1), ("b", 1), ("a", 2), ("a", 1)]) == 3
    assert switches([]) == 0


def test_rmse_counts_both_axes():
    assert rmse(np.array([3 + 4j, 0])) == pytest.approx(np.sqrt(12.5))
