"""Association and tracks: against brute force, with objects that cross, vanish and never were."""

import csv
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from labkit.data import example
from labkit.fusion import (
    Crossing,
    Forecast,
    GlobalNearest,
    JointCompatible,
    Measurement,
    NearestFirst,
    Tracker,
    consistency_band,
    gate_squared,
    looks,
    pairs,
    read_measurements,
    start,
    switches,
    track,
)

SIGMA = 0.03
RULES = [GlobalNearest(), JointCompatible(), NearestFirst()]


def scene(seed: int, tracks: int, measurements: int, spread: float = 0.3) -> tuple[list[Forecast], list[Measurement]]:
    rng = np.random.default_rng(seed)
    forecasts = []
    for x, y in rng.uniform(0, spread, (tracks, 2)):
        L = rng.normal(size=(2, 2)) * 0.03 + np.eye(2) * 0.02
        P = L @ L.T
        forecasts.append(Forecast(x, y, P[0, 0], P[0, 1], P[1, 1]))
    return forecasts, [Measurement.equal(0.0, x, y, "A", SIGMA) for x, y in rng.uniform(0, spread, (measurements, 2))]


def test_distances_are_those_of_the_textbook():
    forecasts, look = scene(1, 3, 4)
    found = pairs(forecasts, look)
    for i, f in enumerate(forecasts):
        for j, m in enumerate(look):
            y, S = m.z - [f.x, f.y], np.array([[f.xx, f.xy], [f.xy, f.yy]]) + m.R
            assert found.squared[i, j] == pytest.approx(y @ np.linalg.inv(S) @ y)
            assert found.distance[i, j] == pytest.approx(np.linalg.norm(y))
            assert found.cost[i, j] - found.squared[i, j] == pytest.approx(np.log(np.linalg.det(S)))


def test_the_gate_is_the_quantile_of_chi_square():
    for share in (0.5, 0.9, 0.999):
        assert gate_squared(share) == pytest.approx(chi2.ppf(share, 2))
    for share in (0, 1, -1, float("nan")):
        with pytest.raises(ValueError, match="the gate is"):
            GlobalNearest(share)


def ways(tracks: int, count: int):
    """Every way to give each measurement a track of its own, or none."""
    return set(permutations([*range(tracks), *[-1] * count], count))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4))
def test_global_nearest_neighbour_is_the_best_of_all_assignments(seed, tracks, count):
    forecasts, look = scene(seed, tracks, count)
    found = pairs(forecasts, look)
    rule = GlobalNearest(0.99)
    allowed = rule.allowed(found, [0.0] * tracks)

    def worth(owner):
        real = [(i, j) for j, i in enumerate(owner) if i >= 0]
        return (len(real), -sum(found.cost[i, j] for i, j in real)) if all(allowed[pair] for pair in real) else (-1, 0)

    best = max(map(worth, ways(tracks, count)))
    number, cost = worth(rule.owners(found, [0.0] * tracks).tolist())
    assert number == best[0] and cost == pytest.approx(best[1])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4))
def test_joint_compatibility_is_the_largest_set_of_pairs_that_are_likely_together(seed, tracks, count):
    forecasts, look = scene(seed, tracks, count)
    found = pairs(forecasts, look)
    rule = JointCompatible(0.9)
    allowed = rule.allowed(found, [0.0] * tracks)

    def worth(owner):
        """All parts of a compatible set have to be compatible too: the search goes measurement by measurement."""
        total, used = 0.0, 0
        for j, i in enumerate(owner):
            if i >= 0:
                total, used = total + found.squared[i, j], used + 1
                if not allowed[i, j] or total > chi2.ppf(0.9, 2 * used):
                    return (-1, 0.0)
        return (used, -total)

    best = max(map(worth, ways(tracks, count)))
    number, total = worth(rule.owners(found, [0.0] * tracks).tolist())
    assert number == best[0] and total == pytest.approx(best[1])


def test_joint_compatibility_refuses_what_the_gates_let_through_one_by_one():
    """Each of five measurements is at its gate's edge: likely alone, not together."""
    edge = 0.99 * np.sqrt(gate_squared(0.9) * 2 * SIGMA**2)
    forecasts = [Forecast(k, 0.0, SIGMA**2, 0.0, SIGMA**2) for k in range(5)]
    look = [Measurement.equal(0.0, k + edge, 0.0, "A", SIGMA) for k in range(5)]
    found = pairs(forecasts, look)
    assert (GlobalNearest(0.9).owners(found, [0.0] * 5) >= 0).all()
    assert (JointCompatible(0.9).owners(found, [0.0] * 5) >= 0).sum() < 5


