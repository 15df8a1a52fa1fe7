"""Small arithmetic on floats, where the call of a NumPy function would cost more than the sum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar, cast

from agribot.core.messages import FloatArray

# A float or an array; what goes in comes out.
Number = TypeVar("Number", float, FloatArray)
Real = TypeVar("Real", int, float)


def clamp(value: Real, least: Real, most: Real) -> Real:
    """Keep a value within limits to the last bit; NaN stays NaN."""
    raised = least if least > value else value  # twice as fast as min() and max()
    return most if most < raised else raised


def view_floats(values: FloatArray) -> Sequence[float]:
    """Give the numbers of a column one by one as plain floats, without a copy.

    Indexing an array costs more than most formulas; a list of a path of 50 km takes hundreds of
    megabytes, and longer to make than a tick.
    """
    return cast(Sequence[float], values.data)
