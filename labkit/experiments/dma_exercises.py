"""The exercises of notebook 03: drivers, sizes, regions and failures of your own, run in the model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from labkit.cache import CAUSES, WRITE_BACK, Access, Cache, Dma, MpuRegion, Transfer, evict, stm32f767, violations
from labkit.checks import shown
from labkit.experiment import Feedback
from labkit.experiments.answers import called
from labkit.experiments.byte_story import LINE
from labkit.experiments.dma_coherence import DmaCoherence
from labkit.experiments.dma_session import HEAP_SIZE, HEAPS, agent, send

DOCUMENTED = tuple(CAUSES)[:6]
BUFFER = 0x2002_0400
FRAME = bytes(range(1, 2 * LINE + 1))


def check_failures(collection: Any) -> Feedback:
    """Exercise 1: settings of the bench that show all six documented failures between them."""
    if not isinstance(collection, list | tuple) or not all(isinstance(each, DmaCoherence) for each in collection):
        return Feedback(False, f"the answer is {shown(collection)}; it has to be a list of settings, like [DmaCoherence()].")
    found = {cause for experiment in collection for cause in experiment.run().causes}
    missing = [cause for cause in DOCUMENTED if cause not in found]
    return Feedback(
        not missing,
        f"{len(DOCUMENTED) - len(missing)} of {len(DOCUMENTED)} failures"
        + (f"; still missing: {', '.join(missing)}." if missing else ", the collection is complete."),
    )


def check_rounding(rounded: Callable[[int, int], Any]) -> Feedback:
    """Exercise 2: what to pass to a clean that works on whole lines and does not round by itself, for a buffer anywhere."""
    cache = Cache(stm32f767())
    dma = Dma(cache.memory)
    for offset in range(LINE):
        for size in range(1, 2 * LINE + 2):
            address, where = BUFFER + offset, f"for the buffer at {BUFFER + offset:#x} with size {size}"
            asked = called(rounded, "rounded(address, size)", address, size)
            if isinstance(asked, Feedback):
                return asked
            if not (isinstance(asked, tuple) and len(asked) == 2 and all(type(each) is int for each in asked)):
                return Feedback(False, f"{where} you return {shown(asked)}; it has to be two whole numbers, address and size.")
            start, length = asked
            if start % LINE or length < 0:
                return Feedback(False, f"{where} you pass {start:#x} and {length}; the address must lie on a line.")
            cache.log.clear()
            cache.write(address, bytes((offset + size + n) % 255 + 1 for n in range(size)))
            wanted = cache.load(address, size)
            done = cache.clean(start, length, round_size=False)
            stale = sum(a != b for a, b in zip(dma.read(address, size).data, wanted))
            if stale:
                return Feedback(False, f"{where} the DMA got {stale} stale bytes.")
            needed = len(cache.geometry.span(address, size))
            if done.lines is not None and len(done.lines) > needed:
                return Feedback(False, f"{where} you clean {len(done.lines)} lines, {needed} would do.")
            cache.clean_invalidate()
    return Feedback(True, f"right for all {LINE} offsets and all sizes up to {2 * LINE + 1} bytes, and never a line too many.")


#: What may happen to the lines of a buffer while the DMA fills it.
EVENTS: dict[str, Callable[[Cache, int], object]] = {
    "nothing happens": lambda cache, line: None,
    "the CPU prefetches the buffer": Cache.speculate,
    "the buffer is evicted": evict,
}


class _BusyDma(Dma):
    """A DMA master whose receptions are interrupted in the middle by something else."""

    def __init__(self, cache: Cache, event: Callable[[Cache, int], object]) -> None:
        super().__init__(cache.memory, cache.log)
        self._cache, self._event = cache, event

    def write(self, address: int, data: bytes) -> Transfer:
        half = len(data) // 2
        super().write(address, data[:half])
        for line in (BUFFER, BUFFER + LINE):
            self._event(self._cache, line)
        return super().write(address + half, data[half:])


def check_receive_driver(driver: Callable[[Cache, Dma, int, bytes], bytes]) -> Feedback:
    """Exercise 3: a driver that receives into two whole lines, correct whatever the cache held and whatever happens meanwhile."""
    for held in ("nothing", "a clean copy", "a dirty copy"):
        for event, happen in EVENTS.items():
            cache = Cache(stm32f767())
            dma = _BusyDma(cache, happen)
            if held == "a clean copy":
                cache.read(BUFFER, len(FRAME))
            elif held == "a dirty copy":
                cache.write(BUFFER, bytes(len(FRAME)))
            got = called(driver, "receive(cache, dma, buffer, frame)", cache, dma, BUFFER, FRAME)
            if isinstance(got, Feedback):
                return got
            scene = f"the cache held {held} of the buffer and {event} during the transfer"
            wrong = violations(cache.log)
            if wrong:
                return Feedback(False, f"{scene}: {wrong[0].cause} ({CAUSES[wrong[0].cause]}).")
            transfers = [n for n, record in enumerate(cache.log) if isinstance(record, Transfer) and record.op == "dma write"]
            later = cache.log[transfers[-1] :] if transfers else []
            reads = (record for record in later if isinstance(record, Access) and record.op == "read")
            read = sum(record.size for record in reads if record.address >= BUFFER)
            if not cache.enabled:
                return Feedback(False, "the cache is off when your driver ends; everybody else pays for that.")
            if got != FRAME or read < len(FRAME):
                return Feedback(
                    False,
                    f"{scene}: your driver has to call dma.write(...) and to return what the CPU then reads, cache.load(...).",
                )
    return Feedback(True, "right in all nine scenes: three states of the cache, three things that happen meanwhile.")


def check_region(region: Any) -> Feedback:
    """Exercise 4: an MPU region over lwIP's heap, and no more, with which the driver as generated sends from any address."""
    if not isinstance(region, MpuRegion):
        return Feedback(False, f"the answer is {shown(region)}; it has to be a region, like MpuRegion(1, 0x3000_4000, 16384).")
    memory, heap = stm32f767((region,)), HEAPS["sram1"]
    kinds = {memory.attribute(at) for at in range(heap, heap + HEAP_SIZE, LINE)}
    for offset in (0, 10, 21):
        try:
            said = agent(send((region,), "generated", heap + offset).received)
        except ValueError as error:
            return Feedback(False, f"the CPU cannot even write the packet: {error}.")
        if said != "session established":
            return Feedback(False, f"the message lies at {heap + offset:#x}, and the agent says {said!r}.")
    if any(kind.cacheable or kind.device for kind in kinds):
        names = ", ".join(sorted(kind.name for kind in kinds))
        return Feedback(False, f"the heap is now {names}; all of it should be normal memory, not cacheable.")
    if any(memory.attribute(at) != WRITE_BACK for at in (heap - LINE, heap + HEAP_SIZE)):
        return Feedback(False, "your region covers more than the heap; its neighbours lose the cache without need.")
    return Feedback(True, "the session is established without a single cache operation, and only the heap pays for it.")
