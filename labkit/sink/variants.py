"""The sink in eleven variants: how a message is pushed into the ring, and how the consumer takes what is there.

Source 1, 4.1, and the public code behind it; the cures are those that readers propose first. Each variant has one idea, so
that what fails is this idea: where the firmware would fail sooner in another way, the docstring says so. A caller
whose byte is refused sleeps until a tick and tries again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from labkit.sink.accesses import cas, fail, fetch_add, put, read, release, sleep, take, wait, write
from labkit.sink.automaton import Thread
from labkit.sink.ring import Ring

# ------------------------------------------------------------------------------------------------------------ producers


def producer(ring: Ring, me: int, push: Callable[[Ring, int, int], Thread]) -> Thread:
    """A task that writes its messages, each when it is released."""
    for message in range(ring.messages):
        yield release()
        yield from push(ring, me, message)


def published_first(ring: Ring, me: int, message: int) -> Thread:
    """Source 1, listing 17: byte by byte; the index is published before the byte is stored."""
    for i in range(ring.bytes):
        while not (yield from write_or_fail(ring, ring.element(me, message, i))):
            yield sleep()


def write_or_fail(ring: Ring, element: int) -> Thread:
    """One try: full or overtaken is failed."""
    w = yield read("write")
    r = yield read("read")
    if ring.space(w, r) == 0:
        return False
    if not (yield cas("write", w, ring.plus(w, 1), claims=1)):
        return False
    yield put(ring.slot(w), element)
    return True


def published_first_mutex(ring: Ring, me: int, message: int) -> Thread:
    """Source 1, listing 18: a message under the mutex; without space the mutex is given back before the sleep."""
    while True:
        yield wait("mutex", 0, 1)
        if (yield from batch(ring, me, message)):
            break
        yield write("mutex", 0, word="give")
        yield sleep()
    yield write("mutex", 0, word="give")


def batch(ring: Ring, me: int, message: int) -> Thread:
    """A message by one who holds the mutex. Space cannot shrink meanwhile: it is asked for once, not before each byte."""
    w = yield read("write")
    r = yield read("read")
    if ring.space(w, r) < ring.bytes:
        return False
    for i in range(ring.bytes):
        if not (yield cas("write", ring.plus(w, i), ring.plus(w, i + 1), claims=1)):
            yield fail()
        yield put(ring.slot(ring.plus(w, i)), ring.element(me, message, i))
    return True


def atomic_push(ring: Ring, me: int, message: int) -> Thread:
    """Each byte is pushed with interrupts disabled, the message is not."""
    for i in range(ring.bytes):
        while not (yield from undisturbed(ring, me, (ring.element(me, message, i),))):
            yield sleep()


def interrupts_off(ring: Ring, me: int, message: int) -> Thread:
    """The whole message is pushed with interrupts disabled."""
    elements = tuple(ring.element(me, message, i) for i in range(ring.bytes))
    while not (yield from undisturbed(ring, me, elements)):
        yield sleep()


def undisturbed(ring: Ring, me: int, elements: tuple[int, ...]) -> Thread:
    """Stores elements, then publishes them; only the DMA goes on meanwhile."""
    yield wait("irq", 0, me + 1, word="disable")
    w = yield read("write")
    r = yield read("read")
    fits = ring.space(w, r) >= len(elements)
    if fits:
        yield from store_then_publish(ring, w, elements)
    yield write("irq", 0, word="enable")
    return fits


def store_then_publish(ring: Ring, w: int, elements: tuple[int, ...]) -> Thread:
    """For one who is alone: the right order, and no need to compare."""
    for i in range(len(elements)):
        yield put(ring.slot(ring.plus(w, i)), elements[i])
    yield write("write", ring.plus(w, len(elements)), claims=len(elements))


def consumer_mutex(ring: Ring, me: int, message: int) -> Thread:
    """As published first, but the consumer takes the mutex, too, and the writer keeps it while it waits for space."""
    yield wait("mutex", 0, 1)
    while not (yield from batch(ring, me, message)):
        yield sleep()
    yield write("mutex", 0, word="give")


def store_first(ring: Ring, me: int, message: int) -> Thread:
    """The two lines of listing 17 exchanged: the byte is stored into a slot that is not yet one's own."""
    for i in range(ring.bytes):
        while not (yield from store_or_fail(ring, ring.element(me, message, i))):
            yield sleep()


def store_or_fail(ring: Ring, element: int) -> Thread:
    """One try: full or overtaken is failed."""
    w = yield read("write")
    r = yield read("read")
    if ring.space(w, r) == 0:
        return False
    yield put(ring.slot(w), element)
    return (yield cas("write", w, ring.plus(w, 1), claims=1))


