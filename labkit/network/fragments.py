"""Long messages in short packets: cut into fragments with a header each, and put together again.

A packet carries at most 1499 bytes (source 2, section 6.1.3), its header of 16 bytes among them: the message's number, the
fragment's number and their count, and the message's timestamp. A message of 0 bytes is one fragment with nothing in it.

Put together is what belongs together, in any order: fragments of the same source with the same number, count and timestamp. A
doubled fragment changes nothing, as long as its message is one of the last few. What contradicts the others is refused, so that
no message is ever made of two.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from labkit.checks import UNBOUNDED, shown, whole

#: Bytes of a packet, header included.
MOST_BYTES = 1499
HEADER = struct.Struct(">IHHq")  # message, fragment, count, timestamp
#: Bytes of a message that one packet carries.
ROOM = MOST_BYTES - HEADER.size
MOST_FRAGMENTS = (1 << 16) - 1
#: Messages of one source that may be incomplete at a time; of more, the one that was touched longest ago is given up.
OPEN = 8


@dataclass(frozen=True)
class Message:
    """A whole message: its number at its source, its timestamp in ns, and its bytes."""

    number: int
    timestamp_ns: int
    data: bytes


def fragment_count(size: int) -> int:
    """How many packets a message of `size` bytes needs."""
    return max(1, -(-size // ROOM))


def fragments(message: Message) -> list[bytes]:
    """The message as packets of at most 1499 bytes, in order.

    Raises:
        ValueError: a number or timestamp that does not fit its field, or a message longer than 65535 fragments.
    """
    number = whole(message.number, 0, "the message's number", (1 << 32) - 1)
    timestamp = whole(message.timestamp_ns, -UNBOUNDED, "the message's timestamp in ns", UNBOUNDED)
    count = fragment_count(len(message.data))
    if count > MOST_FRAGMENTS:
        raise ValueError(f"the message has {len(message.data)} bytes; at most {MOST_FRAGMENTS * ROOM} are allowed")
    return [HEADER.pack(number, i, count, timestamp) + message.data[i * ROOM : (i + 1) * ROOM] for i in range(count)]


@dataclass
class _Partial:
    """What is there of one message."""

    count: int
    timestamp_ns: int
    pieces: dict[int, bytes] = field(default_factory=dict)


@dataclass
class Reassembly:
    """Puts the fragments of one source together.

    Attributes:
        given_up: numbers of messages that were dropped incomplete because too many others were.
    """

    given_up: list[int] = field(default_factory=list)
    _partial: dict[int, _Partial] = field(default_factory=dict)  # in the order in which they were touched last
    _done: dict[int, None] = field(default_factory=dict)  # numbers of complete messages, so that a late double makes none again

    def add(self, packet: bytes) -> Message | None:
        """Take a packet in; the message if it is complete now. A fragment that is there already changes nothing.

        Raises:
            ValueError: no fragment, or one that contradicts those that are there; they stay as they are. Names what is wrong.
        """
        number, index, count, timestamp, piece = _parsed(packet)
        if number in self._done:
            return None
        partial = self._partial.get(number) or _Partial(count, timestamp)
        where = f"fragment {index} of message {number}"
        if (count, timestamp) != (partial.count, partial.timestamp_ns):
            had = f"count {partial.count}, timestamp {partial.timestamp_ns} ns"
            raise ValueError(f"{where} has count {count}, timestamp {timestamp} ns; those before it have {had}")
        if partial.pieces.get(index, piece) != piece:
            raise ValueError(f"{where} came before with other bytes; a repetition has to be the same")
        partial.pieces[index] = piece
        self._partial.pop(number, None)
        if len(partial.pieces) == count:
            self._done[number] = None
            if len(self._done) > OPEN:
                del self._done[next(iter(self._done))]
            return Message(number, timestamp, b"".join(partial.pieces[i] for i in range(count)))
        self._partial[number] = partial
        if len(self._partial) > OPEN:
            oldest = next(iter(self._partial))
            del self._partial[oldest]
            self.given_up.append(oldest)
        return None

    def incomplete(self) -> list[int]:
        """Numbers of the messages of which something is missing."""
        return sorted(self._partial)


def _parsed(packet: bytes) -> tuple[int, int, int, int, bytes]:
    """Message, fragment, count, timestamp, bytes; ValueError if the packet is no fragment."""
    if not HEADER.size <= len(packet) <= MOST_BYTES:
        raise ValueError(f"a fragment has {len(packet)} bytes; {HEADER.size} to {MOST_BYTES} are allowed")
    number, index, count, timestamp = HEADER.unpack_from(packet)
    piece = packet[HEADER.size :]
    if index >= count:
        raise ValueError(f"fragment {index} of message {number} has count {count}; its number has to be below")
    if index < count - 1 and len(piece) != ROOM:
        raise ValueError(f"fragment {index} of message {number} carries {len(piece)} bytes; only the last has fewer than {ROOM}")
    if count > 1 and not piece:
        raise ValueError(f"fragment {index} of message {number} is empty: {shown(packet)}; only a message of 0 bytes has that")
    return number, index, count, timestamp, piece
