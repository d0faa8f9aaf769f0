"""The measurements that both sources published, from the folder `data` (its README describes every column), and sample files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_PACKAGE = Path(__file__).resolve().parent


def _folder() -> Path:
    """In an installed package the files lie inside it, in a checkout beside it."""
    return next((place for place in (_PACKAGE / "data_files", _PACKAGE.parent / "data") if place.is_dir()), _PACKAGE)


def published(name: str) -> Path:
    """Path of one published file; ValueError lists those there are."""
    folder = _folder()
    names = sorted(path.name for path in folder.glob("*.*") if path.suffix in (".csv", ".log"))
    if name not in names:
        raise ValueError(f"no published file {name!r}; there are {', '.join(names) or f'none in {folder}'}")
    return folder / name


def example(name: str) -> Path:
    """Path of one sample file that the lab made itself, from `data/examples`; ValueError lists those there are."""
    folder = _folder() / "examples"
    names = sorted(path.name for path in folder.glob("*.*") if path.suffix != ".md")
    if name not in names:
        raise ValueError(f"no sample file {name!r}; there are {', '.join(names) or f'none in {folder}'}")
    return folder / name


def published_table(name: str) -> pd.DataFrame:
    """One published CSV as a frame."""
    import pandas as pd

    return pd.read_csv(published(name))
