"""One stream of states with all who follow it: the live robot, or a recording that is replayed."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

import msgspec

from agribot.ui.view import SIGNALS

STATES_KEPT = 4  # for one client; older ones are worth nothing
CHANGES_KEPT = 300  # a client that is farther behind gets everything afresh
DIRECT_KEPT = 100
EVENTS_KEPT = 300


class Client:
    """What waits to be sent to one page. A slow page loses its oldest states."""

    def __init__(self) -> None:
        self.dropped = 0
        self._direct: deque[str] = deque(maxlen=DIRECT_KEPT)
        self._states: deque[str] = deque(maxlen=STATES_KEPT)
        self._changes: deque[str] = deque()
        self._is_behind = False
        self._ready = asyncio.Event()

    def tell(self, text: str) -> None:
        """For this page alone, such as an answer."""
        self._direct.append(text)
        self._ready.set()

    def state(self, text: str) -> None:
        self.dropped += len(self._states) == STATES_KEPT
        self._states.append(text)
        self._ready.set()

    def change(self, text: str) -> None:
        if len(self._changes) >= CHANGES_KEPT:
            self.start_over()
        else:
            self._changes.append(text)
        self._ready.set()

    def start_over(self) -> None:
        """Forget what waits; the next thing to be sent is a snapshot."""
        self._changes.clear()
        self._states.clear()
        self._is_behind = True
        self._ready.set()

    async def next(self, channel: Channel) -> str:
        """The next text to send: answers, snapshot, changes, then states."""
        while True:
            if self._direct:
                return self._direct.popleft()
            if self._is_behind:
                self._is_behind = False
                self._changes.clear()
                return channel.snapshot()
            for queue in (self._changes, self._states):
                if queue:
                    return queue.popleft()
            self._ready.clear()
            await self._ready.wait()


class Channel:
    """Encodes nothing itself: what the robot sends is passed on as it is."""

    def __init__(self, source: str, signals: dict[str, Any]) -> None:
        self.source = source
        self.clients: set[Client] = set()
        self.state_text = ""
        self.states = 0
        self.trace_map_m: list[list[float]] = []
        self.weeds: dict[int, list[Any]] = {}
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self._rev = 0
        self._path: dict[str, Any] | None = None
        self._signals = signals

    def publish_state(self, text: str) -> None:
        self.state_text = text
        self.states += 1
        for client in self.clients:
            client.state(text)

    def publish_change(self, text: str) -> None:
        """A trace, path, weeds or event message: kept for those who come later."""
        self._keep(msgspec.json.decode(text))
        for client in self.clients:
            client.change(text)

    def restart(self) -> None:
        """Another recording, or another place in it."""
        self.trace_map_m, self.weeds, self._path = [], {}, None
        self.events.clear()
        for client in self.clients:
            client.start_over()

    def snapshot(self) -> str:
        return msgspec.json.encode(
            {
                "k": "snap",
                "traj": {"first": 0, "xy": self.trace_map_m},
                "weeds": {"rev": self._rev, "all": list(self.weeds.values())},
                "path": self._path,
                "events": list(self.events),
                "signals": self._signals,
            }
        ).decode()

    def newest(self) -> dict[str, Any]:
        """The newest state; empty before the first."""
        state: dict[str, Any] = msgspec.json.decode(self.state_text) if self.state_text else {}
        return state

    def _keep(self, message: dict[str, Any]) -> None:
        kind = message.pop("k")
        if kind == "traj":
            del self.trace_map_m[message["first"] :]
            self.trace_map_m += message["xy"]
        elif kind == "path":
            self._path = message
        elif kind == "weeds":
            self._rev = message["rev"]
            self.weeds.update((row[0], row) for row in message["set"])
            for id in message["gone"]:
                self.weeds.pop(id, None)
        elif kind == "event":
            self.events.append(message)


def signal_table() -> dict[str, Any]:
    names, units = zip(*SIGNALS, strict=True)
    return {"names": list(names), "units": list(units)}
