"""Which connections the server keeps when there are more than it has room for.

A new connection has shown nothing yet. It therefore always gets a slot, and the one that has the
least right to its own gives way: strangers before viewers, viewers before operators. Of equals,
the address with the most connections loses its oldest. Operators never give way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

MAX_CONNECTIONS = 200  # connections of browsers and programs together
STRANGER, VIEWER, OPERATOR = 0, 1, 2  # the more, the later it gives way


class Slot:
    """One connection; `rank` rises once it has shown whom it belongs to."""

    def __init__(self, address: str, cut: Callable[[], None]) -> None:
        self.address, self.cut = address, cut
        self.rank = STRANGER

    def identify(self, role: str | None) -> None:
        rank = OPERATOR if role == "operator" else VIEWER if role else STRANGER
        self.rank = max(self.rank, rank)


class ConnectionSlots:
    """All open connections, the oldest first."""

    def __init__(self, limit: int = MAX_CONNECTIONS) -> None:
        self._limit = limit
        self._slots: dict[Slot, None] = {}

    def __len__(self) -> int:
        return len(self._slots)

    def enter(self, slot: Slot) -> bool:
        """Whether it has a place; another one may have been cut for it."""
        if len(self._slots) >= self._limit:
            victim = self._least_entitled()
            if victim.rank == OPERATOR:
                return False
            del self._slots[victim]
            victim.cut()
        self._slots[slot] = None
        return True

    def leave(self, slot: Slot) -> None:
        self._slots.pop(slot, None)

    def _least_entitled(self) -> Slot:
        crowd = Counter((slot.rank, slot.address) for slot in self._slots)
        return min(self._slots, key=lambda slot: (slot.rank, -crowd[slot.rank, slot.address]))
