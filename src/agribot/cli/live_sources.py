"""Sources of `agribot live`: the simulator, a video file, a webcam, a network camera."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np

from agribot.cli.videos import open_capture
from agribot.core.messages import ByteArray

SIM_SPEED_MPS = 0.5
MOST_DIGITS = 4  # of the number of a webcam


class SimulatedDrive:
    """The robot's camera along a crop row of the Farm world, in real time, back and forth."""

    ends = True

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

    def close(self) -> None:
        pass


class Capture:
    """OpenCV's reader: a file at its own frame rate, or a camera as fast as it gives frames."""

    def __init__(self, source: str) -> None:
        self.name = source
        self.ends = Path(source).is_file()
        is_number = source.isascii() and source.isdigit() and len(source) <= MOST_DIGITS
        self._capture = open_capture(int(source) if is_number else source)
        rate_hz = self._capture.get(5)  # cv2.CAP_PROP_FPS
        self._period_s = 1.0 / rate_hz if self.ends and rate_hz > 0.0 else 0.0
        self._due_s = time.monotonic()

    def read(self) -> ByteArray | None:
        """Read the next frame, (H, W, 3); None at the end."""
        if self._period_s:
            self._due_s = max(self._due_s + self._period_s, time.monotonic() - 1.0)
            time.sleep(max(0.0, self._due_s - time.monotonic()))
        good, frame_bgr = self._capture.read()
        return np.ascontiguousarray(frame_bgr[..., ::-1]) if good else None

    def close(self) -> None:
        self._capture.release()
