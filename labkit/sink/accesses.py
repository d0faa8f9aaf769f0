"""The accesses to shared memory that the code of a thread names: each of them is one indivisible step, all else is its own.

A thread is a generator that yields them: `w = yield read("write")`. The value of the yield is what the access gives back.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Kind(IntEnum):
    """What an access does. `SLEEP` and `RELEASE` are no accesses: the thread leaves the processor until a tick."""

    READ = 0
    WRITE = 1
    CAS = 2
    ADD = 3
    WAIT = 4
    PUT = 5
    TAKE = 6
    SLEEP = 7
    RELEASE = 8
    FAIL = 9
    DONE = 10


class Access(NamedTuple):
    """One step of a thread.

    Attributes:
        kind: what it does.
        variable: the name of the variable, "" if it has none.
        a, b: what it compares with or stores; see the functions of this module.
        claims: how many elements the producer owns a slot for once this access has succeeded. The program does not know of
            it; the checks do.
        word: what to call it in a history.
    """

    kind: Kind
    variable: str = ""
    a: int = 0
    b: int = 0
    claims: int = 0
    word: str = ""


def read(variable: str) -> Access:
    """Gives back the value of the variable."""
    return Access(Kind.READ, variable, word="read")


def write(variable: str, value: int, claims: int = 0, word: str = "write") -> Access:
    """Stores the value."""
    return Access(Kind.WRITE, variable, value, claims=claims, word=word)


def cas(variable: str, expected: int, value: int, claims: int = 0) -> Access:
    """Stores `value` if the variable holds `expected`; gives back whether it did (1 or 0)."""
    return Access(Kind.CAS, variable, expected, value, claims, "cas")


def fetch_add(variable: str, value: int, modulus: int) -> Access:
    """Adds, modulo `modulus`; gives back what was there before."""
    return Access(Kind.ADD, variable, value, modulus, word="fetch-add")


def wait(variable: str, expected: int, value: int, word: str = "take") -> Access:
    """Blocks until the variable holds `expected`, then stores `value` in the same step: taking a mutex, a notification."""
    return Access(Kind.WAIT, variable, expected, value, word=word)


def put(slot: int, element: int) -> Access:
    """A producer stores an element into a slot of the ring."""
    return Access(Kind.PUT, f"buf[{slot}]", element, word="write")


def take(slot: int) -> Access:
    """The consumer or the DMA reads a slot and sends on what is there. Gives back nothing: nobody decides by it."""
    return Access(Kind.TAKE, f"buf[{slot}]", word="read")


def sleep() -> Access:
    """Off the processor until a tick; which one is left open, so that delays of every length are covered."""
    return Access(Kind.SLEEP, word="wake")


def release() -> Access:
    """Waits for the release of the next job. Where interleaving is free any thread may pause anywhere: there it is no step."""
    return Access(Kind.RELEASE, word="wake")


def fail() -> Access:
    """An assertion of the program does not hold: the machine stops."""
    return Access(Kind.FAIL, word="assert")


DONE = Access(Kind.DONE)
