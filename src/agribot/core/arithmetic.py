"""One formula for one robot and for hundreds: the functions that floats and arrays do not share.

A formula that is written against `Arithmetic` runs on Python floats in the robot, where the
call of a NumPy function would cost more than the sum, and on arrays in the benchmarks, one
element per robot. The results agree to rounding.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from agribot.core.geo import wrap_rad

# A float, or an array with one element per robot.
Number = Any


class Arithmetic(Protocol):
    """What a formula may use besides + - * / and abs()."""

    def cos(self, angle_rad: Number) -> Number: ...

    def sin(self, angle_rad: Number) -> Number: ...

    def sqrt(self, square: Number) -> Number: ...

    def exp(self, power: Number) -> Number: ...

    def least(self, a: Number, b: Number) -> Number: ...

    def most(self, a: Number, b: Number) -> Number: ...

    def choose(self, condition: Number, a: Number, b: Number) -> Number: ...

    def wrap(self, angle_rad: Number) -> Number: ...


class FloatArithmetic:
    """For one robot."""

    cos = staticmethod(math.cos)
    sin = staticmethod(math.sin)
    sqrt = staticmethod(math.sqrt)
    exp = staticmethod(math.exp)

    def least(self, a: Number, b: Number) -> Number:
        return a if a < b else b

    def most(self, a: Number, b: Number) -> Number:
        return a if a > b else b

    def choose(self, condition: Number, a: Number, b: Number) -> Number:
        return a if condition else b

    def wrap(self, angle_rad: Number) -> Number:
        return wrap_rad(angle_rad)


class ArrayArithmetic:
    """For many robots, element by element."""

    cos = staticmethod(np.cos)
    sin = staticmethod(np.sin)
    sqrt = staticmethod(np.sqrt)
    exp = staticmethod(np.exp)
    least = staticmethod(np.minimum)
    most = staticmethod(np.maximum)
    choose = staticmethod(np.where)

    def wrap(self, angle_rad: Number) -> Number:
        return angle_rad - math.tau * np.round(angle_rad / math.tau)


FLOATS: Arithmetic = FloatArithmetic()
ARRAYS: Arithmetic = ArrayArithmetic()
