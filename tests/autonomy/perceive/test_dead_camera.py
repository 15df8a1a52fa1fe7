"""A camera that shows nothing is no evidence."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.config import PerceptionConfig
from agribot.core.messages import CameraFrame
from agribot.description.loader import load_robot


@pytest.mark.parametrize("value", [0, 255], ids=["black", "white"])
def test_a_picture_without_anything_in_it_shows_no_plant_and_no_row(value: int) -> None:
    robot, settings = load_robot("agribot"), PerceptionConfig()
    assert robot.camera is not None
    segmenter = Segmenter(settings.model)
    ground = GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, settings.max_range_m
    )
    shape = (robot.camera.height_px, robot.camera.width_px, 3)
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=np.full(shape, value, dtype=np.uint8))
    scene = observe(frame, segmenter.segment(frame.image_rgb), ground, settings, 1.2)
    assert scene.plants == ()
    assert scene.row_line is None
