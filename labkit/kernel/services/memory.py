"""Memory: blocks for bodies, and those that tasks and objects are made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.checks import whole
from labkit.kernel.heap import Heap
from labkit.kernel.objects import Task
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

MALLOC, MALLOC_FAILED, FREE = CODE["malloc"], CODE["malloc_failed"], CODE["free"]


def allocate(k: Core, task: Task, size: int) -> None:
    task.result = obtain(k, task.code, size, -1)


def free(k: Core, task: Task, address: int) -> None:
    task.result = None
    give_back(k, task.code, address, -1)


def heap_of(k: Core) -> Heap:
    """The heap; ValueError if there is none."""
    if k.heap is None:
        raise ValueError("there is no heap; give the kernel one")
    return k.heap


def obtain(k: Core, by: int, size: int, what: int) -> int | None:
    """A block for `what`, or None; either is in the trace."""
    heap = heap_of(k)
    address = heap.allocate(size)
    k.log((k.now, MALLOC_FAILED if address is None else MALLOC, by, what, heap.free, size))
    return address


def give_back(k: Core, by: int, address: int, what: int) -> None:
    heap = heap_of(k)
    length = heap.give_back(address)
    k.log((k.now, FREE, by, what, heap.free, length))


def obtain_all(k: Core, by: int, sizes: tuple[int, ...], what: int) -> tuple[int, ...] | None:
    """Several blocks, or none of them."""
    found: list[int] = []
    for size in sizes:
        address = obtain(k, by, size, what)
        if address is None:
            for block in reversed(found):
                give_back(k, by, block, what)
            return None
        found.append(address)
    return tuple(found)


def give_back_all(k: Core, by: int, task: Task) -> None:
    """The blocks of a task that is no more: its stack, then its record."""
    for block in task.blocks:
        give_back(k, by, block, task.code)
    task.blocks = ()


def reserve(k: Core, what: str, record: str, more: int, code: int = -1) -> None:
    """Memory for an object made before the start: its record and so many bytes more. ValueError if there is no room."""
    if k.heap is not None and obtain(k, -1, getattr(k.heap.sizes, record) + more, code) is None:
        raise no_room(k, what)


def reserve_for_task(k: Core, task: Task, stack: int | None, by: int) -> bool:
    """Memory for a stack of so many words (None: as many as the idle task has) and the task's record; False: no room."""
    if k.heap is None:
        return True
    sizes = k.heap.sizes
    words = sizes.idle_stack if stack is None else whole(stack, 1, f"task {task.name!r} has a stack of", " words")
    if task.stack_free is not None and task.stack_free > words:
        raise ValueError(f"task {task.name!r} never uses {task.stack_free} words of a stack of {words}; at most all are allowed")
    blocks = obtain_all(k, by, (words * sizes.word, sizes.task), task.code)
    task.blocks = blocks or ()
    return blocks is not None


def no_room(k: Core, what: str) -> ValueError:
    """The error of something that does not fit."""
    heap = heap_of(k)
    return ValueError(f"{what} does not fit the heap: of {heap.free} free bytes {heap.largest} are in one block")
