"""A program on a cache and a DMA master, told in stages: after each one, which bytes CPU, cache, memory and device have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from labkit.cache import DCACHE, Access, Cache, Dma, Memory, Operation, Violation, violations
from labkit.cache.records import Record
from labkit.figures.lanes import Lane, Move

LINE = DCACHE.line
CPU, CACHE, MEMORY, DMA = range(4)  # the lanes from top to bottom


@dataclass(frozen=True)
class Stage:
    """What stands where after one stage.

    Attributes:
        label, text: its name for the strip of stages, and what happens in a sentence.
        lanes: CPU and DMA show what they last wrote or got, cache and memory what they hold.
        moves: which bytes went where during this stage.
        wrong: reads of this stage that missed the latest write. lost: lines dropped although they were dirty.
    """

    label: str
    text: str
    lanes: tuple[Lane, ...]
    moves: tuple[Move, ...]
    wrong: tuple[Violation, ...]
    lost: int


class Story:
    """Records stages over a window of `size` bytes from `first`. A byte is stale when its value is not the one last written.

    Args:
        memory: as it stands at the beginning.
        hexadecimal: show bytes as two digits instead of characters.
    """

    def __init__(self, memory: Memory, first: int, size: int, *, hexadecimal: bool = False) -> None:
        self.cache = Cache(memory)
        self.dma = Dma(memory, self.cache.log)
        self.first, self.size, self._hexadecimal = first, size, hexadecimal
        self._latest = bytearray(memory.read(first, size))
        self._seen: dict[int, list[tuple[str, str]]] = {at: [("", "absent")] * size for at in (CPU, DMA)}
        self._stages: list[tuple[str, str, tuple[Lane, ...], tuple[Move, ...], range]] = []

    @contextmanager
    def stage(self, label: str, text: str) -> Iterator[None]:
        """What is done inside is one stage of the story."""
        start = len(self.cache.log)
        yield
        records = self.cache.log[start:]
        moves = tuple(move for record in records for move in self._moves(record))
        self._stages.append((label, text, self._lanes(), moves, range(start, len(self.cache.log))))

    def stages(self) -> list[Stage]:
        """All stages so far, with the reads that went wrong in each."""
        found = violations(self.cache.log)
        told = []
        for label, text, lanes, moves, span in self._stages:
            lost = sum(len(r.lost) for r in self.cache.log[span.start:span.stop] if isinstance(r, Operation))
            told.append(Stage(label, text, lanes, moves, tuple(v for v in found if v.index in span), lost))
        return told

    def _inside(self, address: int, size: int) -> range:
        """The columns of these bytes that lie in the window."""
        return range(max(0, address - self.first), min(self.size, address + size - self.first))

    def _moves(self, record: Record) -> list[Move]:
        """Which bytes a record moved; on the way it notes what the masters saw and which value is the latest."""
        if isinstance(record, Operation):
            return self._lines(record.written_back, CACHE, "down") + [
                move for line in record.dropped for move in self._lines((line,), CACHE, "lost" if line in record.lost else "dropped")]
        columns = self._inside(record.address, record.size if isinstance(record, Access) else len(record.data))
        to_memory = record.op == "write" or record.op == "dma read"
        moves = [] if not isinstance(record, Access) else self._fill(record)
        if record.op != "speculate":
            master, gap = (CPU, CPU) if isinstance(record, Access) else (DMA, MEMORY)
            for c in columns:
                value = record.data[c + self.first - record.address]
                if record.op in ("write", "dma write"):
                    self._latest[c] = value
                self._seen[master][c] = self._text(value), "plain" if value == self._latest[c] else "stale"
            moves += [Move(c, gap, "down" if to_memory else "up") for c in columns]
        return moves

    def _fill(self, access: Access) -> list[Move]:
        """What an access of the CPU moved between cache and memory."""
        moves = self._lines((access.line,), CACHE, "up") if access.filled else []
        if access.written_back and access.victim is not None:
            moves += self._lines((access.victim,), CACHE, "down")
        if access.to_memory or access.bypass:
            way = "down" if access.op == "write" else "up"
            moves += [Move(c, CACHE, way) for c in self._inside(access.address, access.size)]
        return moves

    def _lines(self, lines: Sequence[int], lane: int, kind: str) -> list[Move]:
        return [Move(c, lane, kind) for line in lines for c in self._inside(line, LINE)]

    def _lanes(self) -> tuple[Lane, ...]:
        cells: list[tuple[str, str]] = []
        dirty = []
        for c in range(self.size):
            line = self.cache.held(self.first + c)
            if line is None:
                cells.append(("", "absent"))
                continue
            value = line.data[self.first + c - line.address]
            state = "stale" if value != self._latest[c] else "dirty" if line.dirty else "newest"
            cells.append((self._text(value), state))
            if line.dirty and (not c or line.address == self.first + c):
                columns = self._inside(line.address, LINE)
                dirty.append((columns.start, columns.stop))
        stored = self.cache.memory.read(self.first, self.size)
        memory = [(self._text(v), "newest" if v == self._latest[c] else "stale") for c, v in enumerate(stored)]
        attribute = self.cache.memory.attribute(self.first)
        note = "" if attribute.cacheable else f"not asked: this memory is {attribute.name}"
        return tuple(Lane(name, *zip(*column), dirty=tuple(dirty) if name == "cache" else (), note=note if name == "cache" else "")
                     for name, column in (("CPU", self._seen[CPU]), ("cache", cells), ("memory", memory), ("DMA", self._seen[DMA])))

    def _text(self, value: int) -> str:
        if self._hexadecimal:
            return f"{value:02X}"
        return chr(value) if 32 < value < 127 else "0" if not value else "?"
