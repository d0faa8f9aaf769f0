"""CRC-32/MPEG-2: the library's, the bitwise algorithm as a lesson, and what the hardware unit makes of words.

Polynomial 0x04C11DB7, start 0xFFFFFFFF, no reflection, no inversion at the end: what the CRC unit of the STM32 does by itself.
"""

from __future__ import annotations

from fastcrc.crc32 import mpeg_2

POLYNOMIAL = 0x04C11DB7
START = 0xFFFFFFFF


def crc32_mpeg2(data: bytes) -> int:
    """The checksum of bytes in order (library fastcrc)."""
    return mpeg_2(data)


def crc32_mpeg2_bitwise(data: bytes) -> int:
    """The same as it is defined: a long division by the polynomial, bit by bit, without carries."""
    crc = START
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1) ^ (POLYNOMIAL if crc & 0x80000000 else 0)
            crc &= 0xFFFFFFFF
    return crc


def crc32_mpeg2_words(data: bytes) -> int:
    """What the hardware unit gives if it is fed with 32-bit words that a little-endian processor loads from memory.

    It divides each word from its highest bit on, so that the bytes of each word go in backwards. The host's library, fed
    with bytes, disagrees unless every word reads the same both ways. ValueError if the length is no multiple of 4.
    """
    if len(data) % 4:
        raise ValueError(f"{len(data)} bytes are no whole words; the length must be a multiple of 4")
    return mpeg_2(b"".join(data[i : i + 4][::-1] for i in range(0, len(data), 4)))
