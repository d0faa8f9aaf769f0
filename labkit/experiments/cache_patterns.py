"""Notebook 02, the cache itself: a map of sets and ways, miss rates over size, ways and stride, loop orders of a product."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from annotated_types import Interval, MaxLen, MultipleOf, Unit
from typing_extensions import Doc

from labkit.cache import (
    DCACHE,
    Cache,
    Geometry,
    History,
    MissClasses,
    References,
    count,
    history,
    miss_classes,
    patterns,
    replay,
    stm32f767,
)
from labkit.checks import shown
from labkit.experiment import Experiment, Feedback, Labels, Metric, View, progress
from labkit.experiments.answers import refused
from labkit.figures import BLUE, FONT, GREEN, INK, ORANGE, SKY, VERMILION, Curve, Panel, axis, cache_map, curves, held, stack

LINE = 32  # bytes, of the Cortex-M7
POLICIES = {
    "lru": "LRU: longest not used",
    "plru": "tree-PLRU: a tree of bits",
    "fifo": "FIFO: longest in the cache",
    "random": "random, seed 0",
}
Policy = Annotated[Literal["lru", "plru", "fifo", "random"], Labels(POLICIES), Doc("who has to go when a set is full")]
MOST_STEPS = 300
#: Pattern of `CacheMap` -> the parameters that shape it.
SHAPED_BY = {
    "sequential": ("elements", "rounds", "stores"),
    "strided": ("elements", "stride", "rounds", "stores"),
    "random": ("elements", "stride", "rounds", "stores"),
    "matrix": ("edge",),
    "own": ("own",),
}


class CacheMap(Experiment[History]):
    """What is in the cache after each access, and why did this one miss?

    A pattern of accesses goes through a small data cache with lines of 32 bytes; `step` is how many have happened. Above the map
    of sets and ways; the outlined cell is where the latest access went. Below all addresses in order of time.
    """

    step: Annotated[
        int,
        Interval(ge=0, le=MOST_STEPS),
        Unit("accesses"),
        View(play=True),
        Doc("how far the pattern has run; arrow keys step one by one"),
    ] = 20
    pattern: Annotated[
        Literal["sequential", "strided", "matrix", "random", "own"],
        Labels(
            {
                "sequential": "sequential, 4 bytes apart",
                "strided": "strided, by the slider",
                "matrix": "matrix product of doubles, i j k",
                "random": "random, in elements x stride bytes",
                "own": "my own, as text below",
            }
        ),
        Doc("which addresses the CPU asks for"),
    ] = "strided"
    elements: Annotated[int, Interval(ge=1, le=60), Doc("elements of 4 bytes in a round")] = 12
    stride: Annotated[int, Interval(ge=4, le=1024), MultipleOf(4), Unit("bytes"), Doc("distance of neighbouring elements")] = 32
    rounds: Annotated[int, Interval(ge=1, le=5), Doc("how often all elements are visited")] = 3
    edge: Annotated[int, Interval(ge=2, le=4), Doc("rows and columns of the matrices")] = 3
    size: Annotated[
        Literal[128, 256, 512, 1024, 2048, 4096, 16384],
        Labels({k: f"{k} bytes" for k in (128, 256, 512, 1024, 2048, 4096)} | {16384: "16 KiB, the Cortex-M7's"}),
        Doc("capacity of the cache"),
    ] = 256
    ways: Annotated[Literal[1, 2, 4], Labels({1: "1, direct-mapped", 2: "2", 4: "4, the Cortex-M7's"}), Doc("lines per set")] = 2
    policy: Policy = "lru"
    stores: Annotated[bool, Doc("each access also changes its element, so that lines become dirty")] = False
    own: Annotated[
        str,
        MaxLen(400),
        Doc("statements between semicolons: read|write|modify ADDRESS [size N] [times N] [step N], repeat N ... end"),
    ] = "repeat 4; read 0x20020000 times 3 step 128; write 0x20020040; end"

    def references(self) -> References:
        """The pattern chosen."""
        op = "modify" if self.stores else "read"
        match self.pattern:
            case "sequential":
                return patterns.sequential(self.elements, op=op, rounds=self.rounds)
            case "strided":
                return patterns.strided(self.elements, self.stride, op=op, rounds=self.rounds)
            case "matrix":
                return patterns.matrix_product(self.edge, element=8)
            case "random":
                return patterns.random(self.elements * self.rounds, self.elements * self.stride, op=op)
            case "own":
                return patterns.parse(self.own)

    def run(self) -> History:
        made, geometry = self.references(), Geometry(self.size, self.ways, LINE)
        touched = int(((made.address + made.size - 1) // LINE - made.address // LINE + 1).sum())
        if touched > MOST_STEPS:
            raise ValueError(f"the pattern has {touched} accesses to a line; the map steps through {MOST_STEPS} at most")
        return history(replay(made, Cache(stm32f767(), geometry, self.policy)), geometry)

    def figure(self, result: History) -> dict[str, Any]:
        return cache_map(result, min(self.step, len(result)), "step")

    def without_effect(self) -> Mapping[str, str]:
        found = {
            name: "for other patterns only" if name != "own" else "for the pattern of that name"
            for name in ("elements", "stride", "rounds", "stores", "edge", "own")
            if name not in SHAPED_BY[self.pattern]
        }
        return found | ({"policy": "with several lines in a set"} if self.ways == 1 else {})

    def metrics(self, result: History) -> list[Metric]:
        step = min(self.step, len(result))
        accesses, misses, written_back = (int(result.totals[name][step]) for name in ("accesses", "misses", "write_backs"))
        why = result.miss_classes(step)
        return [
            Metric("step", step, f"of {len(result)}"),
            Metric("misses so far", misses, f"of {accesses}"),
            Metric("miss rate so far", 100 * misses / accesses if accesses else None, "%"),
            Metric("compulsory", why.compulsory, "misses", note="the first touch of a line"),
            Metric("capacity", why.capacity, "misses", note="what a cache of this size with a single set (LRU) misses as well"),
            Metric("conflict", why.conflict, "misses", note="the rest; below 0 where the single set does worse"),
            Metric("written back", written_back, "lines"),
        ]


Size = Literal[512, 1024, 2048, 4096, 8192, 16384, 32768, 65536]
Ways = Literal[1, 2, 4, 8, 16]
Stride = Literal[4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096]
SIZES, WAYS, STRIDES = (get_args(kind) for kind in (Size, Ways, Stride))
VISITS = 4  # rounds of MissRates


class MissRates(Experiment[dict[str, list[float | None]]]):
    """When does a walk over the same elements miss: too much data, too few ways, or the wrong stride?

    A number of elements, `stride` bytes apart, is visited four times. Each panel varies one thing and keeps the others where the
    sliders are; the large point is where they are.
    """

    elements: Annotated[int, Interval(ge=8, le=512), MultipleOf(8), Doc("elements of 4 bytes visited in each round")] = 256
    stride: Annotated[Stride, Labels({s: f"{s} bytes" for s in STRIDES}), Doc("distance of neighbouring elements")] = 32
    size: Annotated[
        Size, Labels({s: f"{s} bytes" if s < 1024 else f"{s // 1024} KiB" for s in SIZES}), Doc("capacity of the cache")
    ] = 16384
    ways: Annotated[Ways, Doc("lines per set")] = 4
    order: Annotated[Literal["circle", "back and forth", "shuffled"], Doc("how a round visits the elements")] = "circle"
    policy: Policy = "lru"

    def references(self, stride: int) -> References:
        """The four rounds with this stride."""
        walk = patterns.strided(self.elements, stride, rounds=VISITS)
        rounds = walk.address.reshape(VISITS, -1).copy()
        if self.order == "back and forth":
            rounds[1::2] = rounds[1::2, ::-1]
        elif self.order == "shuffled":
            np.random.default_rng(0).permuted(rounds, axis=1, out=rounds)
        return References(walk.op, rounds.ravel(), walk.size)

    def rate(self, references: References, size: int, ways: int) -> float:
        """Misses in % of the accesses."""
        return 100 * count(references, Geometry(size, ways, LINE), self.policy)["read_misses"] / len(references)

    def run(self) -> dict[str, list[float | None]]:
        """Miss rates [%] over SIZES, WAYS and STRIDES; None for a cache too small for its ways."""
        here = self.references(self.stride)
        return {
            "size": [self.rate(here, size, self.ways) if size >= self.ways * LINE else None for size in SIZES],
            "ways": [self.rate(here, self.size, ways) if self.size >= ways * LINE else None for ways in WAYS],
            "stride": [self.rate(self.references(stride), self.size, self.ways) for stride in STRIDES],
        }

    def figure(self, result: dict[str, list[float | None]]) -> dict[str, Any]:
        kib = [[str(v) if v < 1024 else f"{v // 1024}K" for v in values] for values in (SIZES, STRIDES)]
        drawn = (
            ("size", SIZES, kib[0], "size of the cache [bytes]", BLUE),
            ("ways", WAYS, [str(w) for w in WAYS], "lines per set (ways)", GREEN),
            ("stride", STRIDES, kib[1], "stride [bytes]", ORANGE),
        )
        panels = []
        for i, (key, values, ticks, title, colour) in enumerate(drawn):
            line = Curve(f"over {key}", range(len(values)), result[key], colour, mark=values.index(getattr(self, key)))
            x = axis(title, tickvals=list(range(len(values))), ticktext=ticks, range=[-0.4, len(values) - 0.6])
            y = axis("" if i else "misses [%]", range=[-4, 106])
            panels.append(curves([line], x, y, legend=False, width=len(values), left=50 if i else 74))
        return stack(panels, height=380, legend=False)

    def metrics(self, result: dict[str, list[float | None]]) -> list[Metric]:
        lines = len(np.unique(self.references(self.stride).address // LINE))
        sets = self.size // (self.ways * LINE)
        used = len(np.unique(self.references(self.stride).address // LINE % sets))
        return [
            Metric("misses", result["size"][SIZES.index(self.size)], "%"),
            Metric("lines touched", lines, f"of {self.size // LINE} that fit"),
            Metric("sets used", used, f"of {sets}", note="a stride that is a multiple of sets x 32 bytes uses one set only"),
            Metric("fewest possible misses", 100 * lines / (VISITS * self.elements), "%", note="each line once"),
        ]


Order = Literal["ijk", "ikj", "jik", "jki", "kij", "kji"]
ORDERS: tuple[str, ...] = get_args(Order)
CAUSES = {"compulsory": SKY, "capacity": ORANGE, "conflict": VERMILION}


class MatrixOrders(Experiment[dict[str, MissClasses]]):
    """Same product, same numbers: which order of the three loops misses least?

    C = A B with n x n numbers of 4 bytes, C zero at first and added to at every step; all six orders of the loops, each miss by
    its cause.
    """

    slow: ClassVar[bool] = True
    headline: ClassVar[tuple[str, ...]] = ("misses of the order shown", "best order", "worst against best")

    n: Annotated[int, Interval(ge=8, le=24), MultipleOf(8), Doc("rows and columns")] = 24
    tile: Annotated[
        Literal[0, 2, 4, 8],
        Labels({0: "no tiles", 2: "2 x 2", 4: "4 x 4", 8: "8 x 8"}),
        Doc("edge of the squares into which all loops are cut"),
    ] = 0
    size: Annotated[
        Literal[512, 1024, 2048, 4096, 8192],
        Labels({s: f"{s} bytes" for s in (512, 1024, 2048, 4096, 8192)}),
        Doc("capacity of the cache"),
    ] = 1024
    ways: Annotated[Literal[1, 2, 4], Doc("lines per set")] = 4
    order: Annotated[Order, View(), Doc("the one whose numbers are shown, loops from outside to inside")] = "ijk"

    def run(self) -> dict[str, MissClasses]:
        geometry, result = Geometry(self.size, self.ways, LINE), {}
        for order in progress(ORDERS):
            made = patterns.matrix_product(self.n, order=order, tile=self.tile or None)
            result[order] = miss_classes(count(made, geometry)["fills"], made, geometry)
        return result

    def figure(self, result: dict[str, MissClasses]) -> dict[str, Any]:
        places = list(range(len(ORDERS)))
        drawn: list[dict[str, Any]] = [
            {
                "type": "bar",
                "x": places,
                "y": [getattr(result[o], cause) for o in ORDERS],
                "name": cause,
                "width": 0.62,
                "marker": {"color": colour},
                "hovertemplate": f"{cause}: %{{y}}<extra></extra>",
            }
            for cause, colour in CAUSES.items()
        ]
        totals = [result[o].total for o in ORDERS]
        tops = [max(t, result[o].compulsory + result[o].capacity) for t, o in zip(totals, ORDERS, strict=True)]
        drawn.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": places,
                "y": totals,
                "name": "all misses",
                "hovertemplate": "%{y} misses<extra></extra>",
                "marker": {"symbol": "line-ew", "size": 56, "line": {"width": 4, "color": INK}},
            }
        )
        drawn.append(
            {
                "type": "scatter",
                "mode": "text",
                "x": places,
                "y": tops,
                "text": [f"<b>{t:,}</b>".replace(",", "\u202f") for t in totals],
                "textposition": "top center",
                "textfont": {"size": FONT},
                "showlegend": False,
                "hoverinfo": "skip",
            }
        )
        lowest = min(0, *(result[o].conflict for o in ORDERS))
        names = [f"<b>{' '.join(o)}</b>" for o in ORDERS]
        x = axis("order of the loops, from outside to inside", tickvals=places, ticktext=names, showgrid=False, range=[-0.6, 5.6])
        most = held(1.18 * max(tops))  # room for the numbers above the bars
        y = axis("lines missed", range=[-held(-1.1 * lowest) if lowest else 0, most], zeroline=True, zerolinecolor=INK)
        return stack(Panel(drawn, y, x, left=84), height=440, barmode="relative")

    def metrics(self, result: dict[str, MissClasses]) -> list[Metric]:
        mine, steps = result[self.order], self.n**3
        return [
            Metric(
                "misses of the order shown", mine.total, f"of {4 * steps:,}".replace(",", "\u202f"), note="accesses to memory"
            ),
            Metric("compulsory", mine.compulsory, "lines"),
            Metric("capacity", mine.capacity, "lines"),
            Metric("conflict", mine.conflict, "lines"),
            Metric("best order", min(result, key=lambda o: result[o].total)),
            Metric(
                "worst against best",
                max(r.total for r in result.values()) / min(r.total for r in result.values()),
                "times the misses",
            ),
        ]


# Exercises: each asks the model


def check_full_of_holes(answer: MissRates) -> Feedback:
    """Exercise 1: every access misses in the Cortex-M7's data cache, although the lines would fit into it ten times."""
    wrong = refused(answer, MissRates(), "elements", "stride")
    if wrong:
        return wrong
    references = answer.references(answer.stride)
    lines = len(np.unique(references.address // LINE))
    if lines * 10 > DCACHE.size // LINE:
        return Feedback(
            False, f"{lines} lines are too many: ten times as many must fit into the {DCACHE.size // LINE} of the cache."
        )
    rate = answer.rate(references, answer.size, answer.ways)
    return Feedback(
        rate == 100, f"{lines} lines in a cache with room for {DCACHE.size // LINE}, and {rate:g} % of the accesses miss."
    )


def check_fifo_beats_lru(text: Any) -> Feedback:
    """Exercise 2: a pattern of at most 12 accesses to four ways that FIFO serves with fewer misses than LRU."""
    if not isinstance(text, str):
        return Feedback(False, f'the answer is {shown(text)}; it has to be a pattern in quotes, like "read 0x20020000 times 4".')
    try:
        made = patterns.parse(text)
    except ValueError as error:
        return Feedback(False, f"{error}.")
    if len(made) > 12:
        return Feedback(False, f"{len(made)} accesses; 12 are enough.")
    misses = {policy: count(made, Geometry(128, 4, LINE), policy)["fills"] for policy in ("lru", "fifo")}
    return Feedback(
        misses["fifo"] < misses["lru"], f"in one set of 4 ways LRU misses {misses['lru']} times, FIFO {misses['fifo']} times."
    )


def check_good_order(answer: MatrixOrders) -> Feedback:
    """Exercise 3: at most a sixth of the misses of i j k without tiles, for the same product in the same cache."""
    start = MatrixOrders()
    wrong = refused(answer, start, "order", "tile")
    if wrong:
        return wrong
    before, now = start.run()[start.order].total, answer.run()[answer.order].total
    return Feedback(now * 6 <= before, f"{now} misses against {before} of i j k without tiles: {before / now:.1f} times fewer.")
