"""Frames for a network: the newest of a camera that is faster, every one or every Nth of a file."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from agribot.core.errors import AgribotError, PerceptionError
from agribot.core.messages import ByteArray

LOOK_S = 0.2  # period of a look for an interruption by the user


class FrameSource(Protocol):
    """`read` blocks for the next frame (height, width, 3); None at the end of the source.

    `stop` lets a `read` in another thread end, where that can be; `close` comes after it.

    `ends`: an end is normal, as of a file, and not a camera that stopped.
    `is_file`: its frames wait until they are read; those of a camera go by.
    """

    name: str
    ends: bool
    is_file: bool

    def read(self) -> ByteArray | None: ...

    def explain_silence(self) -> str:
        """Say why no picture comes, as far as it is known, and what to do."""
        ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


class TimedFrame(NamedTuple):
    captured_s: float  # time.monotonic()
    image_rgb: ByteArray


class Frames(Protocol):
    """Frames of a source; how many it gave, and how many of them a newer one replaced."""

    captured: int
    dropped: int

    def __iter__(self) -> Iterator[TimedFrame]: ...


class EveryFrame:
    """Every frame of a file, or every Nth from the first, read when it is asked for.

    Iterating ends with the file, or after `seconds`.
    """

    dropped = 0

    def __init__(self, source: FrameSource, every: int = 1, seconds: float | None = None) -> None:
        self.captured = 0
        self._source, self._every, self._seconds = source, every, seconds

    def __iter__(self) -> Iterator[TimedFrame]:
        end_s = time.monotonic() + self._seconds if self._seconds else float("inf")
        try:
            while time.monotonic() < end_s and (image_rgb := self._source.read()) is not None:
                is_taken = self.captured % self._every == 0
                self.captured += 1
                if is_taken:
                    yield TimedFrame(time.monotonic(), image_rgb)
        finally:
            self._source.stop()
            self._source.close()


class NewestFrame:
    """A thread that reads a source and hands out the newest frame.

    Iterating ends with the source, after `seconds`, or when `stop` is called. It raises
    PerceptionError where a camera gives no frame for `patience_s` or stops.
    """

    def __init__(
        self,
        source: FrameSource,
        patience_s: float = 5.0,
        seconds: float | None = None,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """`is_stopped` ends the iteration as `stop` does; it is looked at while no frame comes."""
        self.captured = self.dropped = 0
        self._is_stopped = is_stopped
        self._source = source
        self._patience_s = patience_s
        self._seconds = seconds
        self._changed = threading.Condition()
        self._waiting: TimedFrame | None = None
        self._ended = False
        self._stopped = False
        self._fault: AgribotError | None = None
        # A camera driver that hangs must not keep the program from ending.
        self._thread = threading.Thread(target=self._capture, name="camera", daemon=True)

    def __iter__(self) -> Iterator[TimedFrame]:
        end_s = time.monotonic() + self._seconds if self._seconds else float("inf")
        self._thread.start()
        try:
            while time.monotonic() < end_s:
                frame = self._take(min(end_s, time.monotonic() + self._patience_s), end_s)
                if frame is None:
                    return
                yield frame
        finally:
            self.stop()

    def stop(self) -> None:
        self._stopped = True
        self._source.stop()
        self._thread.join(timeout=2.0)
        if not self._thread.is_alive():
            self._source.close()

    def _take(self, until_s: float, end_s: float) -> TimedFrame | None:
        with self._changed:
            while self._waiting is None and not self._ended:
                left_s = until_s - time.monotonic()
                if self._is_stopped():
                    return None
                if left_s <= 0.0:
                    if until_s >= end_s:
                        return None
                    raise PerceptionError(
                        f"{self._source.name}: no frame for {self._patience_s:.1f} s after "
                        f"{self.captured} frames; {self._source.explain_silence()}"
                    )
                self._changed.wait(min(left_s, LOOK_S))
            frame, self._waiting = self._waiting, None
        if frame is not None:
            return frame
        if self._fault is not None:
            raise self._fault
        if not self._source.ends and not self._stopped:
            raise PerceptionError(
                f"{self._source.name}: stopped after {self.captured} frames; "
                f"{self._source.explain_silence()}, then start again"
            )
        return None

    def _capture(self) -> None:
        try:
            while not self._stopped:
                image_rgb = self._source.read()
                if image_rgb is None:
                    break
                self._offer(TimedFrame(time.monotonic(), image_rgb))
        except AgribotError as error:
            self._fault = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _offer(self, frame: TimedFrame) -> None:
        with self._changed:
            self.captured += 1
            self.dropped += self._waiting is not None
            self._waiting = frame
            self._changed.notify_all()
