"""From the robot to the page's server: newest state first, nothing that a slow page could hold up.

The control loop only leaves its newest record here. A thread of its own tells the server, at
its own pace: states by their newest value, everything that grows (trace, events, weeds) by what
is new since the last time. A server that stalls therefore loses old states and nothing else.
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Protocol

import msgspec
import numpy as np

from agribot.autonomy.weeds.track import Track
from agribot.core.messages import ByteArray, CameraFrame, Path, TickRecord
from agribot.record.events import Event
from agribot.ui.view import RunView, weed_row

STATE_HZ = 30.0
SLOW_EVERY = 10  # states between two looks at weeds, events and path
PATH_STEP_M = 0.05
TRACE_CHUNK = 2000
PICTURE_HEAD = struct.Struct(">BIdHH")
_LEVEL = {"fault": "fault", "stop": "warn", "hold": "warn", "limit": "warn"}

Message = dict[str, Any]


class Source(Protocol):
    """The parts of a session that a page shows besides its ticks."""

    def path(self) -> Path | None: ...

    def weeds(self) -> list[Track]: ...

    def events_since(self, index: int) -> list[Event]: ...

    def recording(self) -> str: ...

    def calibration(self) -> Message | None: ...


class Feed:
    """`send` takes one encoded message and may block; it raises OSError once nobody listens."""

    def __init__(self, view: RunView, source: Source, send: Callable[[bytes], None]) -> None:
        self._view, self._source, self._send = view, source, send
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ui-feed", daemon=True)
        self._changes = Changes(source)
        self._traced = 0
        self._told = -1
        self._tick_wall_s = self._tick_mono_s = 0.0
        self._pace = Pace()

    def start(self) -> None:
        self._thread.start()

    def __call__(self, record: TickRecord) -> None:
        self._view(record)
        self._tick_wall_s, self._tick_mono_s = time.time(), time.monotonic()

    def close(self) -> bool:
        """The last state still goes out; False when the server does not take it."""
        self._ended.set()
        self._thread.join(timeout=1.0)
        return not self._thread.is_alive()

    def _run(self) -> None:
        period_s, number = 1.0 / STATE_HZ, 0
        next_s = time.monotonic()
        try:
            while not self._ended.is_set():
                self._tell(number)
                number += 1
                next_s = max(next_s + period_s, time.monotonic() - period_s)
                self._ended.wait(max(0.0, next_s - time.monotonic()))
            self._tell(0)
        except OSError:
            return  # the server is gone; the link notices by itself

    def _tell(self, number: int) -> None:
        view = self._view
        if view.ticks != self._told:
            self._told = view.ticks
            state = view.state()
            if state is not None:
                state["wall_ms"] = round(self._tick_wall_s * 1e3, 1)
                state["mono_ms"] = round(self._tick_mono_s * 1e3, 1)
                state["rtf"] = self._pace.ratio(state["t"], time.monotonic())
                state["weeds"] = self._changes.weed_count
                state["recording"] = self._source.recording()
                state["calibration"] = self._source.calibration()
                self._put(state)
        self._tell_trace()
        if number % SLOW_EVERY == 0:
            for message in self._changes.messages():
                self._put(message)
            self._put(self._counts())

    def _counts(self) -> Message:
        record = self._view.record
        return {
            "k": "counts",
            "wall_s": time.time(),
            "t": record.batch.t_s if record else 0.0,
            "cpu_s": time.process_time(),
            "topics": dict(self._view.topics),
        }

    def _tell_trace(self) -> None:
        trace = self._view.trace_map_m
        while self._traced < len(trace):
            chunk = trace[self._traced : self._traced + TRACE_CHUNK]
            self._put({"k": "traj", "first": self._traced, "xy": chunk})
            self._traced += len(chunk)

    def _put(self, message: Message) -> None:
        self._send(msgspec.json.encode(message))


class Changes:
    """What is new in the weed map, the events and the path since it was last asked."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._rows: dict[int, list[Any]] = {}
        self._rev = 0
        self._events = 0
        self._path: Path | None = None
        self.weed_count = 0

    def messages(self) -> list[Message]:
        messages: list[Message] = []
        path = self._source.path()
        if path is not None and path is not self._path:
            self._path = path
            messages.append({"k": "path", **thinned(path)})
        for event in self._source.events_since(self._events):
            self._events += 1
            messages.append(event_message(event))
        weeds = self._weeds()
        return [*messages, weeds] if weeds else messages

    def _weeds(self) -> Message | None:
        rows = {track.id: weed_row(track) for track in self._source.weeds()}
        changed = [row for id, row in rows.items() if self._rows.get(id) != row]
        gone = [id for id in self._rows if id not in rows]
        if not changed and not gone:
            return None
        self._rows = rows
        self._rev += 1
        self.weed_count = sum(row[1] == 0 for row in rows.values())
        return {"k": "weeds", "rev": self._rev, "set": changed, "gone": gone}


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

    A message is 1 byte kind (0 image, 1 mask), 4 bytes frame index, 8 bytes wall time in ms,
    2 x 2 bytes height and width, big endian, then the pixels.
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
        """Called in the network's thread."""
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
                        self._link.send_bytes(packed(kind, *picture))
        except OSError:
            return


def packed(kind: int, index: int, wall_ms: float, pixels: ByteArray) -> bytes:
    height, width = pixels.shape[:2]
    return PICTURE_HEAD.pack(kind, index, wall_ms, height, width) + pixels.tobytes()


def thinned(path: Path) -> Message:
    """The path with a point about every 5 cm: `xy` in the map and `row` of each point."""
    step_m = float(path.s_m[-1]) / max(len(path.s_m) - 1, 1)
    every = max(1, round(PATH_STEP_M / step_m)) if step_m > 0 else 1
    keep = sorted({*range(0, len(path.s_m), every), len(path.s_m) - 1})
    return {"xy": np.round(path.xy_map_m[keep], 4).tolist(), "row": path.row[keep].tolist()}


def event_message(event: Event) -> Message:
    level = _LEVEL.get(event.kind, "info")
    text = event.reason or "no objection any more"
    return {"k": "event", "t": event.t_s, "level": level, "source": event.kind, "text": text}
