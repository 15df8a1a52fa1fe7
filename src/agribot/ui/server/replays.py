"""Which recordings are shown to which browsers, and which gives way when there are too many."""

from __future__ import annotations

from typing import NamedTuple

from agribot.ui.server.access import Role
from agribot.ui.server.replay import Replay

MAX_REPLAYS = 4  # replays of browsers at a time, each with a whole recording in memory
EVERYBODY = ""  # browsers that have chosen no recording of their own
NO_ROOM = (
    f"{MAX_REPLAYS} recordings are shown to operators, as many as there is room for; "
    "try again when one of them has gone back to the robot"
)


class NoRoom(Exception):
    """All replays belong to those who do not give way to this browser."""


class _Shown(NamedTuple):
    replay: Replay
    role: Role | None


class Replays:
    """The replays by browser, the oldest first."""

    def __init__(self) -> None:
        self._shown: dict[str, _Shown] = {}

    def find(self, browser: str) -> Replay | None:
        shown = self._shown.get(browser) or self._shown.get(EVERYBODY)
        return None if shown is None else shown.replay

    def find_victim(self, browser: str, role: Role | None) -> str | None:
        """Find whose replay gives way to this browser's: a viewer's first, then the oldest.

        Raises: NoRoom: all are of operators, and a viewer asks.
        """
        others = [other for other in self._shown if other not in (browser, EVERYBODY)]
        if len(others) < MAX_REPLAYS:
            return None
        victim = min(others, key=lambda other: self._shown[other].role == "operator")
        if self._shown[victim].role == "operator" and role != "operator":
            raise NoRoom(NO_ROOM)
        return victim

    def start(self, browser: str, replay: Replay, role: Role | None) -> str | None:
        """Show a recording; return whose replay gave way.

        Raises: NoRoom: all are of operators, and a viewer asks.
        """
        victim = self.find_victim(browser, role)
        if victim is not None:
            self.end(victim)
        self._shown[browser] = _Shown(replay, role)
        return victim

    def end(self, browser: str) -> None:
        self._shown.pop(browser, None)

    def step(self, wall_s: float) -> None:
        """Move on those that are watched."""
        for replay, _ in self._shown.values():
            if replay.clients:
                replay.step(wall_s)
