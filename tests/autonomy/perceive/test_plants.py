from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import ground_plants, observe
from agribot.core.errors import PerceptionError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import CameraFrame, PlantClass
from tests.autonomy.perceive.drawn_field import CAMERA, CONFIG, GROUND, draw

WEED, CROP, SOIL = PlantClass.WEED, PlantClass.CROP, PlantClass.SOIL


def test_bare_soil_holds_no_plants() -> None:
    assert ground_plants(draw(), GROUND, CONFIG) == []


def test_each_plant_is_found_once_with_its_class_and_area() -> None:
    discs = ((0.8, 0.2, 0.05, CROP), (1.0, -0.15, 0.03, WEED), (1.3, 0.1, 0.02, WEED))
    plants = ground_plants(draw(*discs), GROUND, CONFIG)
    assert [plant.plant for plant in plants] == [CROP, WEED, WEED]
    for plant, (_, _, radius_m, _) in zip(plants, discs, strict=True):
        assert plant.area_m2 == pytest.approx(math.pi * radius_m**2, rel=0.15)
        assert plant.confidence == pytest.approx(240 / 255, abs=0.01)


@pytest.mark.parametrize("x_m", [0.7, 1.0, 1.4, 1.8])
@pytest.mark.parametrize("radius_m", [0.02, 0.06])
def test_the_foot_of_a_plant_is_found_under_its_foliage(x_m: float, radius_m: float) -> None:
    (plant,) = ground_plants(draw((x_m, 0.2, radius_m, WEED), height_ratio=0.5), GROUND, CONFIG)
    off_m = math.hypot(plant.x_body_m - x_m, plant.y_body_m - 0.2)
    assert off_m < 0.006 + 0.15 * radius_m
    assert off_m < 2.0 * plant.std_m


def test_flat_and_tall_weeds_lie_within_three_sigma_of_their_place() -> None:
    for height_ratio in (0.2, 0.7):
        disc = (1.2, -0.1, 0.05, WEED)
        (plant,) = ground_plants(draw(disc, height_ratio=height_ratio), GROUND, CONFIG)
        off_m = math.hypot(plant.x_body_m - 1.2, plant.y_body_m + 0.1)
        assert off_m < 3.0 * plant.std_m


def test_a_plant_cut_by_the_image_edge_is_not_reported() -> None:
    edge_x_m = float(GROUND.x_body_m[-1, 256])
    cut = draw((edge_x_m, 0.0, 0.06, WEED), (1.0, 0.0, 0.03, WEED))
    (plant,) = ground_plants(cut, GROUND, CONFIG)
    assert plant.x_body_m == pytest.approx(1.0, abs=0.02)


def test_plants_beyond_the_range_are_left_for_a_later_frame() -> None:
    beyond_m = 0.3 + CONFIG.max_range_m + 0.1
    (plant,) = ground_plants(
        draw((beyond_m, 0.0, 0.05, WEED), (1.2, 0.0, 0.05, WEED)), GROUND, CONFIG
    )
    assert plant.x_body_m < 1.3


def test_specks_smaller_than_the_smallest_plant_are_dropped() -> None:
    radius_m = 0.6 * math.sqrt(CONFIG.min_plant_area_m2 / math.pi)
    assert ground_plants(draw((0.8, 0.0, radius_m, WEED)), GROUND, CONFIG) == []
    assert len(ground_plants(draw((0.8, 0.0, 2 * radius_m, WEED)), GROUND, CONFIG)) == 1


def test_an_unsure_network_reports_nothing() -> None:
    unsure = round(255 * CONFIG.min_confidence) - 3
    disc = (0.8, 0.0, 0.05, WEED)
    assert ground_plants(draw(disc, confidence=unsure), GROUND, CONFIG) == []
    assert len(ground_plants(draw(disc, confidence=unsure + 6), GROUND, CONFIG)) == 1


def test_a_weed_coloured_fringe_of_a_crop_plant_is_no_weed() -> None:
    fringe = draw((0.9, 0.0, 0.1, CROP), (0.9, 0.085, 0.02, WEED), height_ratio=0.3)
    (plant,) = ground_plants(fringe, GROUND, CONFIG)
    assert plant.plant == CROP
    assert plant.area_m2 == pytest.approx(math.pi * 0.1**2, rel=0.15)


def test_a_crop_coloured_leaf_inside_a_weed_is_no_crop() -> None:
    mixed = draw((0.9, 0.0, 0.06, WEED), (0.9, 0.0, 0.02, CROP))
    (plant,) = ground_plants(mixed, GROUND, CONFIG)
    assert plant.plant == WEED


def test_a_weed_that_only_touches_a_crop_plant_stays_a_weed() -> None:
    touching = draw((0.9, 0.0, 0.08, CROP), (0.9, 0.115, 0.04, WEED))
    plants = ground_plants(touching, GROUND, CONFIG)
    assert {plant.plant for plant in plants} == {WEED, CROP}


def test_a_crop_coloured_seam_in_the_ground_is_no_plant() -> None:
    seam = draw()
    seam.class_id[200:202, 150:300] = CROP
    assert ground_plants(seam, GROUND, CONFIG) == []
    seam.class_id[200:202, 150:300] = WEED
    assert len(ground_plants(seam, GROUND, CONFIG)) == 1


def test_two_weeds_apart_are_two_plants() -> None:
    apart = draw((0.8, 0.05, 0.02, WEED), (0.8, -0.05, 0.02, WEED))
    assert len(ground_plants(apart, GROUND, CONFIG)) == 2


def test_positions_grow_less_certain_with_distance() -> None:
    near, far = ground_plants(draw((0.6, 0.0, 0.03, WEED), (1.7, 0.0, 0.03, WEED)), GROUND, CONFIG)
    assert 0.0 < near.std_m < far.std_m < 0.1


def test_vegetation_above_the_horizon_is_not_on_the_ground() -> None:
    level = transform((0.0, 0.0, 0.5), (0.0, 0.2, 0.0)) @ LINK_FROM_OPTICAL
    ground = GroundLookup(CAMERA, level, (96, 128), CONFIG.max_range_m)
    class_id = np.full((96, 128), SOIL, dtype=np.uint8)
    class_id[5:15, 40:80] = WEED
    trees = ClassMap(
        class_id=class_id, confidence=np.full((96, 128), 255, np.uint8), scale_px=(5.0, 5.0)
    )
    assert ground_plants(trees, ground, CONFIG) == []


def test_a_class_map_of_another_size_is_refused() -> None:
    small = np.full((10, 10), SOIL, dtype=np.uint8)
    class_map = ClassMap(class_id=small, confidence=small, scale_px=(48.0, 64.0))
    with pytest.raises(PerceptionError, match="map_shape"):
        ground_plants(class_map, GROUND, CONFIG)


def test_a_scene_tells_when_it_was_seen_and_what_the_camera_covered() -> None:
    frame = CameraFrame(t_s=3.0, index=7, image_rgb=np.zeros((480, 640, 3), np.uint8))
    scene = observe(frame, draw((1.0, 0.0, 0.05, WEED)), GROUND, CONFIG, ready_s=3.2)
    assert (scene.t_s, scene.ready_s, scene.frame_index) == (3.0, 3.2, 7)
    assert scene.view_body_m == GROUND.view_body_m
    assert sum(scene.class_ratio) == pytest.approx(1.0)
    assert scene.class_ratio[WEED] > 0.0 == scene.class_ratio[CROP]
    assert len(scene.plants) == 1
