"""A program on a cache and a DMA master, told in stages: after each one, which bytes CPU, cache, memory and device have."""

from __future__ import annotations

from collections.abc import Iterator
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
    """Records stages over a window of `size` bytes from `first`.

    A byte is stale when another write of it is newer, even if the two happen to have the same value.

    Args:
        memory: as it stands at the beginning.
        hexadecimal: show bytes as two digits instead of characters.
    """

    def __init__(self, memory: Memory, first: int, size: int, *, hexadecimal: bool = False) -> None:
        self.cache = Cache(memory)
        self.dma = Dma(memory, self.cache.log)
        self.first, self.size, self._hexadecimal = first, size, hexadecimal
        # per column: which record wrote it last, and whose write memory and the cached line hold (-1: there from the beginning)
        self._latest, self._stored, self._cached = [-1] * size, [-1] * size, [-1] * size
        self._seen: dict[int, list[tuple[str, str]]] = {at: [("", "absent")] * size for at in (CPU, DMA)}
        self._stages: list[tuple[str, str, tuple[Lane, ...], tuple[Move, ...], range]] = []

    @contextmanager
    def stage(self, label: str, text: str) -> Iterator[None]:
        """What is done inside is one stage of the story."""
        start = len(self.cache.log)
        yield
        span = range(start, len(self.cache.log))
        moves = tuple(move for index in span for move in self._follow(index, self.cache.log[index]))
        self._stages.append((label, text, self._lanes(), moves, span))

    def stages(self) -> list[Stage]:
        """All stages so far, with the reads that went wrong in each."""
        found = violations(self.cache.log)
        told = []
        for label, text, lanes, moves, span in self._stages:
            lost = sum(len(r.lost) for r in self.cache.log[span.start : span.stop] if isinstance(r, Operation))
            told.append(Stage(label, text, lanes, moves, tuple(v for v in found if v.index in span), lost))
        return told

    def _columns(self, address: int, size: int = LINE) -> range:
        """The columns of these bytes that lie in the window."""
        return range(max(0, address - self.first), min(self.size, address + size - self.first))

    def _follow(self, index: int, record: Record) -> list[Move]:
        """Keep the columns up to date with a record; returns which bytes it moved."""
        if isinstance(record, Access):
            return self._access(index, record)
        if isinstance(record, Operation):
            moves = [move for line in record.written_back for move in self._write_back(line)]
            return moves + [
                Move(c, CACHE, "lost" if line in record.lost else "dropped")
                for line in record.dropped
                for c in self._columns(line)
            ]
        columns = self._columns(record.address, len(record.data))
        writes = record.op == "dma write"
        for c in columns:
            if writes:
                self._latest[c] = self._stored[c] = index
            self._note(DMA, c, record.data[c + self.first - record.address], self._stored[c])
        return [Move(c, MEMORY, "up" if writes else "down") for c in columns]

    def _access(self, index: int, access: Access) -> list[Move]:
        moves = self._write_back(access.victim) if access.written_back and access.victim is not None else []
        if access.filled:
            for c in self._columns(access.line):
                self._cached[c] = self._stored[c]
                moves.append(Move(c, CACHE, "up"))
        writes, way = access.op == "write", "down" if access.op == "write" else "up"
        for c in self._columns(access.address, access.size):
            if writes:
                self._latest[c] = index
                self._cached[c] = index if access.way >= 0 else self._cached[c]
                self._stored[c] = index if access.to_memory else self._stored[c]
            version = self._cached[c] if access.way >= 0 else self._stored[c]
            self._note(CPU, c, access.data[c + self.first - access.address], version)
            moves.append(Move(c, CPU, way))
            if access.to_memory or access.bypass:
                moves.append(Move(c, CACHE, way))
        return moves

    def _write_back(self, line: int) -> list[Move]:
        for c in self._columns(line):
            self._stored[c] = self._cached[c]
        return [Move(c, CACHE, "down") for c in self._columns(line)]

    def _note(self, master: int, column: int, value: int, version: int) -> None:
        """What a master wrote or got."""
        self._seen[master][column] = self._text(value), "plain" if version == self._latest[column] else "stale"

    def _lanes(self) -> tuple[Lane, ...]:
        cells: list[tuple[str, str]] = []
        dirty = []
        for c in range(self.size):
            line = self.cache.held(self.first + c)
            if line is None:
                cells.append(("", "absent"))
                continue
            state = "stale" if self._cached[c] != self._latest[c] else "dirty" if line.dirty else "newest"
            cells.append((self._text(line.data[self.first + c - line.address]), state))
            columns = self._columns(line.address)
            if line.dirty and c == columns.start:
                dirty.append((columns.start, columns.stop))
        stored = self.cache.memory.read(self.first, self.size)
        memory = [(self._text(v), "newest" if self._stored[c] == self._latest[c] else "stale") for c, v in enumerate(stored)]
        attribute = self.cache.memory.attribute(self.first)
        note = "" if attribute.cacheable else f"not asked: this memory is {attribute.name}"
        return (
            Lane("CPU", *zip(*self._seen[CPU])),
            Lane("cache", *zip(*cells), dirty=tuple(dirty), note=note),
            Lane("memory", *zip(*memory)),
            Lane("DMA", *zip(*self._seen[DMA])),
        )

    def _text(self, value: int) -> str:
        if self._hexadecimal:
            return f"{value:02X}"
        return chr(value) if 32 < value < 127 else "0" if not value else "?"
