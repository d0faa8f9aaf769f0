"""The kernel's services: what happens when a task has said `yield os.take(lock)`.

A service is a function of the core, the calling task and its arguments; it leaves the answer in `task.result`. One that has to
wait leaves itself in `task.pending` and is tried again when the task next runs: there is no hand-off (rule 9). Rule numbers are
those of tests/oracle/freertos/README.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from labkit.kernel.objects import DELETED, FOREVER, SUSPENDED, Mutex, Queue, Semaphore, Task
from labkit.kernel.protocols import settle
from labkit.trace import CODE

if TYPE_CHECKING:
    from labkit.kernel.core import Core

TAKE, TAKE_BLOCK, TAKE_FAIL = CODE["take"], CODE["take_block"], CODE["take_fail"]
GIVE, GIVE_FAIL, OVERWRITE = CODE["give"], CODE["give_fail"], CODE["overwrite"]
SEND, SEND_FRONT, SEND_BLOCK, SEND_FAIL = CODE["send"], CODE["send_front"], CODE["send_block"], CODE["send_fail"]
RECV, RECV_BLOCK, RECV_FAIL = CODE["recv"], CODE["recv_block"], CODE["recv_fail"]
PEEK, PEEK_BLOCK, PEEK_FAIL = CODE["peek"], CODE["peek_block"], CODE["peek_fail"]
NOTIFY, NOTIFY_TAKE, NOTIFY_TAKE_BLOCK = CODE["notify"], CODE["notify_take"], CODE["notify_take_block"]
DELAY, DELAY_UNTIL, YIELD = CODE["delay"], CODE["delay_until"], CODE["yield"]
SUSPEND, RESUME, PRIO_SET, DONE = CODE["suspend"], CODE["resume"], CODE["prio_set"], CODE["done"]
RELEASE, DEADLINE, COMPLETE = CODE["release"], CODE["deadline"], CODE["complete"]
BEGIN, END, MARK = CODE["begin"], CODE["end"], CODE["mark"]

Service = Callable[..., None]


# Semaphores and mutexes


def take(k: Core, task: Task, lock: Semaphore | Mutex, timeout: int | None) -> None:
    task.inherited = False
    if isinstance(lock, Mutex) and lock.recursive and lock.holder is task:
        lock.depth += 1  # rule 19
        task.result = True
    else:
        _take(k, task, lock, _deadline(k, timeout))


def _take(k: Core, task: Task, lock: Semaphore | Mutex, deadline: int) -> None:
    count = lock.count
    if count:
        k.log((k.now, TAKE, task.code, lock.code, count, 0))
        lock.count = count - 1
        if isinstance(lock, Mutex):
            lock.protocol.taken(k, task, lock)
        task.result = True
    elif k.ticks >= deadline:  # rule 12: only after it has tried
        if isinstance(lock, Mutex):
            lock.protocol.timed_out(k, task, lock)
        k.log((k.now, TAKE_FAIL, task.code, lock.code, 0, 0))
        task.result = False
    else:
        k.log((k.now, TAKE_BLOCK, task.code, lock.code, 0, 0))
        k.block(task, deadline, (_take, (lock, deadline)), lock, lock.waiters)


def give(k: Core, task: Task, lock: Semaphore | Mutex) -> None:
    task.result = True
    if isinstance(lock, Semaphore):
        task.result, switch = give_semaphore(k, task.code, lock)
        if switch:
            k.reschedule()
        return
    if lock.holder is not task:
        owner = f"which {lock.holder.name!r} holds" if lock.holder else "which nobody holds"
        raise ValueError(f"task {task.name!r} gives mutex {lock.name!r}, {owner}; only its holder may give it")
    if lock.depth:
        lock.depth -= 1
        return
    k.log((k.now, GIVE, task.code, lock.code, lock.count, 0))
    if lock.protocol.give(k, task, lock):
        k.reschedule()


def give_semaphore(k: Core, by: int, semaphore: Semaphore) -> tuple[bool, bool]:
    """Whether there was room for another count, and whether the waiter it woke is above the running task."""
    count = semaphore.count
    if count == semaphore.length:
        k.log((k.now, GIVE_FAIL, by, semaphore.code, count, 0))
        return False, False
    k.log((k.now, GIVE, by, semaphore.code, count, 0))
    semaphore.count = count + 1
    return True, bool(semaphore.waiters) and k.wake(semaphore.waiters)


# Queues


def send(k: Core, task: Task, queue: Queue, item: Any, timeout: int | None, kind: int = SEND) -> None:
    _send(k, task, queue, item, _deadline(k, timeout), kind)


def send_front(k: Core, task: Task, queue: Queue, item: Any, timeout: int | None) -> None:
    send(k, task, queue, item, timeout, SEND_FRONT)


def _send(k: Core, task: Task, queue: Queue, item: Any, deadline: int, kind: int) -> None:
    count = len(queue.items)
    if count < queue.length:
        k.log((k.now, kind, task.code, queue.code, count, stamp(item)))
        if kind == SEND:
            queue.items.append(item)
        else:
            queue.items.appendleft(item)
        task.result = True
        if queue.receivers and k.wake(queue.receivers):
            k.reschedule()
    elif k.ticks >= deadline:
        k.log((k.now, SEND_FAIL, task.code, queue.code, count, stamp(item)))
        task.result = False
    else:
        k.log((k.now, SEND_BLOCK, task.code, queue.code, count, stamp(item)))
        k.block(task, deadline, (_send, (queue, item, deadline, kind)), queue, queue.senders)


def overwrite(k: Core, task: Task, queue: Queue, item: Any) -> None:
    k.log((k.now, OVERWRITE, task.code, queue.code, len(queue.items), stamp(item)))
    queue.items.clear()
    queue.items.append(item)
    task.result = True
    if queue.receivers and k.wake(queue.receivers):
        k.reschedule()


def receive(k: Core, task: Task, queue: Queue, timeout: int | None) -> None:
    _receive(k, task, queue, _deadline(k, timeout))


def _receive(k: Core, task: Task, queue: Queue, deadline: int) -> None:
    if queue.items:
        item = queue.items.popleft()
        k.log((k.now, RECV, task.code, queue.code, len(queue.items) + 1, stamp(item)))
        task.result = item
        if queue.senders and k.wake(queue.senders):
            k.reschedule()
    else:
        _no_item(k, task, queue, deadline, _receive, RECV_FAIL, RECV_BLOCK)


def peek(k: Core, task: Task, queue: Queue, timeout: int | None) -> None:
    _peek(k, task, queue, _deadline(k, timeout))


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
    if k.ticks >= deadline:
        k.log((k.now, fails, task.code, queue.code, 0, 0))
        task.result = None
    else:
        k.log((k.now, blocks, task.code, queue.code, 0, 0))
        k.block(task, deadline, (retry, (queue, deadline)), queue, queue.receivers)


# Notifications (rule 26)


def notify_give(k: Core, task: Task, target: Task) -> None:
    task.result = None
    if notify(k, task.code, target):
        k.reschedule()


def notify(k: Core, by: int, target: Task) -> bool:
    """Count up; wake the target if it waits in notify_take, or timed out there and has not run. True: it is above the caller."""
    target.notified += 1
    k.log((k.now, NOTIFY, by, target.code, target.notified, 0))
    if not target.awaits_notification:
        return False
    target.awaits_notification = False
    return k.make_ready(target)


def notify_take(k: Core, task: Task, clear: bool, timeout: int | None) -> None:
    if task.notified or timeout == 0:
        _notify_take(k, task, clear)
    else:
        k.log((k.now, NOTIFY_TAKE_BLOCK, task.code, -1, 0, 0))
        task.awaits_notification = True
        k.sleep(task, _deadline(k, timeout), (_notify_take, (clear,)))


def _notify_take(k: Core, task: Task, clear: bool) -> None:
    count = task.result = task.notified
    task.awaits_notification = False
    if count:
        task.notified = 0 if clear else count - 1
    k.log((k.now, NOTIFY_TAKE, task.code, -1, count, 0))


# Time


def delay(k: Core, task: Task, ticks: int) -> None:
    wake = k.ticks + ticks
    task.result = None
    k.log((k.now, DELAY, task.code, -1, wake * k.tick, 0))
    if ticks:
        k.sleep(task, wake)
    else:
        k.reschedule()  # rule 8


def delay_until(k: Core, task: Task, period: int, since: int | None) -> None:
    """Rule 25. Each call ends a job and releases the next one; the nominal release is the wake time, even if that has passed.

    A previous wake time that is still to come is to the kernel a tick count that has overflowed: the call does not block, and
    the wake time moves on (rule 59 of part 2). The next job is then released at once.
    """
    now, tick = k.now, k.tick
    previous = task.last_wake = task.last_wake if since is None else since
    if task.job < 0 and task.released < 0 and task.computed >= max(previous, 0) * tick:
        release(k, task, max(previous, 0) * tick)  # it began with work instead of waiting for its first release
    wake = task.last_wake = previous + period
    at = wake * tick
    task.result = sleeps = previous <= k.ticks < wake
    if task.released >= 0:
        task.released = -1
        k.log((now, COMPLETE, task.code, -1, task.due, task.job, now, DELAY_UNTIL, task.code, -1, at, sleeps))
    else:
        k.log((now, DELAY_UNTIL, task.code, -1, at, sleeps))
    if sleeps:
        task.next_release = at
        k.sleep(task, wake)
    else:
        release(k, task, at)
        k.reschedule()


def yield_cpu(k: Core, task: Task) -> None:
    task.result = None
    k.log((k.now, YIELD, task.code, -1, 0, 0))
    k.reschedule()


# Tasks


def suspend(k: Core, task: Task, target: Task | None) -> None:
    target = target or task
    task.result = None
    k.log((k.now, SUSPEND, task.code, target.code, 0, 0))
    k.suspend(target)
    if target is task or k.is_outranked():
        k.reschedule()


def resume(k: Core, task: Task, target: Task) -> None:
    task.result = None
    if resumed(k, task.code, target):
        k.reschedule()


def resumed(k: Core, by: int, target: Task) -> bool:
    """Rules 23 and 24. True if the target was suspended and is above the running task."""
    if target.state != SUSPENDED:
        return False
    k.log((k.now, RESUME, by, target.code, 0, 0))
    if target.next_release >= 0:
        release(k, target, target.next_release)
    return k.make_ready(target)


def set_priority(k: Core, task: Task, target: Task | None, priority: int) -> None:
    """Rules 20 to 22."""
    target = target or task
    base, current = target.base, target.priority
    task.result = None
    if priority != base and not k.textbook and (current == base or priority > current):
        current = priority
    k.log((k.now, PRIO_SET, task.code, target.code, priority, current))
    if priority == base:
        return
    target.base = priority
    if k.textbook:
        settle(k, target, None, None)
    else:
        target.key = priority
        k.change_priority(target, current)
    lowers_itself = target is task and priority < base
    raises_above = target is not task and base < priority and priority > task.priority
    if lowers_itself or raises_above or k.is_outranked():
        k.reschedule()


def end_task(k: Core, task: Task) -> None:
    """The body has returned: the task is deleted, and its last job is complete."""
    complete(k, task)
    k.log((k.now, DONE, task.code, -1, 0, 0))
    task.state = DELETED
    k.ready.remove(task)
    k.reschedule()


# Jobs, scopes and marks: rows in the trace that take no time


def release(k: Core, task: Task, nominal: int) -> None:
    """A job begins: its response time counts from `nominal`, in cycles, or from now if that is still to come."""
    now, code = k.now, task.code
    if nominal > now or nominal < 0:
        nominal = min(max(nominal, 0), now)
    task.next_release = -1
    task.released = nominal
    task.job = job = task.job + 1
    if task.deadline is None:
        k.log((now, RELEASE, code, -1, nominal, job))
    else:
        task.due = nominal + task.deadline
        k.log((now, RELEASE, code, -1, nominal, job, now, DEADLINE, code, -1, task.due, job))


def complete(k: Core, task: Task) -> None:
    """The open job, if there is one, is done: at this request, not at the end of its last computation.

    If that end falls on a tick that releases a higher task, the request comes after that task has run, as in the real kernel.
    Response-time analysis counts to the end of the computation, so a body that is to meet its bound exactly leaves its last
    cycle to the request.
    """
    if task.released >= 0:
        k.log((k.now, COMPLETE, task.code, -1, task.due, task.job))
        task.released = -1


def begin(k: Core, task: Task, scope: str) -> None:
    k.log((k.now, BEGIN, k.code_of(scope), task.code, 0, 0))


def end(k: Core, task: Task, scope: str) -> None:
    k.log((k.now, END, k.code_of(scope), task.code, 0, 0))


def mark(k: Core, task: Task, value: int, extra: int) -> None:
    k.log((k.now, MARK, task.code, -1, value, extra))


def stamp(item: Any) -> int:
    """How an item shows in the trace: an integer of up to 63 bits as itself, anything else as 0."""
    return item if isinstance(item, int) and -FOREVER < item < FOREVER else 0


def _deadline(k: Core, timeout: int | None) -> int:
    return FOREVER if timeout is None else k.ticks + timeout


#: The services that can cost something, by the names that `Costs` uses.
PRICED: dict[str, Service] = {
    "take": take,
    "give": give,
    "send": send,
    "send_front": send_front,
    "overwrite": overwrite,
    "receive": receive,
    "peek": peek,
    "notify_give": notify_give,
    "notify_take": notify_take,
    "delay": delay,
    "delay_until": delay_until,
    "yield_cpu": yield_cpu,
    "suspend": suspend,
    "resume": resume,
    "set_priority": set_priority,
}
