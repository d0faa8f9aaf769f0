"""Data references as columns: what a tracer records and what an access pattern is made of; the reader for trace files."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import numpy as np

STORE, LOAD, MODIFY = 1, 2, 3
OPS = {"write": STORE, "read": LOAD, "modify": MODIFY}
_COLUMNS = {"op": np.uint8, "addr": np.uint64, "size": np.uint8}


class TraceFileError(ValueError):
    """The file is no trace of data references; the message says what is wrong."""


@dataclass(frozen=True, eq=False)
class References:
    """Data references in program order.

    Attributes:
        op: uint8 array of shape (n,): 1 store, 2 load, 3 modify (load and store in one).
        address: int64 array of shape (n,), in bytes. size: int64 array of shape (n,), bytes of each reference.
    """

    op: np.ndarray
    address: np.ndarray
    size: np.ndarray

    def __len__(self) -> int:
        return len(self.op)

    def clipped(self, line: int) -> References:
        """Sizes cut to a line, as cachegrind does before it looks anything up; a reference then touches two lines at most."""
        return References(self.op, self.address, np.minimum(self.size, line))


def read_trace(path: str | PathLike[str]) -> References:
    """Read a trace of data references: an .npz file with the arrays `op` (uint8: 1 store, 2 load, 3 modify), `addr` (uint64)
    and `size` (uint8, bytes), all of one length.

    Raises:
        TraceFileError: the file cannot be read, an array is missing, extra, of another dtype, shape or length, or a value is
            not allowed; one sentence each.
    """
    try:
        file, columns = np.load(path, allow_pickle=False), None
        if isinstance(file, np.lib.npyio.NpzFile):
            with file:
                columns = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise TraceFileError(f"there is no file {path}") from None
    except Exception as error:  # a damaged file makes zipfile, zlib and numpy raise a dozen different ones
        why = " ".join(str(error).split()) or type(error).__name__
        raise TraceFileError(f"{path} cannot be read as an .npz file of plain arrays: {why}") from None
    if columns is None:
        raise TraceFileError(f"{path} holds a single array; a trace is an .npz file with the arrays op, addr and size")
    if set(columns) != set(_COLUMNS):
        raise TraceFileError(f"{path} has the arrays {', '.join(sorted(columns)) or 'none'}; a trace has op, addr and size")

    for name, dtype in _COLUMNS.items():
        column = columns[name]
        if column.dtype != dtype or column.ndim != 1:
            raise TraceFileError(
                f"{path}: array {name} is {column.ndim}-dimensional {column.dtype}; it must be 1-dimensional {dtype.__name__}"
            )
        if len(column) != len(columns["op"]):
            raise TraceFileError(f"{path}: array {name} has {len(column)} entries and op {len(columns['op'])}; they must agree")
    _check(path, "op", columns["op"], (columns["op"] < STORE) | (columns["op"] > MODIFY), "1 store, 2 load or 3 modify")
    _check(path, "size", columns["size"], columns["size"] == 0, "at least 1 byte")
    _check(path, "addr", columns["addr"], columns["addr"] >= np.uint64(2**63 - 256), "below 2**63 - 256")
    return References(columns["op"], columns["addr"].astype(np.int64), columns["size"].astype(np.int64))


def _check(path: str | PathLike[str], name: str, column: np.ndarray, wrong: np.ndarray, allowed: str) -> None:
    if wrong.any():
        at = int(np.argmax(wrong))
        raise TraceFileError(f"{path}: {name} of reference {at} is {column[at]}; allowed is {allowed}")
