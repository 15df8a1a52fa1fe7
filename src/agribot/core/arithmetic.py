"""One formula for one robot and for many: the functions that floats and arrays do not share.

A formula that is written against `Arithmetic` runs on Python floats in the robot, where the
call of a NumPy function would cost more than the sum, and on arrays in the benchmarks, one
element per robot. The results agree to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeVar, cast

import numpy as np
import numpy.typing as npt

from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray

# A float, or an array with one element per robot; what goes in comes out.
Number = TypeVar("Number", float, FloatArray)
Mask = npt.NDArray[np.bool_]
Condition = bool | Mask
Real = TypeVar("Real", int, float)


def clamp(value: Real, least: Real, most: Real) -> Real:
    """Keep a value within limits to the last bit; NaN stays NaN."""
    return min(max(value, least), most)


def view_floats(values: FloatArray) -> Sequence[float]:
    """Give the numbers of a column one by one as plain floats, without a copy.

    Indexing an array costs more than most formulas; a list of a path of 50 km takes hundreds of
    megabytes, and longer to make than a tick.
    """
    return cast(Sequence[float], values.data)


class Arithmetic(Protocol[Number]):
    """What a formula may use besides + - * / and abs()."""

    def cos(self, angle_rad: Number, /) -> Number: ...

    def sin(self, angle_rad: Number, /) -> Number: ...

    def sqrt(self, square: Number, /) -> Number: ...

    def exp(self, power: Number | float, /) -> Number | float: ...

    def least(self, a: Number | float, b: Number | float, /) -> Number: ...

    def most(self, a: Number | float, b: Number | float, /) -> Number: ...

    def choose(self, condition: Condition, a: Number | float, b: Number | float, /) -> Number: ...

    def wrap(self, angle_rad: Number, /) -> Number: ...


class FloatArithmetic:
    """For one robot."""

    cos = staticmethod(math.cos)
    sin = staticmethod(math.sin)
    sqrt = staticmethod(math.sqrt)
    exp = staticmethod(math.exp)
    wrap = staticmethod(wrap_rad)

    def least(self, a: float, b: float, /) -> float:
        return a if a < b else b

    def most(self, a: float, b: float, /) -> float:
        return a if a > b else b

    def choose(self, condition: Condition, a: float, b: float, /) -> float:
        return a if condition else b


FLOATS: Arithmetic[float] = FloatArithmetic()
