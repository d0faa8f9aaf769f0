"""From counts to time: the same run in cycles and microseconds, with and without caches, over AXI or ITCM.

The hits and misses come from the functional model; this module only prices them. Every price is a parameter, because the
manuals give few of them (RM0410: flash wait states) and published run times identify only the ratio of two totals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from labkit.cache.memory import Memory
from labkit.cache.records import Access, Operation, Record

#: Flash wait states of the STM32F767 (RM0410): supply from (mV), highest clock (MHz), MHz per wait state.
FLASH = ((2700, 216, 30), (2400, 216, 24), (2100, 216, 22), (1800, 180, 20))
SUPPLY = (1800, 3600)  # mV
PATHS = ("axi", "itcm")


def wait_states(hz: int, millivolts: int = 3300) -> int:
    """Flash wait states at a clock of `hz` and a supply of `millivolts`; one more than that is a flash read in cycles.

    Raises:
        ValueError: the supply is outside 1800..3600 mV or the clock above what it allows.
    """
    if not SUPPLY[0] <= millivolts <= SUPPLY[1]:
        raise ValueError(f"supply of {millivolts} mV; the STM32F767 runs on {SUPPLY[0]} to {SUPPLY[1]} mV")
    top, step = next((top, step) for lowest, top, step in FLASH if millivolts >= lowest)
    if not 0 < hz <= top * 1_000_000:
        raise ValueError(f"clock of {hz} Hz at {millivolts} mV; allowed is 1 Hz to {top} MHz")
    return (hz - 1) // (step * 1_000_000)


@dataclass(frozen=True)
class Timing:
    """Prices in CPU cycles. Only the wait states are known; the rest are assumptions to vary.

    Attributes:
        hz, millivolts: give the wait states.
        per_instruction: cycles per instruction when nothing has to be waited for (c).
        overhead: cycles that the AXI bus adds to a flash read (o), 1 to 3.
        line_beats: further cycles of a line fill from flash: 32 bytes are four beats of 64 bits.
        uncached_data: cycles of a load or store that bypasses the data cache (p_D).
        data_fill: stall of a line fill of the data cache (L_D); less than the whole fill, as the wanted word comes first.
        write_back: stall of writing a dirty line back. store: stall of a store that goes to memory; 0 with a store buffer.
        art_hits: share of the fetches over ITCM that the ART accelerator serves without wait states; 0 is accelerator off.
    """

    hz: int = 216_000_000
    millivolts: int = 3300
    per_instruction: float = 1.0
    overhead: int = 2
    line_beats: int = 3
    uncached_data: int = 6
    data_fill: int = 12
    write_back: int = 0
    store: int = 0
    art_hits: float = 0.0

    def __post_init__(self) -> None:
        wait_states(self.hz, self.millivolts)
        for name in ("per_instruction", "overhead", "line_beats", "uncached_data", "data_fill", "write_back", "store"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is {getattr(self, name)} cycles; it cannot be below 0")
        if not 0 <= self.art_hits <= 1:
            raise ValueError(f"art_hits is {self.art_hits}; it is a share from 0 to 1")

    @property
    def flash_read(self) -> int:
        """Cycles of a flash read over AXI: 1 + wait states + overhead."""
        return 1 + wait_states(self.hz, self.millivolts) + self.overhead


@dataclass(frozen=True)
class Work:
    """What a piece of program asks of the memory system.

    Attributes:
        instructions: executed (N). fetches: 64-bit reads of code (F), about 0.41 to 0.56 per instruction.
        data: loads and stores (D) to cacheable memory.
        code_fills: line fills of the instruction cache (M_I). data_fills: of the data cache (M_D).
        write_backs: of the data cache. stores_to_memory: stores that go past it while it is on.
        uncached: accesses that bypass the data cache even while it is on (device, non-cacheable).
        insensitive: cycles that no cache changes (kappa), such as polling a peripheral.
    """

    instructions: int
    fetches: int
    data: int = 0
    code_fills: int = 0
    data_fills: int = 0
    write_backs: int = 0
    stores_to_memory: int = 0
    uncached: int = 0
    insensitive: int = 0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is {getattr(self, name)}; it cannot be below 0")

    @classmethod
    def of_counts(
        cls,
        data: Mapping[str, int],
        *,
        instructions: int,
        fetches: int,
        code_fills: int = 0,
        uncached: int = 0,
        insensitive: int = 0,
    ) -> Work:
        """Work whose data side is the counts of `count_trace` or of the fold `counts`."""
        return cls(
            instructions=instructions,
            fetches=fetches,
            data=data["lines_touched"],
            code_fills=code_fills,
            data_fills=data["fills"],
            write_backs=data["write_backs"],
            stores_to_memory=data["stores_to_memory"],
            uncached=uncached,
            insensitive=insensitive,
        )


@dataclass(frozen=True)
class Cost:
    """Where the cycles of a run go; `total` is their sum, `microseconds` that at the clock of the timing."""

    compute: int
    code: int
    data: int
    insensitive: int
    hz: int

    @property
    def total(self) -> int:
        return self.compute + self.code + self.data + self.insensitive

    @property
    def microseconds(self) -> float:
        return self.total / self.hz * 1e6


def run_cost(work: Work, timing: Timing = Timing(), *, icache: bool = True, dcache: bool = True, path: str = "axi") -> Cost:
    """Cycles of a run; each part is rounded to whole cycles.

        off: N c + F (1 + WS + o) + D p_D + kappa        on: N c + M_I (1 + WS + o + 3) + M_D L_D + kappa

    Over ITCM the instruction cache serves nothing: F (1 + WS (1 - art_hits)), without bus overhead.

    Raises:
        ValueError: an unknown path.
    """
    if path not in PATHS:
        raise ValueError(f"no path {path!r} to the flash; there are {', '.join(PATHS)}")
    if path == "itcm":
        code = round(work.fetches * (1 + wait_states(timing.hz, timing.millivolts) * (1 - timing.art_hits)))
    elif icache:
        code = work.code_fills * (timing.flash_read + timing.line_beats)
    else:
        code = work.fetches * timing.flash_read
    data = (work.data + work.uncached) * timing.uncached_data
    if dcache:
        data = (
            work.data_fills * timing.data_fill
            + work.write_backs * timing.write_back
            + work.stores_to_memory * timing.store
            + work.uncached * timing.uncached_data
        )
    return Cost(round(work.instructions * timing.per_instruction), code, data, work.insensitive, timing.hz)


def speed_up(work: Work, timing: Timing = Timing(), *, path: str = "axi") -> float:
    """Time without caches over time with both; all that published run times identify."""
    with_caches = run_cost(work, timing, path=path).total
    if not with_caches:
        raise ValueError("work that takes 0 cycles with caches has no speed-up; give it instructions")
    return run_cost(work, timing, icache=False, dcache=False, path=path).total / with_caches


def data_cycles(records: Iterable[Record], memory: Memory, timing: Timing = Timing()) -> int:
    """Stall cycles of the data side of a log: fills, write-backs, stores to memory and uncached accesses; TCM costs nothing."""
    total = 0
    for record in records:
        if isinstance(record, Operation):
            total += len(record.written_back) * timing.write_back
        if not isinstance(record, Access):
            continue
        total += record.filled * timing.data_fill + record.written_back * timing.write_back
        if record.bypass and record.op != "speculate":
            total += 0 if "TCM" in memory.region(record.address).interface else timing.uncached_data
        elif record.to_memory:
            total += timing.store
    return total
