"""Data references as columns: what a tracer records and what an access pattern is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STORE, LOAD, MODIFY = 1, 2, 3
OPS = {"write": STORE, "read": LOAD, "modify": MODIFY}


class TraceFileError(ValueError):
    """The file is no trace of data references; the message says what is wrong."""


@dataclass(frozen=True, eq=False)
class References:
    """Data references in program order.

    Attributes:
        op: uint8 array of shape (n,): 1 store, 2 load, 3 modify (load and store in one).
        address: int64 array of shape (n,), in bytes. size: int64 array of shape (n,), bytes of each reference.

    Raises:
        ValueError: the arrays differ in length, or a value is not allowed; the first such reference is named.
    """

    op: np.ndarray
    address: np.ndarray
    size: np.ndarray

    def __post_init__(self) -> None:
        if not self.op.shape == self.address.shape == self.size.shape == (len(self.op),):
            raise ValueError(
                f"op, address and size have the shapes {self.op.shape}, {self.address.shape} and {self.size.shape}; "
                "they must be 1-dimensional and of one length"
            )
        check_column("op", self.op, (self.op < STORE) | (self.op > MODIFY), "1 store, 2 load or 3 modify")
        check_column("size", self.size, self.size < 1, "at least 1 byte")
        check_column("address", self.address, self.address < 0, "at least 0")
        check_column("address", self.address, self.address > 2**63 - 1 - self.size, "at most 2**63 - 1, its size included")

    def __len__(self) -> int:
        return len(self.op)

    def clipped(self, line: int) -> References:
        """Sizes cut to a line, as cachegrind does before it looks anything up; a reference then touches two lines at most."""
        return References(self.op, self.address, np.minimum(self.size, line))


def check_column(name: str, column: np.ndarray, wrong: np.ndarray, allowed: str) -> None:
    """ValueError that names the first value that is wrong."""
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"{name} of reference {at} is {column[at]}; allowed is {allowed}")
