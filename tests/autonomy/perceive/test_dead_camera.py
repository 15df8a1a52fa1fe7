"""A camera that shows nothing, or no field, is no evidence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.plants import look, observe
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.config import PerceptionConfig
from agribot.core.facts import PlantsStrange
from agribot.core.messages import ByteArray, CameraFrame, Scene
from agribot.description.loader import load_robot
from tests.finding import find

SETTINGS, SHAPE = PerceptionConfig(), (480, 640)
SKIN, HAIR, WALL, SHIRT = (215, 170, 140), (70, 45, 30), (150, 160, 170), (60, 110, 60)


@pytest.fixture(scope="module")
def segmenter() -> Segmenter:
    return Segmenter(SETTINGS.model)


@pytest.fixture(scope="module")
def ground(segmenter: Segmenter) -> GroundLookup:
    robot = load_robot("agribot")
    assert robot.camera is not None
    return GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, SETTINGS.max_range_m
    )


def fill(value: int) -> ByteArray:
    return np.full((*SHAPE, 3), value, dtype=np.uint8)


def roughen(image_rgb: ByteArray) -> ByteArray:
    """Add blotches of every size, as light and texture make them."""
    rng, rough = np.random.default_rng(5), image_rgb.astype(float)
    height, width = image_rgb.shape[:2]
    for across in (4, 16, 64, 256):
        blotches = Image.fromarray(rng.normal(0.0, 6.0, (across * 3 // 4, across)).astype("f4"))
        rough += np.asarray(blotches.resize((width, height), Image.Resampling.BICUBIC))[..., None]
    return (rough + rng.normal(0.0, 3.0, (height, width, 1))).clip(0, 255).astype(np.uint8)


def draw_face() -> ByteArray:
    picture = Image.fromarray(fill(0))
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, 0, 640, 330), WALL)
    draw.rectangle((0, 330, 640, 480), SHIRT)
    draw.ellipse((200, 60, 440, 380), SKIN)
    draw.ellipse((190, 40, 450, 170), HAIR)
    for x in (265, 375):
        draw.ellipse((x - 22, 190, x + 22, 216), "white")
        draw.ellipse((x - 10, 193, x + 10, 213), HAIR)
    draw.ellipse((275, 305, 365, 335), (180, 70, 70))
    return roughen(np.asarray(picture))


def see(
    segmenter: Segmenter, ground: GroundLookup, how: Callable[..., Scene], image_rgb: ByteArray
) -> Scene:
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=image_rgb)
    return how(frame, name_plants(segmenter.segment(image_rgb)), ground, SETTINGS, 1.2)


@pytest.mark.parametrize(
    "image_rgb",
    [fill(0), fill(255), roughen(fill(150)), roughen(fill(215))],
    ids=["black", "white", "concrete", "snow"],
)
def test_a_picture_without_anything_in_it_shows_no_plant_and_no_row(
    segmenter: Segmenter, ground: GroundLookup, image_rgb: ByteArray
) -> None:
    scene = see(segmenter, ground, observe, image_rgb)
    assert scene.plants == ()
    assert scene.row_line is None


def test_a_face_is_no_plant_that_the_network_knows(
    segmenter: Segmenter, ground: GroundLookup
) -> None:
    scene = see(segmenter, ground, look, draw_face())
    assert find(scene.unfit_fact, PlantsStrange).doubt == pytest.approx(1.0, abs=0.01)
    assert scene.plants == ()
