"""Camera frames at their rate, and the true masks of the last ones for the referee."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

import numpy as np

from agribot.geo import LINK_FROM_OPTICAL
from agribot.messages import ByteArray, CameraFrame, FloatArray
from agribot.robot import CameraSpec, RobotSpec
from agribot.sim.attitude import map_from_base
from agribot.world import WorldSpec

if TYPE_CHECKING:
    from agribot.sim.camera import CameraRenderer

KEPT_MASKS = 20


class CameraFeed:
    """`noise` is the stream of the per-frame noise seeds, or None for clean images."""

    def __init__(
        self,
        robot: RobotSpec,
        camera: CameraSpec,
        world: WorldSpec,
        noise: np.random.Generator | None,
    ) -> None:
        # Compiling the renderer takes seconds; runs without a camera must not pay for it.
        from agribot.sim.camera import CameraRenderer

        self._renderer: CameraRenderer = CameraRenderer(world)
        self._camera = camera
        self._base_from_camera = robot.base_from_link(camera.link) @ LINK_FROM_OPTICAL
        self._noise = noise
        self._index = 0
        self._masks: OrderedDict[int, ByteArray] = OrderedDict()

    def sample(self, t_s: float, row: FloatArray) -> CameraFrame:
        """Render the view from one row of the physics history."""
        map_from_camera = map_from_base(row) @ self._base_from_camera
        seed = None if self._noise is None else int(self._noise.integers(2**31))
        picture = self._renderer.render(map_from_camera, self._camera, noise_seed=seed)
        frame = CameraFrame(t_s=t_s, index=self._index, image_rgb=picture.image_rgb)
        self._masks[self._index] = picture.class_id
        if len(self._masks) > KEPT_MASKS:
            self._masks.popitem(last=False)
        self._index += 1
        return frame

    def truth_mask(self, frame_index: int) -> ByteArray | None:
        """True class ids of a recent frame, (height, width); None when it is too old."""
        return self._masks.get(frame_index)
