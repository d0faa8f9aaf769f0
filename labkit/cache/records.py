"""What happened, as frozen records in the order in which it happened: CPU accesses, cache operations, DMA transfers.

Counts, timelines, 3C classes, pictures and the search for coherence failures are folds over lists of these.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

AccessOp = Literal["read", "write", "modify", "speculate"]
OperationOp = Literal["clean", "invalidate", "clean+invalidate", "enable", "disable"]
TransferOp = Literal["dma read", "dma write"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """One access of the CPU to one line (an access that straddles lines gives one record per line).

    Attributes:
        number: counts the CPU's accesses from 0; records of one access share it. -1 for a speculative fill.
        op: "read", "write", "modify" (load and store in one, as tracers count it) or "speculate".
        address, size: the bytes of the access that lie in this line.
        data: what was written, or for a read and a modify what the CPU got.
        line, set, way: where it was looked for; way is -1 when the line is not held afterwards, set as well when the cache
            was not asked.
        bypass: why the cache was not asked ("cache disabled", or the name of the memory's attribute), else "".
        hit: the line was there. filled: it was fetched from memory now.
        victim: address of the line that made room, or None. written_back: the victim was dirty and went to memory.
        to_memory: this store's bytes went to memory at once (write-through, no allocation, or bypass).
    """

    number: int = -1
    op: AccessOp
    address: int
    size: int = 0
    data: bytes = b""
    line: int
    set: int = -1
    way: int = -1
    bypass: str = ""
    hit: bool = False
    filled: bool = False
    victim: int | None = None
    written_back: bool = False
    to_memory: bool = False

    @property
    def loads(self) -> bool:
        """The CPU got bytes: a read, or the first half of a modify."""
        return self.op in ("read", "modify")

    @property
    def stores(self) -> bool:
        """The CPU wrote bytes: a write, or the second half of a modify."""
        return self.op in ("write", "modify")


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """One cache maintenance operation, by address or on the whole cache, with the rounding it did made visible.

    Attributes:
        op: "clean", "invalidate", "clean+invalidate", "enable" or "disable".
        address, size: what the program asked for; None for the whole cache.
        lines: the line addresses it worked on, held or not; None for the whole cache.
        neighbours: ranges (address, size) inside these lines that the program did not name.
        missed: the range (address, size) at the end that was named but not worked on (size rounding forgotten), or None.
        written_back: lines that went to memory. dropped: lines that left the cache. lost: those of them that were dirty and
            did not go to memory, so that the CPU's bytes are gone.
    """

    op: OperationOp
    address: int | None
    size: int | None
    lines: range | None
    neighbours: tuple[tuple[int, int], ...]
    missed: tuple[int, int] | None
    written_back: tuple[int, ...]
    dropped: tuple[int, ...]
    lost: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Transfer:
    """One transfer of a DMA master, past the cache: op is "dma read" (memory to device) or "dma write" (device to memory)."""

    op: TransferOp
    address: int
    data: bytes


Record = Access | Operation | Transfer


def data_of(records: Iterable[Access]) -> bytes:
    """The bytes of one access, joined from its records."""
    return b"".join(record.data for record in records)
