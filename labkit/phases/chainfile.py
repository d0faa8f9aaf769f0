"""Anybody's chain of phases: read from CSV."""

from __future__ import annotations

import csv
import io
import os
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

from labkit.outside import Name, a_whole, checked, read_text
from labkit.phases.windows import Part, phases_of

#: A chain from a file has at most so many parts, and none takes longer: 31 years.
MOST_PARTS, LONGEST_NS = 1000, 10**18

COLUMNS = ("phase", "part", "ecet_ns", "wcet_ep_ns")


def _number(cell: Any) -> Any:
    """A cell as the whole number it shows, with blanks or underscores between its digits, or else as it is."""
    try:
        return int(cell.replace(" ", "").replace("_", ""))
    except ValueError:
        return cell


class _Row(BaseModel):
    """A line of the file: its cells as texts, without those that are empty."""

    model_config = ConfigDict(extra="ignore")

    phase: Name
    part: Name | None = None
    ecet_ns: Annotated[int, a_whole(1, LONGEST_NS), BeforeValidator(_number)]
    wcet_ep_ns: Annotated[int, a_whole(0, LONGEST_NS), BeforeValidator(_number)]
    wcet_ns: Annotated[int | None, a_whole(1, LONGEST_NS), BeforeValidator(_number)] = None


def read_chain(path: str | os.PathLike[str]) -> list[Part]:
    """A chain from a CSV file with the columns phase, part, ecet_ns, wcet_ep_ns and optionally wcet_ns.

    A part without a name is the whole phase. The file has at most `labkit.outside.MOST_BYTES` and `MOST_PARTS` parts.

    Raises:
        ValueError: a column is missing or comes twice, a cell is no whole number, or a value is out of bounds; names file and
            line.
        OSError: the file cannot be read.
    """
    reader = csv.DictReader(io.StringIO(read_text(path), newline=""), skipinitialspace=True, strict=True)
    chain: list[Part] = []
    try:
        columns = [column.strip() for column in reader.fieldnames or ()]
        reader.fieldnames = columns
        wrong = [column for column in COLUMNS if columns.count(column) != 1]
        if wrong:
            word = "no column" if wrong[0] not in columns else "more than one column"
            raise ValueError(f"{word} {', '.join(wrong)}; a chain has {', '.join(COLUMNS)} once each")
        for cells in reader:
            chain.append(
                _part({key: text.strip() for key, text in cells.items() if key in _Row.model_fields and (text or "").strip()})
            )
            if len(chain) > MOST_PARTS:
                raise ValueError(f"the chain has more parts than {MOST_PARTS}, the most that are allowed")
    except csv.Error as error:
        raise ValueError(f"{path}, line {reader.line_num + 1}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}, line {max(reader.line_num, 1)}: {error}") from None
    try:
        phases_of(chain)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return chain


def _part(cells: dict[str, str]) -> Part:
    row = checked(_Row, cells, "the part")
    return Part(row.phase, row.part or row.phase, row.ecet_ns, row.wcet_ep_ns, row.wcet_ns)
