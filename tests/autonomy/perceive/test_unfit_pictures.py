"""Pictures that show no field: nothing is mapped from them, and the scene says why."""

from __future__ import annotations

from collections.abc import Callable
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.doubt import find_doubt
from agribot.autonomy.perceive.picture_light import find_fault
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.plants import look
from agribot.core.fact_text import render
from agribot.core.facts import (
    Fact,
    OneBrightness,
    OutOfFocus,
    Overexposed,
    PictureNoisy,
    PlantsStrange,
    TooDark,
)
from agribot.core.messages import ByteArray, CameraFrame, PlantClass
from tests.autonomy.perceive.drawn_field import CONFIG, GROUND
from tests.autonomy.perceive.drawn_plants import draw_plants
from tests.finding import is_like

CROP, WEED = PlantClass.CROP, PlantClass.WEED
SHAPE = (480, 640)
FIELD = ((0.9, 0.0, 0.06, CROP), (0.9, 0.3, 0.05, WEED), (1.2, 0.02, 0.06, CROP))


def blur(values: np.ndarray, radius_px: int) -> np.ndarray:
    """Average over squares three times, which is nearly a bell."""
    for axis in (0, 1) * 3:
        shifts = range(-radius_px, radius_px + 1)
        values = np.mean([np.roll(values, shift, axis) for shift in shifts], axis=0)
    return values


def draw_ground() -> np.ndarray:
    """Soil of clods of several sizes with brighter leaves, 0 to 255."""
    rng = np.random.default_rng(3)
    soil = np.full(SHAPE, 100.0)
    for size_px, depth in ((2, 12.0), (8, 12.0), (32, 12.0)):
        clods = rng.normal(0.0, depth, (SHAPE[0] // size_px, SHAPE[1] // size_px))
        soil += clods.repeat(size_px, axis=0).repeat(size_px, axis=1)
    rows, columns = np.indices(SHAPE)
    soil[(rows % 120 - 60) ** 2 + (columns % 160 - 80) ** 2 < 900] += 40.0
    return soil


def paint(values: np.ndarray) -> ByteArray:
    return np.repeat(values.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def draw_grass() -> np.ndarray:
    """Blades of 2 px, each in a brightness of its own, as of a lawn from above."""
    rng = np.random.default_rng(5)
    return rng.uniform(40.0, 140.0, (SHAPE[0] // 8, SHAPE[1] // 2)).repeat(8, 0).repeat(2, 1)


def blank(value: float) -> np.ndarray:
    return np.full(SHAPE, value)


UNFIT: dict[str, tuple[Callable[[], np.ndarray], Fact]] = {
    "black": (lambda: blank(0.0), TooDark()),
    "night": (lambda: 0.05 * draw_ground(), TooDark()),
    "white": (lambda: blank(255.0), Overexposed(1.0)),
    "burnt out": (lambda: 4.0 * draw_ground() - 120.0, Overexposed(ANY)),
    "grey": (lambda: blank(120.0), OneBrightness(120.0)),
    "snow": (
        lambda: np.random.default_rng(1).uniform(0.0, 255.0, SHAPE),
        PictureNoisy(),
    ),
    "grass": (draw_grass, PictureNoisy()),
    "out of focus": (lambda: blur(draw_ground(), 4), OutOfFocus()),
}


@pytest.mark.parametrize("name", UNFIT)
def test_nothing_is_seen_in_a_picture_that_shows_no_field_and_the_scene_says_why(name: str) -> None:
    make, why = UNFIT[name]
    frame = CameraFrame(t_s=3.0, index=7, image_rgb=paint(make()))
    scene = look(frame, draw_plants(*FIELD), GROUND, CONFIG, ready_s=3.2)
    assert is_like(scene.unfit_fact, why)
    assert scene.unfit == render(scene.unfit_fact)
    assert (scene.plants, scene.row_line, scene.crop_cover) == ((), None, None)
    assert scene.weed_scores is None and (scene.t_s, scene.frame_index) == (3.0, 7)


@pytest.mark.parametrize("block_px", [1, 2])
def test_ground_with_plants_is_fit_whatever_the_camera_resolves(block_px: int) -> None:
    values = draw_ground().repeat(block_px, axis=0).repeat(block_px, axis=1)
    assert find_fault(paint(values)) is None
    assert find_fault(paint(0.4 * values)) is None, "an hour after sunset"


def test_a_scene_tells_the_doubt_and_is_empty_above_the_limit_of_its_network() -> None:
    frame = CameraFrame(t_s=3.0, index=7, image_rgb=paint(draw_ground()))
    named = name_plants(draw_plants(*FIELD, score=0.6))
    assert named.doubt is not None
    known = look(frame, msgspec.structs.replace(named, most_doubt=0.5), GROUND, CONFIG, 3.2)
    assert (known.unfit_fact, known.doubt) == (None, named.doubt) and len(known.plants) == 3
    unknown = look(frame, msgspec.structs.replace(named, most_doubt=0.3), GROUND, CONFIG, 3.2)
    assert unknown.unfit_fact == PlantsStrange(named.doubt, 0.3)
    assert (unknown.plants, unknown.doubt) == ((), named.doubt)


def test_the_doubt_is_what_no_sure_stem_of_one_name_explains() -> None:
    sure, faint, none = (
        name_plants(draw_plants(*FIELD, score=score)).doubt for score in (1.0, 0.6, 0.1)
    )
    assert sure == pytest.approx(0.01, abs=0.01)
    assert faint == pytest.approx(0.41, abs=0.01)
    assert none == 1.0


def test_bare_soil_raises_no_doubt() -> None:
    bare = draw_plants()
    assert bare.plants is not None
    assert name_plants(bare).doubt is None
    owned = name_plants(bare).owned
    assert owned is not None
    few = np.zeros(bare.class_id.shape, dtype=bool)
    few[100:110, 100:110] = True
    assert find_doubt(bare.plants, owned, few) is None
