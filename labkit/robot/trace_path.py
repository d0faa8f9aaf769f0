"""How the stamps get out of the board: the temp buffer, the task `profile`, the ring, the task `tsink`, DMA and UART (S4, S5).

There are two sources of stamps. A switch of tasks leaves two of them in a buffer of 512; every 10 ms `profile` makes a line of
each and writes it into the ring under a mutex. A scope, if jobs have one, is stamped by the task itself as it begins and ends:
that task makes the line, waits for the mutex, and for room.

`tsink` looks at the ring every millisecond and hands what is there to the DMA, in two pieces where it wraps, after it has
cleaned the cache lines they lie in. The read index advances only when all of that has gone out, so room comes back in bursts.

With a button (`Button`), only what happens between a press that starts and one that stops leaves stamps.

Here the ring is counted in bytes, as part of the kernel model; which interleavings of its accesses are wrong is the subject of
`labkit.sink`. Simplified: stamps that come while `profile` prints wait for its next round, as with two buffers; a line is as long
as its text would be, but holds none.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from labkit.cache import DCACHE
from labkit.kernel import Costs, Kernel
from labkit.robot.button import Button
from labkit.sink import BITS_PER_BYTE
from labkit.trace import CODE, Trace

SWITCH = CODE["switch"]
COPY = 4  # cycles per byte written into the ring, under the mutex; the rest of a line's cost is its formatting
Body = Callable[[Any], Any]
TENS = 10 ** np.arange(1, 19)
FIXED = {"record": 8, "word": 4}  # bytes of a stamp; a text line depends on its name and time


@dataclass(frozen=True)
class TracePath:
    """Parameters of the trace path.

    Attributes:
        baud: of the link. The source does not state it; its public branches set 115200, 1152000 and 2000000.
        form: lines of text, records of 8 bytes, words of 4.
        stamp: cycles that a line takes whoever makes it, `profile` or, for a scope, the task itself.
        hook: cycles that the stamps of a switch add to it. 0, since the published gaps between stamps, from which the cost of a
            switch comes, have them in it.
        scopes: each job of the periodic tasks is a scope.
        look: cycles of `tsink` each time it runs.
        clean: further cycles for each line of the data cache in which the bytes of a transfer lie; they are cleaned before it,
            or the DMA would send what memory held before. 0, since the published mean, which `look` is, has it in it, and right
            for a ring in memory that is not cached, too.
        when_full: who writes waits and tries again after 1 ms, or drops what does not fit.
        buffer: stamps that the temp buffer holds. capacity: bytes that the ring holds.
        every: period of `profile` in ms.
        batch: stamps that are written at a time. The firmware writes one; more of them give the same bytes and the same
            processor time in fewer steps.
    """

    baud: int = 2_000_000
    form: Literal["text", "record", "word"] = "text"
    stamp: int = 2560
    hook: int = 0
    scopes: bool = False
    look: int = 650
    clean: int = 0
    when_full: Literal["wait", "drop"] = "wait"
    buffer: int = 512
    capacity: int = 2048
    every: int = 10
    batch: int = 1

    def __post_init__(self) -> None:
        for name, known in (("form", ("text", *FIXED)), ("when_full", ("wait", "drop"))):
            if getattr(self, name) not in known:
                raise ValueError(f"trace path: {name} {getattr(self, name)!r}; there are {', '.join(known)}")
        least = {
            "baud": 1,
            "stamp": 0,
            "hook": 0,
            "look": 1,
            "clean": 0,
            "buffer": 1,
            "capacity": 64 * self.batch,
            "every": 1,
            "batch": 1,
        }
        for name, allowed in least.items():
            if getattr(self, name) < allowed:
                raise ValueError(f"trace path: {name} = {getattr(self, name)} is not allowed; allowed is {allowed} or more")


class Sink:
    """The ring and what became of the stamps; times in cycles.

    Attributes:
        capacity: bytes that fit the ring. buffer: stamps that fit the temp buffer.
        written, read: bytes so far; the difference is the fill.
        times, fills: when the fill changed, and to what.
        rounds: of `profile`, four numbers each: its time, stamps taken over, stamps that the temp buffer has lost, stamps dropped
            at the ring in the round before.
        on_air: begin and end of each DMA transfer, and its bytes.
        direct, refused: stamps of scopes that were written, and that were dropped since there was no room.
    """

    def __init__(self, capacity: int, buffer: int):
        self.capacity, self.buffer = capacity, buffer
        self.written = self.read = 0
        self.times, self.fills = array("q", [0]), array("q", [0])
        self.rounds = array("q")
        self.on_air = array("q")
        self.direct = self.refused = 0

    @property
    def fill(self) -> int:
        return self.written - self.read

    def put(self, now: int, size: int) -> None:
        """Write `size` bytes; the caller has looked for room."""
        self.written += size
        self._note(now)

    def taken(self, now: int, size: int) -> None:
        """The read index advances."""
        self.read += size
        self._note(now)

    def _note(self, now: int) -> None:
        self.times.append(now)
        self.fills.append(self.fill)

    def pieces(self) -> list[tuple[int, int]]:
        """The one or two contiguous pieces of what is in the ring: where each begins, and its size."""
        position = self.read % self.capacity
        first = min(self.fill, self.capacity - position)
        return [(at, size) for at, size in ((position, first), (0, self.fill - first)) if size]

    def table(self) -> np.ndarray:
        """The rounds of `profile`, shape (n, 4)."""
        return np.frombuffer(self.rounds, dtype=np.int64).reshape(-1, 4).copy()

    def lost(self, switches: int) -> int:
        """Stamps that never reach the host, of so many switches and of all scopes: no room in the temp buffer or in the ring.

        Those are included that no round of `profile` has counted yet.
        """
        _, taken, missed, dropped = self.table().sum(axis=0)
        waiting = 2 * switches - taken - missed
        return int(missed + dropped + max(0, waiting - self.buffer)) + self.refused

    def arrived(self) -> int:
        """Stamps that were taken over from the temp buffer, or written by scopes."""
        return int(self.table()[:, 1].sum()) + self.direct

    def curve(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and fills as arrays."""
        return np.frombuffer(self.times, dtype=np.int64).copy(), np.frombuffer(self.fills, dtype=np.int64).copy()

    def transfers(self) -> np.ndarray:
        """Begin, end and bytes of each transfer, shape (n, 3)."""
        return np.frombuffer(self.on_air, dtype=np.int64).reshape(-1, 3).copy()


