"""`make lab` opens copies of the notebooks: a Save never touches what the repository holds, and an update never conflicts.

    python -m labkit.workcopy notebooks my-lab

What is missing is copied. What has changed in the repository since replaces a copy that nobody has changed; beside a copy with
somebody's work in it the newer version is laid as NAME.new.ipynb. Nothing that anybody wrote is ever overwritten.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from pathlib import Path

KNOWN = ".copied.json"  # in the folder of the copies: file -> fingerprint of the version offered last


def update(source: Path, copies: Path) -> list[str]:
    """Bring the folder of copies up to date; a sentence for everything that was done or offered."""
    copies.mkdir(parents=True, exist_ok=True)
    try:
        known = json.loads((copies / KNOWN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}  # a first time, or damaged: then every copy that differs counts as somebody's work
    if not isinstance(known, dict):
        known = {}
    said = []
    for file in sorted(path for path in source.iterdir() if path.is_file() and not path.name.startswith(".")):
        mine, newest = copies / file.name, _fingerprint(file)
        if not mine.exists():
            shutil.copy(file, mine)
            said.append(f"{mine}: copied")
        elif newest not in (known.get(file.name), _fingerprint(mine)):
            if _fingerprint(mine) == known.get(file.name):
                shutil.copy(file, mine)
                said.append(f"{mine}: replaced by its newer version (nobody had changed it)")
            else:
                offered = _free(mine)
                shutil.copy(file, offered)
                said.append(f"{offered}: a newer version of {mine.name}, which holds changes of yours and stays as it is")
        known[file.name] = newest
    written = copies / f"{KNOWN}.new"
    written.write_text(json.dumps(known, indent=1), encoding="utf-8")
    written.replace(copies / KNOWN)
    return said


def _fingerprint(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _free(path: Path) -> Path:
    """`01.new.ipynb`, or `01.new2.ipynb` where that exists."""
    numbers = ("", *range(2, 10_000))
    return next(p for n in numbers if not (p := path.with_name(f"{path.stem}.new{n}{path.suffix}")).exists())


if __name__ == "__main__":
    for sentence in update(Path(sys.argv[1]), Path(sys.argv[2])):
        print(sentence)
