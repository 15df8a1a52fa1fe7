"""The packaged network that finds single plants, on fields that no training has seen."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.config import load
from agribot.core.geo import transform
from agribot.core.messages import PlantClass
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.lab.bench.plant_scenes import SCENES
from agribot.lab.bench.plants import judge_scenes
from agribot.lab.train.card import ModelCard
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import Scores, evaluate
from agribot.lab.train.farm import draw_row_crop
from agribot.lab.train.photographs import find_pairs, read_pairs
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.simulated import draw_seedlings
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.renderer import CameraRenderer, Rendering
from agribot.sim.random_scenes import DENSE, sample_light, sample_look
from tests import nightly

MODEL = "agribot-plants"
FRESH_STREAM, SEEDLING_STREAM = 78, 79  # no training draws from them
SEED = 5  # not that of the tables
DATA = Path(os.environ.get("AGRIBOT_DATA", ""))


def judge(*names: str) -> dict[str, Any]:
    scenes = [SCENES[name] for name in names]
    return judge_scenes(scenes, MODEL, preset="kind", frames=4, seed=SEED)


def test_the_card_tells_of_single_plants_scene_by_scene() -> None:
    data = model_path(MODEL).with_suffix(".json").read_bytes()
    card = msgspec.json.decode(data, type=ModelCard)
    assert card.plants.keys() == {*SCENES, "all"}


def judge_pixels(
    drawer: Callable[..., Iterator[DrawnView]], stream: int, scenes: Iterable[int]
) -> Scores:
    """Judge one view of each scene."""
    segmenter = Segmenter(MODEL)

    def draw_views() -> Iterator[LabelledImage]:
        for scene in scenes:
            for image_rgb, label, _ in drawer(np.random.default_rng([0, stream, scene]), 1):
                yield image_rgb, label

    return evaluate(lambda image_rgb: segmenter.segment(image_rgb).class_id, draw_views())


@nightly.by_day(
    "test_it_tells_seedlings_of_carrots_and_parsley_from_weeds",
    "test_beets_whose_leaves_touch_are_single_plants",
    "test_other_crops_are_found_plant_by_plant_too",
)
@pytest.mark.parametrize("species", [crop for crop, *_ in DENSE.crops])
def test_it_tells_each_of_the_five_crops_from_weeds(species: str) -> None:
    one_crop = DENSE._replace(
        crops=tuple(crop for crop in DENSE.crops if crop[0] == species), crop_share=(1.0,)
    )
    drawer = partial(draw_row_crop, variety=one_crop)
    scores = judge_pixels(drawer, FRESH_STREAM, range(6))
    crop, weed = scores.iou["crop"], scores.iou["weed"]
    assert crop is not None and weed is not None
    assert crop > 0.7 and weed > 0.6


def test_missions_in_rows_that_touch_use_it() -> None:
    assert load("beet").perception.model == MODEL
    assert load("farm").perception.model == "agribot-sim"


@nightly.one_by_one("name", ("beet-7-9", "beet-10-12"), in_suite=1)
def test_beets_whose_leaves_touch_are_single_plants(name: str) -> None:
    found = judge(name)
    assert found["crops_truth"] > 80
    assert found["crop_recall"] > 0.8 and found["crop_precision"] > 0.8
    assert found["stem_error_median_m"] < 0.02
    assert found["crops_hit"] <= 0.01 * found["crops_truth"]


def test_other_crops_are_found_plant_by_plant_too() -> None:
    found = judge("lettuce", "maize", "onion")
    assert min(scene["crop_recall"] for scene in found["by"]) > 0.7


def test_most_weeds_of_a_carpet_are_found() -> None:
    found = judge("weeds-20")
    assert found["weeds_truth"] > 80
    assert found["weed_recall"] > 0.6 and found["weed_precision"] > 0.7


@nightly.all_or_first("scenes", range(12), in_suite=3, unit="scenes")
def test_it_tells_seedlings_of_carrots_and_parsley_from_weeds(scenes: Sequence[int]) -> None:
    assert judge_pixels(draw_seedlings, SEEDLING_STREAM, scenes).miou > 0.75


@pytest.mark.parametrize(
    ("name", "layout", "step", "images", "least"),
    [
        ("carrot-weed", "folder", 4, 4, 0.7),
        ("cwfid-train", "cwfid", 10, 4, 0.72),
        pytest.param("carrot-weed", "folder", 1, 15, 0.7, marks=pytest.mark.nightly),
        pytest.param("cwfid-train", "cwfid", 1, 39, 0.72, marks=pytest.mark.nightly),
    ],
)
def test_it_knows_plants_on_photographs_though_it_has_seen_none(
    name: str, layout: str, step: int, images: int, least: float
) -> None:
    """By day on one photograph of every `step`."""
    if not (DATA / name).is_dir():
        pytest.skip(f"AGRIBOT_DATA holds no {name}")
    pairs, _ = find_pairs(DATA / name, layout)
    segmenter = Segmenter(MODEL)
    scores = evaluate(
        lambda image_rgb: classify(segmenter, image_rgb).class_id,
        read_pairs(pairs[::step], pytest.fail),
    )
    assert scores.images == images
    assert scores.miou > least


@nightly.all_or_first("scenes", range(8), in_suite=2, unit="scenes")
def test_the_pole_of_a_base_station_is_no_plant_to_it(scenes: Sequence[int]) -> None:
    """An earlier network took it for crop."""
    world, segmenter = load_world("Farm"), Segmenter(MODEL)
    (pole,) = (obstacle for obstacle in world.obstacles if obstacle.name == "Pole")
    called = pixels = 0
    for scene in scenes:
        rng = np.random.default_rng([0, FRESH_STREAM, scene])
        bare = msgspec.structs.replace(world, plants=(), obstacles=(), light=sample_light(rng))
        look, yaw_rad = sample_look(rng), rng.uniform(-math.pi, math.pi)
        before_m = rng.uniform(1.0, 1.6)
        place_m = (
            pole.x_map_m - before_m * math.cos(yaw_rad),
            pole.y_map_m - before_m * math.sin(yaw_rad),
        )
        seen = [
            draw_from(msgspec.structs.replace(bare, obstacles=there), look, place_m, yaw_rad)
            for there in ((pole,), ())
        ]
        is_pole = seen[0].depth_m < seen[1].depth_m - 0.02
        answer = segmenter.segment(seen[0].image_rgb).class_id
        pixels += int(is_pole.sum())
        called += int((answer[is_pole] != PlantClass.SOIL).sum())
    assert pixels > 2_500 * len(scenes)
    assert called < 0.1 * pixels


def draw_from(
    world: WorldSpec, look: Appearance, place_m: tuple[float, float], yaw_rad: float
) -> Rendering:
    """What the robot's camera sees from there."""
    robot = load_robot()
    assert robot.camera is not None
    map_from_body = transform((*place_m, 0.0), (0.0, 0.0, yaw_rad))
    renderer = CameraRenderer(world, appearance=look, threads=1)
    return renderer.render(map_from_body @ robot.body_from_camera(), robot.camera, noise_seed=1)
