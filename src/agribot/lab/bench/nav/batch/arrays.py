"""The formulas of the robot on arrays: one element per robot (see agribot.core.arithmetic)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from agribot.core.arithmetic import Arithmetic, Condition
from agribot.core.messages import FloatArray

Function = Callable[[FloatArray], FloatArray]
Choice = Callable[[FloatArray | float, FloatArray | float], FloatArray]

Selection = Callable[[Condition, FloatArray | float, FloatArray | float], FloatArray]


class ArrayArithmetic:
    """For many robots, element by element; all arrays (N,)."""

    def __init__(self) -> None:
        self.cos: Function = np.cos
        self.sin: Function = np.sin
        self.sqrt: Function = np.sqrt
        self.exp: Callable[[FloatArray | float], FloatArray | float] = np.exp
        self.least: Choice = np.minimum
        self.most: Choice = np.maximum
        self.choose: Selection = np.where

    def wrap(self, angle_rad: FloatArray, /) -> FloatArray:
        wrapped: FloatArray = angle_rad - math.tau * np.rint(angle_rad / math.tau)
        return wrapped


ARRAYS: Arithmetic[FloatArray] = ArrayArithmetic()


def clamp(values: FloatArray, least: float | FloatArray, most: float | FloatArray) -> FloatArray:
    """Keep values (N,) within limits; np.clip costs three times as much on so few."""
    return np.minimum(np.maximum(values, least), most)
