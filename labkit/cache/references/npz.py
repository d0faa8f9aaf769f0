"""References from an .npz file with the arrays `op` (uint8: 1 store, 2 load, 3 modify), `addr` (uint64) and `size` (uint8).

All are of one length; nothing is unpacked before its size is known.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from typing import IO

import numpy as np

from labkit.cache.references.columns import References, TraceFileError, check_column
from labkit.outside import with_an_end

MOST_IN_FILE = 5_000_000  # references: at worst, each in two lines of its own, counting takes half a minute and 2 GB
_COLUMNS: dict[str, np.dtype] = {"op": np.dtype(np.uint8), "addr": np.dtype(np.uint64), "size": np.dtype(np.uint8)}
_HEADER = 16_384  # bytes before the data of an array; numpy writes 128


def unpacked(file: IO[bytes]) -> References:
    """The references in an archive.

    Raises:
        TraceFileError: an array is missing, extra, too long, of another dtype, shape or length.
        ValueError: a value is not allowed.
    """
    op, addr, size = _unpack(with_an_end(file))
    check_column("addr", addr, addr >= np.uint64(2**63 - 256), "below 2**63 - 256")
    return References(op, addr.astype(np.int64), size.astype(np.int64))


def _unpack(file: IO[bytes]) -> list[np.ndarray]:
    """The arrays of a trace file. numpy's own reader would unpack whatever the file announces, and offers to run code in it."""
    with zipfile.ZipFile(file) as archive:
        names = {name.removesuffix(".npy") for name in archive.namelist()}
        if names != set(_COLUMNS):
            raise TraceFileError(f"it has the arrays {_listed(names)}; a trace has op, addr and size")
        columns = [_column(archive, name, dtype) for name, dtype in _COLUMNS.items()]
    for name, column in zip(_COLUMNS, columns):
        if len(column) != len(columns[0]):
            raise TraceFileError(f"array {name} has {len(column)} entries and op {len(columns[0])}; they must agree")
    return columns


def _column(archive: zipfile.ZipFile, name: str, dtype: np.dtype) -> np.ndarray:
    """One array, refused before anything is unpacked if it is too large, and before its data is if it is of another kind."""
    member = archive.getinfo(f"{name}.npy")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise TraceFileError(f"array {name} is compressed by method {member.compress_type}; it must be stored or deflated")
    if member.file_size > MOST_IN_FILE * dtype.itemsize + _HEADER:
        raise TraceFileError(f"array {name} unpacks to {member.file_size} bytes; a trace has {MOST_IN_FILE} references at most")
    with archive.open(member) as file:
        shape, found = _header(file, name)
        if found.hasobject:
            raise TraceFileError(f"it cannot be read as an .npz file of plain arrays; {name} holds Python objects")
        if found != dtype or len(shape) != 1:
            raise TraceFileError(f"array {name} is {len(shape)}-dimensional {found}; it must be 1-dimensional {dtype}")
        if not 0 <= shape[0] <= MOST_IN_FILE:
            raise TraceFileError(f"array {name} announces {shape[0]} entries; a trace has {MOST_IN_FILE} at most")
        announced = shape[0] * dtype.itemsize
        data = file.read(announced + 1)
    if len(data) != announced:
        raise TraceFileError(f"array {name} does not hold the {announced} bytes of data that it announces")
    return np.frombuffer(data, dtype)


def _header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and dtype that the header of an array announces."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        shape, _, dtype = readers[np.lib.format.read_magic(file)](file)
    except Exception:  # whatever a damaged header leads Python's parser to
        raise TraceFileError(f"array {name} has no readable header; it must be in numpy's format 1.0 or 2.0") from None
    return shape, dtype


def _listed(names: Iterable[str]) -> str:
    """Names from a file as they may be printed: escaped, cut and counted."""
    shown = [ascii(name)[1:-1][:40] for name in sorted(names)]
    return ", ".join(shown[:9]) + (f" and {len(shown) - 9} more" if len(shown) > 9 else "") or "none"
