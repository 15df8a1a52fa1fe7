"""Render what the robot's camera sees and let the network find crop and weeds.

python examples/02_see_a_frame.py frame.png
"""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.geo import transform
from agribot.core.messages import PlantClass
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.camera import CameraRenderer

COLOURS = {PlantClass.WEED: (230, 40, 40), PlantClass.CROP: (40, 200, 60)}


def main(out: str) -> None:
    robot, world = load_robot(), load_world("Farm", seed=1)
    assert robot.camera is not None
    map_from_body = transform((1.0, 5.4, 0.0), (0.0, 0.0, np.pi / 2))
    frame = CameraRenderer(world).render(
        map_from_body @ robot.body_from_camera(), robot.camera, noise_seed=1
    )
    found = Segmenter("agribot-sim").segment(frame.image_rgb).class_id
    painted = frame.image_rgb.copy()
    size = (robot.camera.width_px, robot.camera.height_px)
    mask = np.asarray(Image.fromarray(found).resize(size, Image.Resampling.NEAREST))
    for plant, colour in COLOURS.items():
        here = mask == plant
        painted[here] = (0.4 * painted[here] + 0.6 * np.array(colour)).astype(np.uint8)
    Image.fromarray(np.hstack([frame.image_rgb, painted])).save(out)
    sys.stdout.write(f"{out}\n")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "frame.png")
