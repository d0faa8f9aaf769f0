"""Cache operations with CMSIS semantics, and the memory map they work over."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labkit.cache import SOURCE1_MPU, Cache, Dma, Geometry, Memory, MpuRegion, Region, counts, data_of, stm32f767, timeline
from labkit.cache.dma import evict
from labkit.cache.memory import NON_CACHEABLE, WRITE_BACK, WRITE_THROUGH

SRAM = 0x2002_0000


@pytest.fixture
def cache():
    return Cache(stm32f767())


def test_by_address_rounds_down_and_out_and_says_so(cache):
    cache.write(SRAM, bytes(range(128)))
    done = cache.clean(SRAM + 0x1E, 40)  # 0x1E .. 0x46: lines 0, 1 and 2
    assert (done.lines, done.written_back) == (range(SRAM, SRAM + 70, 32), (SRAM, SRAM + 32, SRAM + 64))
    assert done.neighbours == ((SRAM, 0x1E), (SRAM + 0x46, 96 - 0x46))
    assert done.missed is None


def test_without_the_size_rounding_the_tail_is_missed(cache):
    cache.write(SRAM, b"\xaa" * 64)
    done = cache.clean(SRAM + 16, 32, round_size=False)  # 16 .. 48 needs two lines, 32 bytes make one
    assert (done.written_back, done.missed) == ((SRAM,), (SRAM + 32, 16))
    assert cache.memory.read(SRAM + 16, 32) == b"\xaa" * 16 + bytes(16)


@given(st.integers(0, 500), st.integers(1, 300))
def test_by_address_covers_exactly_the_lines_of_the_buffer(address, size):
    done = Cache(Memory.flat(1024)).clean(address, size)
    assert set(done.lines) == {(address + n) // 32 * 32 for n in range(size)}
    assert sum(length for _, length in done.neighbours) == len(done.lines) * 32 - size
    assert done.missed is None


def test_nothing_is_done_for_size_zero(cache):
    cache.write(SRAM, b"x")
    assert (cache.clean(SRAM, 0).lines, cache.clean(SRAM, 0).written_back) == (range(SRAM, SRAM, 32), ())


def test_clean_keeps_invalidate_drops_and_loses(cache):
    cache.write(SRAM, b"mine")
    assert cache.clean().written_back == (SRAM,)
    assert cache.read(SRAM, 4)[0].hit
    cache.write(SRAM, b"lost")
    dropped = cache.invalidate()
    assert (dropped.dropped, dropped.lost, dropped.written_back) == ((SRAM,), (SRAM,), ())
    assert cache.load(SRAM, 4) == b"mine"
    cache.write(SRAM, b"kept")
    done = cache.clean_invalidate()
    assert (done.written_back, done.dropped, done.lost) == ((SRAM,), (SRAM,), ())
    assert cache.memory.read(SRAM, 4) == b"kept"


def test_enable_invalidates_and_disable_cleans(cache):
    cache.write(SRAM, b"data")
    assert cache.enable().dropped == ()  # already on
    assert cache.disable().written_back == (SRAM,)
    (record,) = cache.read(SRAM, 4)
    assert (record.data, record.bypass, record.way) == (b"data", "cache disabled", -1)
    cache.enable()
    assert not cache.read(SRAM, 4)[0].hit


def test_one_access_tells_its_whole_story():
    cache = Cache(Memory.flat(4096), Geometry(64, 1, 32))
    cache.write(0, b"abcd")
    (record,) = cache.read(64, 2)
    assert (record.set, record.way, record.hit, record.filled, record.victim, record.written_back) == (0, 0, False, True, 0, True)
    assert cache.memory.read(0, 4) == b"abcd"
    first, second = cache.read(94, 4)
    assert (first.line, first.size, second.line, second.size, first.number == second.number) == (64, 2, 96, 2, True)
    assert data_of([first, second]) == bytes(4)


def test_timeline_has_a_column_per_field():
    cache = Cache(Memory.flat(4096), Geometry(64, 1, 32))
    cache.write(0, b"abcd")
    cache.speculate(64)
    columns = timeline(cache.log)
    assert columns["op"].tolist() == ["write", "speculate"]
    assert columns["victim"].tolist() == [-1, 0]
    assert columns["written_back"].tolist() == [False, True]
    assert counts(cache.log)["write_backs"] == 1
    assert len(timeline([])["hit"]) == 0


def test_attributes_of_the_stm32f767():
    memory = stm32f767(SOURCE1_MPU)
    assert memory.attribute(0x2000_0000).cacheable is False  # DTCM
    assert memory.attribute(0x0800_0000) == WRITE_THROUGH
    assert memory.attribute(0x2002_0000) == WRITE_BACK
    assert memory.attribute(0x2007_C000).device  # region 2 of source 1: TEX 0, C 0, B 1
    assert memory.attribute(0x2007_C200) == WRITE_BACK
    with pytest.raises(ValueError, match="0x30004000 lies outside the memory map"):
        memory.attribute(SOURCE1_MPU[0].base)  # region 1 protects nothing on this chip


def test_the_higher_mpu_number_wins_and_tcm_stays_tcm():
    low = MpuRegion(1, SRAM, 1024, tex=0, c=1, b=0)
    memory = stm32f767([MpuRegion(5, SRAM + 512, 512, tex=1, c=0, b=0), low, MpuRegion(6, 0x2000_0000, 4096, tex=1, c=1, b=1)])
    assert memory.attribute(SRAM) == WRITE_THROUGH
    assert memory.attribute(SRAM + 512) == NON_CACHEABLE
    assert "TCM" in memory.attribute(0x2000_0000).name


def test_write_through_reaches_memory_at_once_and_does_not_allocate():
    cache = Cache(Memory.flat(1024, WRITE_THROUGH))
    (record,) = cache.write(0, b"abcd")
    assert (record.way, record.to_memory, cache.memory.read(0, 4)) == (-1, True, b"abcd")
    cache.read(0, 4)
    cache.write(0, b"efgh")
    assert cache.load(0, 4) == cache.memory.read(0, 4) == b"efgh"


def test_shareable_memory_is_not_cached_unless_siwt():
    shared = [MpuRegion(0, SRAM, 1024, tex=1, c=1, b=1, s=1)]
    assert Cache(stm32f767(shared)).read(SRAM, 4)[0].bypass == "write-back, write-allocate, shareable"
    cache = Cache(stm32f767(shared), shared_write_through=True)
    assert cache.read(SRAM, 4)[0].filled
    assert cache.write(SRAM, b"1234")[0].to_memory


@pytest.mark.parametrize(
    ("do", "says"),
    [
        (lambda c: c.read(0x2008_0000, 4), "address 0x20080000 lies outside the memory map"),
        (lambda c: c.read(0x2007_FFFE, 4), "address 0x20080000 lies outside the memory map"),
        (lambda c: c.read(-4, 4), "address -0x4 lies outside the memory map"),
        (lambda c: c.read(SRAM, 0), "access of 0 bytes at 0x20020000; at least 1 byte is needed"),
        (lambda c: c.read(SRAM, 1 << 40), "lies outside the memory map"),
        (lambda c: c.write(SRAM, b""), "access of 0 bytes at 0x20020000; at least 1 byte is needed"),
        (lambda c: c.write(0x0800_0000, b"x"), "store to 0x8000000 in FLASH-AXIM; flash is programmed by its controller"),
        (lambda c: c.read(0x4000_0002, 4), "access of 4 bytes at 0x40000002; device memory takes aligned accesses"),
        (lambda c: c.read(0x4000_0000, 3), "access of 3 bytes at 0x40000000; device memory takes aligned accesses"),
        (lambda c: c.speculate(0x3000_0000), "address 0x30000000 lies outside the memory map"),
        (lambda c: c.clean(SRAM), "clean with address 537001984 and size None; give both"),
        (lambda c: c.invalidate(SRAM, -1), "invalidate with address 537001984 and size -1; give both, not below 0"),
        (lambda c: Dma(c.memory).read(0x0000_0000, 4), "DMA access to 0x0 in ITCM-RAM; only the CPU reaches that memory"),
        (lambda c: Dma(c.memory).write(0x0800_0000, b"x"), "store to 0x8000000 in FLASH-AXIM"),
        (lambda c: Dma(c.memory, width=4).read(SRAM + 2, 4), "address and size must be multiples of its width, 4 bytes"),
        (lambda c: Dma(c.memory, width=3), "DMA width is 3 bytes; allowed are 1, 2 and 4"),
        (lambda c: MpuRegion(8, 0, 32, 0, 0, 0), "MPU region number 8; the STM32F767 has regions 0 to 7"),
        (lambda c: MpuRegion(0, 0, 48, 0, 0, 0), "MPU region 0 has 48 bytes; the size must be a power of two, 32 or more"),
        (lambda c: MpuRegion(0, 0x2002_0020, 64, 0, 0, 0), "0 starts at 0x20020020; it must be aligned to its size of 64 bytes"),
        (lambda c: MpuRegion(0, 0, 32, 1, 0, 1), "MPU region 0 has TEX 1, C 0, B 1; allowed are"),
        (
            lambda c: stm32f767([MpuRegion(1, 0, 32, 0, 0, 0)] * 2),
            "MPU regions are numbered [1, 1]; each number may be used once",
        ),
        (lambda c: Memory([Region("a", 0, 64, WRITE_BACK), Region("b", 32, 64, WRITE_BACK)]), "regions a and b overlap at 0x20"),
        (lambda c: Region("a", 8, 64, WRITE_BACK), "region a at 0x8 with 64 bytes; start and size must be multiples of 32"),
        (lambda c: Memory.flat(1 << 40), "region memory has 1099511627776 bytes; a region has 268435456 at most"),
        (lambda c: Cache(Memory.flat(96), Geometry(256, 2, 64)), "region memory is no whole number of 64-byte lines"),
        (lambda c: Cache(c.memory, policy="mru"), "no replacement policy 'mru'; there are lru, plru, fifo, random"),
        (lambda c: Cache(Memory.flat(1 << 12), Geometry(256, 2, 64)).memory.flat(0), "region memory at 0x0 with 0 bytes"),
    ],
)
def test_bad_input_gets_one_clear_sentence(cache, do, says):
    with pytest.raises(ValueError) as error:
        do(cache)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_refused_access_changes_nothing(cache):
    with pytest.raises(ValueError):
        cache.write(0x2007_FFF0, bytes(64))
    assert not cache.log
    assert not list(cache.lines())


@pytest.mark.parametrize("policy", ["lru", "plru", "fifo", "random"])
def test_evict_gets_any_line_out(policy):
    cache = Cache(stm32f767(), policy=policy)
    cache.write(SRAM, b"dirty")
    evict(cache, SRAM)
    assert cache.held(SRAM) is None
    assert cache.memory.read(SRAM, 5) == b"dirty"


def test_evict_says_when_it_cannot():
    cache = Cache(Memory.flat(4096))
    cache.read(0, 4)
    with pytest.raises(RuntimeError, match="still held after reading 0 other lines"):
        evict(cache, 0)
