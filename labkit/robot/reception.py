"""How a velocity frame gets into the board: a serial line, a DMA that fills a buffer byte by byte, and the task that reads (S6).

When the buffer, as long as a frame, is full, an interrupt wakes `recv_vel`, and arms the reception again at the beginning of the
same buffer (so the public firmware). What the task gets is what is in the buffer *when it reads*: if it comes late, the head of
the next frame and the tail of its own, a torn frame. The checksum finds that, unless both frames are the same.

Simplified: the reading takes no time, being far faster than one byte on the line; frames come whole (what damages them on the
line is in `labkit.sink`), and the line is never idle within one.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

from labkit.checks import whole
from labkit.robot.control import Velocity
from labkit.sink import BITS_PER_BYTE, FRAME_BYTES, VELOCITY_BAUD, Reception, check_frame, encode_frame, read_late


@dataclass(frozen=True)
class Read:
    """What the task got.

    Attributes:
        at: when, in cycles. frame: number of the frame that was complete last. wait: how long it had been.
        newer: bytes in the buffer that were already the next frame's.
        data: the bytes. reception: what became of them.
    """

    at: int
    frame: int
    wait: int
    newer: int
    data: bytes
    reception: Reception


@dataclass
class VelocityLine:
    """The line, and the buffer or the two buffers behind it.

    Args:
        hz: times are in cycles of this clock.
        baud: bit/s. buffers: 1 as in the firmware, or 2: the interrupt arms the other one, and the task reads the full one.

    Attributes:
        begins: when each frame's first byte began. frames: its bytes. reads: what the task got.
    """

    hz: int
    baud: int = VELOCITY_BAUD
    buffers: int = 1
    begins: list[int] = field(default_factory=list)
    frames: list[bytes] = field(default_factory=list)
    reads: list[Read] = field(default_factory=list)

    def __post_init__(self) -> None:
        whole(self.baud, 1, "the baud rate of the velocity line", 10**9)
        whole(self.buffers, 1, "the number of receive buffers", 2)
        self.byte = -(-BITS_PER_BYTE * self.hz // self.baud)

    def send(self, at: int, velocity: Velocity) -> int:
        """A frame of mm/s, mm/s, rad/s comes to the line at cycle `at`, and waits there until the one before is through.

        Returns the cycle of the interrupt at its last byte.
        """
        x, y, z = velocity
        free = self.begins[-1] + FRAME_BYTES * self.byte if self.begins else 0
        self.begins.append(max(at, free))
        self.frames.append(encode_frame(x / 1000, y / 1000, z))
        return self.begins[-1] + FRAME_BYTES * self.byte

    def read(self, now: int) -> Velocity | None:
        """What the task gets from the buffer at cycle `now`, in mm/s and rad/s; None if that is no frame. A frame is complete."""
        last = bisect_right(self.begins, now - FRAME_BYTES * self.byte) - 1  # the one that was complete last
        data, newer = self.frames[last], 0
        if self.buffers == 1 and last + 1 < len(self.frames):
            newer = max(0, (now - self.begins[last + 1]) // self.byte)
            data = read_late(data, self.frames[last + 1], newer)
        heard = check_frame(data)
        self.reads.append(Read(now, last, now - self.begins[last] - FRAME_BYTES * self.byte, newer, data, heard))
        if heard.x is None or heard.y is None or heard.z is None:
            return None
        return 1000 * heard.x, 1000 * heard.y, heard.z

    @property
    def torn(self) -> int:
        """Reads that the checksum has rejected."""
        return sum(read.reception.verdict != "ok" for read in self.reads)
