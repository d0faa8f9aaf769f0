"""The one vocabulary of events that every model, log reader and picture of the lab shares.

An event is a row of six integers: `time, kind, task, other, value, extra`, and the core it happens on where there are several.
What the last three mean depends on the kind and is stated here, in one place; where nothing is stated, `other` is -1 and the
rest 0. `task` and `other` are indices into `Trace.names` (-1: none); a task and a lock therefore share one name space.

`task` is the one that does it or that it happens to: the task switched in (-1: idle), made ready, released, aborted, whose
priority changes; the caller of a service (-1: an interrupt); for `begin` and `end` the scope, or the task itself in a log; for
`isr` the task interrupted, for `overhead` the one that has to wait meanwhile.

A `switch` from a task to itself is the first row of a core, in a window or a recording: the task had the core before.

A job is its task and its number. Its `release` is followed by its `deadline`, if it has one. Its main part ends with `complete`
or `abort`; after an abort the exception part, which is a name of its own (`Trace.exception_of`), ends with a `complete` of the
same job. There is no event for a missed deadline: it follows from these, see `labkit.trace.jobs`.
"""

_ROWS = """
switch             other: task switched out      value: current priority        extra: state of `other`, see STATES
ready                                            value: current priority
create                                           value: base priority
done
release                                          value: nominal release time    extra: job number from 0
deadline                                         value: absolute deadline       extra: job number
complete                                         value: absolute deadline or -1 extra: job number
abort                                            value: absolute deadline or -1 extra: job number
begin              other: caller; log: enclosing scope or -1
end                other: caller; log: -1
inherit            other: task that caused it    value: priority from now on    extra: base priority
disinherit         other: mutex or -1            value: priority from now on    extra: priority before
disinherit_timeout other: mutex or -1            value: priority from now on    extra: priority before
prio_set           other: task whose base is set value: new base priority       extra: its current priority
take               other: object                 value: count before
take_block         other: object                 value: count before
take_fail          other: object                 value: count before
give               other: object                 value: count before
give_fail          other: object                 value: count before
send               other: queue                  value: items before            extra: item
send_front         other: queue                  value: items before            extra: item
overwrite          other: queue                  value: items before            extra: item
send_block         other: queue                  value: items before
send_fail          other: queue                  value: items before            extra: item
recv               other: queue                  value: items before            extra: item
recv_block         other: queue                  value: items before
recv_fail          other: queue                  value: items before
peek               other: queue                  value: items before            extra: item
peek_block         other: queue                  value: items before
peek_fail          other: queue                  value: items before
notify             other: task notified          value: its value afterwards    extra: see NOTIFY_ACTIONS
notify_take                                      value: value taken (0: none)   extra: index of the notification
notify_take_block                                                               extra: index of the notification
delay                                            value: wake time               extra: ticks asked for
delay_until                                      value: wake time               extra: 1 blocked, 0 late
yield
suspend            other: task suspended
resume             other: task resumed
isr                other: target or -1           value: its argument            extra: index into ISR_OPS
isr_end
mark                                             value: free                    extra: free
overhead                                         value: time the kernel takes   extra: index into OVERHEADS
enter_critical                                   value: depth afterwards
exit_critical                                    value: depth afterwards
tick_lost                                        value: tick count, which stays
suspend_all
resume_all
delete             other: task deleted
abort_delay        other: task                   value: 1 it was blocked, 0 not
notify_wait                                      value: value before clearing   extra: 2 * index + 1 if it was notified
notify_wait_block                                                               extra: index of the notification
set_bits           other: event group            value: bits before             extra: bits to set
clear_bits         other: event group            value: bits before             extra: bits to clear
wait_bits          other: event group            value: bits returned           extra: 2 * bits waited for + 1 if that is met
wait_bits_block    other: event group            value: bits now                extra: bits waited for
sync               other: event group            value: bits returned           extra: 2 * bits waited for + 1 if that is met
sync_block         other: event group            value: bits now                extra: bits waited for
stream_send        other: stream buffer          value: bytes sent              extra: bytes in the buffer before
stream_send_block  other: stream buffer          value: bytes in the buffer     extra: bytes to send
stream_recv        other: stream buffer          value: bytes received          extra: bytes in the buffer before
stream_recv_block  other: stream buffer          value: bytes in the buffer
message_send       other: message buffer         value: bytes sent              extra: bytes in the buffer before
message_send_block other: message buffer         value: bytes in the buffer     extra: bytes to send
message_recv       other: message buffer         value: bytes received          extra: bytes in the buffer before
message_recv_block other: message buffer         value: bytes in the buffer
queue_reset        other: queue                  value: items before
set_send           other: queue set              value: members before          extra: the member sent to, a name
select             other: queue set              value: members before          extra: the member returned, a name
select_block       other: queue set              value: members before
select_fail        other: queue set              value: members before
timer_send         other: timer or -1            value: commands before         extra: index into TIMER_COMMANDS
timer_send_block   other: timer or -1            value: commands before         extra: index into TIMER_COMMANDS
timer_send_fail    other: timer or -1            value: commands before         extra: index into TIMER_COMMANDS
timer_command      other: timer                  value: tick count or period    extra: index into TIMER_COMMANDS
timer_expired      other: timer
pend_call                                        value: its number
malloc             other: what it is for or -1   value: free bytes afterwards   extra: bytes asked for
malloc_failed      other: what it is for or -1   value: free bytes              extra: bytes asked for
free               other: what it was for or -1  value: free bytes afterwards   extra: bytes given back
"""

KINDS: tuple[str, ...] = tuple(line.split(maxsplit=1)[0] for line in _ROWS.split("\n") if line)
CODE: dict[str, int] = {name: code for code, name in enumerate(KINDS)}

#: States of a task as FreeRTOS names them; a `switch` row carries the index in `extra`.
STATES: tuple[str, ...] = ("ready", "blocked", "suspended", "deleted", "running")

#: What an interrupt handler does; an `isr` row carries the index in `extra`. Its `task` is the one interrupted.
ISR_OPS: tuple[str, ...] = (
    *("notify_give", "give", "send", "resume", "send_front", "overwrite", "recv", "take", "notify"),
    *("timer_start", "timer_stop", "timer_reset", "timer_change_period", "set_bits", "clear_bits", "stream_send", "message_send"),
)

#: What a notification does to the value. A `notify` row has in `extra` the index here, + 8 * which of the task's notifications,
#: + 4096 if it was refused.
NOTIFY_ACTIONS: tuple[str, ...] = ("give", "none", "set_bits", "increment", "overwrite", "keep", "buffer")

#: What is asked of the timer task; `timer_send` and `timer_command` rows carry the index in `extra`.
TIMER_COMMANDS: tuple[str, ...] = (
    *("timer_start", "timer_stop", "timer_reset", "timer_change_period", "pend_call", "set_bits", "clear_bits"),
)

#: What the kernel spends time on, from the time of an `overhead` row; `task` is the one that has to wait meanwhile.
OVERHEADS: tuple[str, ...] = ("tick", "switch", "service", "isr")
