"""One stream of states with all who follow it: the live robot, or a recording that is replayed."""

from __future__ import annotations

import secrets
from collections import deque
from typing import Any, Protocol

import msgspec

from agribot.ui.view import SIGNALS

EVENTS_KEPT = 300
EPOCH_BITS = 32


class Follower(Protocol):
    """A page's side of a channel."""

    def follow(self, channel: Channel) -> None: ...

    def state(self, text: str) -> None: ...

    def change_weeds(self, ids: list[int]) -> None: ...

    def wake(self) -> None: ...


class Channel:
    """Keeps what grows; each of its clients takes from it what it has not been sent yet.

    `epoch` is in all that a client gets: it changes where what was shown before is no longer
    true, and no two channels have the same, whichever process they are in. That of the live robot
    is the number of its run: a server that is started again goes on with it.
    """

    def __init__(
        self, source: str, signals: dict[str, Any], name: str = "", epoch: int | None = None
    ) -> None:
        self.source, self.name = source, name
        self.epoch = make_epoch() if epoch is None else epoch
        self.clients: set[Follower] = set()
        self.state_text = ""
        self.states = 0
        self.signals = signals
        self.trace_map_m: list[list[float]] = []
        self.weeds: dict[int, list[Any]] = {}
        self.weeds_revision = 0
        self.path: dict[str, Any] = {"xy": [], "row": []}
        self.path_revision = 0
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self.event_count = 0

    def publish_state(self, text: str) -> None:
        head, _, rest = text.partition(",")
        self.state_text = f'{head},"e":{self.epoch},{rest}'
        self.states += 1
        for client in self.clients:
            client.state(self.state_text)

    def publish_change(self, text: str) -> None:
        """A trace, path, weeds or event message."""
        self._keep(msgspec.json.decode(text))
        for client in self.clients:
            client.wake()

    def restart(self) -> None:
        """Another place in the recording: everything is sent afresh."""
        self.epoch = make_epoch()
        self.trace_map_m, self.weeds, self.path = [], {}, {"xy": [], "row": []}
        self.state_text = ""
        self.events.clear()
        self.event_count = 0
        for client in self.clients:
            client.follow(self)

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
            self.path = message
            self.path_revision += 1
        elif kind == "weeds":
            self._keep_weeds(message)
        elif kind == "event":
            self.events.append(message)
            self.event_count += 1

    def _keep_weeds(self, message: dict[str, Any]) -> None:
        self.weeds_revision = message["rev"]
        self.weeds.update((row[0], row) for row in message["set"])
        for id in message["gone"]:
            self.weeds.pop(id, None)
        changed = [*(row[0] for row in message["set"]), *message["gone"]]
        for client in self.clients:
            client.change_weeds(changed)


def make_epoch() -> int:
    """A number that nothing else has that is or was shown at this address."""
    return secrets.randbits(EPOCH_BITS)


def signal_table() -> dict[str, Any]:
    names, units = zip(*SIGNALS, strict=True)
    return {"names": list(names), "units": list(units)}
