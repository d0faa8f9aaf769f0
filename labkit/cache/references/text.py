"""References from the text of two tracers: valgrind's lackey and Dinero.

Lackey (`valgrind --tool=lackey --trace-mem=yes`): `I  04016b80,3` an instruction, ` L 1ffeffe7e8,8` a load, ` S ...` a store,
` M ...` a modify; address in hex, size in bytes. Dinero's "din": a label and an address in hex, `0 1000` a read, `1` a write, `2`
an instruction; what follows in the line is a comment, and every reference is a word of 4 bytes.
"""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Iterator
from typing import IO

import numpy as np

from labkit.cache.references.columns import LOAD, MODIFY, STORE, References, TraceFileError
from labkit.cache.references.npz import MOST_IN_FILE

#: Longest text in bytes; instructions are most of it.
MOST_BYTES = 1 << 30

WORD = 4  # bytes of a reference that has no size
BLOCK = 1 << 20

_LINES = {
    "lackey": re.compile(rb"^(I| L| S| M| SB)[ \t]+(?:0x)?([0-9a-fA-F]{1,16})(?:,([0-9]{1,4}))?[ \t]*\r?$", re.M),
    "dinero": re.compile(rb"^[ \t]*([0-4])[ \t]+(?:0[xX])?([0-9a-fA-F]{1,16})()(?:[ \t].*)?$", re.M),
}
_OPS = {b" L": LOAD, b" S": STORE, b" M": MODIFY, b"0": LOAD, b"1": STORE}
_ELSE = {b"I": "instructions", b" SB": "superblocks", b"2": "instructions", b"3": "escapes", b"4": "flushes"}


def format_of(beginning: bytes) -> str | None:
    """The form that more lines have than not, if there is one; what valgrind itself says, `==12== ...`, does not count."""
    lines = [line for line in beginning.split(b"\n")[:1000] if line.strip() and not line.startswith((b"==", b"--", b"#"))]
    for name, form in _LINES.items():
        if 2 * sum(form.match(line) is not None for line in lines) > len(lines):
            return name
    return None


def read_text(file: IO[bytes], form: str) -> tuple[References, Counter[str]]:
    """The data references of a text, and how many lines of what sort are none: instructions, other lines, ...

    Raises:
        TraceFileError: more than `MOST_IN_FILE` references or `MOST_BYTES`, or none.
    """
    ops, addresses, sizes = array("B"), array("Q"), array("q")
    left = Counter[str]()
    for block in _blocks(file):
        found = _LINES[form].findall(block)
        left["lines of another form"] += block.count(b"\n") - len(found) - block.count(b"\n\n")
        for kind, address, size in found:
            op = _OPS.get(kind)
            if op is None:
                left[_ELSE[kind]] += 1
                continue
            ops.append(op)
            addresses.append(int(address, 16))
            sizes.append(int(size) if size else WORD)
        if len(ops) > MOST_IN_FILE:
            raise TraceFileError(f"it has more than {MOST_IN_FILE} data references, the most that are counted")
    if not ops:
        raise TraceFileError(f"it has no data reference in the form of {form}")
    addr = np.frombuffer(addresses, np.uint64)
    return References(np.frombuffer(ops, np.uint8), addr.astype(np.int64), np.frombuffer(sizes, np.int64)), left


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    """The text in blocks of whole lines."""
    size, begun = 0, b""
    while piece := file.read(BLOCK):
        size += len(piece)
        if size > MOST_BYTES:
            raise TraceFileError(f"it is longer than {MOST_BYTES >> 30} GiB, the most that is read")
        whole, newline, rest = (begun + piece).rpartition(b"\n")
        if len(rest) > BLOCK:
            raise TraceFileError("it has a line of more than a megabyte")
        begun = rest
        if newline:
            yield whole + newline
    if begun:
        yield begun + b"\n"
