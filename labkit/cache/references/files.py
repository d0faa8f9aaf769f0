"""A file of data references, recognised by its content: .npz, or the text of lackey or Dinero."""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass
from os import PathLike

import numpy as np

from labkit.cache.references.columns import References, TraceFileError
from labkit.cache.references.npz import unpacked
from labkit.cache.references.text import format_of, read_text

_LOOKED_AT = 1 << 16  # bytes


@dataclass(frozen=True, eq=False)
class RecordedReferences:
    """References from a file, its format (npz, lackey, dinero), and how many of its lines are none, by sort."""

    references: References
    format: str
    left_out: Counter[str]

    def __str__(self) -> str:
        left = ", ".join(f"{count} {sort}" for sort, count in sorted(self.left_out.items()) if count)
        return f"{self.format}, {len(self.references)} data references" + (f"; left out: {left}" if left else "")


def read_references(path: str | PathLike[str]) -> RecordedReferences:
    """Read a trace of data references. At most `npz.MOST_IN_FILE` of them.

    Raises:
        TraceFileError: the file cannot be read, is in none of the formats or too long, or a value is not allowed.
    """
    try:
        with open(path, "rb") as file:
            return _read(file)
    except FileNotFoundError:
        raise TraceFileError(f"there is no file {path}") from None
    except TraceFileError as error:
        raise TraceFileError(f"{path}: {error}") from None
    except OSError as error:
        raise TraceFileError(f"{path} cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise TraceFileError(f"{path}: {error}") from None
    except Exception as error:  # a damaged archive makes zipfile and zlib raise a dozen different ones
        why = " ".join(str(error).split()) or type(error).__name__
        raise TraceFileError(f"{path} cannot be read as an .npz file of plain arrays: {why}") from None


def read_trace(path: str | PathLike[str]) -> References:
    """The references of `read_references` alone."""
    return read_references(path).references


def _read(file: io.BufferedReader) -> RecordedReferences:
    beginning = file.peek(_LOOKED_AT)[:_LOOKED_AT]
    if beginning.startswith(np.lib.format.MAGIC_PREFIX):
        raise TraceFileError("it holds a single array; a trace is an .npz file with the arrays op, addr and size")
    if beginning.startswith(b"PK"):
        return RecordedReferences(unpacked(file), "npz", Counter())
    form = format_of(beginning)
    if form is None:
        raise TraceFileError("it is no trace of data references: neither .npz, nor lines of valgrind's lackey or of Dinero")
    references, left = read_text(file, form)
    return RecordedReferences(references, form, left)
