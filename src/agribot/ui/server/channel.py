"""One stream of states with all who follow it: the live robot, or a recording that is replayed."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import msgspec

from agribot.ui import wire
from agribot.ui.about import make_epoch
from agribot.ui.server.languages import say_in

EVENTS_KEPT = 300


class ChannelReader(Protocol):
    """A page's side of a channel."""

    language: str

    def follow(self, channel: Channel) -> None: ...

    def add_state(self, text: str) -> None: ...

    def change_weeds(self, ids: list[int]) -> None: ...

    def wake(self) -> None: ...


class Channel:
    """Keeps what grows; each of its clients takes from it what it has not been sent yet.

    `epoch` is in all that a client gets: it changes where what was shown before is no longer
    true, and no two channels have the same, whichever process they are in. That of the live robot
    is the number of its run: a server that is started again goes on with it.
    """

    def __init__(self, source: str, name: str = "", epoch: int | None = None) -> None:
        self.source, self.name = source, name
        self.epoch = make_epoch() if epoch is None else epoch
        self.clients: set[ChannelReader] = set()
        self.state: wire.State | None = None  # the newest
        self._state_texts: dict[str, str] = {}  # texts by language
        self.trace_map_m: list[wire.Vec2] = []
        self.weeds: dict[int, wire.Weed] = {}
        self.path = wire.PathPiece()  # the whole of it
        self.path_revision = 0
        self.receiver: wire.ReceiverState | None = None  # the newest
        self.events: deque[wire.LogEvent] = deque(maxlen=EVENTS_KEPT)
        self.event_count = 0

    def publish_state(self, state: wire.State) -> None:
        """Encode once for all who follow in one language."""
        self.state = msgspec.structs.replace(state, epoch=self.epoch)
        self._state_texts = {}
        for client in self.clients:
            client.add_state(self.write_state(client.language))

    def write_state(self, language: str = "en") -> str:
        """Write the newest state as a page gets it; empty before the first."""
        if self.state is None:
            return ""
        if language not in self._state_texts:
            self._state_texts[language] = wire.encode(say_in(language, self.state)).decode()
        return self._state_texts[language]

    def publish_growth(self, growth: wire.Growth) -> None:
        """Kept for those who come later; those who are here take it when they have room."""
        if isinstance(growth, wire.TracePiece):
            del self.trace_map_m[growth.first :]
            self.trace_map_m += growth.points_map_m
        elif isinstance(growth, wire.PathPiece):
            self.path = growth
            self.path_revision += 1
        elif isinstance(growth, wire.WeedChanges):
            self._keep_weeds(growth)
        elif isinstance(growth, wire.ReceiverState):
            self.receiver = msgspec.structs.replace(growth, epoch=self.epoch)
        else:
            self.events.extend(growth.events)
            self.event_count += len(growth.events)
        for client in self.clients:
            client.wake()

    def restart(self) -> None:
        """Another place in the recording: everything is sent afresh."""
        self.epoch = make_epoch()
        self.trace_map_m, self.weeds, self.path = [], {}, wire.PathPiece()
        self.state = None
        self.receiver = None
        self.events.clear()
        self.event_count = 0
        for client in self.clients:
            client.follow(self)

    def _keep_weeds(self, changes: wire.WeedChanges) -> None:
        self.weeds.update((weed.id, weed) for weed in changes.set)
        for id in changes.gone:
            self.weeds.pop(id, None)
        changed = [*(weed.id for weed in changes.set), *changes.gone]
        for client in self.clients:
            client.change_weeds(changed)


def signal_table() -> wire.SignalTable:
    names, units = zip(*wire.SIGNALS, strict=True)
    return wire.SignalTable(names=list(names), units=list(units))
