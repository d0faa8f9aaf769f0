"""Access patterns as data references: sequential, strided, matrix product, random, and one's own as text."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from labkit.cache.references.columns import LOAD, OPS, STORE, References

BASE = 0x2002_0000  # the start of SRAM1, the first cacheable RAM of the STM32F767
MOST_REFERENCES = 2_000_000
LONGEST = 65_536  # bytes of one reference
ADDRESSES = 2**32
ORDERS = ("ijk", "ikj", "jik", "jki", "kij", "kji")


def _references(op: int | np.ndarray, address: np.ndarray, size: int | np.ndarray) -> References:
    n = len(address)
    return References(
        np.broadcast_to(np.asarray(op, np.uint8), n).copy(),
        address.astype(np.int64),
        np.broadcast_to(np.asarray(size, np.int64), n).copy(),
    )


def _positive(**values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise ValueError(f"{name} is {value}; it must be at least 1")


def sequential(count: int, *, start: int = BASE, size: int = 4, op: str = "read", rounds: int = 1) -> References:
    """`count` neighbouring elements of `size` bytes, one after the other, `rounds` times."""
    return strided(count, size, start=start, size=size, op=op, rounds=rounds)


def strided(count: int, stride: int, *, start: int = BASE, size: int = 4, op: str = "read", rounds: int = 1) -> References:
    """`count` elements of `size` bytes, `stride` bytes apart, `rounds` times."""
    _positive(count=count, stride=stride, size=size, rounds=rounds)
    _limit(count * rounds)
    _within(start, start + (count - 1) * stride, size)
    return _references(_op(op), start + np.tile(np.arange(count, dtype=np.int64) * stride, rounds), size)


def random(count: int, span: int, *, start: int = BASE, size: int = 4, op: str = "read", seed: int = 0) -> References:
    """`count` aligned elements of `size` bytes anywhere in `span` bytes from `start`."""
    _positive(count=count, span=span, size=size)
    _limit(count)
    if span < size:
        raise ValueError(f"span is {span} bytes; at least one element of {size} bytes must fit")
    _within(start, start + span - size, size)
    return _references(_op(op), start + np.random.default_rng(seed).integers(span // size, size=count) * size, size)


def matrix_product(
    n: int, *, order: str = "ijk", element: int = 4, start: int = BASE, tile: int | None = None, accumulate: bool = False
) -> References:
    """C = A B with n x n matrices, row by row in memory, A, B and C one behind the other.

    Args:
        order: the loops from outside to inside, one of `ORDERS`.
        element: bytes per element.
        tile: edge of the square tiles into which all three loops are cut; must divide n. None: no tiles.
        accumulate: keep the sum in a register, so that C is stored once per element; needs k as the inner loop and no tiles.
            Otherwise every step loads A, B and C and stores C.

    Returns:
        4 n^3 references, or 2 n^3 + n^2 with `accumulate`.
    """
    _positive(n=n, element=element)
    if order not in ORDERS:
        raise ValueError(f"no loop order {order!r}; there are {', '.join(ORDERS)}")
    if accumulate and (tile is not None or order[-1] != "k"):
        raise ValueError(f"order {order} with accumulate; a sum in a register needs k as the inner loop and no tiles")
    if tile is not None and (tile < 1 or n % tile):
        raise ValueError(f"tile is {tile}; it must be at least 1 and divide n, which is {n}")
    _limit(4 * n**3)
    _within(start, start + (3 * n * n - 1) * element, element)
    edge = tile or n
    grid = np.indices((n // edge,) * 3 + (edge,) * 3).reshape(6, -1)
    loops = dict(zip(order, grid[:3] * edge + grid[3:]))
    i, j, k = loops["i"], loops["j"], loops["k"]
    a, b, c = (start + element * (matrix * n * n + cell) for matrix, cell in enumerate((i * n + k, k * n + j, i * n + j)))
    if accumulate:
        steps = np.stack([a, b], axis=1).reshape(n * n, 2 * n)
        rows = np.column_stack([steps, c[::n]])
        ops = np.tile(np.array([LOAD] * (2 * n) + [STORE], np.uint8), n * n)
        return _references(ops, rows.ravel(), element)
    ops = np.tile(np.array([LOAD, LOAD, LOAD, STORE], np.uint8), n**3)
    return _references(ops, np.stack([a, b, c, c], axis=1).ravel(), element)


def parse(text: str) -> References:
    """One's own pattern as text, one statement per line (or between semicolons); `#` starts a comment.

        read 0x20020000                     one load of 4 bytes
        write 0x20020010 size 8             one store of 8 bytes
        modify 0x20020000 times 64 step 32  64 loads-and-stores, 32 bytes apart
        repeat 3                            what follows, up to `end`, three times; may be nested
        end

    Raises:
        ValueError: one sentence with the line, what is wrong there, and what is allowed.
    """
    stack = [_Block(0, 1)]
    lines = enumerate(text.splitlines(), 1)
    statements = [(number, part.split()) for number, line in lines for part in line.split("#")[0].split(";")]
    for number, words in statements:
        if not words:
            continue
        command, *rest = words
        if command in OPS:
            stack[-1].add(_statement(number, command, rest), number)
        elif command == "repeat":
            if len(rest) != 1:
                raise ValueError(f"line {number}: repeat needs one number, as in 'repeat 3'")
            stack.append(_Block(number, _number(number, "repeat", rest[0], 1)))
        elif command == "end":
            if rest:
                raise ValueError(f"line {number}: '{rest[0]}' after end; end stands alone")
            if len(stack) == 1:
                raise ValueError(f"line {number}: end without a repeat before it")
            inner = stack.pop()
            _limit(inner.count * inner.times, f"line {number}: ")
            if inner.count:
                stack[-1].add(np.tile(np.concatenate(inner.pieces), (inner.times, 1)), number)
        else:
            raise ValueError(f"line {number}: {command!r} is no command; there are {', '.join([*OPS, 'repeat', 'end'])}")
    if len(stack) > 1:
        raise ValueError(f"line {stack[-1].line}: repeat without an end")
    if not stack[0].count:
        raise ValueError("the pattern has no references; write for example 'read 0x20020000 times 64 step 4'")
    table = np.concatenate(stack[0].pieces)
    return References(table[:, 0].astype(np.uint8), table[:, 1], table[:, 2])


@dataclass
class _Block:
    """What stands between `repeat` and `end`, or the whole text: references as rows (op, address, size), int64, in pieces."""

    line: int
    times: int
    pieces: list[np.ndarray] = field(default_factory=list)
    count: int = 0

    def add(self, rows: np.ndarray, line: int) -> None:
        self.count += len(rows)
        _limit(self.count, f"line {line}: ")
        self.pieces.append(rows)


def _statement(line: int, command: str, words: list[str]) -> np.ndarray:
    """The references of `read|write|modify ADDRESS [size N] [times N] [step N]`, one row (op, address, size) each."""
    if not words:
        raise ValueError(f"line {line}: {command} needs an address, as in '{command} 0x20020000'")
    address = _number(line, "address", words[0], 0)
    values = {"size": 4, "times": 1}
    options, given = ("size", "times", "step"), words[1:]
    for n, name in enumerate(given[::2]):
        if name not in options:
            raise ValueError(f"line {line}: {name!r} is no option of {command}; there are {', '.join(options)}")
        if 2 * n + 1 == len(given):
            raise ValueError(f"line {line}: {name} needs a number after it")
        values[name] = _number(line, name, given[2 * n + 1], None if name == "step" else 1)
    size, times, step = values["size"], values["times"], values.get("step", values["size"])
    _limit(times, f"line {line}: ")
    last = address + (times - 1) * step
    if not 0 <= last < ADDRESSES or size > LONGEST:
        raise ValueError(
            f"line {line}: {times} times step {step} from {address:#x} with size {size}; "
            f"addresses must stay within 32 bits and a size within {LONGEST} bytes"
        )
    addresses = address + step * np.arange(times, dtype=np.int64)
    return np.column_stack([np.full(times, OPS[command]), addresses, np.full(times, size)])


def _number(line: int, name: str, word: str, lowest: int | None) -> int:
    try:
        value = int(word, 0)
    except ValueError:
        raise ValueError(f"line {line}: {name} is {word!r}; it must be a whole number such as 64 or 0x40") from None
    if (lowest is not None and value < lowest) or abs(value) >= 2**32:
        floor = "" if lowest is None else f"at least {lowest} and "
        raise ValueError(f"line {line}: {name} is {word}; it must be {floor}below 2**32")
    return value


def _op(name: str) -> int:
    if name not in OPS:
        raise ValueError(f"no operation {name!r}; there are {', '.join(OPS)}")
    return OPS[name]


def _within(first: int, last: int, size: int) -> None:
    """ValueError unless elements of `size` bytes at `first`, `last` and between lie in the address space."""
    if first < 0 or last + size > ADDRESSES:
        raise ValueError(f"elements of {size} bytes from {first:#x} to {last:#x}; addresses must stay within 32 bits")
    if size > LONGEST:
        raise ValueError(f"elements of {size} bytes; an element has {LONGEST} at most")


def _limit(n: int, where: str = "") -> None:
    if n > MOST_REFERENCES:
        raise ValueError(f"{where}{n} references; a pattern may have {MOST_REFERENCES} at most")