def claim(ring: Ring, index: str) -> Thread:
    """Makes a message's slots one's own by moving an index on; gives back the first."""
    while True:
        w = yield read(index)
        r = yield read("read")
        if ring.space(w, r) < ring.bytes:
            yield sleep()
        elif (yield cas(index, w, ring.plus(w, ring.bytes), claims=ring.bytes)):
            return w


def ready_flag(ring: Ring, me: int, message: int) -> Thread:
    """Claim, store, then mark each slot as ready: the consumer asks the mark and not the index."""
    w = yield from claim(ring, "write")
    for i in range(ring.bytes):
        slot = ring.slot(ring.plus(w, i))
        yield put(slot, ring.element(me, message, i))
        yield write(f"ready[{slot}]", 1)


def sequence(ring: Ring, me: int, message: int) -> Thread:
    """Slots that know for which index they are free, and for which they are full (Vyukov's bounded queue).

    One slot is not enough: full for index 0 and free for index 1 would be the same number.
    """
    w = yield from claim_by_sequence(ring)
    for i in range(ring.bytes):
        slot = ring.slot(ring.plus(w, i))
        yield put(slot, ring.element(me, message, i))
        yield write(f"seq[{slot}]", ring.plus(w, i + 1))


def claim_by_sequence(ring: Ring) -> Thread:
    """The last slot of the message is asked: slots come free in order."""
    while True:
        w = yield read("write")
        last = ring.plus(w, ring.bytes - 1)
        s = yield read(f"seq[{ring.slot(last)}]")
        if s == last:
            if (yield cas("write", w, ring.plus(w, ring.bytes), claims=ring.bytes)):
                return w
        elif ring.fill(s, last) > ring.modulus // 2:  # the slot is behind: still full from the last round
            yield sleep()


def commit_index(ring: Ring, me: int, message: int) -> Thread:
    """Claim on one index, store, publish on another in the order of the claims: whoever is early spins."""
    w = yield from claim(ring, "claim")
    for i in range(ring.bytes):
        yield put(ring.slot(ring.plus(w, i)), ring.element(me, message, i))
    while (yield read("write")) != w:
        pass
    yield write("write", ring.plus(w, ring.bytes))


def ordered(ring: Ring, me: int, message: int) -> Thread:
    """A ticket each, and spinning until it is one's turn. (In the firmware the single writes are published first, too.)"""
    ticket = yield fetch_add("ticket", 1, ring.modulus)
    while (yield read("turn")) != ticket:
        pass
    elements = tuple(ring.element(me, message, i) for i in range(ring.bytes))
    while not (yield from alone(ring, elements)):
        yield sleep()
    yield write("turn", ring.plus(ticket, 1))


def alone(ring: Ring, elements: tuple[int, ...]) -> Thread:
    """One try to write a message by one who has the turn."""
    w = yield read("write")
    r = yield read("read")
    if ring.space(w, r) < len(elements):
        return False
    yield from store_then_publish(ring, w, elements)
    return True


def batch_assert(ring: Ring, me: int, message: int) -> Thread:
    """The first producer writes batches under the mutex and asserts each byte; the others write bytes without it.

    In the firmware bytes are published first, which would fail sooner; here slots have ready flags, and the assertion is left.
    """
    if me:
        for i in range(ring.bytes):
            while not (yield from mark_or_fail(ring, ring.element(me, message, i))):
                yield sleep()
    else:
        yield from asserting_batch(ring, me, message)


def asserting_batch(ring: Ring, me: int, message: int) -> Thread:
    """Listing 18 with its assertion."""
    while True:
        yield wait("mutex", 0, 1)
        if (yield from has_space(ring)):
            break
        yield write("mutex", 0, word="give")
        yield sleep()
    for i in range(ring.bytes):
        if not (yield from mark_or_fail(ring, ring.element(me, message, i))):
            yield fail()
    yield write("mutex", 0, word="give")


def has_space(ring: Ring) -> Thread:
    """Whether a message fits, as it looks now."""
    w = yield read("write")
    r = yield read("read")
    return ring.space(w, r) >= ring.bytes


def mark_or_fail(ring: Ring, element: int) -> Thread:
    """`write_or_fail`, and the slot marked as ready."""
    w = yield read("write")
    r = yield read("read")
    if ring.space(w, r) == 0:
        return False
    if not (yield cas("write", w, ring.plus(w, 1), claims=1)):
        return False
    yield put(ring.slot(w), element)
    yield write(f"ready[{ring.slot(w)}]", 1)
    return True


# ------------------------------------------------------------------------------------------------- consumer and the DMA


def consumer(ring: Ring, drain: Callable[[Ring, int], Thread]) -> Thread:
    """The task `tsink`: drains what is there, sleeps if there is nothing. Its read index is its own; others only look at it."""
    r = ring.start
    while True:
        after = yield from drain(ring, r)
        if after == r:
            yield sleep()
        r = after


