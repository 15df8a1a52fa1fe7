"""What one page is still to be sent of the channel that it follows."""

from __future__ import annotations

import asyncio
import itertools
from collections import deque

from agribot.ui import wire
from agribot.ui.server.channel import Channel, signal_table
from agribot.ui.server.languages import say_in
from agribot.ui.server.window import LEAST_BYTES, Window

STATES_KEPT = 4  # states in a queue; older ones are worth nothing
DIRECT_KEPT = 100
# Limits of one message, over a line of unknown speed; each is about two kilobytes, so that an
# answer to a ping waits a fraction of a second behind it on a line of 8 kB a second.
POINTS, WEEDS, EVENTS = 100, 25, 15
MOST_PARTS = 16  # factor of the limits over a quick line


class Client:
    """A slow page loses its oldest states and nothing else.

    What grows is read from the channel where there is room for it, so that a page that is far
    behind gets it in a few pieces, with the newest states between them.
    """

    def __init__(
        self, channel: Channel, window: Window | None = None, language: str = "en"
    ) -> None:
        self.language = language
        self.dropped = 0
        self.window = window or Window(is_acknowledged=False)
        self._direct: deque[str] = deque(maxlen=DIRECT_KEPT)
        self._ready = asyncio.Event()
        self.follow(channel)

    def follow(self, channel: Channel) -> None:
        """Follow another channel, from its beginning."""
        self.channel = channel
        self._states: deque[str] = deque(maxlen=STATES_KEPT)
        if channel.state is not None:
            self._states.append(channel.write_state(self.language))
        self._is_opened = False
        self._traced = self._events = self._pathed = 0
        self._path_revision = -1
        self._receiver: wire.ReceiverState | None = None
        self._weeds = dict.fromkeys(channel.weeds)
        self._is_state_next = False
        self.wake()

    def send(self, message: wire.ServerMessage) -> None:
        """For this page alone, such as an answer."""
        self._direct.append(self._write(message))
        self.wake()

    def add_state(self, text: str) -> None:
        self.dropped += len(self._states) == STATES_KEPT
        self._states.append(text)
        self.wake()

    def change_weeds(self, ids: list[int]) -> None:
        """Those that are new, different or gone."""
        self._weeds.update(dict.fromkeys(ids))

    def wake(self) -> None:
        self._ready.set()

    async def next(self) -> str:
        """Choose the next text to send: answers, then the channel's growth and states in turn."""
        while True:
            text = self.take()
            if text is not None:
                return text
            self._ready.clear()
            await self._ready.wait()

    def take(self) -> str | None:
        """Choose the next text where one may be sent now."""
        if self._direct:
            return self._direct.popleft()
        if not self.window.has_room:
            return None
        if self._is_state_next and self._states:
            self._is_state_next = False
            return self._states.popleft()
        growth = self._take_growth()
        if growth is not None:
            self._is_state_next = True
            return self._write(growth)
        return self._states.popleft() if self._states else None

    def _write(self, message: wire.ServerMessage) -> str:
        return wire.encode(say_in(self.language, message)).decode()

    def _take_growth(self) -> wire.Snapshot | wire.Growth | None:
        """Collect what is new since the last time, as much as one message takes."""
        channel = self.channel
        if not self._is_opened:
            self._is_opened = True
            return self._opening()
        if self._traced != len(channel.trace_map_m):
            return self._trace()
        path_points = len(channel.path.points_map_m)
        if self._path_revision != channel.path_revision or self._pathed < path_points:
            return self._path()
        if self._receiver is not channel.receiver:
            self._receiver = channel.receiver
            return self._receiver
        return self._take_changes()

    def _take_changes(self) -> wire.WeedChanges | wire.NewEvents | None:
        if self._weeds:
            return self._weed_changes()
        return self._new_events() if self._events < self.channel.event_count else None

    def _opening(self) -> wire.Snapshot:
        channel = self.channel
        return wire.Snapshot(
            epoch=channel.epoch,
            source=channel.source,
            name=channel.name,
            signals=signal_table(),
            trace=self._trace(),
            path=self._path(),
            weeds=self._weed_changes(),
            events=self._new_events(),
        )

    @property
    def _parts(self) -> int:
        return min(self.window.size_bytes // LEAST_BYTES, MOST_PARTS)

    def _trace(self) -> wire.TracePiece:
        channel = self.channel
        first = min(self._traced, len(channel.trace_map_m))
        points = channel.trace_map_m[first : first + POINTS * self._parts]
        self._traced = first + len(points)
        return wire.TracePiece(epoch=channel.epoch, first=first, points_map_m=points)

    def _path(self) -> wire.PathPiece:
        channel = self.channel
        if self._path_revision != channel.path_revision:
            self._path_revision, self._pathed = channel.path_revision, 0
        first = self._pathed
        piece = slice(first, first + POINTS * self._parts)
        points, rows = channel.path.points_map_m[piece], channel.path.rows[piece]
        self._pathed += len(points)
        return wire.PathPiece(epoch=channel.epoch, first=first, points_map_m=points, rows=rows)

    def _weed_changes(self) -> wire.WeedChanges:
        ids = list(itertools.islice(self._weeds, WEEDS * self._parts))
        for id in ids:
            del self._weeds[id]
        channel = self.channel
        return wire.WeedChanges(
            epoch=channel.epoch,
            set=[channel.weeds[id] for id in ids if id in channel.weeds],
            gone=[id for id in ids if id not in channel.weeds],
        )

    def _new_events(self) -> wire.NewEvents:
        """Collect the oldest that are kept and were not sent yet."""
        channel = self.channel
        oldest = channel.event_count - len(channel.events)
        first = max(self._events, oldest)
        self._events = min(first + EVENTS * self._parts, channel.event_count)
        events = list(itertools.islice(channel.events, first - oldest, self._events - oldest))
        return wire.NewEvents(epoch=channel.epoch, events=events)
