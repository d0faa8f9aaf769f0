"""A set-associative cache that holds bytes, so that stale data is visible as data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

from labkit.cache.geometry import DCACHE, Geometry
from labkit.cache.memory import Attribute, Memory
from labkit.cache.policies import Policy, make_policy
from labkit.cache.records import Access, AccessOp, Operation, OperationOp, Record
from labkit.cache.stores import StoreRun

R = TypeVar("R", bound=Record)


@dataclass(slots=True)
class Line:
    """A held line: its address, its bytes, and whether they are newer than memory's. One dirty flag per line, as in the M7."""

    address: int
    data: bytearray
    dirty: bool = False


class Cache:
    """A data cache over a memory; it starts enabled and empty.

    Args:
        memory: what is behind it; its attributes decide what is cached and how.
        geometry: size, ways and line; the Cortex-M7's data cache unless given.
        policy: a name of `labkit.cache.policies.POLICIES` or an object with the four verbs.
        seed: for the policy "random".
        dynamic_read_allocate: stop allocating on stores after three lines written in full (DDI0489 5.9.1; ACTLR.DISRAMODE = 0).
        force_write_through: treat write-back memory as write-through (CACR.FORCEWT).
        shared_write_through: cache shareable memory as write-through instead of not at all (CACR.SIWT).
        log: every record is appended to it, in order.
    """

    def __init__(
        self,
        memory: Memory,
        geometry: Geometry = DCACHE,
        policy: str | Policy = "lru",
        *,
        seed: int = 0,
        dynamic_read_allocate: bool = False,
        force_write_through: bool = False,
        shared_write_through: bool = False,
        log: list[Record] | None = None,
    ) -> None:
        for region in memory.regions:
            if region.start % geometry.line or region.size % geometry.line:
                raise ValueError(f"region {region.name} is no whole number of {geometry.line}-byte lines")
        if geometry.line > 32 and memory.mpu:
            raise ValueError(f"MPU regions with lines of {geometry.line} bytes; with them, lines may have 32 bytes at most")
        self.memory, self.geometry = memory, geometry
        self.policy = make_policy(policy, geometry.sets, geometry.ways, seed) if isinstance(policy, str) else policy
        self.force_write_through, self.shared_write_through = force_write_through, shared_write_through
        self.log: list[Record] = [] if log is None else log
        self.enabled = True
        self._stores = StoreRun(geometry.line) if dynamic_read_allocate else None
        self._sets: list[list[Line | None]] = [[None] * geometry.ways for _ in range(geometry.sets)]
        self._way: dict[int, int] = {}  # line address -> way, for the held lines
        self._number = -1

    def read(self, address: int, size: int) -> tuple[Access, ...]:
        """Load `size` bytes; one record per line touched, whose `data` is what the CPU gets."""
        return self._access("read", address, size, b"")

    def write(self, address: int, data: bytes) -> tuple[Access, ...]:
        """Store bytes; one record per line touched."""
        return self._access("write", address, len(data), bytes(data))

    def modify(self, address: int, data: bytes) -> tuple[Access, ...]:
        """Load and store the same bytes in one access, as tracers count a read-modify-write; the records hold the old bytes."""
        return self._access("modify", address, len(data), bytes(data))

    def load(self, address: int, size: int) -> bytes:
        """`read`, but the bytes only (the records are in the log)."""
        return b"".join(record.data for record in self.read(address, size))

    def speculate(self, address: int) -> Access:
        """Bring a line in without an access, as the Cortex-M7 may at any time (DDI0489 5.2); the adversary of receive drivers."""
        line, bypass = self.geometry.line_address(address), self._bypass(self.memory.attribute(address))
        if bypass:
            return self._log(Access(op="speculate", address=address, line=line, bypass=bypass))
        index, way = self.geometry.set_index(address), self._way.get(line)
        if way is not None:
            return self._log(Access(op="speculate", address=address, line=line, set=index, way=way, hit=True))
        way, victim, written_back = self._fill(line)
        return self._log(
            Access(
                op="speculate",
                address=address,
                line=line,
                set=index,
                way=way,
                filled=True,
                victim=victim,
                written_back=written_back,
            )
        )

    def clean(self, address: int | None = None, size: int | None = None, *, round_size: bool = True) -> Operation:
        """Write dirty lines back and keep them: SCB_CleanDCache, or by address SCB_CleanDCache_by_Addr.

        By address, CMSIS works on whole lines from `address & ~0x1F` over `size + (address & 0x1F)` bytes. With
        `round_size=False` the second correction is left out, as in old versions: the tail of an unaligned buffer is missed.
        """
        return self._maintain("clean", address, size, round_size, write_back=True, drop=False)

    def invalidate(self, address: int | None = None, size: int | None = None, *, round_size: bool = True) -> Operation:
        """Drop lines, dirty or not: SCB_InvalidateDCache and SCB_InvalidateDCache_by_Addr; rounding as in `clean`."""
        return self._maintain("invalidate", address, size, round_size, write_back=False, drop=True)

    def clean_invalidate(self, address: int | None = None, size: int | None = None, *, round_size: bool = True) -> Operation:
        """Write dirty lines back, then drop: SCB_CleanInvalidateDCache and its by-address form; rounding as in `clean`."""
        return self._maintain("clean+invalidate", address, size, round_size, write_back=True, drop=True)

    def enable(self) -> Operation:
        """SCB_EnableDCache: invalidate everything, then switch on; nothing at all if it is on already."""
        operation = self._maintain("enable", None, None, True, write_back=False, drop=not self.enabled)
        self.enabled = True
        return operation

    def disable(self, *, clean: bool = True) -> Operation:
        """SCB_DisableDCache: switch off, then clean and invalidate everything. `clean=False` is the bare register write."""
        self.enabled = False
        return self._maintain("disable", None, None, True, write_back=clean, drop=clean)

    def lines(self) -> Iterator[tuple[int, int, Line]]:
        """The held lines as (set, way, line), set by set."""
        for index, ways in enumerate(self._sets):
            for way, line in enumerate(ways):
                if line is not None:
                    yield index, way, line

    def held(self, address: int) -> Line | None:
        """The line that holds `address`, if the cache has it."""
        line = self.geometry.line_address(address)
        way = self._way.get(line)
        return None if way is None else self._sets[self.geometry.set_index(line)][way]

    def _bypass(self, attribute: Attribute) -> str:
        if not self.enabled:
            return "cache disabled"
        cached = attribute.cacheable and (not attribute.shareable or self.shared_write_through)
        return "" if cached else attribute.name

    def _access(self, op: AccessOp, address: int, size: int, data: bytes) -> tuple[Access, ...]:
        self.memory.check(address, size, write=op != "read")
        length = self.geometry.line
        spans = [(max(address, line), min(address + size, line + length)) for line in self.geometry.span(address, size)]
        if (size not in (1, 2, 4, 8) or address % size) and any(self.memory.attribute(at).device for at, _ in spans):
            raise ValueError(
                f"access of {size} bytes at {address:#x}; device memory takes aligned accesses of 1, 2, 4 or 8 bytes only"
            )
        self._number += 1
        allocate = True
        if self._stores and not self._bypass(self.memory.attribute(address)):
            if op != "write":
                self._stores.load(address, size)
            if op != "read":
                allocate = not self._stores.store(address, size)
        return tuple(self._piece(op, at, end - at, data[at - address : end - address], allocate) for at, end in spans)

    def _piece(self, op: AccessOp, address: int, size: int, data: bytes, allocate: bool) -> Access:
        """The part of an access that lies in one line."""
        attribute, loads, stores = self.memory.attribute(address), op != "write", op != "read"
        line, bypass = self.geometry.line_address(address), self._bypass(attribute)
        if bypass:
            got = self.memory.read(address, size) if loads else data
            if stores:
                self.memory.write(address, data)
            return self._log(
                Access(
                    number=self._number, op=op, address=address, size=size, data=got, line=line, bypass=bypass, to_memory=stores
                )
            )

        index, way = self.geometry.set_index(address), self._way.get(line)
        hit, filled, victim, written_back = way is not None, False, None, False
        if way is not None:
            self.policy.touch(index, way)
        elif loads or (attribute.write_allocate and allocate):
            way, victim, written_back = self._fill(line)
            filled = True
        held = None if way is None else self._sets[index][way]
        span = slice(address - line, address - line + size)
        got = bytes(held.data[span]) if held is not None and loads else data
        to_memory = stores and (held is None or not attribute.write_back or attribute.shareable or self.force_write_through)
        if stores and held is not None:
            held.data[span] = data
            held.dirty |= not to_memory
        if to_memory:
            self.memory.write(address, data)
        return self._log(
            Access(
                number=self._number,
                op=op,
                address=address,
                size=size,
                data=got,
                line=line,
                set=index,
                way=-1 if way is None else way,
                hit=hit,
                filled=filled,
                victim=victim,
                written_back=written_back,
                to_memory=to_memory,
            )
        )

    def _fill(self, line: int) -> tuple[int, int | None, bool]:
        """Fetch a line into its set: the way it got, the line that made room, and whether that was written back."""
        index = self.geometry.set_index(line)
        ways = self._sets[index]
        way = ways.index(None) if None in ways else self.policy.victim(index)
        old = ways[way]
        if old is not None:
            if old.dirty:
                self.memory.write(old.address, bytes(old.data))
            del self._way[old.address]
        ways[way] = Line(line, bytearray(self.memory.read(line, self.geometry.line)))
        self._way[line] = way
        self.policy.fill(index, way)
        return (way, None, False) if old is None else (way, old.address, old.dirty)

    def _maintain(
        self, op: OperationOp, address: int | None, size: int | None, round_size: bool, *, write_back: bool, drop: bool
    ) -> Operation:
        if (address is None) != (size is None) or (size is not None and size < 0) or (address is not None and address < 0):
            raise ValueError(f"{op} with address {address} and size {size}; give both, not below 0, or none for the whole cache")
        lines, neighbours, missed = self._rounded(address, size, round_size)
        written, dropped, lost = [], [], []
        for index, way, held in list(self.lines()):
            if lines is not None and held.address not in lines:
                continue
            if held.dirty and write_back:
                self.memory.write(held.address, bytes(held.data))
                held.dirty = False
                written.append(held.address)
            if drop:
                if held.dirty:
                    lost.append(held.address)
                dropped.append(held.address)
                self._sets[index][way] = None
                del self._way[held.address]
                self.policy.invalidate(index, way)
        return self._log(
            Operation(
                op=op,
                address=address,
                size=size,
                lines=lines,
                neighbours=neighbours,
                missed=missed,
                written_back=tuple(written),
                dropped=tuple(dropped),
                lost=tuple(lost),
            )
        )

    def _rounded(
        self, address: int | None, size: int | None, round_size: bool
    ) -> tuple[range | None, tuple[tuple[int, int], ...], tuple[int, int] | None]:
        """The lines an operation works on (None: all), the bytes in them that were not asked for, and the tail it misses."""
        if address is None or size is None:
            return None, (), None
        length = self.geometry.line
        start, end = self.geometry.line_address(address), address + size
        span = size + address % length if round_size and size else size
        lines = range(start, start + span, length)
        stop = start + len(lines) * length
        ranges = ((start, address - start), (end, stop - end))
        return lines, tuple(r for r in ranges if size and r[1] > 0), (stop, end - stop) if end > stop else None

    def _log(self, record: R) -> R:
        self.log.append(record)
        return record
