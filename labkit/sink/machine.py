"""The machine on which a variant runs: its threads, its memory, who may run, and what one step does to the whole state.

A state is a tuple: the position of each thread, the variables, and for each producer how many elements it has claimed and how
many of them were sent. The program does not see the last two; by them each step is judged.
Memory is sequentially consistent: every access takes effect at once and for all. What a compiler or a processor may exchange,
and the memory order that forbids it, is told in `lessons`.
"""

from __future__ import annotations

from functools import partial

from labkit.sink.accesses import Kind
from labkit.sink.automaton import Automaton, Node
from labkit.sink.ring import SCHEDULES, Ring
from labkit.sink.variants import VARIANTS, Variant, consumer, dma, producer

State = tuple[int, ...]

_READ, _WRITE, _CAS, _ADD, _WAIT, _PUT, _TAKE, _SLEEP, _RELEASE, _FAIL, _DONE = map(int, Kind)
_ASLEEP = (_SLEEP, _RELEASE)


class Machine:
    """Producers P1, P2, ... and the consumer on one processor, the DMA beside it if the ring has one.

    Args:
        variant: a name in `VARIANTS`.
        schedule: "free": any thread that can run may take the next step. Else one core with fixed priorities: the consumer
            "higher" or "lowest" among producers of different priorities (P1 the least), or all "equal", among which
            the processor may change at any tick. There a message begins when its producer is released, at any time.
            The DMA and the tick are hardware: they come at any time, the tick only while interrupts are enabled.
        merge: see `Automaton`.

    The mutex has no priority inheritance here: a waiting thread is not ready, and no verdict hangs on how long it waits.
    """

    def __init__(self, variant: str, ring: Ring, schedule: str = "free", merge: bool = True) -> None:
        if variant not in VARIANTS:
            raise ValueError(f"there is no variant {variant!r}; there are {', '.join(VARIANTS)}")
        if schedule not in SCHEDULES:
            raise ValueError(f"there is no schedule {schedule!r}; there are {', '.join(SCHEDULES)}")
        self.ring, self.schedule, kind = ring, schedule, VARIANTS[variant]
        memory = _memory(ring, kind)
        self.names = [f"P{p + 1}" for p in range(ring.producers)] + ["consumer"] + ["DMA"] * ring.dma
        self.consumer, self.hardware = ring.producers, ring.producers + 1
        first = len(self.names)
        self.variables = dict(zip(range(first, first + len(memory)), memory))
        self.claimed = first + len(memory)
        self.sent = self.claimed + ring.producers
        place = {name: index for index, name in self.variables.items()}
        self.irq = place["irq"]
        starts = [partial(producer, ring, p, kind.push) for p in range(ring.producers)]
        starts += [partial(consumer, ring, kind.drain)] + [partial(dma, ring)] * ring.dma
        self.threads = [Automaton(start, place, releases=schedule != "free", merge=merge) for start in starts]
        producers = range(1, ring.producers + 1)
        self.priorities = {
            "free": None,
            "higher": [*producers, ring.producers + 1],
            "equal": [1] * (ring.producers + 1),
            "lowest": [*producers, 0],
        }[schedule]
        self.initial: State = (0,) * first + tuple(memory.values()) + (0,) * (2 * ring.producers)

    def node(self, state: State, thread: int) -> Node:
        """Where the thread stands."""
        return self.threads[thread].nodes[state[thread]]

    def can_step(self, state: State) -> list[int]:
        """The threads that may take the next step; for one that sleeps the step is the tick that wakes it."""
        off, hardware, priorities = state[self.irq], self.hardware, self.priorities
        ready, others = [], []
        for thread, automaton in enumerate(self.threads):
            node = automaton.nodes[state[thread]]
            kind = node.kind
            if kind == _DONE or (kind == _WAIT and state[node.variable] != node.a):
                continue
            if thread == hardware:
                others.append(thread)
            elif off and off != thread + 1:
                continue
            elif kind in _ASLEEP:
                others.append(thread)
            else:
                ready.append(thread)
        if priorities is not None and len(ready) > 1:
            top = max([priorities[thread] for thread in ready])
            ready = [thread for thread in ready if priorities[thread] == top]
        return ready + others

    def step(self, state: State, thread: int) -> tuple[State, str]:
        """The state after a step of the thread, and what is wrong with the step: a verdict, or "" for nothing."""
        automaton = self.threads[thread]
        node = automaton.nodes[state[thread]]
        kind, at, after = node.kind, node.variable, list(state)
        answer, wrong = 0, ""
        if kind == _READ:
            answer = state[at]
        elif kind == _WRITE:
            after[at] = node.a
            if node.claims:
                after[self.claimed + thread] += node.claims
        elif kind == _WAIT:
            after[at] = node.b
        elif kind == _CAS:
            if state[at] == node.a:
                after[at], answer = node.b, 1
                after[self.claimed + thread] += node.claims
        elif kind == _PUT:
            wrong = self._overwritten(state, at)
            after[at] = node.a
        elif kind == _TAKE:
            wrong = self._misread(state, after, at)
        elif kind == _ADD:
            answer = state[at]
            after[at] = (answer + node.a) % node.b
        elif kind == _FAIL:
            return state, "assert"
        reached = node.next.get(answer)
        after[thread] = automaton.follow(node, answer) if reached is None else reached
        return tuple(after), wrong

    def _overwritten(self, state: State, slot: int) -> str:
        """Storing into a slot with an element that was claimed and not yet sent destroys it."""
        if (held := state[slot]) == 0:
            return ""
        owner, place = divmod(held - 1, self.ring.share)
        return "overwritten" if state[self.sent + owner] <= place < state[self.claimed + owner] else ""

    def _misread(self, state: State, after: list[int], slot: int) -> str:
        """What is sent must be the next element of its producer, and continue the message that was begun."""
        if (held := state[slot]) == 0:
            return "stale"
        ring, sent = self.ring, self.sent
        owner, place = divmod(held - 1, ring.share)
        if place < state[sent + owner]:
            return "stale"  # it was sent before: the one that belongs here is not yet stored
        if place >= state[self.claimed + owner]:
            return "overwritten"  # whoever stored this has not got the slot, but another, whose element is gone
        if place > state[sent + owner]:
            return "lost"  # those before it are skipped
        after[sent + owner] += 1
        if ring.bytes > 1 and any(state[sent + p] % ring.bytes for p in range(ring.producers) if p != owner):
            return "torn"
        return ""

    def finished(self, state: State) -> bool:
        """Everything was sent."""
        return min(state[self.sent :]) == self.ring.share

    def written(self, state: State) -> bool:
        """All producers are through."""
        return all(self.node(state, thread).kind == _DONE for thread in range(self.ring.producers))

    def asleep(self, state: State, thread: int) -> bool:
        """It has paused, and a tick wakes it. (A release is no such thing: it is work to come.)"""
        return self.node(state, thread).kind == _SLEEP


def _memory(ring: Ring, variant: Variant) -> dict[str, int]:
    """Every variable and its first value."""
    memory = {"write": ring.start, "read": ring.start, "irq": 0, **variant.shared(ring)}
    if ring.dma:
        memory |= {"dma_from": 0, "dma_count": 0, "dma_start": 0, "dma_done": 0}
    return memory | {f"buf[{i}]": 0 for i in range(ring.capacity)}
