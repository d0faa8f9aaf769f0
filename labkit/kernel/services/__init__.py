"""The kernel's services: what happens when a task has said `yield os.take(lock)`.

A service is a function of the core, the calling task and its arguments; it leaves the answer in `task.result`. One that has to
wait leaves itself in `task.pending` and is tried again when the task next runs: there is no hand-off (rule 9). One that has
more to do after a switch leaves that there. Rule numbers are those of tests/oracle/freertos (1 to 27) and freertos2 (from 28).
"""

from __future__ import annotations

from collections.abc import Callable

from labkit.kernel.services import (
    buffers,
    delays,
    events,
    jobs,
    memory,
    notifications,
    queues,
    sections,
    semaphores,
    sets,
    tasks,
    timers,
)

Service = Callable[..., None]

#: The services that can cost something, by the names that `Costs` uses.
PRICED: dict[str, Service] = {
    "take": semaphores.take,
    "give": semaphores.give,
    "send": queues.send,
    "send_front": queues.send_front,
    "overwrite": queues.overwrite,
    "receive": queues.receive,
    "peek": queues.peek,
    "reset": queues.reset,
    "messages_waiting": queues.messages_waiting,
    "spaces_available": queues.spaces_available,
    "select": sets.select,
    "notify": notifications.notify,
    "notify_give": notifications.notify_give,
    "notify_take": notifications.notify_take,
    "notify_wait": notifications.notify_wait,
    "notify_state_clear": notifications.state_clear,
    "notify_value_clear": notifications.value_clear,
    "set_bits": events.set_bits,
    "clear_bits": events.clear_bits,
    "get_bits": events.get_bits,
    "wait_bits": events.wait_bits,
    "sync": events.sync,
    "buffer_send": buffers.send,
    "buffer_receive": buffers.receive,
    "buffer_available": buffers.available,
    "buffer_spaces": buffers.spaces,
    "timer_start": timers.timer_start,
    "timer_stop": timers.timer_stop,
    "timer_reset": timers.timer_reset,
    "timer_change_period": timers.timer_change_period,
    "timer_active": timers.timer_active,
    "pend_call": timers.pend_call,
    "delay": delays.delay,
    "delay_until": delays.delay_until,
    "abort_delay": delays.abort_delay,
    "yield_cpu": delays.yield_cpu,
    "create": tasks.create,
    "delete": tasks.delete,
    "suspend": tasks.suspend,
    "resume": tasks.resume,
    "set_priority": tasks.set_priority,
    "get_priority": tasks.get_priority,
    "get_base_priority": tasks.get_base_priority,
    "allocate": memory.allocate,
    "free": memory.free,
    "enter_critical": sections.enter_critical,
    "exit_critical": sections.exit_critical,
    "suspend_all": sections.suspend_all,
    "resume_all": sections.resume_all,
}

__all__ = [
    "PRICED",
    "Service",
    "buffers",
    "delays",
    "events",
    "jobs",
    "memory",
    "notifications",
    "queues",
    "sections",
    "semaphores",
]
__all__ += ["sets", "tasks", "timers"]
