"""Tasks, objects and `allocate` take their memory from one heap, if there is one: first fit, and free neighbours join."""

from labkit.kernel import Heap, Kernel


# %% A block is what was asked for and a header of 8 bytes, rounded up to 8. What is asked for in vain is an event in the trace.
def task(os):
    a = yield os.allocate(100)
    b = yield os.allocate(100)
    print("blocks at", a, "and", b, "leave", heap.free)
    yield os.free(a)
    print("freed", heap.free, "and for 60 there is room at", (yield os.allocate(60)))
    print("for 100000:", (yield os.allocate(100_000)))


heap = Heap(4096)
k = Kernel(heap=heap)
k.task("task", task, priority=1, stack=128)
print(heap.free, "are left before the start")
k.advance(until=1 * k.ms)
print("fewest ever", heap.least, "and", len(k.trace.rows("malloc_failed")), "failure")
