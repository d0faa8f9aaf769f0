"""A DMA master: it reads and writes memory and knows nothing of the CPU's cache. That is the whole problem."""

from __future__ import annotations

from labkit.cache.memory import Memory
from labkit.cache.records import Record, Transfer


class Dma:
    """A master on the bus matrix beside the CPU.

    Args:
        memory: shared with the cache.
        log: every transfer is appended to it; give the cache's `log` to have one history.
        width: bytes per beat (1, 2 or 4); addresses and sizes must be multiples of it.
    """

    def __init__(self, memory: Memory, log: list[Record] | None = None, width: int = 1) -> None:
        if width not in (1, 2, 4):
            raise ValueError(f"DMA width is {width} bytes; allowed are 1, 2 and 4")
        self.memory, self.width = memory, width
        self.log: list[Record] = [] if log is None else log

    def read(self, address: int, size: int) -> Transfer:
        """Memory to device (transmit): the record's `data` is what the device gets."""
        self._check(address, size)
        return self._record(Transfer("dma read", address, self.memory.read(address, size)))

    def write(self, address: int, data: bytes) -> Transfer:
        """Device to memory (receive)."""
        self._check(address, len(data), write=True)
        self.memory.write(address, data)
        return self._record(Transfer("dma write", address, bytes(data)))

    def _check(self, address: int, size: int, write: bool = False) -> None:
        if address % self.width or size % self.width:
            raise ValueError(
                f"DMA of {size} bytes at {address:#x}; address and size must be multiples of its width, {self.width} bytes"
            )
        self.memory.check(address, size, write=write, dma=True)

    def _record(self, record: Transfer) -> Transfer:
        self.log.append(record)
        return record
