"""Size, ways and line length of a cache, and how an address splits into them."""

from __future__ import annotations

from dataclasses import dataclass

MOST_BYTES = 64 * 1024 * 1024  # of a cache: what the models keep of every line bounds their memory to about 1 GB
MOST_LINES = 1024 * 1024  # and with it the ways, as a set has no more lines than the cache
SHORTEST_LINE, LONGEST_LINE = 4, 4096  # bytes


def is_power_of_two(n: int) -> bool:
    return n > 0 and n & (n - 1) == 0


@dataclass(frozen=True)
class Geometry:
    """A set-associative cache of `size` bytes in lines of `line` bytes, `ways` of them per set.

    Raises:
        ValueError: `size` or `line` is no power of two, `ways` is below 1, lines and ways do not divide the size, or there are
            more than 64 MiB, more than 1,048,576 lines, or lines of other than 4 to 4096 bytes.
    """

    size: int
    ways: int
    line: int

    def __post_init__(self) -> None:
        for name in ("size", "line"):
            value = getattr(self, name)
            if not is_power_of_two(value):
                raise ValueError(f"{name} is {value} bytes; it must be a power of two")
        if self.size > MOST_BYTES:
            raise ValueError(f"size is {self.size} bytes; a cache has {MOST_BYTES} at most")
        if self.line < SHORTEST_LINE:
            raise ValueError(f"line is {self.line} bytes; a line holds at least one word of {SHORTEST_LINE} bytes")
        if self.line > LONGEST_LINE:
            raise ValueError(f"line is {self.line} bytes; a line has {LONGEST_LINE} at most")
        if self.size // self.line > MOST_LINES:
            lines = self.size // self.line
            raise ValueError(f"{self.size} bytes in lines of {self.line} are {lines} lines; a cache has {MOST_LINES} at most")
        if self.ways < 1:
            raise ValueError(f"ways is {self.ways}; a cache has at least 1 way")
        if self.size % (self.ways * self.line):
            raise ValueError(f"{self.ways} ways of {self.line}-byte lines do not divide a cache of {self.size} bytes")

    @property
    def sets(self) -> int:
        return self.size // (self.ways * self.line)

    def line_address(self, address: int) -> int:
        """First address of the line that holds `address`."""
        return address & -self.line

    def set_index(self, address: int) -> int:
        """The set an address falls into: the bits just above those that count within a line."""
        return address // self.line % self.sets

    def span(self, address: int, size: int) -> range:
        """The line addresses that `size` bytes from `address` touch."""
        return range(self.line_address(address), address + size, self.line)


#: The caches of the STM32F767 (RM0410; DDI0489 5.9): 128 sets x 4 ways and 256 sets x 2 ways of 32 bytes.
DCACHE = Geometry(16 * 1024, 4, 32)
ICACHE = Geometry(16 * 1024, 2, 32)
