"""The executor of micro-ROS (rclc), the timer of rcl, and the wait of its client: rules 1 to 16 of the firmware's middleware.

The rules were read in the public sources (rclc `executor.c`, rcl `timer.c` and `wait.c`, rmw_microxrcedds `rmw_wait.c`, the
Micro-XRCE-DDS client's `session.c`); the docstrings name them by number. Everything here runs inside one task of
`labkit.kernel`: a callback is a generator of the kernel's requests, and `spin_once` is a part of the task's body.
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

Requests = Generator[Any, Any, Any]
#: Called with the kernel's services and what was taken: a message (None where there is none), or for a timer the ticks since its
#: last call (rule 10).
Callback = Callable[[Any, Any], Requests]
TimerRule = Literal["jazzy", "humble"]
Semantics = Literal["default", "let"]
Trigger = Literal["any", "all", "always"] | int
WaitRule = Literal["poll", "at least 1", "0 is for ever", "for ever"]

TIMER_RULES: dict[str, str] = {"jazzy": "Jazzy: late by a period is dropped", "humble": "Humble: late by a period is caught up"}
#: What a wait's limit means to the transport (rules 14 and 15).
WAIT_RULES: dict[str, str] = {
    "poll": "poll: 0 returns at once",
    "at least 1": "client without poll: 0 becomes 1 ms",
    "0 is for ever": "receive timeout: lwIP reads 0 as for ever",
    "for ever": "receive timeout not compiled in: waits for a packet",
}
HEARTBEAT_EVERY, CONFIRM_WITHIN = 100, 1000  # ticks, which are ms: of a reliable publish
DATA, TICK, EMPTY = 0, 1, 2  # what ended a wait: data; its limit; nothing there, and no time to wait


@dataclass
class Timer:
    """A timer of rcl over the tick count (rules 7 to 10).

    Args:
        period: in ticks, 1 or more.
        callback: called with the ticks since the last call.
        created: tick count at its creation; the first call is due a period later.

    Attributes:
        next: tick at which it is due. last: of its last call. calls, dropped: calls made, and periods jumped over.
    """

    period: int
    callback: Callback
    rule: TimerRule = "jazzy"
    created: int = 0
    next: int = field(init=False)
    last: int = field(init=False)
    calls: int = field(init=False, default=0)
    dropped: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        if self.period < 1:
            raise ValueError(f"a timer with a period of {self.period} ticks; 1 or more is allowed")
        if self.rule not in TIMER_RULES:
            raise ValueError(f"timer rule {self.rule!r}; there are {', '.join(TIMER_RULES)}")
        self.next, self.last = self.created + self.period, self.created

    def ready(self, now: int) -> bool:
        """Rule 8."""
        return self.next <= now

    def call(self, now: int) -> int:
        """Rule 9: move on to the next due time, on the same grid for ever. Returns the ticks since the last call."""
        self.next += self.period
        behind = now - self.next
        if self.rule == "jazzy" and behind >= 0:
            missed = behind // self.period + 1  # after it, next is later than now
        elif behind > 0:
            missed = -(-behind // self.period)  # after it, next is now or later
        else:
            missed = 0
        self.next += missed * self.period
        self.dropped += missed
        self.calls += 1
        elapsed, self.last = now - self.last, now
        return elapsed

    def has_input(self, now: int) -> bool:
        return self.ready(now)

    def take(self, now: int) -> int:
        return self.call(now)


@dataclass
class Subscription:
    """A subscription with a buffer of its newest messages (rule 16).

    Args:
        always: it is called in every pass that is triggered, with None when there is no message (rule 4).
        depth: messages kept.
    """

    topic: str
    callback: Callback
    always: bool = False
    depth: int = 1
    buffer: deque = field(init=False)

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise ValueError(f"subscription {self.topic!r} keeps {self.depth} messages; 1 or more is allowed")
        self.buffer = deque(maxlen=self.depth)

    def has_input(self, now: int) -> bool:
        return bool(self.buffer)

    def take(self, now: int) -> Any:
        return self.buffer.popleft() if self.buffer else None


Handle = Timer | Subscription


@dataclass
class Executor:
    """Handles in the order in which they were added, which is the only order there is (rules 1 to 5).

    Args:
        semantics: "default" takes and executes handle by handle, "let" takes all first (rule 2).
        trigger: "any" handle is ready, "all" are, the one with this index is, or "always" (rule 3).
        limit: of each wait, in ticks.
        before, after: cycles of a pass before its wait (building the wait set) and after it (asking the handles).
    """

    name: str
    handles: Sequence[Handle]
    semantics: Semantics = "default"
    trigger: Trigger = "any"
    limit: int = 1
    before: int = 0
    after: int = 0
    timers: Sequence[Timer] = field(init=False)

    def __post_init__(self) -> None:
        self.timers = [handle for handle in self.handles if isinstance(handle, Timer)]
        if isinstance(self.trigger, int) and not 0 <= self.trigger < len(self.handles):
            raise ValueError(f"executor {self.name!r} is triggered by handle {self.trigger}; it has {len(self.handles)}")

    def wait_limit(self, now: int) -> int:
        """Rule 11: the spin limit, or what is left until the first of *its own* timers, in whole ticks, never below 0."""
        limit = self.limit
        for timer in self.timers:
            if timer.next - now < limit:
                limit = timer.next - now
        return max(0, limit)

    def triggered(self, ready: Sequence[bool]) -> bool:
        """Rule 3."""
        match self.trigger:
            case "any":
                return any(ready)
            case "all":
                return all(ready)
            case "always":
                return True
            case index:
                return ready[index]


class Client:
    """The session that all executors share: one mailbox of datagrams, and the buffers of all subscriptions (rules 12 to 16).

    Args:
        mailbox: the kernel's queue where the network puts datagrams; lwIP's holds 6.
        subscriptions: by topic; a datagram for another topic is data for nobody but ends a wait all the same.
        pool: messages that all buffers can hold together; what finds none free is dropped.
        rule: what the transport makes of a limit.
        topic_of: the topic of a datagram; None if it carries no data (a heartbeat, an acknowledgement).

    Attributes:
        waits: four numbers for each wait: its limit in ticks, what ended it, its end in cycles, and the number of the topic whose
            data ended it, in the order of the subscriptions (-1: none, or one that nobody has subscribed to).
        dropped: messages that found no free buffer. unconfirmed: reliable publishes given up.
    """

    def __init__(
        self,
        mailbox: Any,
        subscriptions: Iterable[Subscription],
        topic_of: Callable[[Any], str | None] = lambda datagram: datagram,
        pool: int = 4,
        rule: WaitRule = "poll",
    ):
        if rule not in WAIT_RULES:
            raise ValueError(f"wait rule {rule!r}; there are {', '.join(WAIT_RULES)}")
        self.mailbox, self.pool, self.rule, self.topic_of = mailbox, pool, rule, topic_of
        self.subscriptions: Mapping[str, Subscription] = {s.topic: s for s in subscriptions}
        self._numbers = {topic: n for n, topic in enumerate(self.subscriptions)}
        self.waits = array("q")
        self.dropped = self.unconfirmed = 0

    def wait(self, os: Any, limit: int) -> Requests:
        """Read datagrams until one carries data, whoever it is for; what is in the buffers already does not count (rule 12).

        Datagrams without data only use up the time (rule 13). A limit of n ticks ends at the n-th coming tick (rule 14).
        """
        if self.rule == "at least 1":
            limit = max(limit, 1)
        endless = self.rule == "for ever" or (self.rule == "0 is for ever" and limit == 0)
        end, number = os.ticks + limit, -1
        while True:
            datagram = yield os.receive(self.mailbox, None if endless else max(end - os.ticks, 0))
            if datagram is None:
                ended = TICK if limit else EMPTY
                break
            topic = self.topic_of(datagram)
            if topic is not None:
                self.store(topic, datagram)
                ended, number = DATA, self._numbers.get(topic, -1)
                break
            if not endless and os.ticks >= end:
                ended = TICK if limit else EMPTY
                break
        self.waits.extend((limit, ended, os.now, number))

    def confirm(self, os: Any, answer_of: Callable[[Any], bool | None], again: Callable[[bool], None]) -> Requests:
        """A reliable publish, after it has sent: inside the callback, until the agent has acknowledged, for a second at most.

        Data that come meanwhile go to their buffers, whoever they are for. Without an answer it sends a heartbeat every 100 ms.
        (rmw_microxrcedds `rmw_publish.c`, the client's `session.c` and `output_reliable_stream.c`, the agent's `Processor.cpp`.)

        Args:
            answer_of: what a datagram without data says: True for acknowledged, False for missing, None for nothing of that.
            again: sends once more: the message (True) or a heartbeat (False).

        Returns whether it was acknowledged.
        """
        end = os.ticks + CONFIRM_WITHIN
        beat = os.ticks + HEARTBEAT_EVERY
        while os.ticks < end:
            datagram = yield os.receive(self.mailbox, max(0, min(beat, end) - os.ticks))
            if datagram is None:
                beat += HEARTBEAT_EVERY
                again(False)
            elif (topic := self.topic_of(datagram)) is not None:
                self.store(topic, datagram)
            elif answer := answer_of(datagram):
                return True
            elif answer is False:
                again(True)
        self.unconfirmed += 1
        return False

    def store(self, topic: str, message: Any) -> None:
        """Rule 16: the newest `depth` stay; if all of the pool is taken by others, the message is dropped."""
        subscription = self.subscriptions.get(topic)
        if subscription is None:
            return
        full = sum(len(s.buffer) for s in self.subscriptions.values()) >= self.pool
        if full and len(subscription.buffer) < subscription.depth:
            self.dropped += 1
        else:
            subscription.buffer.append(message)


def spin_once(os: Any, executor: Executor, client: Client) -> Requests:
    """One pass (rule 1): build the wait set, wait once, see who is ready, ask the trigger, go through the handles in order."""
    if executor.before:
        yield executor.before
    yield from client.wait(os, executor.wait_limit(os.ticks))
    if executor.after:
        yield executor.after
    now = os.ticks
    ready = [handle.has_input(now) for handle in executor.handles]
    if not executor.triggered(ready):
        return  # nothing is taken; what has come stays in the buffers
    due = [h for h, some in zip(executor.handles, ready, strict=True) if some or (isinstance(h, Subscription) and h.always)]
    if executor.semantics == "let":
        inputs = [None if isinstance(handle, Timer) else handle.take(now) for handle in due]
        for handle, taken in zip(due, inputs, strict=True):
            yield from handle.callback(os, handle.call(os.ticks) if isinstance(handle, Timer) else taken)
    else:
        for handle in due:
            yield from handle.callback(os, handle.take(os.ticks))


def spin(os: Any, executors: Sequence[Executor], client: Client) -> Requests:
    """Spin each executor in turn, for ever: the loop of the firmware's task."""
    while True:
        for executor in executors:
            yield from spin_once(os, executor, client)


def spin_periodically(os: Any, executor: Executor, client: Client, period: int) -> Requests:
    """Rule 6: a pass, then sleep until start + k periods (in ticks); an overrun skips the sleep and is caught up."""
    due = os.ticks
    while True:
        yield from spin_once(os, executor, client)
        due += period
        if due > os.ticks:
            yield os.delay(due - os.ticks)
