"""The heap: heap_4's rules, worked out by hand and against a plain list of bytes; and the kernel that lives from it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.kernel import Heap, Kernel, Sizes, heap_stats, task_list


def test_a_block_is_what_was_asked_for_and_a_header_rounded_up():
    heap = Heap(1024)
    assert heap.free == 1024 - 8  # the end marker
    assert heap.allocate(1) == 0
    assert heap.allocate(8) == 16
    assert heap.allocate(9) == 32
    assert heap.free == 1016 - 16 - 16 - 24
    assert heap.allocate(0) is None


def test_the_first_block_that_is_large_enough_is_taken_not_the_best():
    heap = Heap(1024)
    first, wall, second, _ = (heap.allocate(size) for size in (120, 8, 40, 8))
    heap.give_back(first)
    heap.give_back(second)
    assert heap.allocate(40) == first  # although the second gap fits exactly
    assert wall == 128


def test_what_is_left_of_a_block_goes_along_if_it_is_two_headers_or_less():
    heap = Heap(1024)
    gap, _ = heap.allocate(56), heap.allocate(8)  # 64 bytes
    heap.give_back(gap)
    before = heap.free
    assert heap.allocate(40) == gap  # 48 are wanted, 16 would be left
    assert before - heap.free == 64
    heap.give_back(gap)
    assert heap.allocate(32) == gap  # 40 are wanted, 24 are left
    assert before - heap.free == 40


def test_a_block_joins_the_free_ones_on_both_sides():
    heap = Heap(256)
    blocks = [heap.allocate(24) for _ in range(3)]
    heap.give_back(blocks[0])
    heap.give_back(blocks[2])
    assert heap.blocks == 2  # the third has joined the rest
    heap.give_back(blocks[1])
    assert (heap.blocks, heap.free, heap.largest, heap.least) == (1, 248, 248, 248 - 3 * 32)


def test_free_bytes_in_pieces_are_not_enough():
    heap = Heap(8 + 4 * 32)
    blocks = [heap.allocate(24) for _ in range(4)]
    heap.give_back(blocks[0])
    heap.give_back(blocks[2])
    assert heap.free == 64 and heap.largest == 32
    assert heap.allocate(25) is None


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 90)), max_size=60), st.sampled_from((4, 8, 16)), st.integers(1, 20))
@settings(max_examples=200, deadline=None)
def test_no_two_blocks_share_a_byte_and_none_is_lost(steps, alignment, header):
    heap = Heap(600, alignment, header)
    whole, used = heap.free, {}
    owner = [None] * whole
    for number, (take, size) in enumerate(steps):
        if take:
            before = heap.free
            address = heap.allocate(size)
            if address is None:
                assert size + heap.header > heap.largest - alignment
                continue
            length = before - heap.free
            assert address % alignment == 0 and length >= size + heap.header
            assert all(each is None for each in owner[address : address + length])
            owner[address : address + length] = [number] * length
            used[address] = length
        elif used:
            address = sorted(used)[size % len(used)]
            length = heap.give_back(address)
            assert length == used.pop(address)
            owner[address : address + length] = [None] * length
        assert heap.free == owner.count(None) == whole - sum(used.values())
        gaps = sum(1 for at, each in enumerate(owner) if each is None and (at == 0 or owner[at - 1] is not None))
        assert heap.blocks == gaps  # neighbours have joined
    for address in list(used):
        heap.give_back(address)
    assert (heap.free, heap.blocks, heap.largest) == (whole, 1, whole)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Heap(10), "a heap of 10 bytes; 24 to 4294967296 are allowed"),
        (lambda: Heap(100, alignment=12), "blocks aligned to 12 bytes; a power of two is allowed"),
        (lambda: Heap(100).give_back(8), "free at address 8, where no block is"),
        (lambda: Sizes(task=-1), "the size of task is -1 bytes"),
        (
            lambda: Kernel(heap=Heap(500)).queue("q", 200),
            "object 'q' does not fit the heap: of 488 free bytes 488 are in one block",
        ),
        (lambda: Kernel(heap=Heap(500)).task("t", idle, 1), "task 't' does not fit the heap"),
        (lambda: Kernel(heap=Heap(900)).task("t", idle, 1, stack=50, stack_free=51), "never uses 51 words of a stack of 50"),
    ],
)
def test_what_cannot_be_says_why(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def idle(os):
    yield os.suspend()


def test_free_without_a_heap_says_so():
    k = Kernel()

    def body(os):
        yield os.allocate(5)

    k.task("a", body, 1)
    with pytest.raises(ValueError, match="there is no heap; give the kernel one"):
        k.run(10)


def test_tasks_and_objects_are_made_from_it_and_given_back():
    """A worker deleted by its boss is given back at once, one that ends when the idle task runs."""
    heap = Heap(4096)
    k = Kernel(cpu_hz=10_000, tick_hz=1000, heap=heap)
    k.queue("queue", 10, item=12)
    seen = []

    def worker(os):
        yield os.compute(3)

    def boss(os):
        before = heap.free
        first = yield os.create("first", idle, 1, stack=100)
        seen.append(before - heap.free)
        yield os.delay(1)
        yield os.delete(first)
        seen.append(before - heap.free)
        yield os.create("second", worker, 5, stack=100)  # above: it ends before this returns
        seen.append(before - heap.free)
        yield os.delay(1)
        seen.append(before - heap.free)
        yield os.create("third", worker, 1, stack=5000)

    k.task("boss", boss, 2, stack=200, stack_free=40)
    run = k.run(100)
    one = 400 + 8 + 96 + 8
    assert seen == [one, 0, one, 0]
    stats = heap_stats(run)
    boss_blocks, queue, idle_blocks = 800 + 8 + 96 + 8, 80 + 120 + 8, 512 + 8 + 96 + 8
    assert stats.least == 4088 - queue - boss_blocks - idle_blocks - one
    assert stats.free == 4088 - queue - idle_blocks  # the boss has ended
    assert (stats.obtained, stats.given_back, stats.failed) == (9, 6, 1)
    assert heap_stats(run, 5).given_back == 0
    listed = {task.name: (task.state, task.stack_free) for task in task_list(run).tasks}
    assert listed == {"IDLE": ("X", None), "boss": ("D", 40), "first": ("D", None), "second": ("D", None)}
    assert "first" not in {task.name for task in task_list(Kernel(heap=Heap(4096)).run(5)).tasks}
