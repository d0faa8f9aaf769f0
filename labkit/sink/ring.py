"""The ring that all variants share: indices that count on, slots, fill, and what is to be sent through it."""

from __future__ import annotations

from dataclasses import dataclass

from labkit.checks import whole

SCHEDULES = ("free", "higher", "equal", "lowest")

#: The most of each that is taken: beyond, no search would come to an end.
MOST_PRODUCERS, MOST_MESSAGES, MOST_BYTES, MOST_CAPACITY = 8, 64, 16, 64


@dataclass(frozen=True)
class Ring:
    """The numbers of a sink and of the work that is sent through it.

    Attributes:
        producers, messages, bytes: each producer writes so many messages of so many bytes.
        capacity: slots.
        modulus: the indices count modulo this (2**32 on the target; small, so that they come around here). They start one
            below it, so that they wrap after the first element. With one up to the
            capacity a full ring looks like an empty one.
        dma: a DMA reads the slots, in up to two contiguous chunks, and notifies the consumer, instead of the consumer itself.
    """

    producers: int = 2
    messages: int = 2
    bytes: int = 1
    capacity: int = 2
    modulus: int = 16
    dma: bool = False

    def __post_init__(self) -> None:
        whole(self.producers, 1, "the number of producers", MOST_PRODUCERS)
        whole(self.messages, 1, "the number of messages of each producer", MOST_MESSAGES)
        whole(self.bytes, 1, "the number of bytes of a message", MOST_BYTES)
        whole(self.capacity, 1, "the capacity of the ring", MOST_CAPACITY)
        whole(self.modulus, 2, "the modulus of the indices", 1 << 32)

    @property
    def start(self) -> int:
        """Where both indices begin."""
        return self.modulus - 1

    @property
    def share(self) -> int:
        """Elements that each producer writes."""
        return self.messages * self.bytes

    def plus(self, index: int, count: int) -> int:
        """The index `count` further on."""
        return (index + count) % self.modulus

    def fill(self, write: int, read: int) -> int:
        """Elements between the indices."""
        return (write - read) % self.modulus

    def space(self, write: int, read: int) -> int:
        """Free slots; less than none if the indices are beyond repair."""
        return self.capacity - self.fill(write, read)

    def slot(self, index: int) -> int:
        """Where in the ring the index points to."""
        return index % self.capacity

    def element(self, producer: int, message: int, byte: int) -> int:
        """The number by which an element is known in memory, from 1 on; 0 is a slot that was never written."""
        return 1 + producer * self.share + message * self.bytes + byte

    def label(self, element: int) -> str:
        """An element in words: 'P1/2' is the second message of the first producer, 'P1/2.1' its first byte if it has several."""
        if element == 0:
            return "never written"
        producer, place = divmod(element - 1, self.share)
        message, byte = divmod(place, self.bytes)
        return f"P{producer + 1}/{message + 1}" + (f".{byte + 1}" if self.bytes > 1 else "")
