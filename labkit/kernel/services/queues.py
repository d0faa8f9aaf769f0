"""Queues: send, receive, peek, overwrite, reset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from labkit.kernel.objects import FOREVER, Mutex, Queue, Semaphore, Task
from labkit.kernel.services.sets import sent_to_member
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

SEND, SEND_FRONT, SEND_BLOCK, SEND_FAIL = CODE["send"], CODE["send_front"], CODE["send_block"], CODE["send_fail"]
RECV, RECV_BLOCK, RECV_FAIL = CODE["recv"], CODE["recv_block"], CODE["recv_fail"]
PEEK, PEEK_BLOCK, PEEK_FAIL = CODE["peek"], CODE["peek_block"], CODE["peek_fail"]
OVERWRITE, QUEUE_RESET = CODE["overwrite"], CODE["queue_reset"]


def send(k: Core, task: Task, queue: Queue, item: Any, timeout: int | None) -> None:
    _send(k, task, queue, item, k.deadline(timeout), SEND)


def send_front(k: Core, task: Task, queue: Queue, item: Any, timeout: int | None) -> None:
    _send(k, task, queue, item, k.deadline(timeout), SEND_FRONT)


def overwrite(k: Core, task: Task, queue: Queue, item: Any) -> None:
    task.result = True
    if put(k, task.code, queue, item, OVERWRITE):
        k.reschedule()


def _send(k: Core, task: Task, queue: Queue, item: Any, deadline: int, kind: int) -> None:
    count = len(queue.items)
    if count < queue.length:
        task.result = True
        if put(k, task.code, queue, item, kind):
            k.reschedule()
    elif k.expired(task, deadline):
        k.log((k.now, SEND_FAIL, task.code, queue.code, count, stamp(item)))
        task.result = False
    else:
        k.log((k.now, SEND_BLOCK, task.code, queue.code, count, stamp(item)))
        k.block(task, deadline, (_send, (queue, item, deadline, kind)), queue, queue.senders)


def put(k: Core, by: int, queue: Queue, item: Any, kind: int) -> bool:
    """An item for which there is room; True if that woke a task above the running one."""
    items = queue.items
    count = len(items)
    k.log((k.now, kind, by, queue.code, count, stamp(item)))
    if kind == SEND:
        items.append(item)
    elif kind == SEND_FRONT:
        items.appendleft(item)
    else:
        items.clear()
        items.append(item)
    if queue.container is not None:
        return (kind != OVERWRITE or not count) and sent_to_member(k, by, queue, queue.container)
    return bool(queue.receivers) and k.wake(queue.receivers)


def send_from_isr(k: Core, by: int, queue: Queue, item: Any, kind: int) -> tuple[bool, bool]:
    """Whether there was room (rule 27), and whether a task above the running one woke."""
    if len(queue.items) < queue.length or kind == OVERWRITE:
        return True, put(k, by, queue, item, kind)
    k.log((k.now, SEND_FAIL, by, queue.code, len(queue.items), stamp(item)))
    return False, False


def receive(k: Core, task: Task, queue: Queue, timeout: int | None) -> None:
    _receive(k, task, queue, k.deadline(timeout))


def _receive(k: Core, task: Task, queue: Queue, deadline: int) -> None:
    if queue.items:
        task.result, switch = get(k, task.code, queue)
        if switch:
            k.reschedule()
    else:
        _no_item(k, task, queue, deadline, _receive, RECV_FAIL, RECV_BLOCK)


def get(k: Core, by: int, queue: Queue) -> tuple[Any, bool]:
    """The item that is read next, and whether a sender above the running task woke."""
    item = queue.items.popleft()
    k.log((k.now, RECV, by, queue.code, len(queue.items) + 1, stamp(item)))
    return item, bool(queue.senders) and k.wake(queue.senders)


def receive_from_isr(k: Core, by: int, queue: Queue) -> tuple[Any, bool]:
    if queue.items:
        return get(k, by, queue)
    k.log((k.now, RECV_FAIL, by, queue.code, 0, 0))
    return None, False


def peek(k: Core, task: Task, queue: Queue, timeout: int | None) -> None:
    _peek(k, task, queue, k.deadline(timeout))


def _peek(k: Core, task: Task, queue: Queue, deadline: int) -> None:
    if queue.items:
        item = queue.items[0]
        k.log((k.now, PEEK, task.code, queue.code, len(queue.items), stamp(item)))
        task.result = item
        if queue.receivers and k.wake(queue.receivers):  # rule 13: the item is still there
            k.reschedule()
    else:
        _no_item(k, task, queue, deadline, _peek, PEEK_FAIL, PEEK_BLOCK)


def _no_item(k: Core, task: Task, queue: Queue, deadline: int, retry: Any, fails: int, blocks: int) -> None:
    if k.expired(task, deadline):
        k.log((k.now, fails, task.code, queue.code, 0, 0))
        task.result = None
    else:
        k.log((k.now, blocks, task.code, queue.code, 0, 0))
        k.block(task, deadline, (retry, (queue, deadline)), queue, queue.receivers)


def reset(k: Core, task: Task, queue: Queue) -> None:
    """Rule 63: one blocked sender is woken, however much room there is."""
    k.log((k.now, QUEUE_RESET, task.code, queue.code, len(queue.items), 0))
    queue.items.clear()
    task.result = None
    if queue.senders and k.wake(queue.senders):
        k.reschedule()


def messages_waiting(k: Core, task: Task, waiting: Queue | Semaphore | Mutex) -> None:
    task.result = len(waiting.items) if isinstance(waiting, Queue) else waiting.count


def spaces_available(k: Core, task: Task, queue: Queue) -> None:
    task.result = queue.length - len(queue.items)


def stamp(item: Any) -> int:
    """How an item shows in the trace: an integer of up to 63 bits as itself, anything else as 0."""
    return item if isinstance(item, int) and -FOREVER < item < FOREVER else 0
