"""Where recordings come from: a path, an open file, bytes or text; read in blocks and up to a stated size."""

from __future__ import annotations

import codecs
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO, StringIO
from typing import IO, Any

from labkit.trace.readers.report import LogError, told

#: Longest recording in bytes (a text in characters); a log of this size has some 13 million stamps.
MOST_BYTES = 256 << 20

#: So much is read at a time.
BLOCK = 1 << 20


class Source:
    """A recording that is being read, once, from its beginning.

    Attributes:
        title: the name of the file, or "text", for messages.
        head: the first block, which can be looked at before the rest is read.
    """

    def __init__(self, title: str, stream: IO[Any]) -> None:
        self.title = title
        self._stream = stream
        self.head: bytes | str = stream.read(BLOCK)

    def blocks(self, most: int | None = None) -> Iterator[bytes | str]:
        """All of it, block by block; LogError if it is longer than `most`, or `MOST_BYTES`."""
        size, piece, most = 0, self.head, most or MOST_BYTES
        while piece:
            size += len(piece)
            if size > most:
                raise LogError(
                    f"{self.title}: longer than {most >> 20} MiB, the most that is read; cut the recording into pieces"
                )
            yield piece
            piece = self._stream.read(BLOCK)

    def beginning(self) -> list[str]:
        """The lines of the first block, the last of which may be cut."""
        head = self.head
        text = head if isinstance(head, str) else head.decode(_encoding(head), "replace")
        return text.replace("\r\n", "\n").split("\n")

    def lines(self) -> Iterator[list[str]]:
        """The lines in blocks, without their ends; bytes as UTF-8, or UTF-16 if they begin like it (as PowerShell redirects)."""
        begun, decoder = list[str](), None
        for piece in self.blocks():
            if not isinstance(piece, str):
                decoder = decoder or codecs.getincrementaldecoder(_encoding(piece))("replace")
                piece = decoder.decode(piece)
            begun.append(piece)
            if "\n" in piece:
                lines = "".join(begun).replace("\r\n", "\n").split("\n")
                begun = [lines.pop()]
                yield lines
        if decoder is not None:
            begun.append(decoder.decode(b"", True))
        if last := "".join(begun):
            yield [last]

    def text(self) -> str:
        """All of it as text; what is not UTF-8 becomes U+FFFD."""
        data = self.bytes()
        return data.decode(_encoding(data), "replace")

    def bytes(self, most: int | None = None) -> bytes:
        """All of it as bytes, a text as UTF-8; LogError if it is longer than `most`, or `MOST_BYTES`."""
        return b"".join(piece.encode("utf-8", "replace") if isinstance(piece, str) else piece for piece in self.blocks(most))


@contextmanager
def open_source(source: str | os.PathLike[str] | bytes | IO[Any]) -> Iterator[Source]:
    """Open a path, an open file (text or binary), bytes or text; a str with a line break or like a stamp is the text itself.

    Whatever goes wrong while it is read is a LogError that names it.
    """
    title = _title(source)
    try:
        with _stream(source) as stream:
            yield Source(title, stream)
    except LogError:
        raise
    except (OSError, UnicodeError) as error:
        raise LogError(f"{title}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    except ValueError as error:  # a NUL in a path, a closed file
        raise LogError(f"{title}: cannot be read ({error})") from None


def _is_log(source: str) -> bool:
    """Is this str a log rather than the path of one?"""
    return "\n" in source or not source.strip() or (source.endswith((" 0", " 1")) and not os.path.exists(source))


def _title(source: object) -> str:
    if isinstance(source, str) and _is_log(source):
        return "text"
    name = source if isinstance(source, str | os.PathLike) else getattr(source, "name", "text")
    name = str(name)
    return name if name.isprintable() else told(name)


@contextmanager
def _stream(source: str | os.PathLike[str] | bytes | IO[Any]) -> Iterator[IO[Any]]:
    if isinstance(source, str) and _is_log(source):
        yield StringIO(source, newline="")
    elif isinstance(source, str | os.PathLike):
        with open(source, "rb") as file:
            yield file
    elif isinstance(source, bytes | bytearray):
        yield BytesIO(source)
    elif hasattr(source, "read"):
        yield source
    else:
        raise LogError(f"a recording is a path, an open file, bytes or text, not {type(source).__name__}")


def _encoding(beginning: bytes) -> str:
    return "utf-16" if beginning[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
