"""What a station measured of an element: when, where, how well; and anybody's measurements, read from CSV.

The time of a measurement is in seconds, as float, unlike elsewhere in the lab: an estimator takes any instant, and rounding the
times of a file to whole nanoseconds would move its results by more than the 1e-9 m to which they can be checked.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import IO, NamedTuple

import numpy as np

from labkit.checks import shown
from labkit.outside import read_text

#: Columns of a file of measurements, in any order, and of estimates.
COLUMNS = ("t_s", "x_m", "y_m", "station")
ESTIMATE = ("t_s", "track", "x_m", "y_m", "vx_mps", "vy_mps", "var_x", "var_y")

#: No time in s and no coordinate in m is larger, and a standard deviation in m lies between these two.
LARGEST = 1e12
FINEST, COARSEST = 1e-6, 1e6

#: Longest name of a station.
MOST_NAME = 100


@dataclass(frozen=True, slots=True)
class Measurement:
    """An element's position as one station measured it.

    Attributes:
        time: in s on the global clock.
        x, y: in m.
        station: who measured it.
        xx, xy, yy: its covariance in m^2.

    Raises:
        ValueError: a number is not finite or too large, or the covariance is not positive definite; names which.
    """

    time: float
    x: float
    y: float
    station: str
    xx: float
    xy: float
    yy: float

    def __post_init__(self) -> None:
        for name in ("time", "x", "y"):
            value = getattr(self, name)
            if not abs(value) <= LARGEST:  # nor is it not a number
                raise ValueError(f"a measurement's {name} is {shown(value)}; a number up to {LARGEST:g} is allowed")
        bounds = FINEST**2 <= self.xx <= COARSEST**2 and FINEST**2 <= self.yy <= COARSEST**2
        if not (bounds and self.xy**2 < self.xx * self.yy):
            told = f"[[{self.xx:g}, {self.xy:g}], [{self.xy:g}, {self.yy:g}]]"
            allowed = f"a positive definite one with standard deviations from {FINEST:g} to {COARSEST:g} m"
            raise ValueError(f"the covariance of a measurement is {told}; {allowed} is allowed")

    @classmethod
    def equal(cls, time: float, x: float, y: float, station: str, sigma: float) -> Measurement:
        """One that is equally good in all directions: R = sigma^2 I, `sigma` in m."""
        return cls(time, x, y, station, sigma * sigma, 0.0, sigma * sigma)

    @property
    def z(self) -> np.ndarray:
        """The position, shape (2,)."""
        return np.array([self.x, self.y])

    @property
    def R(self) -> np.ndarray:
        """The covariance, shape (2, 2)."""
        return np.array([[self.xx, self.xy], [self.xy, self.yy]])

    @property
    def variance(self) -> float | None:
        """That of each axis, if the measurement is equally good in all directions."""
        return self.xx if self.xx == self.yy and self.xy == 0 else None


class Reading(NamedTuple):
    """A file of measurements as it was read.

    Attributes:
        measurements: in order of time; those of one time in the order of the file.
        moved: how many stood later in the file than one of a later time.
        copies: how many rows were left out because time, place and station were those of a row before.
        ignored: names of the columns that nobody asked for.
    """

    measurements: list[Measurement]
    moved: int
    copies: int
    ignored: list[str]


def check_sigma(sigma: float) -> float:
    """`sigma`, if it is a standard deviation that is allowed; ValueError."""
    if not FINEST <= sigma <= COARSEST:
        raise ValueError(f"sigma is {shown(sigma)} m; {FINEST:g} to {COARSEST:g} is allowed")
    return sigma


def read_measurements(path: str | os.PathLike[str], sigma: float) -> Reading:
    """The measurements in a CSV file with the columns of `COLUMNS`, rows in any order, each with R = sigma^2 I.

    Times may be negative, since only differences count. Rows of the same time and station are one look at several objects; rows
    that are the same in everything are copies, and one of them is taken.

    Raises:
        ValueError: `sigma` is not allowed, the file is longer than `labkit.outside.MOST_BYTES` or no UTF-8 text, a column is
            missing or comes twice, or a cell is no number; names file and line.
        OSError: the file cannot be read.
    """
    check_sigma(sigma)
    rows = csv.reader(io.StringIO(read_text(path), newline=""), skipinitialspace=True, strict=True)
    try:
        head = [cell.strip() for cell in next(rows, [])]
        wrong = [column for column in COLUMNS if head.count(column) != 1]
        if wrong:
            word = "no column" if wrong[0] not in head else "more than one column"
            raise ValueError(f"{word} {', '.join(wrong)}; a file of measurements has {', '.join(COLUMNS)} once each")
        places = [head.index(column) for column in COLUMNS]
        found = [_measurement([row[i] for i in places], sigma) for row in rows if _full(row, head)]
    except csv.Error as error:
        raise ValueError(f"{path}, line {rows.line_num + 1}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}, line {max(rows.line_num, 1)}: {error}") from None
    single = list(dict.fromkeys(found))
    latest = np.maximum.accumulate([m.time for m in single]) if single else np.empty(0)
    moved = sum(m.time < last for m, last in zip(single, latest))
    single.sort(key=lambda m: m.time)  # a stable sort
    return Reading(single, moved, len(found) - len(single), [name for name in head if name not in COLUMNS])


def _full(row: list[str], head: list[str]) -> bool:
    """Whether there is something in the row; ValueError if it does not fit the head."""
    if not any(cell.strip() for cell in row):
        return False
    if len(row) != len(head):
        raise ValueError(f"{len(row)} cells, where the first line names {len(head)} columns")
    return True


def _measurement(cells: list[str], sigma: float) -> Measurement:
    time, x, y = (_number(cell, column) for cell, column in zip(cells[:3], COLUMNS))
    station = cells[3].strip()
    if not (station.isprintable() and 1 <= len(station) <= MOST_NAME):
        raise ValueError(f"station is {shown(station)}; a text of 1 to {MOST_NAME} printable characters is allowed")
    return Measurement.equal(time, x, y, station, sigma)


def _number(cell: str, column: str) -> float:
    text = cell.strip()
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        raise ValueError(f"{column} is {shown(text)}; a number of at most {LARGEST:g} is allowed")
    return value


def write_estimates(rows: Iterable[tuple[float | int, ...]], file: IO[str]) -> None:
    """Write estimates as CSV with the columns of `ESTIMATE`, numbers in full; `file` is open for text with newline=""."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(ESTIMATE)
    writer.writerows(rows)
