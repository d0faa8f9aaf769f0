"""Where a program or a DMA master read a byte that was not the latest one written, and why: a fold over the records.

The fold keeps, for every byte, which write is the latest, which one memory holds and which one the cached line holds. It needs
no data, so it finds a failure even when the stale byte happens to have the right value.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

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


@dataclass
class _Copy:
    """A cached line: per byte which write it holds (its number in the log; -1 for what was there at the start)."""

    versions: list[int]
    speculative: bool
    dirty: bool = False


@dataclass
class _State:
    line: int
    latest: dict[int, int] = field(default_factory=dict)
    memory: dict[int, int] = field(default_factory=dict)
    copies: dict[int, _Copy] = field(default_factory=dict)
    invalidated: list[range | None] = field(default_factory=list)  # None: the whole cache
    overwritten: dict[int, str] = field(default_factory=dict)  # byte -> how memory lost the latest write
    dropped: set[int] = field(default_factory=set)  # bytes whose latest write was in a line dropped dirty

    def write(self, byte: int, version: int) -> None:
        self.latest[byte] = version
        self.overwritten.pop(byte, None)
        self.dropped.discard(byte)

    def write_back(self, line: int, how: str) -> None:
        copy = self.copies[line]
        copy.dirty = False
        for offset, version in enumerate(copy.versions):
            byte = line + offset
            if version != self.latest.get(byte, -1) == self.memory.get(byte, -1):
                self.overwritten[byte] = how
            self.memory[byte] = version

    def cause(self, byte: int, reader: str) -> str:
        line = byte - byte % self.line
        latest, copy = self.latest[byte], self.copies.get(line)
        if self.memory.get(byte, -1) == latest:  # the CPU has an old copy of it
            again = copy is not None and copy.speculative and any(lines is None or line in lines for lines in self.invalidated)
            return "speculative fill" if again else "receive without invalidate"
        if copy is not None and copy.versions[byte % self.line] == latest:
            return "transmit without clean" if reader == "DMA" else "disabled while dirty"
        if byte in self.dropped:
            return "invalidate hit a dirty neighbour"
        return self.overwritten.get(byte, "disabled while dirty")


def violations(log: Iterable[Record], line: int = 32) -> list[Violation]:
    """All reads in a log (of a cache with lines of `line` bytes and its DMA masters) that missed the latest write, in order."""
    state, found = _State(line), []
    for index, record in enumerate(log):
        if isinstance(record, Access):
            found += _access(state, index, record)
        elif isinstance(record, Operation):
            _operation(state, record)
        else:
            found += _transfer(state, index, record)
    return found


def _access(state: _State, index: int, access: Access) -> list[Violation]:
    if access.victim is not None:
        if access.written_back:
            state.write_back(access.victim, "dirty eviction")
        del state.copies[access.victim]
    if access.filled:
        versions = [state.memory.get(access.line + offset, -1) for offset in range(state.line)]
        state.copies[access.line] = _Copy(versions, access.op == "speculate")
    copy = state.copies.get(access.line) if access.way >= 0 else None
    span = range(access.address, access.address + access.size)
    found = []
    if access.op in ("read", "modify"):
        seen = [state.memory.get(b, -1) if copy is None else copy.versions[b - access.line] for b in span]
        found = _stale(state, index, "CPU", span, seen)
    if access.op in ("write", "modify"):
        for byte in span:
            state.write(byte, index)
            if copy is not None:
                copy.versions[byte - access.line] = index
            if access.to_memory:
                state.memory[byte] = index
        if copy is not None:
            copy.dirty |= not access.to_memory
    return found


def _operation(state: _State, operation: Operation) -> None:
    for line in operation.written_back:
        state.write_back(line, "clean overwrote the DMA")
    for line in operation.dropped:
        copy = state.copies.pop(line)
        if line in operation.lost:
            held = zip(range(line, line + state.line), copy.versions)
            state.dropped |= {byte for byte, v in held if v == state.latest.get(byte) != state.memory.get(byte)}
    if operation.op in ("invalidate", "clean+invalidate"):
        state.invalidated.append(operation.lines)


def _transfer(state: _State, index: int, transfer: Transfer) -> list[Violation]:
    span = range(transfer.address, transfer.address + len(transfer.data))
    if transfer.op == "dma read":
        return _stale(state, index, "DMA", span, [state.memory.get(byte, -1) for byte in span])
    for byte in span:
        state.write(byte, index)
        state.memory[byte] = index
    return []


def _stale(state: _State, index: int, reader: str, span: range, seen: list[int]) -> list[Violation]:
    """The bytes of a read that hold another write than the latest, joined to stretches of one cause."""
    found: list[Violation] = []
    for byte, version in zip(span, seen):
        if version == state.latest.get(byte, -1):
            continue
        cause = state.cause(byte, reader)
        if found and found[-1].cause == cause and found[-1].address + found[-1].size == byte:
            found[-1] = Violation(index, reader, cause, found[-1].address, found[-1].size + 1)
        else:
            found.append(Violation(index, reader, cause, byte, 1))
    return found
