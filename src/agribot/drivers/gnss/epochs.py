"""Messages of a receiver joined by the time that they are about."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Generic, TypeVar

Kind = TypeVar("Kind", bound=Hashable)


class EpochJoiner(Generic[Kind]):
    """Joins messages with one time to an epoch.

    An epoch ends with the kind of message that ended the one before it, so that it waits for no
    other, or else where the next one begins.
    """

    def __init__(self) -> None:
        self._time: int | None = None
        self._parts: dict[Kind, bytes] = {}
        self._last_kind: Kind | None = None
        self._ending_kind: Kind | None = None
        self._is_given = True

    def add(self, time: int, kind: Kind, payload: bytes) -> list[tuple[int, dict[Kind, bytes]]]:
        """Add a message; gives the epochs that it completes, each with its time."""
        found = []
        if time != self._time:
            self._ending_kind = self._last_kind
            found += self._give()
            self._time, self._parts, self._is_given = time, {}, False
        self._parts[kind] = payload
        self._last_kind = kind
        return found + self._give() if kind == self._ending_kind else found

    def _give(self) -> list[tuple[int, dict[Kind, bytes]]]:
        if self._is_given or self._time is None:
            return []
        self._is_given = True
        return [(self._time, self._parts)]