def test_the_source_lets_the_most_recent_element_choose_first():
    forecasts = [Forecast(0.00, 0, 1e-4, 0, 1e-4), Forecast(0.06, 0, 1e-4, 0, 1e-4)]
    look = [Measurement.equal(0.0, 0.05, 0.0, "A", SIGMA)]
    found = pairs(forecasts, look)
    assert NearestFirst().owners(found, [0.1, 0.2]).tolist() == [0]  # though the other one is nearer
    assert NearestFirst().owners(found, [0.2, 0.1]).tolist() == [1]
    assert GlobalNearest().owners(found, [0.1, 0.2]).tolist() == [1]


def test_the_gate_of_the_source():
    rule = NearestFirst(a_max=2.0, e_max=0.1)
    assert rule.reach([0.0, 0.5]).tolist() == [0.1, 0.35]  # a_max/2 dt^2 + e_max
    found = pairs(
        [Forecast(0, 0, 1.0, 0, 1.0)], [Measurement.equal(0, 0.34, 0, "A", SIGMA), Measurement.equal(0, 0.36, 0, "A", SIGMA)]
    )
    assert rule.allowed(found, [0.5]).tolist() == [[True, False]]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: type(rule).__name__)
@pytest.mark.parametrize(("tracks", "count"), [(1, 7), (6, 1), (3, 3), (2, 30), (30, 2)])
def test_no_track_gets_two_measurements_of_a_look(rule, tracks, count):
    forecasts, look = scene(9, tracks, count, 0.2)
    owner = rule.owners(pairs(forecasts, look), [0.1] * tracks)
    taken = owner[owner >= 0].tolist()
    assert owner.shape == (count,) and len(taken) == len(set(taken)) and (owner < tracks).all()


def test_joint_compatibility_of_too_many_is_refused():
    forecasts, look = scene(1, 2, 201)
    with pytest.raises(ValueError, match="at most 200"):
        JointCompatible().owners(pairs(forecasts, look), [0.0] * 2)


# ------------------------------------------------------------------------------------------------------------- tracks


def world(
    objects: int, seed: int = 1, periods: int = 40, staggered: bool = False, shuffle: bool = True
) -> list[tuple[int, Measurement]]:
    """Objects that go straight on and cross, seen by two stations 160 ms apart: (object, measurement) in order of time."""
    rng = np.random.default_rng(seed)
    starts = np.arange(objects) * 0.9 + 1j * np.arange(objects) * 0.4
    speeds = np.exp(1j * rng.uniform(0, 6.28, objects)) * 0.4
    found = []
    for k in range(periods):
        for station, late in (("A", 0.0), ("B", 0.16)):
            order = rng.permutation(objects) if shuffle else range(objects)
            for place, j in enumerate(order):
                t = 0.33 * k + late + (0.01 * place if staggered else 0)
                z = starts[j] + speeds[j] * t + SIGMA * (rng.normal() + 1j * rng.normal())
                found.append((int(j), Measurement.equal(t, z.real, z.imag, station, SIGMA)))
    return found


def truth_of(found, seen) -> list[tuple[int, int]]:
    who = {id(m): j for j, m in seen}
    steps = [(s.measurement.time, who[id(s.measurement)], t.number) for t in found.tracks for s in t.steps]
    return [(j, number) for _, j, number in sorted(steps)]


@pytest.mark.parametrize("rule", [GlobalNearest(), JointCompatible()], ids=["global", "joint"])
@pytest.mark.parametrize("staggered", [False, True])
@pytest.mark.parametrize("objects", [2, 5, 10])
def test_every_object_has_one_track_that_never_changes(rule, staggered, objects):
    seen = world(objects, staggered=staggered)
    found = track([m for _, m in seen], "cv", 0.1, rule)
    assert [t.number for t in found.tracks] == list(range(1, objects + 1)) and found.unused == 0
    assert {row[1] for row in found.rows()} == set(range(1, objects + 1))
    assert switches(truth_of(found, seen)) == 0


def test_a_false_detection_is_left_out_and_a_vanished_object_ends():
    seen = [m for j, m in world(2) if j == 0 or m.time < 6]
    ghost = Measurement.equal(4.001, 50.0, 50.0, "A", SIGMA)
    found = track(sorted([*seen, ghost], key=lambda m: m.time), "cv", 0.1)
    assert len(found.tracks) == 2 and found.unused == 1
    first, second = (len(t.steps) for t in found.tracks)
    assert {first, second} == {80, sum(j == 1 and m.time < 6 for j, m in world(2))}
    assert all(row[0] != ghost.time for row in found.rows())


