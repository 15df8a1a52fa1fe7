"""The look that the network was trained on: it must not drift unnoticed.

`python -m tests.sim.camera.test_camera_look` writes the kept values again; do so only together
with newly trained weights.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import GroundTile
from agribot.description.loader import load_robot
from agribot.sim.camera import CameraRenderer
from tests.sim.camera.camera_scenes import plant, world

KEPT = Path(__file__).with_name("neutral_look.csv")
CROPS = ("sugar_beet", "maize", "lettuce")
WEEDS = ("grass", "goosefoot", "thistle", "amaranth")
BLOCK_PX = 40


def _block_means() -> FloatArray:
    """Mean red, green, blue, weed share and crop share of blocks of the rover's view, (192, 5)."""
    robot = load_robot()
    assert robot.camera is not None
    plants = [
        plant(0.5 + 0.22 * (k // 3), 0.25 * (k % 3) - 0.25, CROPS[k % 3], size_m=0.15, seed=k)
        for k in range(12)
    ] + [
        plant(0.6 + 0.2 * (k // 4), 0.2 * (k % 4) - 0.35, WEEDS[k % 4], size_m=0.07, seed=k,
              kind=PlantClass.WEED)
        for k in range(16)
    ]  # fmt: skip
    surfaces = (("grass", 0.45, 9.0), ("pavement", -0.8, -0.45), ("gravel", -9.0, -0.8))
    tiles = [
        GroundTile(surface=name, x_min_m=-9.0, x_max_m=9.0, y_min_m=low, y_max_m=high)
        for name, low, high in surfaces
    ]
    renderer = CameraRenderer(world(*plants, ground=tuple(tiles)))
    view = transform((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(3.0))) @ robot.body_from_camera()
    drawn = renderer.render(view, robot.camera, noise_seed=None)
    planes = np.dstack(
        [drawn.image_rgb, *(drawn.class_id == kind for kind in (PlantClass.WEED, PlantClass.CROP))]
    )
    height, width = planes.shape[0] // BLOCK_PX, planes.shape[1] // BLOCK_PX
    blocks = planes.reshape(height, BLOCK_PX, width, BLOCK_PX, 5).astype(float)
    means: FloatArray = blocks.mean(axis=(1, 3)).reshape(-1, 5)
    return means


def test_the_neutral_look_is_the_one_that_the_weights_were_trained_on() -> None:
    means, kept = _block_means(), np.loadtxt(KEPT, delimiter=",")
    assert means[:, 3].sum() > 1.0
    assert means[:, 4].sum() > 5.0
    np.testing.assert_allclose(means[:, :3], kept[:, :3], atol=0.3)
    np.testing.assert_allclose(means[:, 3:], kept[:, 3:], atol=0.003)


if __name__ == "__main__":
    np.savetxt(KEPT, _block_means(), fmt="%.4f", delimiter=",")
