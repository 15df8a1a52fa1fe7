"""Types of options: numbers that are refused where they stand, before any work is done."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

from agribot.core.errors import ConfigError, describe_range, format_number

MOST_SEED = 2**63 - 1  # largest number that JSON, TOML and NumPy all hold
MOST_DIGITS = 40  # letters of a word in a message; a longer one is shortened


def number(least: float = -math.inf, most: float = math.inf) -> Callable[[str], float]:
    """Read a finite number of a range, both ends included."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and least <= value <= most):
            raise argparse.ArgumentTypeError(
                f"{_shorten(text)}: {_describe_wanted('number', least, most)}"
            )
        return value

    return read


def above(limit: float, most: float = math.inf) -> Callable[[str], float]:
    """Read a finite number larger than the limit."""
    within = number(limit, most)

    def read(text: str) -> float:
        value = within(text)
        if value == limit:
            raise argparse.ArgumentTypeError(
                f"{_shorten(text)}: out of range; give a number above {limit:g}"
            )
        return value

    return read


def whole(least: int, most: int = MOST_SEED) -> Callable[[str], int]:
    """Read a whole number of a range, both ends included."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:  # also more digits than Python reads
            value = least - 1
        if not least <= value <= most:
            wanted = _describe_wanted("whole number", least, most)
            raise argparse.ArgumentTypeError(f"{_shorten(text)}: {wanted}")
        return value

    return read


finite = number()
positive = above(0.0)
seed = whole(0)
threads = whole(1, 1024)
port = whole(0, 65535)


def check_within(
    name: str, value: float, least: float, most: float = math.inf, unit: str = ""
) -> None:
    """Refuse a value outside of its range, both ends included.

    Raises: ConfigError: it is outside, or not a number.
    """
    if not least <= value <= most:
        shown = _shorten(format_number(value))
        raise ConfigError(f"{name} {shown}: {describe_range(least, most, unit)}")


def check_above(name: str, value: float, limit: float, most: float = math.inf) -> None:
    """Refuse a value that is not larger than the limit, or above the most.

    Raises: ConfigError: it is outside, or not a number.
    """
    if not limit < value <= most:
        shown = _shorten(format_number(value))
        end = "" if most == math.inf else f" and at most {most:g}"
        raise ConfigError(f"{name} {shown}: out of range; give more than {limit:g}{end}")


def _describe_wanted(kind: str, least: float, most: float) -> str:
    if most in (math.inf, MOST_SEED):
        low = "" if least == -math.inf else f", at least {least:g}"
        return f"not accepted; give a {'finite ' if kind == 'number' else ''}{kind}{low}"
    return f"not accepted; give a {kind} from {least:g} to {most:g}"


def _shorten(text: str) -> str:
    return text if len(text) <= MOST_DIGITS else f"{text[:MOST_DIGITS]}..."
