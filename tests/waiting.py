"""Patience for what another process does: only its absence fails, never its slowness."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 180.0
POLL_S = 0.02
T = TypeVar("T")


def wait_for(ask: Callable[[], T | None], what: str, patience_s: float = PATIENCE_S) -> T:
    """The first true value that `ask` gives, however often it has to be asked."""
    end_s = time.monotonic() + patience_s
    while not (value := ask()):
        assert time.monotonic() < end_s, f"waited {patience_s:g} s in vain for {what}"
        time.sleep(POLL_S)
    return value
