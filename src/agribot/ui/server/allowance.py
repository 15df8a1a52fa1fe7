"""How many messages a page may send. It knows no clock: the caller says what time it is."""

from __future__ import annotations

MAX_MESSAGES_PER_S = 120  # 20 Hz of driving needs a sixth of it
MAX_BURST = 480  # what a Wi-Fi that was away for some seconds brings at once


class Allowance:
    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = float(MAX_BURST), now_s

    def take(self, now_s: float) -> bool:
        """Whether one more message is within the limit."""
        refill = (now_s - self._at_s) * MAX_MESSAGES_PER_S
        self._left, self._at_s = min(self._left + refill, MAX_BURST), now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
