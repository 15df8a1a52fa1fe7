"""Camera frames of a recording: JPEG at a low rate, and with the plants found in them."""

from __future__ import annotations

import io
from collections import OrderedDict

import numpy as np
from PIL import Image, ImageDraw

from agribot.core.geo import inverse
from agribot.core.lens import distort
from agribot.core.messages import ByteArray, CameraFrame, PlantClass, Scene
from agribot.core.robot import RobotSpec

_KEPT_FRAMES = 4  # frames whose scene is still to come; latency is a few frames at most
_COLOUR = {PlantClass.WEED: (230, 40, 30), PlantClass.CROP: (60, 200, 70)}
_SLACK_S = 1e-6


class CameraLog:
    """Picks frames at `rate_hz` and draws the plants of their scenes."""

    def __init__(
        self, robot: RobotSpec, rate_hz: float, quality: int, *, keeps_raw: bool = False
    ) -> None:
        self.keeps_raw = keeps_raw
        self._period_s = 1.0 / rate_hz if rate_hz > 0 else None
        self._quality = quality
        self._next_s = 0.0
        self._frames: OrderedDict[int, ByteArray] = OrderedDict()
        self._camera = robot.camera
        self._optical_from_body = inverse(robot.body_from_camera()) if robot.camera else np.eye(4)

    def encode_image(self, frame: CameraFrame) -> bytes | None:
        """Encode the frame as JPEG, or return None if it is not due at `rate_hz`."""
        if self._period_s is None or frame.t_s < self._next_s - _SLACK_S:
            return None
        if frame.image_rgb.size == 0:  # a replayed frame has no pixels any more
            return None
        self._next_s = max(self._next_s + self._period_s, frame.t_s)
        self._frames[frame.index] = frame.image_rgb
        while len(self._frames) > _KEPT_FRAMES:
            self._frames.popitem(last=False)
        return self._encode_jpeg(Image.fromarray(frame.image_rgb))

    def encode_overlay(self, scene: Scene) -> bytes | None:
        """Encode a picked frame with its plants circled, or return None for the others."""
        pixels = self._frames.pop(scene.frame_index, None)
        if pixels is None or self._camera is None:
            return None
        image = Image.fromarray(pixels)
        draw = ImageDraw.Draw(image)
        k_px = self._camera.matrix()
        for plant in scene.plants:
            p_optical = self._optical_from_body @ (plant.x_body_m, plant.y_body_m, 0.0, 1.0)
            if p_optical[2] <= self._camera.clip_near_m:
                continue
            seen = distort(p_optical[:2] / p_optical[2], self._camera.distortion)
            u_px, v_px, _ = k_px @ (*seen, 1.0)
            radius_m = (max(plant.area_m2, 1e-4) / np.pi) ** 0.5
            radius_px = max(4.0, self._camera.focal_px * radius_m / p_optical[2])
            box = (u_px - radius_px, v_px - radius_px, u_px + radius_px, v_px + radius_px)
            draw.ellipse(box, outline=_COLOUR.get(plant.plant, (200, 200, 200)), width=2)
        return self._encode_jpeg(image)

    def _encode_jpeg(self, image: Image.Image) -> bytes:
        buffer = io.BytesIO()
        image.save(buffer, format="JPEG", quality=self._quality)
        return buffer.getvalue()
