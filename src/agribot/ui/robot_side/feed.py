"""The robot's feed of the page's server: newest state first, never held up by a slow page.

The control loop only leaves its newest record here. A separate thread sends to the server, at
its own pace: states by their newest value, everything that grows (trace, events, weeds) by what
is new since the last time. A server that stalls therefore loses old states and nothing else.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Protocol

import msgspec

from agribot.autonomy.weeds.track import Track
from agribot.core.messages import ByteArray, CameraFrame, Path, PlantClass, TickRecord
from agribot.record.events import Event
from agribot.ui import wire
from agribot.ui.view import RunView, shown_event, shown_weed, thin_path

STATE_HZ = 30.0
RECEIVER_EVERY = 30  # states between two looks at the GNSS receiver's status
SLOW_EVERY = 10  # states between two looks at weeds, events and path
TRACE_CHUNK = 2000


class FeedSource(Protocol):
    """The parts of a session that a page shows besides its ticks."""

    def path(self) -> Path | None: ...

    def weeds(self) -> list[Track]: ...

    def events_since(self, index: int) -> list[Event]: ...

    def recording(self) -> str: ...

    def calibration(self) -> wire.CalibrationProgress | None: ...


class Feed:
    """`send` takes one encoded message and may block; raises OSError once the other end closed."""

    def __init__(self, view: RunView, source: FeedSource, send: Callable[[bytes], None]) -> None:
        self._view, self._source, self._send = view, source, send
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ui-feed", daemon=True)
        self._changes = Changes(source)
        self._traced = 0
        self._sent_ticks = -1
        self._receiver: wire.ReceiverState | None = None
        self._tick_mono_s = 0.0
        self._pace = Pace()

    def start(self) -> None:
        self._thread.start()

    def __call__(self, record: TickRecord) -> None:
        self._view(record)
        self._tick_mono_s = time.monotonic()

    def close(self) -> bool:
        """Send the last state; False when the server does not take it."""
        self._ended.set()
        self._thread.join(timeout=1.0)
        return not self._thread.is_alive()

    def _run(self) -> None:
        period_s, number = 1.0 / STATE_HZ, 0
        next_s = time.monotonic()
        try:
            while not self._ended.is_set():
                self._send_changes(number)
                number += 1
                next_s = max(next_s + period_s, time.monotonic() - period_s)
                self._ended.wait(max(0.0, next_s - time.monotonic()))
            self._send_changes(0)
        except OSError:
            return  # the server is gone; the link notices by itself

    def _send_changes(self, number: int) -> None:
        view = self._view
        if view.ticks != self._sent_ticks:
            self._sent_ticks = view.ticks
            state = view.state()
            if state is not None:
                self._put(self._complete(state))
        self._send_trace()
        if number % SLOW_EVERY == 0:
            for message in self._changes.messages():
                self._put(message)
            self._put(self._counts())
        if number % RECEIVER_EVERY == 0 and view.record is not None:
            self._send_receiver()

    def _complete(self, state: wire.State) -> wire.State:
        """With what a view alone cannot know."""
        return msgspec.structs.replace(
            state,
            mono_ms=round(self._tick_mono_s * 1e3, 1),
            pace_ratio=self._pace.ratio(state.t_s, time.monotonic()),
            weed_count=self._changes.weed_count,
            recording=self._source.recording(),
            calibration=self._source.calibration(),
        )

    def _counts(self) -> wire.TickCounts:
        record = self._view.record
        return wire.TickCounts(
            wall_s=time.time(),
            t_s=record.batch.t_s if record else 0.0,
            cpu_s=time.process_time(),
            samples={**self._view.topics, "ticks": self._view.ticks},
        )

    def _send_trace(self) -> None:
        trace = self._view.trace_map_m
        while self._traced < len(trace):
            chunk = trace[self._traced : self._traced + TRACE_CHUNK]
            self._put(wire.TracePiece(first=self._traced, points_map_m=chunk))
            self._traced += len(chunk)

    def _send_receiver(self) -> None:
        receiver = self._view.receiver.show()
        if receiver != self._receiver:
            self._receiver = receiver
            self._put(receiver)

    def _put(self, message: wire.RobotMessage) -> None:
        self._send(wire.encode(message))


class Changes:
    """What is new in the weed map, the events and the path since it was last asked."""

    def __init__(self, source: FeedSource) -> None:
        self._source = source
        self._known: dict[int, wire.Weed] = {}
        self._events = 0
        self._path: Path | None = None
        self.weed_count = 0

    def messages(self) -> list[wire.Growth]:
        messages: list[wire.Growth] = []
        path = self._source.path()
        if path is not None and path is not self._path:
            self._path = path
            messages.append(thin_path(path))
        events = self._source.events_since(self._events)
        if events:
            self._events += len(events)
            messages.append(wire.NewEvents(events=[shown_event(event) for event in events]))
        weeds = self._weeds()
        return [*messages, weeds] if weeds else messages

    def _weeds(self) -> wire.WeedChanges | None:
        weeds = {track.id: shown_weed(track) for track in self._source.weeds()}
        changed = [weed for id, weed in weeds.items() if self._known.get(id) != weed]
        gone = [id for id in self._known if id not in weeds]
        if not changed and not gone:
            return None
        self._known = weeds
        self.weed_count = sum(weed.plant == PlantClass.WEED for weed in weeds.values())
        return wire.WeedChanges(set=changed, gone=gone)


class Pace:
    """How fast simulated time goes by, over the last second or so."""

    def __init__(self) -> None:
        self._from: tuple[float, float] | None = None
        self._ratio: float | None = None

    def ratio(self, t_s: float, wall_s: float) -> float | None:
        if self._from is None or t_s < self._from[0]:
            self._from = (t_s, wall_s)
        elif wall_s - self._from[1] >= 1.0:
            self._ratio = round((t_s - self._from[0]) / (wall_s - self._from[1]), 2)
            self._from = (t_s, wall_s)
        return self._ratio


class CameraFeed:
    """Newest frame and newest class mask to the server, while somebody watches.

    A message is a `wire.PIXELS_HEAD`, then the pixels.
    """

    def __init__(self, link: Connection) -> None:
        self._link = link
        self._newest: dict[int, tuple[int, float, ByteArray]] = {}
        self._wall_ms: dict[int, float] = {}
        self._wake = threading.Event()
        self._ended = False
        self.is_watched = self.is_mask_watched = False
        self._thread = threading.Thread(target=self._run, name="ui-camera", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def __call__(self, record: TickRecord) -> None:
        frames: tuple[CameraFrame, ...] = record.batch.frames
        if self.is_watched and frames:
            frame, wall_ms = frames[-1], time.time() * 1e3
            self._wall_ms = {**dict(list(self._wall_ms.items())[-20:]), frame.index: wall_ms}
            self._offer(0, frame.index, wall_ms, frame.image_rgb)

    def mask(self, frame_index: int, class_id: ByteArray) -> None:
        """Take a mask, in the network's thread."""
        if self.is_watched and self.is_mask_watched:
            wall_ms = self._wall_ms.get(frame_index, time.time() * 1e3)
            self._offer(1, frame_index, wall_ms, class_id)

    def close(self) -> bool:
        self._ended = True
        self._wake.set()
        self._thread.join(timeout=1.0)
        return not self._thread.is_alive()

    def _offer(self, kind: int, index: int, wall_ms: float, pixels: ByteArray) -> None:
        self._newest[kind] = (index, wall_ms, pixels)
        self._wake.set()

    def _run(self) -> None:
        try:
            while not self._ended:
                self._wake.wait()
                self._wake.clear()
                for kind in (0, 1):
                    picture = self._newest.pop(kind, None)
                    if picture is not None:
                        self._link.send_bytes(pack_pixels(kind, *picture))
        except OSError:
            return


def pack_pixels(kind: int, index: int, wall_ms: float, pixels: ByteArray) -> bytes:
    height, width = pixels.shape[:2]
    return wire.PIXELS_HEAD.pack(kind, index, wall_ms, height, width) + pixels.tobytes()
