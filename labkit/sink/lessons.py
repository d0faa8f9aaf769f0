"""Each variant as a few lines of C11, and the memory order that these lines need on top of the order of steps.

The explorer lets every access take effect at once and for all. A compiler and a processor with a store buffer need not: C11
promises only what its memory orders say. An atomic access that names none has the strongest, seq_cst; where that does not help
either, `why` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

#: What all of them share; with it each piece of code compiles.
PREAMBLE = """\
#include <assert.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CAPACITY = 2048 };
static uint8_t buf[CAPACITY];
static atomic_size_t write_index, read_index;
void lock(void), unlock(void), sleep_one_tick(void), interrupts_off(void), interrupts_on(void);
void send(size_t slot);
"""


@dataclass(frozen=True)
class Lesson:
    """One variant in C11.

    Attributes:
        code: to be compiled behind `PREAMBLE`.
        orders: the memory orders that it needs; empty if a lock orders everything.
        why: what they are for, or why none of them cures the variant.
    """

    code: str
    orders: tuple[str, ...]
    why: str


_CLAIM = """\
    size_t w = atomic_load_explicit(&{index}, memory_order_relaxed);
    do {{
        while (w - atomic_load_explicit(&read_index, memory_order_acquire) == CAPACITY) {{
            sleep_one_tick();
            w = atomic_load_explicit(&{index}, memory_order_relaxed);
        }}
    }} while (!atomic_compare_exchange_weak_explicit(
        &{index}, &w, w + 1, memory_order_relaxed, memory_order_relaxed));
"""

LESSONS: dict[str, Lesson] = {
    "published-first": Lesson(
        """\
bool push(uint8_t byte) {
    size_t w = atomic_load(&write_index);
    if (w - atomic_load(&read_index) == CAPACITY) return false;
    if (!atomic_compare_exchange_strong(&write_index, &w, w + 1)) return false;
    buf[w % CAPACITY] = byte;  /* after it was announced */
    return true;
}
""",
        ("seq_cst",),
        "Even sequential consistency, the strongest order and the default, does not help: the two steps stand in the wrong "
        "order. For C11 the store is a data race with the consumer's read, and means nothing at all.",
    ),
    "published-first-mutex": Lesson(
        """\
void push(const uint8_t *bytes, size_t n) {
    for (;; sleep_one_tick()) {
        lock();
        if (CAPACITY - (atomic_load(&write_index) - atomic_load(&read_index)) >= n) break;
        unlock();
    }
    for (size_t i = 0; i < n; ++i) {
        size_t w = atomic_fetch_add(&write_index, 1);
        buf[w % CAPACITY] = bytes[i];
    }
    unlock();
}
""",
        ("seq_cst",),
        "The mutex orders the producers (unlock releases, lock acquires). The consumer never locks it: nothing orders the two.",
    ),
    "atomic-push": Lesson(
        """\
void push(const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; ++i) {
        interrupts_off();
        size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
        buf[w % CAPACITY] = bytes[i];
        atomic_store_explicit(&write_index, w + 1, memory_order_release);
        interrupts_on();  /* here another producer may come between */
    }
}
""",
        ("release",),
        "Release keeps the byte in front of the index. That the bytes of a message stay together is no question of memory order.",
    ),
    "consumer-mutex": Lesson(
        """\
void push(uint8_t byte) {
    lock();
    while (atomic_load(&write_index) - atomic_load(&read_index) == CAPACITY)
        sleep_one_tick();  /* with the mutex that the consumer needs */
    buf[atomic_fetch_add(&write_index, 1) % CAPACITY] = byte;
    unlock();
}

void drain(void) {
    lock();
    for (size_t r = atomic_load(&read_index); r != atomic_load(&write_index); atomic_store(&read_index, ++r))
        send(r % CAPACITY);
    unlock();
}
""",
        (),
        "The mutex orders everything, so that the indices need not even be atomic. It also makes everybody wait for everybody.",
    ),
    "store-first": Lesson(
        """\
bool push(uint8_t byte) {
    size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
    if (w - atomic_load_explicit(&read_index, memory_order_acquire) == CAPACITY) return false;
    buf[w % CAPACITY] = byte;  /* others store here, too */
    return atomic_compare_exchange_strong_explicit(
        &write_index, &w, w + 1, memory_order_release, memory_order_relaxed);
}
""",
        ("release", "acquire"),
        "With release the byte is there before the index says so: right for one producer. Two of them race for the slot.",
    ),
    "ready-flag": Lesson(
        """\
static atomic_bool ready[CAPACITY];

void push(uint8_t byte) {
"""
        + _CLAIM.format(index="write_index")
        + """\
    buf[w % CAPACITY] = byte;
    atomic_store_explicit(&ready[w % CAPACITY], true, memory_order_release);
}

