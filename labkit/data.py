"""The measurements that both sources published, from the folder `data` beside the package (its README describes every column)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path(__file__).resolve().parents[1] / "data"


def published(name: str) -> Path:
    """Path of one published file; ValueError lists those there are."""
    path = FOLDER / name
    if not path.is_file():
        raise ValueError(
            f"no published file {name!r}; there are {', '.join(sorted(p.name for p in FOLDER.glob('*.*') if p.suffix != '.md'))}"
        )
    return path


def published_table(name: str) -> pd.DataFrame:
    """One published CSV as a frame."""
    import pandas as pd

    return pd.read_csv(published(name))
