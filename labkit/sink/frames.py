"""The velocity frame, and its reception between idle times of the line (source 1, 3.1.2).

A frame is three little-endian doubles x, y, z and their CRC-32/MPEG-2 over the 24 bytes in order, little-endian, too: 28 bytes,
packed. The line has no other mark of a beginning than the silence before it: that resynchronises after any damage.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any

from labkit.checks import whole
from labkit.sink.crc import crc32_mpeg2

_PAYLOAD = Struct("<3d")
_FRAME = Struct("<3dI")

#: Bytes of a frame.
FRAME_BYTES = _FRAME.size

#: Bits of a byte on the line: start, eight, stop.
BITS_PER_BYTE = 10

#: The velocity link of source 1, bit/s.
VELOCITY_BAUD = 115_200

#: Largest file of receptions, in bytes and in lines.
MOST_BYTES, MOST_LINES = 8 << 20, 250_000


@dataclass(frozen=True, slots=True)
class Reception:
    """What became of the bytes between two idle times.

    Attributes:
        verdict: "ok", "short" or "long" (not 28 bytes), "crc" (the checksum does not fit), "hex" (no bytes at all, but text that
            should be some).
        x, y, z: what was sent, in m/s and rad/s, if the verdict is "ok". Any double may come, infinities and NaN too: the
            checksum says that it arrived as it was sent, not that it makes sense.
    """

    verdict: str
    x: float | None = None
    y: float | None = None
    z: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """For JSON, which has no NaN and no infinities: they are null."""
        if self.verdict != "ok":
            return {"verdict": self.verdict}
        return {"verdict": self.verdict} | {
            name: value if value is not None and math.isfinite(value) else None
            for name, value in zip("xyz", (self.x, self.y, self.z), strict=True)
        }


_SHORT, _LONG, _CRC, _HEX = map(Reception, ("short", "long", "crc", "hex"))


def encode_frame(x: float, y: float, z: float) -> bytes:
    """The 28 bytes that the host sends."""
    payload = _PAYLOAD.pack(x, y, z)
    return payload + crc32_mpeg2(payload).to_bytes(4, "little")


def check_frame(data: bytes) -> Reception:
    """What the robot makes of a reception."""
    if len(data) != FRAME_BYTES:
        return _SHORT if len(data) < FRAME_BYTES else _LONG
    x, y, z, crc = _FRAME.unpack(data)
    return Reception("ok", x, y, z) if crc == crc32_mpeg2(data[: _PAYLOAD.size]) else _CRC


def byte_ns(baud: int) -> int:
    """Time of a byte on the line in ns, rounded up."""
    return -(-BITS_PER_BYTE * 10**9 // whole(baud, 1, "the baud rate", 10**9))


def receptions(
    times_ns: Sequence[int], data: bytes, baud: int = VELOCITY_BAUD, most: int | None = FRAME_BYTES
) -> Iterator[bytes]:
    """Bytes as the receiver with idle-line detection hands them on.

    Args:
        times_ns: when each byte's start bit begins, in order.
        data: the bytes.
        baud: bit/s. The line is idle if no byte begins within a byte's time after the last one's end.
        most: length of the buffer: when it is full the reception ends, too, and another one begins. None: without bound.

    Raises:
        ValueError: times and bytes do not fit together, times go back, or no such baud rate or buffer.
    """
    if len(times_ns) != len(data):
        raise ValueError(f"{len(times_ns)} times for {len(data)} bytes; one for each is allowed")
    length = byte_ns(baud)
    most = None if most is None else whole(most, 1, "the length of the buffer")
    return _receptions(times_ns, data, length, most)


def _receptions(times_ns: Sequence[int], data: bytes, length: int, most: int | None) -> Iterator[bytes]:
    begin = 0
    for i in range(1, len(data)):
        if times_ns[i] < times_ns[i - 1]:
            raise ValueError(f"byte {i} comes at {times_ns[i]} ns, before the one in front of it; times go up")
        if times_ns[i] - times_ns[i - 1] >= 2 * length or i - begin == most:
            yield data[begin:i]
            begin = i
    if data:
        yield data[begin:]


def pieces(data: bytes, size: int = FRAME_BYTES) -> Iterator[bytes]:
    """What a receiver without idle-line detection hands on: every 28 bytes. After one lost byte it is never in step again."""
    return (data[i : i + size] for i in range(0, len(data), whole(size, 1, "the length of a piece")))


def read_late(frame: bytes, following: bytes, arrived: int) -> bytes:
    """What a task reads from a buffer that the interrupt has armed again at once, when so many bytes of the next have arrived.

    The public code behind source 1 does so: under load the task sees the head of one frame and the tail of another.
    """
    arrived = whole(arrived, 0, "the number of bytes that have arrived", min(len(frame), len(following)))
    return following[:arrived] + frame[arrived:]


def check_lines(lines: Iterable[bytes]) -> Iterator[Reception]:
    """One reception per line of hexadecimal digits (blanks between bytes are allowed)."""
    for line in lines:
        try:
            yield check_frame(bytes.fromhex(line.decode("ascii")))
        except ValueError:
            yield _HEX


def read_frames(path: str | os.PathLike[str]) -> list[Reception]:
    """The receptions of a file, one per line, whatever is in it; ValueError if it is longer than the limits, OSError."""
    with open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path} is longer than {MOST_BYTES >> 20} MiB, the largest file that is read")
    lines = data.removeprefix(b"\xef\xbb\xbf").split(b"\n")
    if not lines[-1]:
        lines.pop()  # the file ends with its last line
    if len(lines) > MOST_LINES:
        raise ValueError(f"{path} has {len(lines)} lines; at most {MOST_LINES} are read")
    return list(check_lines(lines))
