"""The memory that tasks and objects are made from, by the rules of FreeRTOS's heap_4: first fit, and free neighbours join.

A block is what was asked for and a header, rounded up to the alignment. Of the free blocks, in order of address, the first that
is large enough is taken; what is left of it stays free if it is larger than two headers, and else goes along. A block that is
given back joins the free ones before and behind it. An end marker of one header is never given out. Addresses count from 0.
"""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass

from labkit.kernel.checks import whole

POINTER = 4  #: bytes of one, which is what a queue set holds


@dataclass(frozen=True)
class Sizes:
    """What the kernel asks for, in bytes; they depend on port and configuration, so say yours.

    Attributes:
        word: of the stack, which a task has so many of as `Kernel.task` says.
        task, queue, event_group, buffer, timer: the kernel's record of one; a semaphore or mutex is a queue without items.
        command: of the timer task's queue.
        idle_stack, timer_stack: words of the two tasks of the kernel's own.
    """

    word: int = 4
    task: int = 96
    queue: int = 80
    event_group: int = 28
    buffer: int = 36
    timer: int = 44
    command: int = 16
    idle_stack: int = 128
    timer_stack: int = 256

    def __post_init__(self) -> None:
        for name, size in vars(self).items():
            whole(size, 0, f"the size of {name} is", " bytes")


class Heap:
    """A heap of `size` bytes with blocks as above.

    Attributes:
        free: bytes in free blocks, headers included, as xPortGetFreeHeapSize says; `least`: the fewest there ever were.
        sizes: what tasks and objects ask for.
    """

    def __init__(self, size: int, alignment: int = 8, header: int = 8, sizes: Sizes | None = None):
        self.alignment = whole(alignment, 1, "a heap with blocks aligned to", " bytes", 4096)
        if self.alignment & (self.alignment - 1):
            raise ValueError(f"a heap with blocks aligned to {alignment} bytes; a power of two is allowed")
        self.header = self._up(whole(header, 1, "a heap with headers of", " bytes", 4096))
        size = whole(size, 3 * self.header, "a heap of", " bytes", 1 << 32)
        self.sizes = sizes or Sizes()
        self.free = self.least = (size - self.header) // self.alignment * self.alignment
        self._gaps: list[tuple[int, int]] = [(0, self.free)]  # (address, bytes) of free blocks, in order
        self._used: dict[int, int] = {}

    def _up(self, size: int) -> int:
        return -(-size // self.alignment) * self.alignment

    def allocate(self, size: int) -> int | None:
        """The address of a block for `size` bytes; None if no free block is large enough, or for 0 bytes."""
        wanted = self._up(whole(size, 0, "allocate", " bytes") + self.header)
        if not size:
            return None
        at = next((at for at, (_, length) in enumerate(self._gaps) if length >= wanted), None)
        if at is None:
            return None
        address, length = self._gaps[at]
        if length - wanted > 2 * self.header:
            self._gaps[at] = address + wanted, length - wanted
        else:
            wanted = length
            del self._gaps[at]
        self._used[address] = wanted
        self.free -= wanted
        self.least = min(self.least, self.free)
        return address

    def give_back(self, address: int) -> int:
        """Free a block and return its size with header; ValueError if there is none at that address."""
        if address not in self._used:
            raise ValueError(f"free at address {address!r}, where no block is; an address that allocate has returned is allowed")
        length = self._used.pop(address)
        self.free += length
        at = bisect(self._gaps, (address, length))
        self._gaps.insert(at, (address, length))
        self._join(at)
        if at:
            self._join(at - 1)
        return length

    def _join(self, at: int) -> None:
        """One free block of two if they touch."""
        if at + 1 < len(self._gaps):
            (address, length), (behind, more) = self._gaps[at : at + 2]
            if address + length == behind:
                self._gaps[at : at + 2] = [(address, length + more)]

    @property
    def largest(self) -> int:
        """The largest free block, header included."""
        return max((length for _, length in self._gaps), default=0)

    @property
    def blocks(self) -> int:
        """How many free blocks there are."""
        return len(self._gaps)
