"""Sweeps: here, over processes and over a real Dask cluster the table is the same."""

import pandas as pd
import pytest

from labkit import PriorityInversion, sweep
from labkit.experiment import ParameterError, progress_listener

AXES = {"hold": range(4, 7), "protocol": ("freertos", "ceiling")}


def test_rows_are_all_combinations_in_order():
    table = sweep(PriorityInversion(interference=5), **AXES)
    assert list(zip(table["hold"], table["protocol"], strict=True)) == [
        (h, p) for h in (4, 5, 6) for p in ("freertos", "ceiling")
    ]
    assert (table["H blocked, semaphore"] == [6, 6, 7, 7, 8, 8]).all()


def test_processes_give_the_same_table():
    pd.testing.assert_frame_equal(sweep(PriorityInversion, workers=2, **AXES), sweep(PriorityInversion, **AXES))


def test_a_dask_cluster_gives_the_same_table():
    import distributed

    here = {"dashboard_address": None, "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **here) as cluster, distributed.Client(cluster) as client:
        pd.testing.assert_frame_equal(sweep(PriorityInversion, client=client, **AXES), sweep(PriorityInversion, **AXES))


def test_a_wrong_value_stops_the_sweep_before_it_starts():
    with pytest.raises(ParameterError, match="hold = 99 is not allowed"):
        sweep(PriorityInversion, hold=[1, 99])
    with pytest.raises(ParameterError, match="at least one parameter"):
        sweep(PriorityInversion)


def test_progress_is_told():
    told = []
    token = progress_listener.set(told.append)
    try:
        sweep(PriorityInversion, hold=range(1, 5))
    finally:
        progress_listener.reset(token)
    assert told == [0.0, 0.25, 0.5, 0.75, 1.0]
