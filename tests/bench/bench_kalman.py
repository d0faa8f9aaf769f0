"""Time of a Kalman filter per track, one and a thousand, beside filterpy in the same run; time of the association of a look."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from labkit.fusion import MOTIONS, GlobalNearest, JointCompatible, Measurement, NearestFirst, PlaneFilter, Tracker, pairs, start

SIGMA, Q, DT = 0.03, 0.1, 0.165


def per_call(work: Callable[[int], None], count: int, repeats: int = 7) -> float:
    """CPU microseconds of one of `count` repetitions, best of some repeats."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.process_time()
        work(count)
        best = min(best, (time.process_time() - begin) / count)
    return 1e6 * best


def textbook(count: int) -> None:
    kf = KalmanFilter(dim_x=4, dim_z=2)
    kf.H, kf.R, kf.P = np.eye(2, 4), SIGMA**2 * np.eye(2), np.diag([SIGMA**2, SIGMA**2, 4, 4])
    A = np.kron([[1, DT], [0, 1]], np.eye(2))
    noise = Q * np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(2))
    z = np.array([0.1, 0.2])
    for _ in range(count):
        kf.predict(F=A, Q=noise)
        kf.update(z)


def fast(model: str, z: complex | np.ndarray) -> Callable[[int], None]:
    motion = MOTIONS[model]

    def work(count: int) -> None:
        state = motion.start(z, SIGMA**2)
        for _ in range(count):
            state = motion.update(motion.predict(state, DT, Q), z, SIGMA**2)

    return work


def whole_filter(count: int) -> None:
    """With the record of a measurement and the check of the numbers, as the tracks use it."""
    measurements = [Measurement.equal(DT * k, 0.1, 0.2, "A", SIGMA) for k in range(2)]
    filter_ = PlaneFilter("cv", Q, measurements[0])
    for _ in range(count):
        filter_.time = 0.0
        filter_.update(measurements[1])


@pytest.mark.parametrize("model", MOTIONS)
def test_predict_and_update(benchmark, model):
    """`ratio_one` and `ratio_thousand`: how many of ours take as long as one of filterpy; that is always constant velocity."""
    rng = np.random.default_rng(1)
    crowd = rng.normal(size=1000) + 1j * rng.normal(size=1000)
    peer = per_call(textbook, 2000)
    one, thousand = per_call(fast(model, 0.1 + 0.2j), 5000), per_call(fast(model, crowd), 100) / 1000
    benchmark.extra_info["filterpy us"] = round(peer, 2)
    benchmark.extra_info["one us"], benchmark.extra_info["ratio_one"] = round(one, 2), round(peer / one, 1)
    benchmark.extra_info["thousand us"], benchmark.extra_info["ratio_thousand"] = round(thousand, 4), round(peer / thousand)
    whole = per_call(whole_filter, 5000)
    print(f"\n{model}: filterpy (cv) {peer:.1f} us; one track {one:.2f} us ({peer / one:.0f} x)")
    print(f"    as PlaneFilter (cv) {whole:.2f} us")
    print(f"    each of 1000 tracks {thousand:.3f} us ({peer / thousand:.0f} x)")
    benchmark.pedantic(fast(model, 0.1 + 0.2j), (1000,), rounds=5)


@pytest.mark.parametrize("rule", [GlobalNearest(), NearestFirst(), JointCompatible()], ids=["global", "source", "joint"])
@pytest.mark.parametrize("objects", [1, 10, 100])
def test_association_of_a_look(benchmark, rule, objects):
    """Distances of all pairs and the choice among them; `look us`: with predictions, updates and the tracker around it."""
    rng = np.random.default_rng(2)
    places = np.stack([np.arange(objects) % 10, np.arange(objects) // 10], axis=-1) * 1.0

    def look(t: float) -> list[Measurement]:
        order = rng.permutation(objects)
        seen = places + SIGMA * rng.normal(size=places.shape)
        return [Measurement.equal(t, *seen[i].tolist(), "A", SIGMA) for i in order]

    looks = [look(DT * k) for k in range(60)]
    tracker = Tracker(lambda first: start("cv", Q, first), rule)
    for some in looks[:20]:
        tracker.take(some)
    begin = time.process_time()
    for some in looks[20:]:
        tracker.take(some)
    whole = 1e6 * (time.process_time() - begin) / 40
    forecasts = [track.filter.forecast(60 * DT) for track in tracker.tracks]
    elapsed = [DT] * len(forecasts)

    def associate(count: int) -> None:
        for _ in range(count):
            rule.owners(pairs(forecasts, looks[-1]), elapsed)

    took = per_call(associate, 100, 5)
    benchmark.extra_info["association us"], benchmark.extra_info["look us"] = round(took, 1), round(whole, 1)
    print(f"\n{type(rule).__name__}, {objects} objects: association {took:.0f} us, a look with everything {whole:.0f} us")
    benchmark.pedantic(associate, (10,), rounds=3)
