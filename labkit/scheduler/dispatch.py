"""The inner loop of every scheduler here: run ranked work on one preemptive processor."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np


def dispatch(arrivals: list[int], ranks: list[int], left: list[int], until: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run work on one preemptive processor, lowest rank first, never idle while there is some.

    Args:
        arrivals: times at which work arrives, never falling, none at or after `until`.
        ranks: what arrives then.
        left: rank -> work left; counted down in place, so that it is 0 afterwards for all that was completed.

    Returns:
        (rank, start, end) of each slice in order of time, int64; slices end wherever something arrives.
    """
    who: list[int] = []
    starts: list[int] = []
    ends: list[int] = []
    ready: list[int] = []
    for arrived, now, upcoming in zip(ranks, arrivals, [*arrivals[1:], until]):
        heappush(ready, arrived)
        while ready and now < upcoming:
            rank = ready[0]
            who.append(rank)
            starts.append(now)
            now += left[rank]
            if now <= upcoming:
                heappop(ready)
                left[rank] = 0
            else:
                left[rank] = now - upcoming
                now = upcoming
            ends.append(now)
    return np.array(who, dtype=np.int64), np.array(starts, dtype=np.int64), np.array(ends, dtype=np.int64)
