"""Stream and message buffers: bytes from one writer to one reader (rules 64 to 67).

Whoever waits, waits for a notification at index 0, from the other side or from anybody.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import Buffer, Task
from labkit.kernel.services.notifications import await_notification, forget, notified
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

#: By whether it is a message buffer.
SENT, RECEIVED = ((CODE[f"stream_{what}"], CODE[f"message_{what}"]) for what in ("send", "recv"))
SEND_BLOCK, RECV_BLOCK = ((CODE[f"stream_{what}_block"], CODE[f"message_{what}_block"]) for what in ("send", "recv"))


def send(k: Core, task: Task, buffer: Buffer, count: int, timeout: int | None) -> None:
    """Wait for room for all of it, or for as much as a stream buffer can ever hold."""
    need = count + buffer.header if buffer.header else min(count, buffer.length)
    if timeout == 0 or need > buffer.length:
        _put(k, task, buffer, count, buffer.room)
    else:
        _send(k, task, buffer, count, need, k.deadline(timeout))


def _send(k: Core, task: Task, buffer: Buffer, count: int, need: int, deadline: int) -> None:
    room = buffer.room
    if room >= need:
        _put(k, task, buffer, count, room)
    else:
        _sleeps(buffer, "writer", task)
        k.log((k.now, SEND_BLOCK[buffer.header > 0], task.code, buffer.code, buffer.level, count))
        await_notification(k, task, 0, deadline, (_send_again, (buffer, count, need, deadline, room)))


def _send_again(k: Core, task: Task, buffer: Buffer, count: int, need: int, deadline: int, room: int) -> None:
    forget(task, 0)
    buffer.writer = None
    if k.expired(task, deadline):
        _put(k, task, buffer, count, room or buffer.room)  # rule 65: the room seen before it slept, if there was any
    else:
        _send(k, task, buffer, count, need, deadline)


def _put(k: Core, task: Task, buffer: Buffer, count: int, room: int) -> None:
    task.result, switch = put(k, task.code, buffer, count, room)
    if switch:
        k.reschedule()


def put(k: Core, by: int, buffer: Buffer, count: int, room: int) -> tuple[int, bool]:
    """As many of the bytes as have room, of a message all or none; and whether a reader above the running task woke."""
    if buffer.header:
        count = count if count + buffer.header <= room else 0
    count = min(count, room)
    k.log((k.now, SENT[buffer.header > 0], by, buffer.code, count, buffer.level))
    if not count:
        return 0, False
    buffer.level += count + buffer.header
    if buffer.header:
        buffer.messages.append(count)
    return count, buffer.level >= buffer.trigger and _tell(k, by, buffer, "reader")


def receive(k: Core, task: Task, buffer: Buffer, most: int, timeout: int | None) -> None:
    """Wait only if it is empty, and only once (rule 64)."""
    if buffer.level or timeout == 0:
        _get(k, task, buffer, most)
    else:
        _sleeps(buffer, "reader", task)
        k.log((k.now, RECV_BLOCK[buffer.header > 0], task.code, buffer.code, 0, 0))
        await_notification(k, task, 0, k.deadline(timeout), (_receive_woken, (buffer, most)))


def _receive_woken(k: Core, task: Task, buffer: Buffer, most: int) -> None:
    forget(task, 0)
    buffer.reader = None
    _get(k, task, buffer, most)


def _get(k: Core, task: Task, buffer: Buffer, most: int) -> None:
    count = min(most, buffer.level)
    if buffer.header:
        first = buffer.messages[0] if buffer.messages else 0
        count = first if first <= most else 0  # rule 66: a message that is too long stays
    k.log((k.now, RECEIVED[buffer.header > 0], task.code, buffer.code, count, buffer.level))
    task.result = count
    if not count:
        return
    buffer.level -= count + buffer.header
    if buffer.header:
        buffer.messages.popleft()
    if _tell(k, task.code, buffer, "writer"):
        k.reschedule()


def _sleeps(buffer: Buffer, side: str, task: Task) -> None:
    other = getattr(buffer, side)
    if other is not None and other is not task:
        raise ValueError(
            f"task {task.name!r} waits as the {side} of {buffer.kind} {buffer.name!r}, as {other.name!r} does; one may"
        )
    setattr(buffer, side, task)


def _tell(k: Core, by: int, buffer: Buffer, side: str) -> bool:
    """Notify the other side if it waits; True if it is above the running task."""
    waiter: Task | None = getattr(buffer, side)
    if waiter is None:
        return False
    setattr(buffer, side, None)
    return notified(k, by, waiter, "buffer", 0, 0)[1]


def available(k: Core, task: Task, buffer: Buffer) -> None:
    task.result = buffer.level


def spaces(k: Core, task: Task, buffer: Buffer) -> None:
    task.result = buffer.room
