"""The lanes of bytes against what `violations` finds and against bytes counted by hand."""

from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.cache import Cache, Dma, Memory, Region, violations
from labkit.cache.memory import NON_CACHEABLE, WRITE_BACK, WRITE_BACK_NO_ALLOCATE, WRITE_THROUGH
from labkit.experiments.byte_story import CACHE, CPU, DMA, MEMORY, Story

START, SIZE = 64, 96  # of the window; accesses reach beyond both ends of it
KINDS = st.sampled_from([WRITE_BACK, WRITE_BACK, WRITE_THROUGH, WRITE_BACK_NO_ALLOCATE, NON_CACHEABLE])
PLACES = st.tuples(st.integers(START - 40, START + SIZE), st.integers(1, 40))
ACTS = ("read", "write", "modify", "speculate", "dma read", "dma write", "clean", "invalidate", "clean_invalidate", "evict")
STEPS = st.one_of(st.tuples(st.sampled_from(ACTS), PLACES), st.tuples(st.sampled_from(["disable", "off", "enable"]), PLACES))


def act(story, op, address, size, data):
    """Do one thing."""
    match op:
        case "read":
            story.cache.read(address, size)
        case "write" | "modify":
            getattr(story.cache, op)(address, data)
        case "speculate":
            story.cache.speculate(address)
        case "dma read":
            story.dma.read(address, size)
        case "dma write":
            story.dma.write(address, data)
        case "evict":  # 4 ways of 128 sets: these lines push the one of the address out of its set
            for n in range(1, 6):
                story.cache.read(address % 4096 + 4096 * n, 1)
        case "enable":
            story.cache.enable()
        case "disable" | "off":
            story.cache.disable(clean=op == "disable")
        case _:
            getattr(story.cache, op)(address, size)


@settings(max_examples=150, deadline=None)
@given(st.lists(STEPS, max_size=40), KINDS)
def test_lanes_and_violations_mark_the_bytes_that_differ_from_the_latest_write(steps, kind):
    """Write number n puts the value n into all its bytes, so that a byte is stale exactly when its value is not the latest."""
    story = Story(Memory([Region("memory", 0, 1 << 15, kind)]), START, SIZE, hexadecimal=True)
    latest = bytearray(1 << 15)
    wrong: dict[tuple[int, int], str] = {}  # (record, byte) -> reader of every byte that was not the latest
    seen = {lane: ["absent"] * SIZE for lane in (CPU, DMA)}
    for number, (op, (address, size)) in enumerate(steps, 1):
        data = bytes([number]) * size
        first = len(story.cache.log)
        with story.stage(op, ""):
            act(story, op, address, size, data)
        for index, record in enumerate(story.cache.log[first:], first):
            lane = {"dma read": DMA, "dma write": DMA, "read": CPU, "write": CPU, "modify": CPU}.get(record.op)
            for byte, value in enumerate(getattr(record, "data", b""), getattr(record, "address", None) or 0):
                stale = record.op in ("read", "modify", "dma read") and value != latest[byte]
                if stale:
                    wrong[index, byte] = "DMA" if lane == DMA else "CPU"
                if lane is not None and START <= byte < START + SIZE:
                    seen[lane][byte - START] = "stale" if stale else "plain"
        if op in ("write", "modify", "dma write"):
            latest[address : address + size] = data

        lanes = story.stages()[-1].lanes
        for column in range(SIZE):
            byte = START + column
            held = story.cache.held(byte)
            memory = "newest" if story.cache.memory.read(byte, 1)[0] == latest[byte] else "stale"
            cached = "absent"
            if held is not None:
                newest = held.data[byte - held.address] == latest[byte]
                cached = "stale" if not newest else "dirty" if held.dirty else "newest"
            assert (lanes[MEMORY].state[column], lanes[CACHE].state[column]) == (memory, cached)
        assert {lane: list(lanes[lane].state) for lane in seen} == seen

    found = violations(story.cache.log)
    assert {(v.index, v.address + n): v.reader for v in found for n in range(v.size)} == wrong
    assert found == [v for stage in story.stages() for v in stage.wrong]


def test_a_modify_shows_what_the_cpu_got_and_makes_memory_stale():
    story = Story(Memory([Region("memory", 0, 1 << 15, WRITE_BACK)]), START, 4, hexadecimal=True)
    with story.stage("modify", ""):
        story.cache.modify(START, b"\x01\x02\x03\x04")
    with story.stage("send", ""):
        story.dma.read(START, 4)
    modify, send = story.stages()
    assert modify.lanes[CPU].text == ("00",) * 4 and modify.lanes[CACHE].text == ("01", "02", "03", "04")
    assert set(modify.lanes[CACHE].state) == {"dirty"} and set(modify.lanes[MEMORY].state) == {"stale"}
    assert {move.kind for move in modify.moves if move.lane == CPU} == {"up", "down"}
    assert set(send.lanes[DMA].state) == {"stale"} and [v.size for v in send.wrong] == [4]


def test_a_log_that_begins_in_the_middle_is_judged_from_there():
    cache = Cache(Memory([Region("memory", 0, 1 << 15, WRITE_BACK)]))
    cache.write(0, b"dirty")
    cache.read(32, 4)
    cache.log.clear()
    for address in range(4096, 6 * 4096, 4096):
        cache.read(address, 1)  # evicts line 0, of which the log says nothing
    Dma(cache.memory, cache.log).write(32, b"news")
    cache.read(32, 8)
    cache.clean_invalidate()
    (found,) = violations(cache.log)
    assert (found.reader, found.cause, found.address, found.size) == ("CPU", "receive without invalidate", 32, 4)
