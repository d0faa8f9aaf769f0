"""A table of tasks as text: rows and cells as a spreadsheet copies them, and the tasks they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from labkit.checks import shown

#: Column of the table -> field in the JSON of `labkit schedule`.
FIELDS = {
    "name": "name",
    "C": "wcet",
    "T": "period",
    "D": "deadline",
    "offset": "offset",
    "ECET": "ecet",
    "EP": "ep_wcet",
    "times": "times",
}
#: What else a first line may call a column.
SYNONYMS = {"task": "name", "o": "offset", "phase": "offset", **{field: column for column, field in FIELDS.items()}}
NEEDED = ("name", "T")


def cells(text: str) -> list[tuple[str, ...]]:
    """The rows of a table as text: a line or what a semicolon ends is a row, tabs or commas are between its cells.

    A first line of column names says in which order they come, as what is copied from a spreadsheet. Empty rows are left out.
    """
    rows = [
        [cell.strip() for cell in re.split(r"\t|," if "\t" not in row else r"\t", row)] for row in re.split(r"[\r\n;]+", text)
    ]
    rows = [row for row in rows if any(row)]
    order: Sequence[str] = tuple(FIELDS)
    if rows and (named := [_column(cell) for cell in rows[0]]) and {"name", "T"} <= set(named):
        order, rows = [column or "" for column in named], rows[1:]
    return [tuple(dict(zip(order, row, strict=False)).get(column, "") for column in FIELDS) for row in rows]


def _column(word: str) -> str | None:
    bare = re.sub(r"[\[(].*", "", word).strip().lower()
    return next((column for column in FIELDS if column.lower() == bare), SYNONYMS.get(bare))


def text_of(rows: Iterable[Sequence[str]]) -> str:
    """A table as text that `cells` reads; what would end a cell or row becomes a blank."""
    plain = ([re.sub(r"[\s,;]+", " ", cell).strip() for cell in row] for row in rows)
    return "; ".join(re.sub(r"[, ]+$", "", ", ".join(row)) for row in plain if any(row))


def entry(row: Sequence[str]) -> dict[str, Any]:
    """A row as a task of the JSON of `labkit schedule`. Raises ValueError, a sentence, for a cell that is no whole number."""
    made: dict[str, Any] = {}
    for (column, field), cell in zip(FIELDS.items(), row, strict=True):
        if column == "name":
            made[field] = cell
        elif column == "times" and cell:
            made[field] = [_whole(column, each) for each in cell.split()]
        elif cell:
            made[field] = _whole(column, cell)
    missing = [column for column in NEEDED if FIELDS[column] not in made or made[FIELDS[column]] == ""]
    if missing:
        raise ValueError(f"{' and '.join(missing)} missing")
    return made


def _whole(column: str, cell: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,18}", cell):
        raise ValueError(f"{column} is {shown(cell)}; whole numbers only (choose a finer unit for parts of one)")
    return int(cell)


def complaint(error: ValueError) -> str:
    """The sentence of a reader in the words of the table: without the task's name, fields called as the columns."""
    text = re.sub(r"^task '[^']*':? ?(has )?", "", str(error).partition("; policy")[0])
    for column, field in FIELDS.items():
        text = re.sub(rf"\b{field}\b", column, text)
    return text
