"""Many runs of an experiment at once: over local processes, or over any Dask cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import TYPE_CHECKING, Any

from labkit.experiment import Experiment, ParameterError, progress

if TYPE_CHECKING:
    import pandas as pd


def sweep(
    experiment: type[Experiment[Any]] | Experiment[Any], *, client: Any = None, workers: int = 1, **axes: Iterable[Any]
) -> pd.DataFrame:
    """Run every combination of the values in `axes`; one row each, with the swept parameters and all metrics as columns.

    Args:
        experiment: the class, or an experiment whose other parameters are kept.
        client: a `distributed.Client`; the runs then go to its cluster.
        workers: without a client, the number of local processes; 1 runs here, one after the other. Processes start afresh,
            so the experiment has to be importable, not defined in a notebook.

    Rows are in the order of the axes, the last one varying fastest. Raises ParameterError before anything runs if a
    value is not allowed. The number of runs done goes to whoever listens to `labkit.experiment.progress`.
    """
    import pandas as pd

    if not axes:
        raise ParameterError(
            "a sweep needs at least one parameter with its values, such as sweep(PriorityInversion, hold=range(1, 16))"
        )
    cls = experiment if isinstance(experiment, type) else type(experiment)
    kept = {} if isinstance(experiment, type) else experiment.model_dump()
    points = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    experiments = [cls(**{**kept, **point}) for point in points]
    rows = [
        point | values
        for point, values in zip(points, progress(_results(experiments, client, workers), len(points)), strict=True)
    ]
    return pd.DataFrame(rows)


def _results(experiments: list[Experiment[Any]], client: Any, workers: int) -> Iterator[dict[str, Any]]:
    """Results in order, each as soon as it is there."""
    if client is not None:
        futures = client.map(_values, experiments, pure=False)
        yield from (future.result() for future in futures)
    elif workers == 1:
        yield from map(_values, experiments)
    else:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        with ProcessPoolExecutor(workers, get_context("spawn")) as pool:  # a fork of a notebook kernel with its threads may hang
            try:
                yield from pool.map(_values, experiments, chunksize=max(1, len(experiments) // (8 * workers)))
            finally:
                pool.shutdown(cancel_futures=True)


def _values(experiment: Experiment[Any]) -> dict[str, Any]:
    return experiment.values()