def test_two_false_detections_of_one_look_are_not_one_object_unless_they_are_in_one_place():
    false = [Measurement.equal(0.0, x, 0.0, "A", SIGMA) for x in (0.0, 1.0, 1.05)]
    later = Measurement.equal(0.16, 0.3, 0.0, "B", SIGMA)  # in the gate of a track whose velocity nobody knows
    wide = [Measurement.equal(0.16, x, 0.0, "B", SIGMA) for x in (0.3, -0.3)]
    assert [len(t.steps) for t in track([*false, later], "cv", 0.1).tracks] == [2, 2]
    assert [len(t.steps) for t in track([false[0], *wide], "cv", 0.1).tracks] == [2, 1]


def test_the_sample_file_is_what_its_model_makes_and_three_elements_are_found():
    world = Crossing(3, 0.5, 0.3, SIGMA, missed=0.1, false=0.05, seed=12)
    made = sorted((f"{m.time:.3f}", m.station, f"{m.x:.4f}", f"{m.y:.4f}") for look, _ in world.looks(20) for m in look)
    with open(example("positions.csv"), newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert sorted((row["t_s"], row["station"], row["x_m"], row["y_m"]) for row in rows) == made
    assert all(float(r["arrived_s"]) == pytest.approx(float(r["t_s"]) + (0.4 if r["station"] == "B" else 0.1)) for r in rows)
    assert len(track(read_measurements(example("positions.csv"), SIGMA).measurements, "cv", 0.1).tracks) == 3


@pytest.mark.parametrize("gap", [1, 10, 1000])
def test_an_element_that_is_alone_survives_every_gap(gap):
    first = [Measurement.equal(0.2 * k, 0.1 * k, 0.0, "A", SIGMA) for k in range(20)]
    later = [Measurement.equal(m.time + 4 + gap, m.x + 2 + gap / 2, 0.0, "A", SIGMA) for m in first]
    assert [len(t.steps) for t in track(first + later, "cv", 0.01).tracks] == [40]


def test_a_single_measurement_is_a_track():
    found = track([Measurement.equal(0, 0, 0, "A", 1)], "cv", 1)
    assert len(found.rows()) == 1 and found.tracks[0].mean_nis() is None


def test_nis_is_about_two_if_sigma_is_right_and_tells_when_it_is_not():
    """The straight line of a prior velocity: nothing but sigma decides, q is 0."""
    rng = np.random.default_rng(6)
    v = 2 * rng.normal(size=(100, 2))
    means = []
    for assumed in (SIGMA, 2 * SIGMA):
        nis = []
        for one in v:
            z = [0.165 * k * one + SIGMA * np.random.default_rng(k).normal(size=2) for k in range(20)]
            seen = [Measurement.equal(0.165 * k, *place, "A", assumed) for k, place in enumerate(z)]
            nis.append(track(seen, "cv", 0.0, GlobalNearest(1 - 1e-9)).tracks[0].mean_nis())
        means.append(np.mean(nis))
    low, high = consistency_band(2, 19)  # all runs have the same noise, so that this is one run
    assert low < means[0] < high and means[1] < 0.3 * means[0]


def test_two_stations_that_see_different_objects_at_different_rates():
    fast = [Measurement.equal(0.33 * k, 0.1 * k, 0.0, "A", SIGMA) for k in range(60)]
    slow = [Measurement.equal(0.99 * k + 0.1, 5 + 0.1 * k, 0.0, "B", SIGMA) for k in range(20)]
    found = track(sorted([*fast, *slow], key=lambda m: m.time), "cv", 0.1)
    assert sorted(len(t.steps) for t in found.tracks) == [20, 60]


def test_stations_that_look_at_the_same_time_are_two_looks():
    look = [Measurement.equal(0, i, 0, s, 1) for i in range(2) for s in "AB"]
    assert [[(m.x, m.station) for m in part] for part in looks(look)] == [[(0, "A"), (1, "A")], [(0, "B"), (1, "B")]]


@pytest.mark.parametrize("bad", [{"confirm": 0}, {"drop": 0}, {"drop": 1.5}, {"model": "cx"}, {"q": -1.0}, {"q": float("nan")}])
def test_what_is_not_allowed_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        track([], **({"model": "cv", "q": 0.1} | bad))


def test_a_look_of_two_times_or_of_none_or_too_old_is_refused():
    tracker = Tracker(lambda m: start("cv", 0.1, m))
    tracker.take([Measurement.equal(1, 0, 0, "A", 1)])
    for look in ([], [Measurement.equal(t, 0, 0, "A", 1) for t in (1, 2)], [Measurement.equal(0.5, 0, 0, "A", 1)]):
        with pytest.raises(ValueError, match="a look has"):
            tracker.take(look)


def test_more_tracks_than_can_be_followed_are_refused():
    with pytest.raises(ValueError, match="more than 1000 tracks"):
        track([Measurement.equal(0, 100 * k, 0, "A", 1) for k in range(1001)], "cv", 0.1)
