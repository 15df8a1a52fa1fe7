"""Values in JSON from outside: which are numbers, and how one is quoted."""

from __future__ import annotations

import math
from typing import TypeGuard

MOST_QUOTED = 80  # letters of a value in a message


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a finite number that a float can hold; integers in JSON may have any size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def quote_value(value: object) -> str:
    """Quote a value in a message, the first letters of a long one."""
    return repr(value)[:MOST_QUOTED]
