"""Execution-time models: how long the jobs of a task really take, as draws of whole time units.

Each function returns a model, `draw(jobs, rng)`, which gives an int64 array of that many execution times, at least 1, drawn from
the `numpy.random.Generator` it is given. Draws are independent of each other; real run times rarely are (the same scene comes
again, caches stay warm): the models leave that out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp, log
from statistics import NormalDist

import numpy as np

ExecutionModel = Callable[[int, np.random.Generator], np.ndarray]


def constant(time: int) -> ExecutionModel:
    """Always `time`."""
    _least("time", time)
    return lambda jobs, rng: np.full(jobs, time, dtype=np.int64)


def uniform(shortest: int, longest: int) -> ExecutionModel:
    """All whole times from `shortest` to `longest`, both included, equally likely."""
    _least("shortest time", shortest)
    _ordered("shortest time", shortest, "longest time", longest)
    return lambda jobs, rng: rng.integers(shortest, longest, jobs, dtype=np.int64, endpoint=True)


def log_normal(median: float, sigma: float, longest: float | None = None) -> ExecutionModel:
    """exp(N(log median, sigma)), drawn again where it exceeds `longest` (which must not lie below the median)."""
    _least("median", median)
    if not sigma >= 0:
        raise ValueError(f"sigma is {sigma}; it must not be negative")
    if longest is not None:
        _ordered("median", median, "longest time", longest)

    def draw(jobs: int, rng: np.random.Generator) -> np.ndarray:
        times = rng.lognormal(log(median), sigma, jobs)
        while longest is not None and len(over := np.flatnonzero(times > longest)):
            times[over] = rng.lognormal(log(median), sigma, len(over))
        return _whole(times)

    return draw


def empirical(samples: Sequence[int]) -> ExecutionModel:
    """One of the measured times, each equally likely."""
    measured = np.asarray(samples)
    if measured.ndim != 1 or not measured.size:
        raise ValueError("an empirical model needs one or more measured times")
    _least("measured time", measured.min())
    return lambda jobs, rng: _whole(rng.choice(measured, jobs))


def two_mode(usual: ExecutionModel, rare: ExecutionModel, share: float) -> ExecutionModel:
    """A draw of `rare` with probability `share`, else of `usual`."""
    if not 0 <= share <= 1:
        raise ValueError(f"share of the rare mode is {share}; it must be from 0 to 1")

    def draw(jobs: int, rng: np.random.Generator) -> np.ndarray:
        often, seldom = usual(jobs, rng), rare(jobs, rng)
        return np.where(rng.random(jobs) < share, seldom, often)

    return draw


def from_quantiles(points: Sequence[tuple[float, float]]) -> ExecutionModel:
    """Times with given quantiles, (share, time) from share 0 to share 1; between two of them the logarithm is linear."""
    shares, times = np.asarray(points, dtype=float).T
    if shares[0] != 0 or shares[-1] != 1 or np.any(np.diff(shares) <= 0) or np.any(np.diff(times) < 0):
        raise ValueError(f"quantiles {list(points)}: shares must rise from 0 to 1, and times must not fall")
    _least("time", times[0])
    return lambda jobs, rng: _whole(np.exp(np.interp(rng.random(jobs), shares, np.log(times))))


def fit_log_normal(share: float, below: float, longest: float, runs: int) -> tuple[float, float]:
    """Median and sigma of the log-normal law of which `share` lies below `below` and the largest of `runs` draws has the median
    `longest`.

    Two published numbers and a count determine the law; whether it is log-normal at all they do not say.
    """
    if not 0 < share < 1 or runs < 1:
        raise ValueError(f"share {share} and {runs} runs: the share must lie between 0 and 1, and there must be a run")
    at, top = (NormalDist().inv_cdf(p) for p in (share, 0.5 ** (1 / runs)))
    if not (top > at and longest > below > 0):
        raise ValueError(f"no log-normal law has a share {share} below {below} and {longest} as the largest of {runs} runs")
    sigma = log(longest / below) / (top - at)
    return exp(log(below) - at * sigma), sigma


def _whole(times: np.ndarray) -> np.ndarray:
    return np.rint(times).astype(np.int64).clip(1)


def _least(what: str, value: float) -> None:
    if not value >= 1:
        raise ValueError(f"{what} is {value}; it must be at least 1 time unit")


def _ordered(low_name: str, low: float, high_name: str, high: float) -> None:
    if low > high:
        raise ValueError(f"{low_name} {low} exceeds {high_name} {high}")
