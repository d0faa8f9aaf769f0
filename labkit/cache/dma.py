"""A DMA master: it reads and writes memory and knows nothing of the CPU's cache. That is the whole problem.

And how a driver hands a buffer to it and gets one back, with every cure to be left out: `transmit` and `receive` are correct by
default. Without a step, or on a buffer that shares its lines, they fail in the six documented ways (`CAUSES` in
`labkit.cache.coherence`), each of which needs its adversary: a speculative fill, an eviction, a store to a neighbour while the
transfer runs.
"""

from __future__ import annotations

from collections.abc import Callable

from labkit.cache.cache import Cache
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


def transmit(cache: Cache, dma: Dma, address: int, data: bytes, *, clean: bool = True) -> bytes:
    """The CPU fills a buffer, cleans it, and the DMA sends it. Returns what the device got."""
    cache.write(address, data)
    if clean:
        cache.clean(address, len(data))
    return dma.read(address, len(data)).data


def receive(
    cache: Cache,
    dma: Dma,
    address: int,
    data: bytes,
    *,
    before: str = "invalidate",
    after: str = "invalidate",
    during: Callable[[], object] | None = None,
) -> bytes:
    """The DMA receives `data` into a buffer and the CPU reads it. Returns what the CPU got.

    Args:
        before, after: operation on the buffer before the transfer starts and after it ended: "invalidate", "clean+invalidate",
            "clean" or "none".
        during: what happens between the last byte and the operation after it, such as `lambda: cache.speculate(address)`.
    """
    _operate(cache, before, address, len(data))
    dma.write(address, data)
    if during is not None:
        during()
    _operate(cache, after, address, len(data))
    return cache.load(address, len(data))


def evict(cache: Cache, address: int) -> int:
    """Read other lines of the same set and region until the line of `address` is gone; returns how many reads it took.

    Raises:
        RuntimeError: it is still there after 64 reads per way (tree-PLRU and random replacement need more than one round).
    """
    region, geometry = cache.memory.region(address), cache.geometry
    stride = geometry.sets * geometry.line
    first = region.start + (geometry.line_address(address) - region.start) % stride
    others = [line for line in range(first, region.end, stride) if line != geometry.line_address(address)]
    for n in range(64 * geometry.ways):
        if cache.held(address) is None:
            return n
        if not others:
            break
        cache.read(others[n % len(others)], 1)
    raise RuntimeError(f"the line of {address:#x} is still held after reading {len(others)} other lines of its set")


def _operate(cache: Cache, op: str, address: int, size: int) -> None:
    operations = {"invalidate": cache.invalidate, "clean+invalidate": cache.clean_invalidate, "clean": cache.clean}
    if op == "none":
        return
    if op not in operations:
        raise ValueError(f"no cache operation {op!r}; there are none, {', '.join(operations)}")
    operations[op](address, size)
