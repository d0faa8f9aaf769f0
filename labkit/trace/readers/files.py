"""A trace as a file that gives the identical trace back: CSV for people and other programs, npz for large ones.

Both begin with a head: hz, start, end, names and, where they say anything, `exception_of` and `closed`. Files from outside are
checked: no number of events, size or content of a file does more than raise `LogError`.
"""

from __future__ import annotations

import csv
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import islice
from typing import IO, Any

import numpy as np

from labkit.outside import with_an_end
from labkit.trace.kinds import CODE, KINDS
from labkit.trace.readers.report import LogError, told
from labkit.trace.trace import COLUMNS, Trace

#: More events than this are not read; 20 million take a gigabyte.
MOST_EVENTS = 20_000_000

#: Longest head in bytes, and longest name in characters.
MOST_HEAD, MOST_NAME = 16_000_000, 100_000

#: CSV rows are turned into numbers in blocks of this size.
_BLOCK = 100_000

_FIELDS = (*COLUMNS, "core")

#: What a damaged zip archive raises.
_UNREADABLE = (zipfile.BadZipFile, zlib.error, struct.error, KeyError, EOFError, NotImplementedError, RuntimeError, SyntaxError)


def export_csv(trace: Trace, target: str | os.PathLike[str] | IO[str]) -> None:
    """Write the trace as CSV: one line of JSON (the head), then a header and one row per event, with names.

    `read_csv` gives the identical trace back; pandas reads it with `pd.read_csv(path, skiprows=1)`. A trace of several cores has
    a column `core` more.

    Args:
        target: path, or a file open for text with newline="".
    Raises:
        ValueError: a name is empty, too long or appears twice, so that names cannot stand for their codes.
    """
    if "" in trace.names or len(set(trace.names)) < len(trace.names):
        raise ValueError("names in a trace to be exported must be different from each other and not empty")
    long = next((name for name in trace.names if len(name) > MOST_NAME), None)
    if long is not None:
        raise ValueError(f"a name of {len(long)} characters, {told(long)}; at most {MOST_NAME} can be exported as CSV")
    names = [*trace.names, ""]  # index -1: none
    more = [] if trace.core is None else [trace.core]
    with opened(target, "w") as file:
        file.write("# " + json.dumps(head_of(trace)) + "\r\n")
        writer = csv.writer(file)
        writer.writerow(_FIELDS[: len(COLUMNS) + len(more)])
        for first in range(0, len(trace), _BLOCK):
            block = slice(first, first + _BLOCK)
            columns = (column[block].tolist() for column in (*(getattr(trace, name) for name in COLUMNS), *more))
            writer.writerows(
                (time, KINDS[kind], names[task], names[other], *rest)
                for time, kind, task, other, *rest in zip(*columns, strict=True)
            )


def read_csv(source: str | os.PathLike[str] | IO[str]) -> Trace:
    """Read back what `export_csv` wrote.

    Raises:
        LogError: not such a file; names the line and what is wrong with it. Or more than `MOST_EVENTS` events.
    """
    try:
        with opened(source, "r") as file:
            line = file.readline(MOST_HEAD)
            head = read_head(line.removeprefix("# "))
            codes = {**{name: i for i, name in enumerate(head["names"])}, "": -1}
            if len(codes) <= len(head["names"]):
                raise LogError("line 1: the names must be different from each other and not empty")
            reader = csv.reader(file)
            fields = tuple(next(reader, ()))
            if fields not in (COLUMNS, _FIELDS):
                raise LogError(f"line 2 must be {','.join(COLUMNS)}, and core if there are several")
            blocks = [np.empty((0, len(fields)), np.int64)]
            rows = (_row(row, codes, len(fields), reader.line_num + 1) for row in reader)
            while block := list(islice(rows, _BLOCK)):
                blocks.append(np.array(block, dtype=np.int64))
                if (len(blocks) - 1) * _BLOCK > MOST_EVENTS:
                    raise LogError(f"more than {MOST_EVENTS} events; that many are read from one file")
        return checked_trace(head, dict(zip(fields, np.ascontiguousarray(np.concatenate(blocks).T), strict=True)))
    except OSError as error:
        raise LogError(f"{_named(source)}: cannot be read ({error.strerror or error})") from None
    except (UnicodeError, csv.Error, OverflowError) as error:
        raise LogError(f"{_named(source)}: not a trace as CSV ({error})") from None
    except ValueError as error:
        raise error if isinstance(error, LogError) else LogError(f"{_named(source)}: {error}") from None


def export_npz(trace: Trace, target: str | os.PathLike[str] | IO[bytes]) -> None:
    """Write the trace as compressed numpy columns; `read_npz` gives the identical trace back.

    The columns are int64 arrays named as in `Trace`; `head` is the head as JSON in bytes (uint8). Nothing in it is pickled.

    Args:
        target: path, or a file open for writing bytes.
    """
    columns = {name: getattr(trace, name) for name in (COLUMNS if trace.core is None else _FIELDS)}
    head = np.frombuffer(json.dumps(head_of(trace)).encode(), np.uint8)
    with opened(target, "wb") as file:
        np.savez_compressed(file, head=head, **columns)


