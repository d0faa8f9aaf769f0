"""The exact rate-monotonic test for many task sets at once, for acceptance curves; the quick bounds are in `bounds`."""

from __future__ import annotations

import numpy as np

from labkit.scheduler.analysis.verdict import Budget

MAX_VALUE = 1 << 31  #: below it no product overflows, as every task a window counts fits into its own period


def accept_response_time(wcets: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Rate-monotonic response-time analysis, D = T, for integer arrays of shape (sets, tasks); bool array of shape (sets,).

    Exact for synchronous release and without jitter: with D = T the first job of a task decides, so w = C_i + sum of
    ceil(w / T_j) C_j over the shorter periods is iterated until it settles or passes T_i (Joseph and Pandya 1986; Audsley et al.
    1993). All sets step together; each step raises every unsettled w by at least 1, so the loop ends.

    Raises:
        ValueError: shapes differ, or a value is below 1 or not below 2^31.
        UndecidedError: more than `MAX_STEPS` steps, of which whole columns do 16 at a time.
    """
    wcets, periods = np.asarray(wcets, dtype=np.int64), np.asarray(periods, dtype=np.int64)
    if wcets.ndim != 2 or wcets.shape != periods.shape:
        raise ValueError(f"wcets of shape {wcets.shape} and periods of shape {periods.shape}; both must be (sets, tasks)")
    if wcets.size and not (min(wcets.min(), periods.min()) >= 1 and max(wcets.max(), periods.max()) < MAX_VALUE):
        raise ValueError(f"execution times and periods must be from 1 to {MAX_VALUE - 1}")
    order = np.argsort(periods, axis=1, kind="stable")
    cost, period = np.take_along_axis(wcets, order, axis=1), np.take_along_axis(periods, order, axis=1)
    fits, budget = np.ones(len(wcets), dtype=bool), Budget("response times of many sets")
    for task in range(wcets.shape[1]):
        going = np.flatnonzero(fits)
        window = cost[going, : task + 1].sum(axis=1)
        while len(going):
            budget.spend(1 + len(going) * (task + 1) // 16)
            late = window > period[going, task]
            fits[going[late]] = False
            jobs = -(-window[:, None] // period[going, :task])
            wider = cost[going, task] + (jobs * cost[going, :task]).sum(axis=1)
            more = ~late & (wider > window)
            going, window = going[more], wider[more]
    return fits
