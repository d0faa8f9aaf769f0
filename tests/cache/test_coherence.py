"""The six failures between a cache and a DMA master, each reachable, each cured."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.cache import DCACHE, Cache, Dma, MpuRegion, stm32f767
from labkit.cache.coherence import CAUSES, violations
from labkit.cache.dma import evict, receive, transmit
from labkit.cache.policies import POLICIES

BUFFER = 0x2002_0100  # in SRAM1, on a line
OLD, NEW = b"old frame.......", b"NEW FRAME!!!!!!!"
NON_CACHEABLE = (MpuRegion(0, 0x2002_0000, 4096, tex=1, c=0, b=0),)


def bench(mpu=(), policy="lru"):
    cache = Cache(stm32f767(mpu), policy=policy)
    return cache, Dma(cache.memory, cache.log)


def causes(cache):
    return {v.cause for v in violations(cache.log)}


def test_transmit_without_clean_sends_what_memory_held():
    cache, dma = bench()
    assert transmit(cache, dma, BUFFER, NEW, clean=False) == bytes(16)  # zeros, like the client_key of source 1
    assert causes(cache) == {"transmit without clean"}


def test_receive_without_invalidate_reads_the_old_line():
    cache, dma = bench()
    cache.memory.write(BUFFER, OLD)
    cache.read(BUFFER, 16)
    assert receive(cache, dma, BUFFER, NEW, before="none", after="none") == OLD
    assert causes(cache) == {"receive without invalidate"}


def test_invalidate_before_only_is_undone_by_a_speculative_fill():
    cache, dma = bench()
    cache.memory.write(BUFFER, OLD)
    cache.read(BUFFER, 16)
    cache.invalidate(BUFFER, 16)
    cache.speculate(BUFFER)
    assert receive(cache, dma, BUFFER, NEW, before="none", after="none") == OLD
    assert causes(cache) == {"speculative fill"}


def test_invalidate_after_only_comes_too_late_for_a_dirty_eviction():
    cache, dma = bench()
    cache.write(BUFFER, OLD)
    assert receive(cache, dma, BUFFER, NEW, before="none", during=lambda: evict(cache, BUFFER)) == OLD
    assert causes(cache) == {"dirty eviction"}


def test_invalidate_of_a_shared_line_destroys_the_neighbour():
    cache, dma = bench()
    assert receive(cache, dma, BUFFER + 16, NEW, during=lambda: cache.write(BUFFER, b"neighbour")) == NEW
    assert cache.load(BUFFER, 9) == bytes(9)
    assert causes(cache) == {"invalidate hit a dirty neighbour"}


def test_clean_invalidate_of_a_shared_line_destroys_what_the_dma_wrote():
    cache, dma = bench()
    cache.memory.write(BUFFER + 16, OLD)
    cache.write(BUFFER, b"neighbour")  # dirty, and holds the old buffer too
    got = receive(cache, dma, BUFFER + 16, NEW, before="none", after="clean+invalidate")
    assert got == OLD
    assert cache.load(BUFFER, 9) == b"neighbour"
    assert causes(cache) == {"clean overwrote the DMA"}


def test_clean_cures_transmit():
    cache, dma = bench()
    assert transmit(cache, dma, BUFFER, NEW) == NEW
    assert not violations(cache.log)


@pytest.mark.parametrize("adversary", ["nothing", "speculate", "evict"])
def test_invalidate_before_and_after_on_whole_lines_cures_receive(adversary):
    cache, dma = bench()
    cache.write(BUFFER, OLD * 2)
    act = {"nothing": None, "speculate": lambda: cache.speculate(BUFFER), "evict": lambda: evict(cache, BUFFER)}[adversary]
    assert receive(cache, dma, BUFFER, NEW * 2, during=act) == NEW * 2
    assert not violations(cache.log)


def test_a_non_cacheable_mpu_region_cures_everything_without_any_operation():
    cache, dma = bench(NON_CACHEABLE)
    cache.write(BUFFER, OLD)
    assert transmit(cache, dma, BUFFER, NEW, clean=False) == NEW
    cache.speculate(BUFFER)
    assert receive(cache, dma, BUFFER, OLD, before="none", after="none") == OLD
    got = receive(cache, dma, BUFFER + 16, NEW, before="none", after="none", during=lambda: cache.write(BUFFER, b"neighbour"))
    assert (got, cache.load(BUFFER, 9)) == (NEW, b"neighbour")
    assert not violations(cache.log)


def test_alignment_cures_the_neighbour():
    cache, dma = bench()
    neighbour = BUFFER + 32
    assert receive(cache, dma, BUFFER, NEW * 2, during=lambda: cache.write(neighbour, b"neighbour")) == NEW * 2
    assert cache.load(neighbour, 9) == b"neighbour"
    assert not violations(cache.log)


def test_dtcm_hides_every_failure():
    cache, dma = bench()
    assert transmit(cache, dma, 0x2000_0000, NEW, clean=False) == NEW
    assert receive(cache, dma, 0x2000_0000, OLD, before="none", after="none") == OLD
    assert not violations(cache.log)


def test_switching_the_cache_off_with_dirty_lines_loses_sight_of_them():
    cache, _ = bench()
    cache.write(BUFFER, NEW)
    cache.disable(clean=False)
    assert cache.load(BUFFER, 16) == bytes(16)
    assert causes(cache) == {"disabled while dirty"}


def test_a_violation_says_who_read_what_and_why():
    cache, dma = bench()
    transmit(cache, dma, BUFFER + 4, b"abcd", clean=False)
    (found,) = violations(cache.log)
    assert (found.index, found.reader, found.address, found.size) == (1, "DMA", BUFFER + 4, 4)
    cause = "transmit without clean"
    assert str(found) == f"DMA read 4 stale bytes at 0x20020104 (record 1), {cause}: {CAUSES[cause]}"


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["transmit", "receive", "touch", "speculate", "evict"]),
            st.integers(0, 3),
            st.binary(min_size=1, max_size=64),
        ),
        max_size=25,
    ),
    st.sampled_from(sorted(POLICIES)),
)
@settings(max_examples=60, deadline=None)
def test_correct_drivers_on_whole_lines_never_fail_whatever_speculation_and_eviction_do(steps, policy):
    cache, dma = bench(policy=policy)
    buffer = lambda n: BUFFER + n * 2 * DCACHE.line  # noqa: E731  two lines each
    for step, n, data in steps:
        if step == "transmit":
            assert transmit(cache, dma, buffer(n), data) == data
        elif step == "receive":
            assert receive(cache, dma, buffer(n), data, during=lambda n=n: cache.speculate(buffer(n))) == data
        elif step == "touch":
            cache.write(buffer(n), data)
        elif step == "speculate":
            cache.speculate(buffer(n))
        else:
            evict(cache, buffer(n))
    assert not violations(cache.log)


def test_an_unknown_operation_is_refused():
    cache, dma = bench()
    with pytest.raises(ValueError, match="no cache operation 'flush'; there are none, invalidate, clean\\+invalidate, clean"):
        receive(cache, dma, BUFFER, NEW, before="flush")