def read_npz(source: str | os.PathLike[str] | IO[bytes]) -> Trace:
    """Read back what `export_npz` wrote.

    Raises:
        LogError: not such a file, or more than `MOST_EVENTS` events; says what is wrong.
    """
    try:
        with opened(source, "rb") as file, zipfile.ZipFile(with_an_end(file)) as archive:
            head = read_head(_array(archive, "head", np.uint8, MOST_HEAD).tobytes())
            several = "core.npy" in archive.namelist()
            columns = {name: _array(archive, name, np.int64, MOST_EVENTS) for name in (_FIELDS if several else COLUMNS)}
        return checked_trace(head, columns)
    except OSError as error:
        raise LogError(f"{_named(source)}: cannot be read ({error.strerror or error})") from None
    except _UNREADABLE as error:
        raise LogError(f"{_named(source)}: not a trace as npz ({told(str(error))})") from None
    except ValueError as error:
        raise error if isinstance(error, LogError) else LogError(f"{_named(source)}: not a trace as npz ({error})") from None


def _array(archive: zipfile.ZipFile, name: str, dtype: type[np.generic], most: int) -> np.ndarray:
    """One column of an npz; what its own header says is believed only if the data are there."""
    size = np.dtype(dtype).itemsize
    if f"{name}.npy" not in archive.namelist():
        raise LogError(f"not a trace as npz, which has a column {name}")
    info = archive.getinfo(f"{name}.npy")
    if info.file_size > most * size + 1000:
        raise LogError(f"{name} has {info.file_size} bytes; at most {most * size} are read")
    data = BytesIO(archive.read(info))
    version = np.lib.format.read_magic(data)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, given = read(data)
    body = data.getbuffer()[data.tell() :]
    if given != np.dtype(dtype) or len(shape) != 1 or shape[0] * size != len(body):
        raise LogError(f"{name} must be one row of {np.dtype(dtype)}")
    return np.frombuffer(body, dtype)


def head_of(trace: Trace) -> dict[str, Any]:
    """What a file says of the trace as a whole."""
    head: dict[str, Any] = {"hz": trace.hz, "start": trace.start, "end": trace.end, "names": trace.names}
    more = {"exception_of": trace.exception_of, "closed": trace.closed}
    return head | {key: value for key, value in more.items() if value}


def read_head(line: str | bytes) -> dict[str, Any]:
    """`head_of` read back from JSON; LogError if it is not that."""
    try:
        head = json.loads(line)
        numbers = all(type(head[key]) is int and abs(head[key]) < 1 << 63 for key in ("hz", "start", "end"))
        names, of, closed = head["names"], head.setdefault("exception_of", []), head.setdefault("closed", False)
        count = len(names)
        named = isinstance(names, list) and all(isinstance(name, str) for name in names)
        owned = not of or (len(of) == count and all(type(task) is int and -1 <= task < count for task in of))
        if numbers and head["hz"] > 0 and named and owned and isinstance(closed, bool):
            return head
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        pass
    raise LogError(
        "line 1 must be '# ' and JSON with hz, start, end and the list of names, as export_csv writes it"
        if isinstance(line, str)
        else "its head must be JSON with hz, start, end and the list of names, as export_npz writes it"
    )


def _row(row: list[str], codes: dict[str, int], fields: int, line: int) -> tuple[int, ...]:
    try:
        time, kind, task, other, *rest = row
        if len(row) == fields:
            return int(time), CODE[kind], codes[task], codes[other], *map(int, rest)
    except KeyError as error:
        raise LogError(f"line {line}: {told(error.args[0])} is no kind of event and no name of line 1") from None
    except ValueError:
        pass
    raise LogError(f"line {line}: {told(','.join(row))} is not {','.join(_FIELDS[:fields])}")


def checked_trace(head: dict[str, Any], columns: dict[str, np.ndarray]) -> Trace:
    """The trace of columns from outside, checked."""
    sizes = {len(column) for column in columns.values()}
    if len(sizes) > 1:
        raise LogError(f"columns of different lengths, {min(sizes)} to {max(sizes)} events")
    bounds = {"kind": (0, len(KINDS)), "task": (-1, len(head["names"])), "other": (-1, len(head["names"]))}
    for name, (least, most) in bounds.items():
        wrong = (columns[name] < least) | (columns[name] >= most)
        if wrong.any():
            at = int(wrong.argmax())
            raise LogError(f"event {at} has {name} {columns[name][at]}; {least} to {most - 1} are allowed")
    core = columns.pop("core", None)
    if core is not None and len(core) and core.min() < 0:
        raise LogError(f"event {int(core.argmin())} is on core {core.min()}; cores are counted from 0")
    return Trace.from_columns(
        np.stack(list(columns.values())),
        head["names"],
        head["hz"],
        start=head["start"],
        end=head["end"],
        exception_of=head["exception_of"],
        core=core,
        closed=head["closed"],
    )


def _named(source: Any) -> str:
    return told(str(source)) if isinstance(source, str | os.PathLike) else "file"


@contextmanager
def opened(target: Any, mode: str) -> Iterator[Any]:
    """A file as it is, or the file at a path, open for text without translation of line ends, or for bytes."""
    if hasattr(target, "write" if "w" in mode else "read"):
        yield target
    elif "b" in mode:
        with open(target, mode) as file:
            yield file
    else:
        with open(target, mode, encoding="utf-8", newline="") as file:
            yield file