void drain(size_t r) {
    for (; atomic_load_explicit(&ready[r % CAPACITY], memory_order_acquire); ++r) {
        send(r % CAPACITY);
        atomic_store_explicit(&ready[r % CAPACITY], false, memory_order_relaxed);
        atomic_store_explicit(&read_index, r + 1, memory_order_release);
    }
}
""",
        ("release", "acquire"),
        "Release on the flag and acquire by the consumer carry the byte over; release on the read index and acquire by the "
        "producer carry the free slot back. The claim itself may be relaxed.",
    ),
    "sequence": Lesson(
        """\
static atomic_size_t sequence[CAPACITY];  /* starts as 0, 1, 2, ... */

bool push(uint8_t byte) {
    size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
    for (;;) {
        ptrdiff_t lead = (ptrdiff_t)(atomic_load_explicit(&sequence[w % CAPACITY], memory_order_acquire) - w);
        if (lead < 0) return false;
        if (lead > 0) w = atomic_load_explicit(&write_index, memory_order_relaxed);
        else if (atomic_compare_exchange_weak_explicit(
                     &write_index, &w, w + 1, memory_order_relaxed, memory_order_relaxed)) break;
    }
    buf[w % CAPACITY] = byte;
    atomic_store_explicit(&sequence[w % CAPACITY], w + 1, memory_order_release);
    return true;
}

void drain(size_t r) {
    for (; atomic_load_explicit(&sequence[r % CAPACITY], memory_order_acquire) == r + 1; ++r) {
        send(r % CAPACITY);
        atomic_store_explicit(&sequence[r % CAPACITY], r + CAPACITY, memory_order_release);
    }
}
""",
        ("release", "acquire"),
        "The slot's own number is all that both sides synchronise on: release when it changes, acquire when it is read. The "
        "write index only deals out slots and may be relaxed.",
    ),
    "interrupts-off": Lesson(
        """\
bool push(const uint8_t *bytes, size_t n) {
    interrupts_off();
    size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
    bool fits = CAPACITY - (w - atomic_load_explicit(&read_index, memory_order_acquire)) >= n;
    for (size_t i = 0; fits && i < n; ++i) buf[(w + i) % CAPACITY] = bytes[i];
    if (fits) atomic_store_explicit(&write_index, w + n, memory_order_release);
    interrupts_on();
    return fits;
}
""",
        ("release", "acquire"),
        "On one core only the compiler can exchange the steps, and release forbids it that. With a second core or a DMA that "
        "looks at the index the release is needed from the processor as well, and no interrupt mask would do.",
    ),
    "commit-index": Lesson(
        """\
static atomic_size_t claim_index;

void push(uint8_t byte) {
"""
        + _CLAIM.format(index="claim_index")
        + """\
    buf[w % CAPACITY] = byte;
    while (atomic_load_explicit(&write_index, memory_order_acquire) != w) {}  /* for those before me */
    atomic_store_explicit(&write_index, w + 1, memory_order_release);
}
""",
        ("release", "acquire"),
        "Acquire of the predecessor's index and release of one's own make a chain: the consumer, who acquires the last, sees the "
        "bytes of all. No memory order gives the processor to the one who is waited for.",
    ),
    "ordered": Lesson(
        """\
static atomic_size_t next_ticket, turn;

void push(uint8_t byte) {
    size_t ticket = atomic_fetch_add_explicit(&next_ticket, 1, memory_order_relaxed);
    while (atomic_load_explicit(&turn, memory_order_acquire) != ticket) {}
    size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
    while (w - atomic_load_explicit(&read_index, memory_order_acquire) == CAPACITY) sleep_one_tick();
    buf[w % CAPACITY] = byte;
    atomic_store_explicit(&write_index, w + 1, memory_order_release);
    atomic_store_explicit(&turn, ticket + 1, memory_order_release);
}
""",
        ("release", "acquire"),
        "A ticket lock: acquire when the turn has come, release when it is passed on. It is correct, and it spins.",
    ),
    "batch-assert": Lesson(
        """\
static atomic_bool ready[CAPACITY];

bool push_one(uint8_t byte) {
    size_t w = atomic_load_explicit(&write_index, memory_order_relaxed);
    if (w - atomic_load_explicit(&read_index, memory_order_acquire) == CAPACITY) return false;
    if (!atomic_compare_exchange_strong_explicit(
            &write_index, &w, w + 1, memory_order_relaxed, memory_order_relaxed)) return false;
    buf[w % CAPACITY] = byte;
    atomic_store_explicit(&ready[w % CAPACITY], true, memory_order_release);
    return true;
}

void push(const uint8_t *bytes, size_t n) {
    lock();
    for (size_t i = 0; i < n; ++i) {
        bool done = push_one(bytes[i]);
        assert(done);  /* fails if somebody calls push_one without the mutex */
        (void)done;
    }
    unlock();
}
""",
        ("release", "acquire"),
        "The orders are those of the ready flags, and right. A mutex that not everybody takes excludes nobody.",
    ),
}
