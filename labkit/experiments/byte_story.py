"""A program on a cache and a DMA master, told in stages: after each one, which bytes CPU, cache, memory and device have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from labkit.cache import DCACHE, Access, Cache, Coherence, Dma, Memory, Operation, Record, Transfer, Violation
from labkit.figures import Lane, Move

LINE = DCACHE.line
CPU, CACHE, MEMORY, DMA = range(4)  # the lanes from top to bottom


@dataclass(frozen=True)
class Stage:
    """What stands where after one stage.

    Attributes:
        label, text: its name for the strip of stages, and what happens in a sentence.
        lanes: CPU and DMA show what they last wrote or got (of a modify what they got), cache and memory what they hold.
        moves: which bytes went where during this stage.
        wrong: reads of this stage that missed the latest write. lost: lines dropped although they were dirty.
        touched: lines that the driver's operations cleaned or dropped.
    """

    label: str
    text: str
    lanes: tuple[Lane, ...]
    moves: tuple[Move, ...]
    wrong: tuple[Violation, ...]
    lost: int
    touched: int


class Story:
    """Records stages over a window of `size` bytes from `first`.

    A byte is stale when another write of it is newer, even if the two happen to have the same value; `Coherence` knows which.

    Args:
        memory: as it stands at the beginning.
        hexadecimal: show bytes as two digits instead of characters.
    """

    def __init__(self, memory: Memory, first: int, size: int, *, hexadecimal: bool = False) -> None:
        self.cache = Cache(memory)
        self.dma = Dma(memory, self.cache.log)
        self.first, self.size, self._hexadecimal = first, size, hexadecimal
        self._coherence = Coherence(LINE)
        self._seen = {master: [("", "absent")] * size for master in (CPU, DMA)}  # text and state, as shown
        self._stages: list[Stage] = []

    @contextmanager
    def stage(self, label: str, text: str) -> Iterator[None]:
        """What is done inside is one stage of the story."""
        start = len(self.cache.log)
        yield
        moves: list[Move] = []
        wrong: list[Violation] = []
        lost = touched = 0
        for record in self.cache.log[start:]:
            stale = self._coherence.follow(record)
            if not isinstance(record, Operation):
                self._note(record, stale)
            else:
                lost += len(record.lost)
                touched += len({*record.written_back, *record.dropped})
            moves += self._moves(record)
            wrong += stale
        self._stages.append(Stage(label, text, self._lanes(), tuple(moves), tuple(wrong), lost, touched))

    def stages(self) -> list[Stage]:
        """All stages so far."""
        return list(self._stages)

    def _columns(self, address: int, size: int = LINE) -> range:
        """The columns of these bytes that lie in the window."""
        return range(max(0, address - self.first), min(self.size, address + size - self.first))

    def _note(self, record: Access | Transfer, stale: Sequence[Violation]) -> None:
        """Show what a master wrote or got."""
        lane = self._seen[CPU if isinstance(record, Access) else DMA]
        for c in self._columns(record.address, len(record.data)):
            lane[c] = self._text(record.data[c + self.first - record.address]), "plain"
        for violation in stale:
            for c in self._columns(violation.address, violation.size):
                lane[c] = lane[c][0], "stale"

    def _moves(self, record: Record) -> list[Move]:
        """Which bytes of the window a record moved."""
        if isinstance(record, Access):
            return self._access(record)
        if isinstance(record, Transfer):
            way = "up" if record.op == "dma write" else "down"
            return [Move(c, MEMORY, way) for c in self._columns(record.address, len(record.data))]
        moves = [Move(c, CACHE, "down") for line in record.written_back for c in self._columns(line)]
        for line in record.dropped:
            moves += [Move(c, CACHE, "lost" if line in record.lost else "dropped") for c in self._columns(line)]
        return moves

    def _access(self, access: Access) -> list[Move]:
        moves = []
        if access.victim is not None and access.written_back:
            moves += [Move(c, CACHE, "down") for c in self._columns(access.victim)]
        if access.filled:
            moves += [Move(c, CACHE, "up") for c in self._columns(access.line)]
        columns = self._columns(access.address, access.size)
        if access.loads:
            moves += [Move(c, lane, "up") for c in columns for lane in ((CPU, CACHE) if access.bypass else (CPU,))]
        if access.stores:
            moves += [Move(c, lane, "down") for c in columns for lane in ((CPU, CACHE) if access.to_memory else (CPU,))]
        return moves

    def _lanes(self) -> tuple[Lane, ...]:
        """The four lanes as they stand now."""
        held: list[tuple[str, str]] = []
        stored: list[tuple[str, str]] = []
        dirty: dict[tuple[int, int], None] = {}  # the columns of each dirty line, in order
        for byte, value in enumerate(self.cache.memory.read(self.first, self.size), self.first):
            stored.append((self._text(value), "stale" if self._coherence.memory_is_stale(byte) else "newest"))
            line = self.cache.held(byte)
            if line is None:
                held.append(("", "absent"))
                continue
            state = "stale" if self._coherence.line_is_stale(byte) else "dirty" if line.dirty else "newest"
            held.append((self._text(line.data[byte - line.address]), state))
            if line.dirty:
                columns = self._columns(line.address)
                dirty[columns.start, columns.stop] = None
        attribute = self.cache.memory.attribute(self.first)
        note = "" if attribute.cacheable else f"not asked: this memory is {attribute.name}"
        return (
            _lane("CPU", self._seen[CPU]),
            _lane("cache", held, tuple(dirty), note),
            _lane("memory", stored),
            _lane("DMA", self._seen[DMA]),
        )

    def _text(self, value: int) -> str:
        if self._hexadecimal:
            return f"{value:02X}"
        return chr(value) if 32 < value < 127 else "0" if not value else "?"


def _lane(name: str, cells: Sequence[tuple[str, str]], dirty: tuple[tuple[int, int], ...] = (), note: str = "") -> Lane:
    """A lane of cells, each a text and a state."""
    return Lane(name, tuple(text for text, _ in cells), tuple(state for _, state in cells), dirty, note)
