"""The object filter: contours that belong together become one object, a polygon or a disc.

Anytime, as in `edges`: at once every arc is a disc and every edge a polygon of its own; then edges that are chords of a disc go,
since both halves of the contour filter have seen the same points; then edges are joined, the nearest ends first.
Source: diploma thesis on multi-stage sensor fusion (Univ. Magdeburg), section 2.5, which names the result; the rules are ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from labkit.fusion.laser.formats import Contours, Disc, Objects, Polygon
from labkit.fusion.laser.settings import VISIT_NS, Settings


def object_filter(contours: Contours, settings: Settings | None = None) -> Iterator[tuple[int, Objects]]:
    """Anytime: contours to objects."""
    settings = settings or Settings()
    arcs, ends, support = contours.arcs, contours.edges.ends, contours.edges.points
    discs = tuple(
        Disc(x, y, radius, count)
        for (x, y), radius, count in zip(arcs.centres.tolist(), arcs.radii.tolist(), arcs.points.tolist(), strict=True)
    )

    @cache  # from one step to the next all chains but one stay as they are
    def polygon(*chain: int) -> Polygon:
        return _polygon(ends, support, list(chain), settings.join)

    def made(chains: list[list[int]]) -> Objects:
        return Objects(contours.station, contours.time_ns, tuple(polygon(*chain) for chain in chains), discs)

    chains = [[i] for i in range(len(ends))]
    yield max(1, len(ends) + len(arcs)) * VISIT_NS, made(chains)

    if len(arcs) and len(ends):
        chord = _chords(contours, settings)
        chains = [[i] for i in np.flatnonzero(~chord).tolist()]
        yield 3 * len(ends) * len(arcs) * VISIT_NS, made(chains)

    left = [chain[0] for chain in chains]
    if len(left) < 2:
        return
    gap = np.hypot(
        *np.moveaxis(ends[left, 1][:, None] - ends[left, 0][None], -1, 0)
    )  # from the end of one to the start of another
    np.fill_diagonal(gap, np.inf)
    behind: dict[int, int] = {}
    before: dict[int, int] = {}
    cost = gap.size * VISIT_NS
    near = np.argwhere(gap <= settings.join)
    for i, k in near[np.argsort(gap[tuple(near.T)], kind="stable")].tolist():
        if left[i] not in behind and left[k] not in before:
            behind[left[i]], before[left[k]] = left[k], left[i]
            yield cost, made(_chains(left, behind, before))
            cost = VISIT_NS
    if not behind:
        yield cost, made(chains)


def _chords(contours: Contours, settings: Settings) -> np.ndarray:
    """Which edges lie on a disc: both ends near the circle, and no longer than its diameter."""
    ends, arcs = contours.edges.ends, contours.arcs
    off = np.hypot(*np.moveaxis(ends[:, :, None] - arcs.centres, -1, 0)) - arcs.radii
    near = np.abs(off).max(axis=1) <= settings.split + settings.arc
    short = contours.edges.lengths[:, None] <= 2 * arcs.radii + 2 * settings.split
    return (near & short).any(axis=1)


def _chains(edges: list[int], behind: dict[int, int], before: dict[int, int]) -> list[list[int]]:
    """Edges in the order in which they follow each other; a ring begins with its first edge."""
    chains: list[list[int]] = []
    done: set[int] = set()
    for first in [i for i in edges if i not in before] + edges:
        if first in done:
            continue
        chain, at = [first], first
        while at in behind and behind[at] != first:
            at = behind[at]
            chain.append(at)
        done.update(chain)
        chains.append(chain)
    return chains


def _polygon(ends: np.ndarray, support: np.ndarray, chain: list[int], reach: float) -> Polygon:
    """The corners along a chain of edges: where two meet, the middle between their ends."""
    if len(chain) == 1:
        return Polygon(ends[chain[0]], False, int(support[chain[0]]))
    e = ends[chain]
    corners = np.concatenate([e[:1, 0], (e[:-1, 1] + e[1:, 0]) / 2, e[-1:, 1]])
    closed = len(chain) > 2 and float(np.hypot(*(corners[-1] - corners[0]))) <= reach
    if closed:
        corners = np.concatenate([(corners[:1] + corners[-1:]) / 2, corners[1:-1]])
    return Polygon(corners, closed, int(support[chain].sum()))
