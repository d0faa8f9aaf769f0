"""Event groups: bits as levels, and who waits for some or all of them (rules 48 to 53)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.kernel.objects import EventGroup, Task
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

SET_BITS, CLEAR_BITS = CODE["set_bits"], CODE["clear_bits"]
WAIT_BITS, WAIT_BITS_BLOCK, SYNC, SYNC_BLOCK = (CODE[k] for k in ("wait_bits", "wait_bits_block", "sync", "sync_block"))


def set_bits(k: Core, task: Task, group: EventGroup, bits: int) -> None:
    switch = bits_set(k, task.code, group, bits)
    task.result = group.bits  # rule 50: before any of the woken tasks runs
    if switch:
        k.reschedule()


def bits_set(k: Core, by: int, group: EventGroup, bits: int) -> bool:
    """Set bits and release everyone who is satisfied (rule 48); True if one of them is above the running task."""
    k.log((k.now, SET_BITS, by, group.code, group.bits, bits))
    found = group.bits = group.bits | bits
    consumed, switch = 0, False
    for task in tuple(group.waiters):
        wanted, every, clear = task.wants
        if _met(found, wanted, every):
            task.granted = found
            consumed |= wanted if clear else 0
            switch |= k.make_ready(task)
    group.bits &= ~consumed
    return switch


def clear_bits(k: Core, task: Task, group: EventGroup, bits: int) -> None:
    task.result = group.bits
    bits_cleared(k, task.code, group, bits)


def bits_cleared(k: Core, by: int, group: EventGroup, bits: int) -> None:
    k.log((k.now, CLEAR_BITS, by, group.code, group.bits, bits))
    group.bits &= ~bits


def get_bits(k: Core, task: Task, group: EventGroup) -> None:
    task.result = group.bits


def wait_bits(k: Core, task: Task, group: EventGroup, bits: int, every: bool, clear: bool, timeout: int | None) -> None:
    if timeout == 0 or _met(group.bits, bits, every):
        _look(k, task, group, bits, every, clear, WAIT_BITS)
    else:
        k.log((k.now, WAIT_BITS_BLOCK, task.code, group.code, group.bits, bits))
        _wait(k, task, group, (bits, every, clear), k.deadline(timeout), WAIT_BITS)


def sync(k: Core, task: Task, group: EventGroup, bits: int, wanted: int, timeout: int | None) -> None:
    """Rule 52: whoever brings the last bit takes them all away, and does not wait."""
    reached = group.bits | bits
    switch = bits_set(k, task.code, group, bits)
    if _met(reached, wanted, True):
        group.bits &= ~wanted
        task.pending = _done, (group, reached, wanted, True, SYNC)
    elif timeout == 0:
        task.pending = _done, (group, group.bits, wanted, True, SYNC)
    else:
        k.log((k.now, SYNC_BLOCK, task.code, group.code, group.bits, wanted))
        _wait(k, task, group, (wanted, True, True), k.deadline(timeout), SYNC)
        return
    if switch:
        k.reschedule()


def _wait(k: Core, task: Task, group: EventGroup, wants: tuple[int, bool, bool], deadline: int, kind: int) -> None:
    task.wants, task.granted = wants, -1
    task.waits_for, task.waits_in = group, group.waiters
    group.waiters.append(task)
    k.sleep(task, deadline, (_woken, (group, *wants, kind)))


def _woken(k: Core, task: Task, group: EventGroup, bits: int, every: bool, clear: bool, kind: int) -> None:
    """Rule 51: what a set has granted counts; otherwise the bits as they are now."""
    task.key = task.priority  # the wait has used its place in line for the bits
    if task.granted >= 0:
        _done(k, task, group, task.granted, bits, every, kind)
    else:
        _look(k, task, group, bits, every, clear, kind)


def _look(k: Core, task: Task, group: EventGroup, bits: int, every: bool, clear: bool, kind: int) -> None:
    found = group.bits
    if clear and _met(found, bits, every):
        group.bits &= ~bits
    _done(k, task, group, found, bits, every, kind)


def _done(k: Core, task: Task, group: EventGroup, found: int, bits: int, every: bool, kind: int) -> None:
    k.log((k.now, kind, task.code, group.code, found, 2 * bits + _met(found, bits, every)))
    task.result = found


def _met(found: int, bits: int, every: bool) -> bool:
    return found & bits == bits if every else found & bits != 0
