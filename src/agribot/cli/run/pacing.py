"""Simulated time against the clock on the wall."""

from __future__ import annotations

import math
import time

from agribot.core.errors import ConfigError


def parse_pace(text: str) -> float:
    """Parse simulated seconds per second; infinite for as fast as possible.

    Raises: ConfigError: neither a number above 0 nor 'max'.
    """
    if text == "max":
        return math.inf
    try:
        pace = float(text)
    except ValueError:
        pace = math.nan
    if not pace > 0:
        raise ConfigError(
            f"--speed {text}: not a speed; give a number above 0 (1 is real time), or 'max' for as "
            "fast as possible"
        )
    return pace


def wait_until(moment_s: float) -> None:
    """Sleep until a moment of the monotonic clock."""
    remaining_s = moment_s - time.monotonic()
    if remaining_s > 0:
        time.sleep(remaining_s)