def drain_published(ring: Ring, r: int) -> Thread:
    """Everything below the write index (source 1, listing 19)."""
    w = yield read("write")
    if w != r:
        yield from send(ring, r, ring.fill(w, r))
        yield write("read", w)
    return w


def drain_locked(ring: Ring, r: int) -> Thread:
    """The same under the mutex."""
    yield wait("mutex", 0, 1)
    w = yield from drain_published(ring, r)
    yield write("mutex", 0, word="give")
    return w


def drain_ready(ring: Ring, r: int) -> Thread:
    """All slots in order that are marked as ready; the marks go before the space comes back."""
    count = yield from count_ready(ring, r)
    if count:
        yield from send(ring, r, count)
        for i in range(count):
            yield write(f"ready[{ring.slot(ring.plus(r, i))}]", 0)
        yield write("read", ring.plus(r, count))
    return ring.plus(r, count)


def count_ready(ring: Ring, r: int) -> Thread:
    """How many slots from `r` on are ready."""
    count = 0
    while count < ring.capacity and (yield read(f"ready[{ring.slot(ring.plus(r, count))}]")):
        count += 1
    return count


def drain_sequence(ring: Ring, r: int) -> Thread:
    """One slot, if its number says that it is full; then it is free for the next round."""
    s = yield read(f"seq[{ring.slot(r)}]")
    if s != ring.plus(r, 1):
        return r
    yield from send(ring, r, 1)
    yield write(f"seq[{ring.slot(r)}]", ring.plus(r, ring.capacity))
    return ring.plus(r, 1)


def send(ring: Ring, r: int, count: int) -> Thread:
    """Sends `count` elements from index `r` on in contiguous chunks, by oneself or with the DMA."""
    slot = ring.slot(r)
    while count:
        chunk = min(count, ring.capacity - slot)
        if ring.dma:
            yield write("dma_from", slot)
            yield write("dma_count", chunk)
            yield write("dma_start", 1, word="give")
            yield wait("dma_done", 1, 0)
        else:
            for i in range(chunk):
                yield take(slot + i)
        slot, count = 0, count - chunk


def dma(ring: Ring) -> Thread:
    """The hardware beside the processor: sends a chunk when it is told to, then its interrupt notifies the consumer."""
    while True:
        yield from transfer()


def transfer() -> Thread:
    """One chunk."""
    yield wait("dma_start", 1, 0)
    slot = yield read("dma_from")
    count = yield read("dma_count")
    for i in range(count):
        yield take(slot + i)
    yield write("dma_done", 1, word="give")


# ------------------------------------------------------------------------------------------------------------- variants


@dataclass(frozen=True)
class Variant:
    """A way to build the sink.

    Attributes:
        title: the idea in a few words.
        push: what a producer does for a message.
        drain: what the consumer does when it runs; from index to index.
        shared: variables beside buf, write, read, irq, and their first values.
        bytes: length of a message that shows what it is about.
    """

    title: str
    push: Callable[[Ring, int, int], Thread]
    drain: Callable[[Ring, int], Thread] = drain_published
    shared: Callable[[Ring], Mapping[str, int]] = lambda ring: {}
    bytes: int = 1


def _mutex(ring: Ring) -> dict[str, int]:
    return {"mutex": 0}


def _ready(ring: Ring) -> dict[str, int]:
    return {f"ready[{i}]": 0 for i in range(ring.capacity)}


def _seq(ring: Ring) -> dict[str, int]:
    first_round = [ring.plus(ring.start, i) for i in range(ring.capacity)]
    return {f"seq[{i}]": i for i in range(ring.capacity)} | {f"seq[{ring.slot(index)}]": index for index in first_round}


VARIANTS: dict[str, Variant] = {
    "published-first": Variant("index published before the byte is stored (source 1)", published_first),
    "published-first-mutex": Variant("a mutex around the message (source 1)", published_first_mutex, shared=_mutex),
    "atomic-push": Variant("each byte pushed without interrupts, no mutex", atomic_push, bytes=2),
    "consumer-mutex": Variant("the consumer takes the mutex, too", consumer_mutex, drain_locked, _mutex),
    "store-first": Variant("byte stored before the compare-and-swap", store_first),
    "ready-flag": Variant("a ready flag per slot", ready_flag, drain_ready, _ready),
    "sequence": Variant("a sequence number per slot (Vyukov)", sequence, drain_sequence, _seq),
    "interrupts-off": Variant("the message pushed without interrupts", interrupts_off),
    "commit-index": Variant("published in the order of the claims", commit_index, shared=lambda ring: {"claim": ring.start}),
    "ordered": Variant("tickets, spinning for one's turn", ordered, shared=lambda ring: {"ticket": 0, "turn": 0}),
    "batch-assert": Variant(
        "an asserting batch under the mutex against single writes without it",
        batch_assert,
        drain_ready,
        lambda ring: _ready(ring) | _mutex(ring),
    ),
}
