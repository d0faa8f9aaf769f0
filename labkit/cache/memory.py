"""Memory behind the cache: bytes, the map that says where they are, and the attributes that say how they are cached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from labkit.cache.geometry import is_power_of_two

MOST_BYTES = 256 * 1024 * 1024  # of a region: its bytes are kept, all of them, from the first access on
_GRAIN = 32  # bytes; the smallest MPU region, so attributes change on multiples of it only


@dataclass(frozen=True)
class Attribute:
    """How a memory may be cached (Armv7-M memory types).

    Attributes:
        name: the type as the manuals call it.
        cacheable: read-allocate; every cacheable memory is (DDI0489 5.9).
        write_back: a store stays in its line until that is written back; otherwise it goes to memory as well.
        write_allocate: a store that misses fetches the line; otherwise it goes to memory only.
        device: reads and writes have effects, so they are never cached or speculated and must be aligned.
        shareable: another master sees it; the Cortex-M7 then does not cache it (CACR.SIWT = 0).
    """

    name: str
    cacheable: bool = False
    write_back: bool = False
    write_allocate: bool = False
    device: bool = False
    shareable: bool = False


WRITE_BACK = Attribute("write-back, write-allocate", True, True, True)
WRITE_BACK_NO_ALLOCATE = Attribute("write-back, no write-allocate", True, True, False)
WRITE_THROUGH = Attribute("write-through, no write-allocate", True, False, False)
NON_CACHEABLE = Attribute("non-cacheable")
TCM = Attribute("TCM, never cached")
DEVICE = Attribute("device", device=True, shareable=True)
STRONGLY_ORDERED = Attribute("strongly ordered", device=True, shareable=True)

_ENCODING = {  # (TEX, C, B) as in the table of MPU_RASR encodings, DUI0646
    (0, 0, 0): STRONGLY_ORDERED,
    (0, 0, 1): DEVICE,
    (0, 1, 0): WRITE_THROUGH,
    (0, 1, 1): WRITE_BACK_NO_ALLOCATE,
    (1, 0, 0): NON_CACHEABLE,
    (1, 1, 1): WRITE_BACK,
    (2, 0, 0): Attribute("device", device=True),
}


@dataclass(frozen=True)
class Region:
    """A piece of the memory map: `size` bytes from `start`; `interface` names the bus, `dma` says if a DMA master reaches it."""

    name: str
    start: int
    size: int
    attribute: Attribute
    interface: str = "AXI"
    writable: bool = True
    dma: bool = True

    def __post_init__(self) -> None:
        if self.start < 0 or self.size <= 0 or self.start % _GRAIN or self.size % _GRAIN:
            raise ValueError(
                f"region {self.name} at {self.start:#x} with {self.size} bytes; "
                f"start and size must be multiples of {_GRAIN}, the size above 0"
            )
        if self.size > MOST_BYTES:
            raise ValueError(f"region {self.name} has {self.size} bytes; a region has {MOST_BYTES} at most")

    @property
    def end(self) -> int:
        """First address behind the region."""
        return self.start + self.size


@dataclass(frozen=True)
class MpuRegion:
    """One region of the memory protection unit: an override of the default attributes (Armv7-M; subregions left out).

    Where regions overlap, the one with the higher number wins.

    Raises:
        ValueError: number not in 0..7, size no power of two or below 32, base not a multiple of the size, or an encoding of
            TEX, C and B that is reserved or not modelled.
    """

    number: int
    base: int
    size: int
    tex: int
    c: int
    b: int
    s: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.number <= 7:
            raise ValueError(f"MPU region number {self.number}; the STM32F767 has regions 0 to 7")
        if not is_power_of_two(self.size) or self.size < 32:
            raise ValueError(f"MPU region {self.number} has {self.size} bytes; the size must be a power of two, 32 or more")
        if self.base % self.size:
            raise ValueError(
                f"MPU region {self.number} starts at {self.base:#x}; it must be aligned to its size of {self.size} bytes"
            )
        if (self.tex, self.c, self.b) not in _ENCODING:
            raise ValueError(
                f"MPU region {self.number} has TEX {self.tex}, C {self.c}, B {self.b}; "
                f"allowed are {', '.join(map(str, _ENCODING))}"
            )

    @property
    def attribute(self) -> Attribute:
        """The memory type that TEX, C, B and S encode; S counts for normal memory only."""
        kind = _ENCODING[self.tex, self.c, self.b]
        if kind.device or not self.s:
            return kind
        return Attribute(f"{kind.name}, shareable", kind.cacheable, kind.write_back, kind.write_allocate, shareable=True)


@dataclass
class Memory:
    """Bytes at addresses, all 0 at first. The map is fixed; only the bytes change.

    Args:
        regions: the memory map, without overlaps.
        mpu: overrides of the regions' attributes.
    """

    regions: Sequence[Region]
    mpu: Sequence[MpuRegion] = ()
    _bytes: dict[str, bytearray] = field(default_factory=dict, repr=False)
    _memo: dict[int, tuple[Region, Attribute]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        ordered = sorted(self.regions, key=lambda region: region.start)
        for low, high in pairwise(ordered):
            if high.start < low.end:
                raise ValueError(f"regions {low.name} and {high.name} overlap at {high.start:#x}")
        numbers = [region.number for region in self.mpu]
        if len(set(numbers)) < len(numbers):
            raise ValueError(f"MPU regions are numbered {numbers}; each number may be used once")

    @classmethod
    def flat(cls, size: int, attribute: Attribute = WRITE_BACK) -> Memory:
        """One region of `size` bytes at address 0, for the study of access patterns."""
        return cls([Region("memory", 0, size, attribute)])

    def _where(self, address: int) -> tuple[Region, Attribute]:
        found = self._memo.get(address // _GRAIN)
        if found is None:
            region = next((r for r in self.regions if r.start <= address < r.end), None)
            if region is None:
                known = ", ".join(f"{r.name} {r.start:#x}..{r.end - 1:#x}" for r in self.regions)
                raise ValueError(f"address {address:#x} lies outside the memory map ({known})")
            over = [m for m in self.mpu if m.base <= address < m.base + m.size]
            # TCM accesses never reach the cache, whatever the MPU says (DDI0489 5.9)
            changed = over and region.attribute is not TCM
            found = region, max(over, key=lambda m: m.number).attribute if changed else region.attribute
            self._memo[address // _GRAIN] = found
        return found

    def region(self, address: int) -> Region:
        """The region that holds `address`; ValueError outside the map."""
        return self._where(address)[0]

    def attribute(self, address: int) -> Attribute:
        """The attribute in force at `address`: the MPU's if it covers it, else the region's; ValueError outside the map."""
        return self._where(address)[1]

    def check(self, address: int, size: int, *, write: bool = False, dma: bool = False) -> None:
        """ValueError unless every byte lies in the map and, as asked, may be written and reached by a DMA master."""
        if size < 1:
            raise ValueError(f"access of {size} bytes at {address:#x}; at least 1 byte is needed")
        at = address
        while at < address + size:
            region = self.region(at)
            if write and not region.writable:
                raise ValueError(f"store to {at:#x} in {region.name}; flash is programmed by its controller, not by stores")
            if dma and not region.dma:
                raise ValueError(f"DMA access to {at:#x} in {region.name}; only the CPU reaches that memory")
            at = region.end

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes from `address`, as they stand in memory."""
        self.check(address, size)
        region, store = self._store(address)
        offset = address - region.start
        data = bytes(store[offset : offset + size])
        return data if len(data) == size else data + self.read(region.end, size - len(data))

    def write(self, address: int, data: bytes) -> None:
        """Put bytes into memory, past every cache; how a debugger loads a program, so flash takes them too."""
        self.check(address, len(data))
        region, store = self._store(address)
        fits = min(len(data), region.end - address)
        offset = address - region.start
        store[offset : offset + fits] = data[:fits]
        if fits < len(data):
            self.write(region.end, data[fits:])

    def _store(self, address: int) -> tuple[Region, bytearray]:
        region = self.region(address)
        if region.name not in self._bytes:
            self._bytes[region.name] = bytearray(region.size)
        return region, self._bytes[region.name]
