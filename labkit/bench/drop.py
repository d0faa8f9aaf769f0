"""A place in a bench to drop a file on, for a parameter that names one. The page's side is drop.js.

The file comes in pieces, each asked for when the one before is on the disk: a Jupyter server closes the connection over a message
of more than 10 MiB.
"""

from __future__ import annotations

import filecmp
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from labkit.bench.heard import HERE, Heard, page_code

FOLDER = Path("dropped")  # beside the notebook
LONGEST = 80  # characters of a name


class Drop(Heard):
    """Takes a file from the page into the folder `dropped`, in which nothing is ever overwritten.

    Args:
        arrived: gets its path, once all of it is there.
        most: largest file in bytes.
    """

    _esm = page_code("drop.js")
    _css = HERE / "drop.css"

    def __init__(self, arrived: Callable[[str], None], most: int) -> None:
        super().__init__()
        self._arrived, self._most = arrived, most
        self._file: IO[bytes] | None = None  # the one that is coming, under a name of its own until it is complete
        self._name, self._size = "", 0
        self.on_msg(self._received)

    def _received(self, _: Any, content: dict[str, Any], buffers: list[memoryview]) -> None:
        try:
            match content:
                case {"want": "state"}:
                    self.send({"kind": "limit", "most": self._most, "folder": FOLDER.name})
                case {"begin": str(name), "size": int(size)}:
                    self._begin(name, size)
                case {"piece": int(at)}:
                    self._append(at, buffers[0])
                case {"stop": True}:
                    self._drop()
        except OSError as error:
            self._drop()
            self.send({"kind": "note", "text": f"{self._name} cannot be kept: {error.strerror or error}"})

    def _begin(self, name: str, size: int) -> None:
        self._drop()
        self._name, self._size = _plain(name), size
        if size > self._most:
            self.send({"kind": "note", "text": f"{self._name} is longer than {self._most >> 20} MiB, the most that is taken"})
            return
        FOLDER.mkdir(exist_ok=True)
        self._file = open(FOLDER / f".{os.getpid()}.{id(self)}.part", "wb")  # noqa: SIM115  # it is filled by messages to come
        self._append(0, memoryview(b""))

    def _append(self, at: int, piece: memoryview) -> None:
        if self._file is None or at != self._file.tell():  # of a file that was given up
            return
        self._file.write(piece)
        there = self._file.tell()
        if there < self._size:
            self.send({"kind": "more", "at": there})
            return
        self._file.close()
        path = _kept(Path(self._file.name), self._name)
        self._file = None
        self.send({"kind": "note", "text": f"reading {self._name} ..."})
        self._arrived(path.as_posix())
        self.send({"kind": "note", "text": f"kept as {path.as_posix()}"})

    def _drop(self) -> None:
        """Give up the file that is coming."""
        if self._file is not None:
            self._file.close()
            Path(self._file.name).unlink(missing_ok=True)
            self._file = None


def _plain(name: str) -> str:
    """A name of a file, and nothing else, on every system."""
    plain = re.sub(r"[^\w.+() -]+", "_", re.split(r"[/\\]", name)[-1]).strip(" .")
    return plain[-LONGEST:].lstrip(" .") or "file"


def _kept(file: Path, name: str) -> Path:
    """Where the file is kept: under its name, or one with a number if there is another one; the same one is kept once."""
    wanted = FOLDER / name
    number = 1
    while wanted.exists() and not (wanted.is_file() and filecmp.cmp(file, wanted, shallow=False)):
        number += 1
        wanted = FOLDER / f"{Path(name).stem}-{number}{Path(name).suffix}"
    file.replace(wanted)
    return wanted
