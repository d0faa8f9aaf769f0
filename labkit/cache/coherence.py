"""Where a program or a DMA master read a byte that was not the latest one written, and why: a fold over the records.

The fold keeps, for every byte, which write is the latest, which one memory holds and which one the cached line holds. It needs
no data, so it finds a failure even when the stale byte happens to have the right value. Nothing else in the lab decides what
is stale: pictures ask the same fold.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from labkit.cache.records import Access, Operation, Record, Transfer

#: Every way in which a DMA master and a cache can disagree, and what went wrong. The first six are the documented ones.
CAUSES: dict[str, str] = {
    "transmit without clean": "the CPU's bytes are still in a dirty line; clean the buffer before the DMA reads it",
    "receive without invalidate": "the CPU reads a line fetched before the DMA wrote; invalidate the buffer before reading it",
    "speculative fill": "invalidated before the transfer, the line was fetched again by speculation; invalidate after it as well",
    "dirty eviction": "a dirty line was evicted over what the DMA had written; invalidate before the transfer as well",
    "invalidate hit a dirty neighbour": "an invalidate dropped a dirty line with the CPU's bytes; give the buffer whole lines",
    "clean overwrote the DMA": "a dirty line was cleaned over what the DMA had written; give the buffer whole lines",
    "disabled while dirty": "the cache was switched off with dirty lines in it; clean and invalidate when disabling",
}


@dataclass(frozen=True)
class Violation:
    """A read that did not get the latest bytes.

    Attributes:
        index: which record of the log read them. reader: "CPU" or "DMA".
        cause: a key of `CAUSES`. address, size: consecutive bytes with this cause.
    """

    index: int
    reader: str
    cause: str
    address: int
    size: int

    def __str__(self) -> str:
        what = f"{self.reader} read {self.size} stale bytes at {self.address:#x} (record {self.index})"
        return f"{what}, {self.cause}: {CAUSES[self.cause]}"


def violations(log: Iterable[Record], line: int = 32) -> list[Violation]:
    """All reads in a log (of a cache with lines of `line` bytes and its DMA masters) that missed the latest write, in order.

    A log may begin in the middle, after a `clear()`: what was written before its first record counts as seen by everybody.
    """
    coherence = Coherence(line)
    return [violation for record in log for violation in coherence.follow(record)]


@dataclass
class _Copy:
    """A cached line: per byte which write it holds, and whether speculation fetched it."""

    writes: list[int]
    speculative: bool = False


class Coherence:
    """Which write every byte is of: the latest one, the one in memory, the one in its line; kept up to date record by record.

    A write is known by the index of its record; -1 is whatever was there before the first record.

    Args:
        line: bytes per line of the cache.
    """

    def __init__(self, line: int = 32) -> None:
        self._line = line
        self._index = -1  # of the latest record
        self._latest: dict[int, int] = {}
        self._memory: dict[int, int] = {}
        self._copies: dict[int, _Copy] = {}  # by line address
        self._invalidated: list[range | None] = []  # None: the whole cache
        self._overwritten: dict[int, str] = {}  # byte -> how memory lost the latest write
        self._dropped: set[int] = set()  # bytes whose latest write was in a line dropped dirty

    def follow(self, record: Record) -> list[Violation]:
        """Take note of the next record; returns the stale bytes that it read, joined to stretches of one cause."""
        self._index += 1
        if isinstance(record, Access):
            return self._access(record)
        if isinstance(record, Transfer):
            return self._transfer(record)
        self._operation(record)
        return []

    def memory_is_stale(self, byte: int) -> bool:
        """Memory does not hold the latest write of this byte."""
        return self._memory.get(byte, -1) != self._latest.get(byte, -1)

    def line_is_stale(self, byte: int) -> bool:
        """The line that holds this byte, which must be in the cache, does not hold the latest write of it."""
        return self._copy(byte - byte % self._line).writes[byte % self._line] != self._latest.get(byte, -1)

    def _copy(self, line: int) -> _Copy:
        """A held line; one that the log never fetched was there before the first record."""
        return self._copies.setdefault(line, _Copy([-1] * self._line))

    def _access(self, access: Access) -> list[Violation]:
        if access.victim is not None:
            if access.written_back:
                self._write_back(access.victim, "dirty eviction")
            self._copies.pop(access.victim, None)
        if access.filled:
            fetched = [self._memory.get(byte, -1) for byte in range(access.line, access.line + self._line)]
            self._copies[access.line] = _Copy(fetched, access.op == "speculate")
        copy = self._copy(access.line) if access.way >= 0 else None
        span = range(access.address, access.address + access.size)
        found = []
        if access.loads:
            stale = self.memory_is_stale if copy is None else self.line_is_stale
            found = self._violations("CPU", [byte for byte in span if stale(byte)])
        if access.stores:
            self._write(span, access.to_memory)
            if copy is not None:
                start = access.address - access.line
                copy.writes[start : start + access.size] = [self._index] * access.size
        return found

    def _transfer(self, transfer: Transfer) -> list[Violation]:
        span = range(transfer.address, transfer.address + len(transfer.data))
        if transfer.op == "dma read":
            return self._violations("DMA", [byte for byte in span if self.memory_is_stale(byte)])
        self._write(span, to_memory=True)
        return []

    def _operation(self, operation: Operation) -> None:
        for line in operation.written_back:
            self._write_back(line, "clean overwrote the DMA")
        for line in operation.lost:
            held = range(line, line + self._line)
            self._dropped |= {byte for byte in held if self.memory_is_stale(byte) and not self.line_is_stale(byte)}
        for line in operation.dropped:
            self._copies.pop(line, None)
        if operation.op in ("invalidate", "clean+invalidate"):
            self._invalidated.append(operation.lines)

    def _write(self, span: range, to_memory: bool) -> None:
        self._latest.update(dict.fromkeys(span, self._index))
        if to_memory:
            self._memory.update(dict.fromkeys(span, self._index))
        self._dropped.difference_update(span)
        for byte in span:
            self._overwritten.pop(byte, None)

    def _write_back(self, line: int, how: str) -> None:
        for byte, write in enumerate(self._copy(line).writes, line):
            if write != self._latest.get(byte, -1) and not self.memory_is_stale(byte):
                self._overwritten[byte] = how
            self._memory[byte] = write

    def _violations(self, reader: str, stale: list[int]) -> list[Violation]:
        """These bytes of a read, in order of their addresses, as violations."""
        found: list[Violation] = []
        for byte in stale:
            cause, last = self._cause(byte, reader), found[-1] if found else None
            if last is not None and last.cause == cause and last.address + last.size == byte:
                found[-1] = Violation(self._index, reader, cause, last.address, last.size + 1)
            else:
                found.append(Violation(self._index, reader, cause, byte, 1))
        return found

    def _cause(self, byte: int, reader: str) -> str:
        line = byte - byte % self._line
        held = line in self._copies
        if not self.memory_is_stale(byte):  # the CPU has an old copy of it
            again = held and self._copies[line].speculative and any(lines is None or line in lines for lines in self._invalidated)
            return "speculative fill" if again else "receive without invalidate"
        if held and not self.line_is_stale(byte):
            return "transmit without clean" if reader == "DMA" else "disabled while dirty"
        if byte in self._dropped:
            return "invalidate hit a dirty neighbour"
        return self._overwritten.get(byte, "disabled while dirty")
