"""Cameras of a real robot: `camera=v4l2:/dev/video0`, `video:FILE`, `rtsp://HOST/PATH`, `pipe:...`.

A thread grabs pictures and hands on the newest ones with the time of their arrival; a camera that
is lost is opened again, ever more rarely. The control loop never waits for it.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol
from urllib.parse import urlsplit

import numpy as np

from agribot.core import extras
from agribot.core.errors import ConfigError, add_advice
from agribot.core.messages import ByteArray, CameraFrame
from agribot.core.platform import Sensor
from agribot.core.stamp_clock import SampleQueue
from agribot.drivers.line.byte_streams import FIRST_WAIT_S, LONGEST_WAIT_S
from agribot.drivers.line.clock_watch import ClockWatch
from agribot.drivers.line.schemes import SourceContext, SourceUri
from agribot.drivers.line.uri_options import UriOptions

MOST_WAITING = 4  # pictures not yet taken; a loop that stands still keeps no more
CLOSING_S = 2.0  # a driver that hangs keeps no program from ending
# Least time from the middle of the exposure until the picture is there.
LATENCY_S = {"v4l2": 0.05, "rtsp": 0.2, "video": 0.0, "pipe": 0.05}
PIPE_ERROR_CHARS = 200
# Time for the last output of a program that ended; one that it started may hold its error output
# open.
LAST_WORDS_S = 2.0
SAME_ASPECT = 0.01


class Grabber(Protocol):
    """An open camera. Raises: OSError: it broke, or its pictures ended."""

    def read(self) -> ByteArray:
        """Wait for the next picture, (height, width, 3) uint8, red green blue."""
        ...

    def close(self) -> None: ...


class OpenCvGrabber:
    """Whatever OpenCV opens; pictures of another size are fitted to `size_px`, width and height."""

    def __init__(
        self, source: str, size_px: tuple[int, int], settings: tuple[tuple[str, float], ...] = (),
        *, is_file: bool = False,
    ) -> None:  # fmt: skip
        """Open it.

        Raises: OSError: it cannot be opened.
        """
        os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
        import cv2

        self._cv2: Any = cv2
        self._size_px = size_px
        self._capture = cv2.VideoCapture(source)
        for name, value in settings:
            self._capture.set(getattr(cv2, name), value)
        if not self._capture.isOpened():
            raise OSError("cannot be opened; check path, address and who else uses it")
        rate_hz = self._capture.get(cv2.CAP_PROP_FPS) if is_file else 0.0
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else 0.0
        self._due_s = time.monotonic()

    def read(self) -> ByteArray:
        if self._period_s:  # a file at its own pace
            self._due_s = max(self._due_s + self._period_s, time.monotonic() - 1.0)
            time.sleep(max(0.0, self._due_s - time.monotonic()))
        is_good, picture_bgr = self._capture.read()
        if not is_good:
            raise OSError("no more pictures")
        return self._fit(picture_bgr)

    def close(self) -> None:
        self._capture.release()

    def _fit(self, picture_bgr: Any) -> ByteArray:
        height, width = picture_bgr.shape[:2]
        wanted_width, wanted_height = self._size_px
        if (width, height) != self._size_px:
            if abs(width * wanted_height / (height * wanted_width) - 1.0) > SAME_ASPECT:
                raise OSError(
                    f"its pictures have {width} x {height} pixels, the robot's camera "
                    f"{wanted_width} x {wanted_height}; set the camera, or the description"
                )
            picture_bgr = self._cv2.resize(
                picture_bgr, self._size_px, interpolation=self._cv2.INTER_AREA
            )
        return np.ascontiguousarray(picture_bgr[..., ::-1])


class PipeGrabber:
    """A program that writes raw pictures to its output: red, green and blue bytes, top row first.

    For example gst-launch-1.0 with `fdsink`, ffmpeg with `-f rawvideo -pix_fmt rgb24 -`.
    """

    def __init__(self, command: str, size_px: tuple[int, int]) -> None:
        """Start it.

        Raises: OSError: there is no such program.
        """
        self._size_px = size_px
        self._program = subprocess.Popen(
            shlex.split(command), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )  # fmt: skip
        self._said = b""
        self._listener = threading.Thread(
            target=self._listen, name="hears a camera's program", daemon=True
        )
        self._listener.start()

    def read(self) -> ByteArray:
        width, height = self._size_px
        assert self._program.stdout is not None
        data = self._program.stdout.read(width * height * 3)
        if len(data) < width * height * 3:
            status = self._program.wait()
            self._listener.join(LAST_WORDS_S)
            said = self._said.decode(errors="replace").strip().splitlines()
            last_words = f": {said[-1]}" if said else ""
            raise OSError(f"its program ended with status {status}{last_words}")
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def close(self) -> None:
        self._program.kill()
        self._program.wait()
        for pipe in (self._program.stdout, self._program.stderr):
            if pipe is not None:
                pipe.close()

    def _listen(self) -> None:
        """Keep the end of what the program says, which must not wait for a reader."""
        pipe = self._program.stderr
        try:
            while pipe is not None and (said := os.read(pipe.fileno(), 4096)):
                self._said = (self._said + said)[-PIPE_ERROR_CHARS:]
        except (OSError, ValueError):  # closed meanwhile
            pass


class CameraSource:
    """The frames of a camera, each stamped `latency_s` before it arrived."""

    sensor: Sensor = "frames"

    def __init__(
        self, name: str, open_grabber: Callable[[], Grabber], notify: Callable[[str], None],
        latency_s: float = 0.0,
    ) -> None:  # fmt: skip
        """Open the camera and begin to grab.

        Raises: ConfigError: it cannot be opened now.
        """
        self.name = name
        self._open_grabber, self._notify = open_grabber, notify
        self._frames: SampleQueue[CameraFrame] = SampleQueue(
            latency_s=latency_s, longest=MOST_WAITING
        )
        self._clock = ClockWatch(f"camera on {name}", lambda: self._frames.uncertainty_s)
        self._index = 0
        self._ended = threading.Event()
        try:
            self._grabber: Grabber | None = open_grabber()
        except OSError as error:
            fact = f"camera from {name}: {error.strerror or error}"
            raise ConfigError(
                add_advice(fact, "check its power, its cable and who else uses it")
            ) from error
        self._thread = threading.Thread(target=self._run, name=f"grabs {name}", daemon=True)
        self._thread.start()

    def take(self, t_s: float) -> tuple[CameraFrame, ...]:
        return self._frames.take(t_s)

    def take_more(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take notes on the times of its pictures."""
        return {"notes": self._clock.update(t_s)}

    def close(self) -> None:
        """Let go of the camera. Safe to call twice."""
        self._ended.set()
        if isinstance(self._grabber, PipeGrabber):
            self._grabber.close()  # its thread waits for bytes
        self._thread.join(CLOSING_S)

    def _run(self) -> None:
        wait_s = FIRST_WAIT_S
        while not self._ended.is_set():
            grabber = self._grabber or self._open_again(wait_s)
            if grabber is None:
                wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
                continue
            try:
                image_rgb = grabber.read()
            except (OSError, ValueError) as error:  # ValueError: closed meanwhile
                self._lose(grabber, error)
                continue
            wait_s = FIRST_WAIT_S
            frame = CameraFrame(t_s=0.0, index=self._index, image_rgb=image_rgb)
            self._index += 1
            self._frames.put(0.0, self._frames.now_s(), frame)
        if self._grabber is not None:
            self._grabber.close()

    def _lose(self, grabber: Grabber, error: Exception) -> None:
        grabber.close()
        self._grabber = None
        if not self._ended.is_set():
            self._notify(f"camera from {self.name} is lost: {error}; trying again")

    def _open_again(self, wait_s: float) -> Grabber | None:
        if self._ended.wait(wait_s):
            return None
        try:
            self._grabber = self._open_grabber()
        except OSError:
            return None
        self._notify(f"camera from {self.name} is back")
        return self._grabber


