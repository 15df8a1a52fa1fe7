"""A table of numbers that grows by a row with every tick of a long mission."""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np

from agribot.core.messages import FloatArray


class GrowingTable:
    """Rows of floats at eight bytes each: a list of tuples would take five times the memory."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // self._columns

    def append(self, row: Iterable[float]) -> None:
        """Add a row.

        Raises: ValueError: the row has not as many numbers as the table has columns.
        """
        before = len(self._values)
        self._values.extend(row)
        if len(self._values) - before != self._columns:
            del self._values[before:]
            raise ValueError(f"a row of a table of {self._columns} columns has as many numbers")

    def to_array(self) -> FloatArray:
        """Copy the table, (rows, columns)."""
        return np.array(self._values, dtype=float).reshape(-1, self._columns)
