"""Sources of `agribot live`: the simulator, a video file, a camera, a topic of ROS."""

from __future__ import annotations

import argparse
import math
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from agribot.cli.data.videos import open_capture
from agribot.cli.standard_error import print_line
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, CameraFrame

SIM_SPEED_MPS = 0.5
TOPICS = ("ros1:", "ros2:")
# Networks: by ROS_DOMAIN_ID and ROS_MASTER_URI, or the address in the URI.
NETWORK = {"ros_domain": None, "ros_router": None, "ros_master": None}
PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
PERIOD_S = 0.01  # period of a look for the next picture of a topic
MOST_DIGITS = 4  # digits in the number of a webcam


class SimulatedDrive:
    """The robot's camera along a crop row of the Farm world, in real time, back and forth."""

    ends, is_file = True, False

    def __init__(self, seed: int) -> None:
        from agribot.core.config import load
        from agribot.description.loader import load_robot
        from agribot.description.worlds_sdf import load_world
        from agribot.sim.camera.renderer import CameraRenderer

        self.name = "simulator"
        robot = load_robot()
        camera = robot.camera
        assert camera is not None  # body_from_camera() looks
        self._body_from_camera, self._camera = robot.body_from_camera(), camera
        self._renderer = CameraRenderer(load_world("Farm", seed=seed), threads=1)
        self._field = load("farm").field
        self._rng = np.random.default_rng(seed)
        self._frame = 0
        self._start_s = time.monotonic()

    def read(self) -> ByteArray:
        """Render the next frame, (H, W, 3)."""
        from agribot.core.geo import transform

        due_s = self._frame / self._camera.rate_hz
        late_s = time.monotonic() - self._start_s - due_s
        if late_s < 0.0:
            time.sleep(-late_s)
        elif late_s > 1.0:  # a machine too slow for the camera's rate drives slower
            self._start_s += late_s
        self._frame += 1
        yaw_rad = math.radians(self._field.row_yaw_deg)
        along_m = SIM_SPEED_MPS * due_s
        length_m = self._field.row_length_m
        along_m = abs((along_m + length_m) % (2.0 * length_m) - length_m)
        x_m, y_m = self._field.first_row_start_map_m
        x_m += along_m * math.cos(yaw_rad)
        y_m += along_m * math.sin(yaw_rad)
        map_from_body = transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad))
        drawn = self._renderer.render(
            map_from_body @ self._body_from_camera,
            self._camera,
            noise_seed=int(self._rng.integers(2**31)),
        )
        return drawn.image_rgb

    def explain_silence(self) -> str:
        return "the machine is busy; wait longer with --patience"

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


class TopicFrames:
    """The pictures of a topic of ROS 1 or 2, of any size."""

    ends, is_file = False, False

    def __init__(self, uri: str) -> None:
        """Subscribe to the topic. Raises: AgribotError: no topic, or no network."""
        from agribot.cli.run.sensor_sources import source_context
        from agribot.description.loader import load_robot
        from agribot.drivers.line.schemes import read_uri, require_extras
        from agribot.drivers.ros_topics import list_topics, open_pictures

        if not urlsplit(uri).path.strip("/"):
            raise ConfigError(
                f"{uri} names no topic; write ros1:/image_raw or ros2://HOST:PORT/image_raw"
            )
        place, network = read_uri("source", uri), argparse.Namespace(**NETWORK)
        require_extras({"camera": place})
        self.name = uri
        self._start_s = time.monotonic()
        self._waiting: deque[ByteArray] = deque()
        self._is_closed = False
        self._refused = ""
        self._context = source_context(load_robot(), network, self._refuse)
        self._topic = open_pictures(place, self._context)
        self._list_topics: Callable[[], dict[str, str]] = partial(list_topics, place, self._context)

    def read(self) -> ByteArray | None:
        """Wait for the next picture, (H, W, 3)."""
        while not self._waiting and not self._is_closed:
            frames = self._topic.take(time.monotonic() - self._start_s)
            self._waiting += [f.image_rgb for f in frames if isinstance(f, CameraFrame)]
            if not frames:
                time.sleep(PERIOD_S)
        return self._waiting.popleft() if self._waiting else None

    def explain_silence(self) -> str:
        """Name what is refused, or the topics that have pictures if no node publishes this one.

        Raises: BridgeError: the network is gone.
        """
        if self._refused:
            return f"what comes cannot be shown: {self._refused}; take another topic"
        found = self._list_topics()
        if self._topic.name in found:
            return (
                f"{found[self._topic.name]} is published there, but no picture comes; look whether "
                "its node still runs and its camera delivers"
            )
        others = sorted(name for name, kind in found.items() if kind in PICTURES)
        named = f"topics with pictures: {', '.join(others)}" if others else "nor any other picture"
        return f"no node publishes it, {named}; start the camera's node, or name another topic"

    def stop(self) -> None:
        """Let a thread that waits in `read` end."""
        self._is_closed = True

    def close(self) -> None:
        self._context.__exit__()

    def _refuse(self, reason: str) -> None:
        """Print each reason once, not with every picture of a camera."""
        if reason != self._refused:
            self._refused = reason
            print_line(f"agribot live: {reason}")


class Capture:
    """OpenCV's reader of a file or a camera."""

    def __init__(self, source: str) -> None:
        """Open it. Raises: ConfigError: there is no such file or camera."""
        if source.startswith("/") and not Path(source).exists():
            raise ConfigError(
                f"{source} does not exist; check the path, or of a topic write ros1:{source} or "
                f"ros2:{source}"
            )
        self.name = source
        self.ends = self.is_file = Path(source).is_file()
        is_number = source.isascii() and source.isdigit() and len(source) <= MOST_DIGITS
        self._capture = open_capture(int(source) if is_number else source)

    def read(self) -> ByteArray | None:
        """Read the next frame, (H, W, 3); None at the end."""
        good, frame_bgr = self._capture.read()
        return np.ascontiguousarray(frame_bgr[..., ::-1]) if good else None

    def explain_silence(self) -> str:
        return "check the camera and its cable"

    def stop(self) -> None:
        pass

    def close(self) -> None:
        self._capture.release()