def open_camera(sensor: Sensor, uri: SourceUri, context: SourceContext) -> CameraSource:
    """Open a camera; its pictures have the size of the camera in the robot's description.

    Raises: ConfigError: another sensor, a robot without camera, or one that cannot be opened.
    """
    if sensor != "frames":
        raise ConfigError(f"{sensor} from {uri.scheme}: that is a camera; use camera={uri.scheme}:")
    camera = context.robot.camera
    if camera is None:
        raise ConfigError(
            f"camera from {uri.scheme}: robot '{context.robot.name}' has no camera; add one to "
            "its description, which says where it looks"
        )
    size_px = (camera.width_px, camera.height_px)
    if uri.scheme == "pipe":
        return CameraSource(
            uri.path.split(maxsplit=1)[0], lambda: PipeGrabber(uri.path, size_px), context.refuse,
            LATENCY_S["pipe"],
        )  # fmt: skip
    extras.require("camera", f"camera={uri.scheme}: (other than camera=pipe:COMMAND)")
    if uri.scheme == "rtsp":
        parts = urlsplit(f"rtsp:{uri.path}")  # a name without the password
        return CameraSource(
            f"rtsp://{parts.hostname}{parts.path}",
            lambda: OpenCvGrabber(f"rtsp:{uri.path}", size_px, (("CAP_PROP_BUFFERSIZE", 1),)),
            context.refuse, LATENCY_S["rtsp"],
        )  # fmt: skip
    options = UriOptions(uri)
    latency_s = options.pop_number("latency_s", LATENCY_S[uri.scheme], 0.0, 2.0)
    rate_hz = options.pop_number("fps", camera.rate_hz, 0.1, 240.0)
    options.check_empty()
    settings: tuple[tuple[str, float], ...] = (
        ("CAP_PROP_FRAME_WIDTH", size_px[0]), ("CAP_PROP_FRAME_HEIGHT", size_px[1]),
        ("CAP_PROP_FPS", rate_hz), ("CAP_PROP_BUFFERSIZE", 1),
    )  # fmt: skip
    is_file = uri.scheme == "video"
    return CameraSource(
        uri.path,
        lambda: OpenCvGrabber(uri.path, size_px, () if is_file else settings, is_file=is_file),
        context.refuse, latency_s,
    )  # fmt: skip
