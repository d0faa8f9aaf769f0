"""The bench of two stations: each fusion is drawn where it lies, or counted."""

import numpy as np

from labkit.experiments import DistributedFusion
from labkit.experiments.distributed_fusion import MOST_APART, MS


def test_a_fusion_with_the_data_of_one_station_is_counted_and_not_drawn():
    experiment = DistributedFusion(loss=60, threshold=50)
    result = experiment.run()
    figure = experiment.figure(result)
    drawn = {trace["name"]: trace for trace in figure["data"]}
    kinds = [drawn[name] for name in ("coherent", "incoherent", f"beyond {MOST_APART} ms")]
    alone = int((result.apart_ns < 0).sum())
    assert alone > 0 and sum(len(kind["x"]) for kind in kinds) == len(result.apart_ns) - alone
    assert f"; {alone} of {len(result.apart_ns)} had those of one station only" in figure["layout"]["annotations"][-1]["text"]
    near, far, edge = (np.array(kind["customdata"]) for kind in kinds)
    assert near.max() <= 50 < far.min() and far.max() <= MOST_APART < edge.min()
    assert (np.array(kinds[2]["y"]) == MOST_APART).all() and np.array_equal(kinds[1]["y"], far)
    shown = np.sort(np.concatenate([near, far, edge]))
    assert np.array_equal(shown, np.sort(result.apart_ns[result.apart_ns >= 0] / MS))
