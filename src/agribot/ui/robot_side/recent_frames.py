"""The camera's last frames, where each was taken and what the network made of it."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

from agribot.core.messages import ByteArray, CameraFrame, Estimate, TickRecord

KEPT = 16  # number of frames: longer than a network takes, and some MB


class SeenFrame(NamedTuple):
    """`estimate` is of the tick that brought the frame; `class_id` of the network's own size."""

    frame: CameraFrame
    estimate: Estimate
    class_id: ByteArray


class RecentFrames:
    """A tap that keeps references and copies nothing; asked by other threads."""

    def __init__(self) -> None:
        self._frames: dict[int, tuple[CameraFrame, Estimate]] = {}
        self._masks: dict[int, ByteArray] = {}
        self._lock = threading.Lock()

    def __call__(self, record: TickRecord) -> None:
        with self._lock:
            for frame in record.batch.frames:
                self._frames[frame.index] = (frame, record.estimate)
                _forget_old(self._frames)

    def mask(self, frame_index: int, class_id: ByteArray) -> None:
        """Take a mask in the network's thread, perhaps before the tick of its frame ends."""
        with self._lock:
            self._masks[frame_index] = class_id
            _forget_old(self._masks)

    def newest(self) -> SeenFrame | None:
        """Return the newest frame that the network has seen."""
        with self._lock:
            index = max(self._frames.keys() & self._masks.keys(), default=None)
            return None if index is None else SeenFrame(*self._frames[index], self._masks[index])

    def of(self, index: int) -> SeenFrame | None:
        """Find a frame and its mask, as long as it is kept."""
        with self._lock:
            known = self._frames.get(index), self._masks.get(index)
            if known[0] is None or known[1] is None:
                return None
            return SeenFrame(*known[0], known[1])


def _forget_old(kept: dict[int, Any]) -> None:
    while len(kept) > KEPT:
        del kept[next(iter(kept))]
