"""Without DMA no program can tell the cache is there; with DMA only in the six documented ways."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from labkit.cache import Cache, Dma, Geometry, Memory, MpuRegion, Region
from labkit.cache.coherence import CAUSES, violations
from labkit.cache.memory import NON_CACHEABLE, TCM, WRITE_BACK, WRITE_BACK_NO_ALLOCATE, WRITE_THROUGH
from labkit.cache.policies import POLICIES

SIZE = 512
KINDS = (WRITE_BACK, WRITE_THROUGH, WRITE_BACK_NO_ALLOCATE, NON_CACHEABLE, TCM, WRITE_BACK)
END = SIZE * len(KINDS)
addresses = st.integers(0, END - 64)
sizes = st.integers(1, 64)
payloads = st.binary(min_size=1, max_size=64)


class WithoutDma(RuleBasedStateMachine):
    """Loads and stores on a tiny cache beside a bytearray; clean, speculation and CMSIS's enable and disable in between."""

    @initialize(
        policy=st.sampled_from(sorted(POLICIES)),
        ways=st.sampled_from([1, 2, 4]),
        dynamic=st.booleans(),
        force=st.booleans(),
        shared=st.booleans(),
        protected=st.booleans(),
    )
    def start(self, policy, ways, dynamic, force, shared, protected):
        regions = [Region(f"{i} {kind.name}", i * SIZE, SIZE, kind) for i, kind in enumerate(KINDS)]
        mpu = [MpuRegion(3, 0, 128, tex=1, c=1, b=1, s=1), MpuRegion(4, 64, 64, tex=1, c=0, b=0)] if protected else []
        self.cache = Cache(
            Memory(regions, mpu),
            Geometry(256, ways, 32),
            policy,
            dynamic_read_allocate=dynamic,
            force_write_through=force,
            shared_write_through=shared,
        )
        self.dma = Dma(self.cache.memory, self.cache.log)
        self.truth = bytearray(END)
        self.read_wrong: list[tuple[int, int]] = []  # (record, byte address) of every byte that was not the latest

    def compare(self, address, got, first_record):
        """Note the wrong bytes of a read that appended its records from `first_record` on."""
        for record_index in range(first_record, len(self.cache.log)):
            record = self.cache.log[record_index]
            for offset, byte in enumerate(record.data):
                at = record.address + offset
                if byte != self.truth[at]:
                    self.read_wrong.append((record_index, at))
        assert len(got) == sum(len(r.data) for r in self.cache.log[first_record:])

    @rule(address=addresses, size=sizes)
    def read(self, address, size):
        first = len(self.cache.log)
        self.compare(address, self.cache.load(address, size), first)

    @rule(address=addresses, data=payloads)
    def write(self, address, data):
        self.cache.write(address, data)
        self.truth[address : address + len(data)] = data

    @rule(address=addresses, data=payloads)
    def modify(self, address, data):
        first = len(self.cache.log)
        got = b"".join(record.data for record in self.cache.modify(address, data))
        self.compare(address, got, first)
        self.truth[address : address + len(data)] = data

    @rule(start=st.integers(0, END - 256), words=st.integers(8, 36))
    def memset(self, start, words):
        for i in range(words):
            self.write(start + 4 * i, bytes([i + 1] * 4))

    @rule(address=addresses, size=sizes, drop=st.booleans(), whole=st.booleans())
    def clean(self, address, size, drop, whole):
        operation = self.cache.clean_invalidate if drop else self.cache.clean
        operation() if whole else operation(address, size)

    @rule(address=addresses)
    def speculate(self, address):
        self.cache.speculate(address)

    @rule(on=st.booleans())
    def switch(self, on):
        self.cache.enable() if on else self.cache.disable()

    def teardown(self):
        if not hasattr(self, "cache"):
            return
        assert not self.read_wrong
        assert not violations(self.cache.log)
        self.cache.clean()
        assert self.cache.memory.read(0, END) == bytes(self.truth)


class WithDma(WithoutDma):
    """The same with a DMA master and with invalidate: a byte read wrong is one that `violations` explains by one of the six."""

    @rule(address=addresses, size=sizes)
    def dma_read(self, address, size):
        first = len(self.cache.log)
        self.compare(address, self.dma.read(address, size).data, first)

    @rule(address=addresses, data=payloads)
    def dma_write(self, address, data):
        self.dma.write(address, data)
        self.truth[address : address + len(data)] = data

    @rule(address=addresses, size=sizes, whole=st.booleans())
    def invalidate(self, address, size, whole):
        self.cache.invalidate() if whole else self.cache.invalidate(address, size)

    def teardown(self):
        if not hasattr(self, "cache"):
            return
        found = violations(self.cache.log)
        explained = {(v.index, v.address + offset) for v in found for offset in range(v.size)}
        assert set(self.read_wrong) <= explained
        assert {v.cause for v in found} <= set(list(CAUSES)[:6])


TestWithoutDma = WithoutDma.TestCase
TestWithDma = WithDma.TestCase
TestWithoutDma.settings = settings(max_examples=100, stateful_step_count=30, deadline=None)
TestWithDma.settings = settings(max_examples=100, stateful_step_count=30, deadline=None)
