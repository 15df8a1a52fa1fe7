"""The operator's seat: one person drives, everybody may look on and stop.

The seat belongs to a session and not to a connection, so that a page that is loaded again has
it back. It knows no clock: the caller says what time it is.
"""

from __future__ import annotations

from agribot.core.facts import AnyFact, SeatHeld
from agribot.ui import wire

# Silence of a holder; after it any client with the role may take the seat without asking.
SILENCE_S = 2.0


class Seat:
    def __init__(self) -> None:
        self.holder = ""
        self.name = ""
        self._heard_s = 0.0

    def note_life(self, session: str, now_s: float) -> None:
        """Take a sign of life of a session."""
        if session == self.holder:
            self._heard_s = now_s

    def take(self, session: str, name: str, now_s: float, *, force: bool = False) -> AnyFact | None:
        """Why it was refused; None when the seat is taken."""
        if self.holder not in {"", session} and not force and not self.is_silent(now_s):
            return SeatHeld(self.name)
        self.holder, self.name, self._heard_s = session, name, now_s
        return None

    def release(self, session: str) -> bool:
        """Whether this session had it."""
        if session != self.holder or not session:
            return False
        self.holder = self.name = ""
        return True

    def is_silent(self, now_s: float) -> bool:
        return not self.holder or now_s - self._heard_s > SILENCE_S

    def seen_by(self, session: str, now_s: float) -> wire.SeatState:
        """Return what a page shows to this session."""
        if self.holder == session and session:
            return "you"
        return "free" if self.is_silent(now_s) else "other"
