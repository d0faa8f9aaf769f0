"""The one vocabulary of events that every model, log reader and picture of the lab shares.

An event is a row of six integers: `time, kind, task, other, value, extra`, and the core it happens on where there are several.
What the last three mean depends on the kind and is stated here, in one place; where nothing is stated, `other` is -1 and the
rest 0. `task` and `other` are indices into `Trace.names` (-1: none); a task and a lock therefore share one name space.

`task` is the one that does it or that it happens to: the task switched in (-1: idle), made ready, released, aborted, whose
priority changes; the caller of a service (-1: an interrupt); for `begin` and `end` the scope, or the task itself in a log; for
`isr` the task interrupted, for `overhead` the one that has to wait meanwhile.

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
notify             other: task notified          value: its count afterwards
notify_take                                      value: count taken (0: none)
notify_take_block
delay                                            value: wake time
delay_until                                      value: wake time               extra: 1 blocked, 0 late
yield
suspend            other: task suspended
resume             other: task resumed
isr                other: target or -1           value: its argument            extra: index into ISR_OPS
isr_end
mark                                             value: free                    extra: free
overhead                                         value: time the kernel takes   extra: index into OVERHEADS
"""

KINDS: tuple[str, ...] = tuple(line.split(maxsplit=1)[0] for line in _ROWS.split("\n") if line)
CODE: dict[str, int] = {name: code for code, name in enumerate(KINDS)}

#: States of a task as FreeRTOS names them; a `switch` row carries the index in `extra`.
STATES: tuple[str, ...] = ("ready", "blocked", "suspended", "deleted", "running")

#: What an interrupt handler does; an `isr` row carries the index in `extra`. Its `task` is the one interrupted.
ISR_OPS: tuple[str, ...] = ("notify_give", "give", "send", "resume")

#: What the kernel spends time on, from the time of an `overhead` row; `task` is the one that has to wait meanwhile.
OVERHEADS: tuple[str, ...] = ("tick", "switch", "service", "isr")