def lines(trace: Trace, first: int, form: str, button: Button | None = None) -> np.ndarray:
    """Bytes of each stamp of the switches from row `first` on: one for the task that stops, one for the task that starts.

    `<name> <microseconds> <0|1>` and a line feed, or a fixed size. With a button those that are recorded, and the first of all
    is at 0 us.
    """
    rows = first + np.flatnonzero(trace.kind[first:] == SWITCH)
    zero = 0
    if button is not None:
        rows = rows[button.recorded(trace.time[rows])]
        zero = button.count_from(trace.time[rows])
    if form in FIXED:
        return np.full(2 * len(rows), FIXED[form])
    names = np.array([*map(len, trace.names), 0])
    digits = 1 + np.searchsorted(TENS, (trace.time[rows] - zero) * 1_000_000 // trace.hz, side="right")
    both = np.stack([names[trace.other[rows]], names[trace.task[rows]]], axis=1)
    return (both + (digits + 4)[:, None]).ravel()


def with_hook(costs: Costs, path: TracePath | None) -> Costs:
    """What the kernel takes when each switch is stamped."""
    return replace(costs, switch=costs.switch + path.hook) if path else costs


def install(
    k: Kernel, path: TracePath, button: Button | None = None
) -> tuple[Sink, dict[str, Body], Callable[[str, int, Body], Body]]:
    """The ring, the bodies of `tsink` and `profile`, and what makes a scope of each job of a periodic task.

    The last takes the name of the task, its period in ticks and its body, which must sleep by `delay_until`. Without a button,
    all is recorded from the start.
    """
    sink, lock = Sink(path.capacity, path.buffer), k.mutex("sink")
    ms = max(1, k.cpu_hz // k.tick // 1000)  # in ticks
    seen, dropped = 0, 0

    def tsink(os: Any) -> Any:
        me = next(task for task in k.tasks if task.name == "tsink")
        while True:
            pieces = sink.pieces()
            for at, size in pieces:
                yield path.look + path.clean * len(DCACHE.span(at, size))  # the ring begins with a line
                duration = -(-size * BITS_PER_BYTE * k.cpu_hz // path.baud)
                sink.on_air.extend((os.now, os.now + duration, size))
                k.interrupt(os.now + duration, lambda isr: isr.notify_give(me))
                yield os.notify_take()
            if pieces:
                sink.taken(os.now, sum(size for _, size in pieces))
            else:
                yield path.look
                yield os.delay(ms)

    def stamps() -> tuple[np.ndarray, int]:
        """Sizes of the stamps in the temp buffer, and how many found no room there. Empties it."""
        nonlocal seen
        trace = k.trace
        sizes, seen = lines(trace, seen, path.form, button), len(trace)
        return sizes[: path.buffer], max(0, len(sizes) - path.buffer)

    def write(os: Any, size: int) -> Any:
        """Whether so many bytes got into the ring. Who waits for room sleeps, without the mutex."""
        while True:
            yield os.take(lock)
            if sink.capacity - sink.fill >= size:
                yield COPY * size
                sink.put(os.now, size)
                yield os.give(lock)
                return True
            yield os.give(lock)
            if path.when_full == "drop":
                return False
            yield os.delay(ms)

    def stamp(os: Any, name: str) -> Any:
        """A scope begins or ends."""
        zero = 0
        if button is not None:
            if not button.on(os.now):
                return
            if button.zero is None:  # this stamp is the first one, or a switch before it
                button.count_from(np.append(k.trace.time[k.trace.of("switch")], os.now))
            zero = button.zero or 0
        size = FIXED.get(path.form) or len(name) + len(str((os.now - zero) * 1_000_000 // k.cpu_hz)) + 4
        yield max(path.stamp - COPY * size, 0)
        if (yield from write(os, size)):
            sink.direct += 1
        else:
            sink.refused += 1

    def scoped(name: str, period: int, body: Body) -> Body:
        def jobs(os: Any) -> Any:
            job, pause, answer = body(os), os.delay_until(period), None
            yield from stamp(os, name)
            while True:
                request = job.send(answer)
                if request != pause:
                    answer = yield request
                    continue
                yield from stamp(os, name)
                answer = yield pause
                yield from stamp(os, name)

        return jobs if path.scopes else body

    def profile(os: Any) -> Any:
        nonlocal dropped
        while True:
            sizes, lost = stamps()
            sink.rounds.extend((os.now, len(sizes), lost, dropped))
            dropped = 0
            for first in range(0, len(sizes), path.batch):
                some = sizes[first : first + path.batch]
                size = int(some.sum())
                yield max(path.stamp * len(some) - COPY * size, 0)
                if not (yield from write(os, size)):
                    dropped += len(some)
            yield os.delay_until(path.every * ms)

    return sink, {"tsink": tsink, "profile": profile}, scoped
