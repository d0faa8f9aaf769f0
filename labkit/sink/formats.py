"""Stamps on the wire: lines of text, records of 8 bytes, words of 32 bits; dropped events are told in the stream itself.

Text is what source 1 sends: `<name> <microseconds> <1|0>`, 17 to 20 bytes a line. The outlook of its chapter 6 asks for
32-bit words that one store writes whole. The layouts of the binary formats are this lab's own, all little-endian:

    record   cycle 32 bits, name 16 bits, kind 16 bits: 0 end, 1 begin, 2 dropped (then `name` is how many)
    word     bit 31 begin, bits 30..26 name, bits 25..0 cycle; name 31 is a note: with bit 31 how many were
             dropped, without it just the time, for a counter of 26 bits needs one word per wrap
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from struct import pack

import numpy as np

from labkit.checks import whole
from labkit.sink.stamps import CLOCK_HZ, unwrap

RECORD = np.dtype([("cycle", "<u4"), ("name", "<u2"), ("kind", "<u2")])
_END, _BEGIN, _DROPPED = 0, 1, 2

#: Bits of a word that are time.
WORD_BITS = 26
_NOTE = 31

#: Names that fit a record and a word.
MOST_NAMES = {"text": 1 << 62, "record": 1 << 16, "word": _NOTE}


@dataclass(frozen=True, eq=False)
class Decoded:
    """Stamps read back from a stream.

    Attributes:
        cycle: shape (n,), int64, unwrapped.
        name: shape (n,), number of the name.
        begin: shape (n,), bool.
        dropped: shape (m, 2): before which stamp how many were dropped.
        rejected: records of no known kind.
        rest: bytes at the end that are no whole record.
    """

    cycle: np.ndarray
    name: np.ndarray
    begin: np.ndarray
    dropped: np.ndarray
    rejected: int = 0
    rest: int = 0

    def lines(self, names: Sequence[str], hz: int = CLOCK_HZ) -> Iterator[bytes]:
        """As text, ready for `labkit.trace.read_log`; drops are comments."""
        drops: dict[int, int] = {}
        for place, many in self.dropped.tolist():
            drops[place] = drops.get(place, 0) + many
        for i, (cycle, name, begin) in enumerate(zip(self.cycle.tolist(), self.name.tolist(), self.begin.tolist())):
            if i in drops:
                yield text_drop(drops[i])
            yield text_line(names[name] if name < len(names) else f"#{name}", cycle, begin, hz)
        if len(self.cycle) in drops:
            yield text_drop(drops[len(self.cycle)])


def text_line(name: str, cycle: int, begin: bool, hz: int = CLOCK_HZ) -> bytes:
    """A stamp in the format of source 1: whole microseconds, rounded down."""
    return f"{name} {cycle * 1_000_000 // hz} {int(begin)}\n".encode()


def text_drop(count: int) -> bytes:
    """A comment, which readers of lines pass over."""
    return f"# dropped {count}\n".encode()


def record(name: int, cycle: int, begin: bool) -> bytes:
    """A stamp in 8 bytes."""
    return pack("<IHH", cycle & 0xFFFFFFFF, name, begin)


def record_drop(count: int) -> bytes:
    """As many records as the count needs."""
    return b"".join(pack("<IHH", 0, part, _DROPPED) for part in _parts(count, 0xFFFF))


def word(name: int, cycle: int, begin: bool) -> bytes:
    """A stamp in 4 bytes."""
    return (begin << 31 | name << WORD_BITS | cycle & ((1 << WORD_BITS) - 1)).to_bytes(4, "little")


def word_drop(count: int) -> bytes:
    """As many words as the count needs."""
    return b"".join(word(_NOTE, part, True) for part in _parts(count, (1 << WORD_BITS) - 1))


def word_alive(cycle: int) -> bytes:
    """Only the time; one per wrap (0.311 s at 216 MHz) keeps the time known while nothing happens."""
    return word(_NOTE, cycle, False)


def _parts(count: int, most: int) -> Iterator[int]:
    while count > 0:
        yield min(count, most)
        count -= most


def decode_records(data: bytes) -> Decoded:
    """Any bytes: what is no record is counted."""
    whole_part = len(data) - len(data) % RECORD.itemsize
    rows = np.frombuffer(data[:whole_part], RECORD)
    stamps = rows["kind"] <= _BEGIN
    notes = rows["kind"] == _DROPPED
    return Decoded(
        unwrap(rows["cycle"][stamps]),
        rows["name"][stamps],
        rows["kind"][stamps] == _BEGIN,
        _drops(notes, stamps, rows["name"]),
        int(len(rows) - stamps.sum() - notes.sum()),
        len(data) - whole_part,
    )


def decode_words(data: bytes) -> Decoded:
    """Any bytes; every word means something."""
    whole_part = len(data) - len(data) % 4
    words = np.frombuffer(data[:whole_part], "<u4")
    begin, name, low = words >> 31 == 1, words >> WORD_BITS & 31, words & ((1 << WORD_BITS) - 1)
    notes = (name == _NOTE) & begin
    cycles = np.zeros(len(words), np.int64)
    cycles[~notes] = unwrap(low[~notes], WORD_BITS)
    stamps = name != _NOTE
    return Decoded(cycles[stamps], name[stamps], begin[stamps], _drops(notes, stamps, low), 0, len(data) - whole_part)


def _drops(notes: np.ndarray, stamps: np.ndarray, count: np.ndarray) -> np.ndarray:
    return np.stack([np.cumsum(stamps)[notes], count[notes]], axis=1).astype(np.int64)


class Stream:
    """A buffer of limited size in front of the wire, that drops what does not fit and says so.

    One rule for lost events: the note of how many they were comes first, and until it got through with the next stamp behind
    it, every further stamp is dropped and counted as well.

    Args:
        capacity: bytes.
        format: "text", "record" or "word".
        names: the names, in the order of their numbers.
        hz: clock of the counter, for text.

    Attributes:
        dropped: stamps dropped so far. pending: those of them not yet told.
    """

    def __init__(self, capacity: int, format: str, names: Iterable[str], hz: int = CLOCK_HZ) -> None:
        if format not in MOST_NAMES:
            raise ValueError(f"there is no format {format!r}; there are {', '.join(MOST_NAMES)}")
        self.capacity, self.format, self.hz = whole(capacity, 1, "the capacity of the stream in bytes"), format, hz
        self.names = tuple(names)
        if len(self.names) > MOST_NAMES[format]:
            raise ValueError(f"{len(self.names)} names; in the format {format!r} at most {MOST_NAMES[format]} are allowed")
        self._numbers = {name: number for number, name in enumerate(self.names)}
        self._waiting = bytearray()
        self.dropped = self.pending = 0

    def __len__(self) -> int:
        """Bytes that wait to be sent."""
        return len(self._waiting)

    def put(self, name: str, cycle: int, begin: bool) -> bool:
        """Whether the stamp found room. KeyError if the name is none of the stream's."""
        made = self._encode(name, cycle, begin)
        if self.pending:
            made = _DROP[self.format](self.pending) + made
        if len(self._waiting) + len(made) > self.capacity:
            self.dropped += 1
            self.pending += 1
            return False
        self._waiting += made
        self.pending = 0
        return True

    def alive(self, cycle: int) -> bool:
        """A word that holds nothing but the time, if it finds room: one per wrap keeps the time known while nothing happens.

        ValueError for a format that has none.
        """
        if self.format != "word":
            raise ValueError(f"the format {self.format!r} has no words of time alone; only 'word' has")
        if len(self._waiting) + 4 > self.capacity:
            return False
        self._waiting += word_alive(cycle)
        return True

    def take(self, most: int) -> bytes:
        """The next bytes for the wire, at most so many."""
        sent = bytes(self._waiting[:most])
        del self._waiting[:most]
        return sent

    def close(self) -> bytes:
        """All that is left, and the note of what was dropped at the end."""
        rest = self.take(len(self._waiting))
        if self.pending:
            rest += _DROP[self.format](self.pending)
        self.pending = 0
        return rest

    def _encode(self, name: str, cycle: int, begin: bool) -> bytes:
        number = self._numbers[name]
        if self.format == "text":
            return text_line(name, cycle, begin, self.hz)
        return (record if self.format == "record" else word)(number, cycle, begin)


_DROP: dict[str, Callable[[int], bytes]] = {"text": text_drop, "record": record_drop, "word": word_drop}


def link_load(bytes_per_stamp: float, stamps_per_second: float, baud: int, bits_per_byte: int = 10) -> float:
    """Share of a link's time that stamps take; above 1 it cannot carry them."""
    return bytes_per_stamp * bits_per_byte * stamps_per_second / whole(baud, 1, "the baud rate", 10**9)
