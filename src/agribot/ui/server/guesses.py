"""Wrong tokens, counted for each address that sends them."""

from __future__ import annotations

MAX_GUESSES = 10  # wrong tokens in a minute from one address, before it has to wait
FORGET_S = 60.0
MAX_ADDRESSES = 1000


class Guesses:
    """It knows no clock: the caller says what time it is."""

    def __init__(self) -> None:
        self._times_s: dict[str, list[float]] = {}

    def is_too_many(self, address: str, now_s: float) -> bool:
        """Count one more wrong token, and say whether there were too many before it."""
        recent = [at_s for at_s in self._times_s.pop(address, []) if now_s - at_s < FORGET_S]
        is_too_many = len(recent) >= MAX_GUESSES
        self._times_s[address] = recent if is_too_many else [*recent, now_s]
        if len(self._times_s) > MAX_ADDRESSES:
            del self._times_s[next(iter(self._times_s))]
        return is_too_many
