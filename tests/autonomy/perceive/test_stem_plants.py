from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plant_names import LEAST_SCORE
from agribot.autonomy.perceive.plants import ground_plants, observe
from agribot.autonomy.perceive.stem_plants import find_stem_plants
from agribot.autonomy.perceive.stems import PlantMaps
from agribot.core.errors import PerceptionError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import CameraFrame, GroundPlant, PlantClass
from tests.autonomy.perceive.drawn_field import CAMERA, CONFIG, GROUND, Disc, draw
from tests.autonomy.perceive.drawn_plants import draw_plants, find_stems_px, number_pixels

UNSURE = 128  # of 255: leaves that say neither
WEED, CROP, SOIL = PlantClass.WEED, PlantClass.CROP, PlantClass.SOIL


def find_plants(class_map: ClassMap) -> list[GroundPlant]:
    return find_stem_plants(class_map, GROUND, CONFIG)


def plants_in(class_map: ClassMap) -> PlantMaps:
    assert class_map.plants is not None
    return class_map.plants


def off_m(plant: GroundPlant, disc: Disc) -> float:
    return math.dist((plant.x_body_m, plant.y_body_m), disc[:2])


def assert_found(class_map: ClassMap, *discs: Disc) -> None:
    """Assert that exactly these plants are found, each in its place and with its class."""
    plants = find_plants(class_map)
    assert len(plants) == len(discs)
    for disc in discs:
        plant = min(plants, key=lambda plant, disc=disc: off_m(plant, disc))  # type: ignore[misc]
        assert off_m(plant, disc) < 0.003
        assert plant.plant == disc[3]


def test_bare_soil_holds_no_plants() -> None:
    assert find_plants(draw_plants()) == []


def test_each_plant_is_found_once_with_its_class_and_area() -> None:
    discs = ((0.8, 0.2, 0.05, CROP), (1.0, -0.15, 0.03, WEED), (1.3, 0.1, 0.04, WEED))
    class_map = draw_plants(*discs, height_ratio=0.5)
    assert_found(class_map, *discs)
    plants = ground_plants(class_map, GROUND, CONFIG)
    assert [plant.plant for plant in plants] == [CROP, WEED, WEED]
    for plant, (_, _, radius_m, _) in zip(plants, discs, strict=True):
        assert plant.area_m2 == pytest.approx(math.pi * radius_m**2, rel=0.15)


@pytest.mark.parametrize("height_ratio", [0.1, 0.6])
@pytest.mark.parametrize("x_m", [0.7, 1.2, 1.7])
def test_the_place_of_a_plant_is_that_of_its_stem_however_high_its_leaves(
    x_m: float, height_ratio: float
) -> None:
    assert_found(
        draw_plants((x_m, 0.2, 0.05, WEED), height_ratio=height_ratio), (x_m, 0.2, 0.05, WEED)
    )


def test_crops_whose_leaves_touch_are_each_a_plant() -> None:
    pair = ((0.9, 0.0, 0.05, CROP), (0.9, 0.09, 0.05, CROP))
    class_map = draw_plants(*pair)
    assert_found(class_map, *pair)
    merged = msgspec.structs.replace(class_map, plants=None)
    assert len(ground_plants(merged, GROUND, CONFIG)) == 1
    one, other = find_plants(class_map)
    assert one.area_m2 == pytest.approx(other.area_m2, rel=0.25)


def test_overlapping_plants_of_both_classes_are_each_a_plant() -> None:
    field = (
        (0.9, 0.0, 0.06, CROP), (0.94, 0.07, 0.03, WEED), (0.87, -0.06, 0.03, WEED),
        (1.2, 0.1, 0.04, WEED), (1.2, 0.15, 0.04, WEED), (1.25, 0.12, 0.05, WEED),
    )  # fmt: skip
    assert_found(draw_plants(*field), *field)


def test_a_weed_under_the_leaves_of_a_crop_keeps_its_class_unless_its_own_are_surely_crop() -> None:
    weed, crop = (0.95, 0.035, 0.04, WEED), (0.9, 0.0, 0.06, CROP)
    class_map = draw_plants(weed, crop)
    assert_found(class_map, weed, crop)
    class_map.class_id[class_map.class_id == WEED] = CROP
    assert_found(class_map, weed, crop)
    class_map.confidence[:] = 255
    assert_found(class_map, crop)  # what may be either is neither


def test_a_plant_whose_stem_is_outside_the_picture_is_not_reported() -> None:
    edge_x_m = float(GROUND.x_body_m[-1, 256])
    cut, whole = (edge_x_m - 0.01, 0.0, 0.06, WEED), (edge_x_m + 0.09, 0.0, 0.04, WEED)
    assert_found(draw_plants(cut, whole), whole)
    (alone,) = find_plants(draw_plants(whole))
    (beside,) = find_plants(draw_plants(cut, whole))
    assert beside.area_m2 == pytest.approx(alone.area_m2, rel=0.1)


def test_a_plant_cut_by_the_edge_is_reported_where_its_stem_is_in_the_picture() -> None:
    edge_x_m = float(GROUND.x_body_m[-1, 256])
    cut = (edge_x_m + 0.02, 0.0, 0.06, CROP)
    assert ground_plants(draw(cut, height_ratio=0.3), GROUND, CONFIG) == []
    assert_found(draw_plants(cut), cut)


def test_a_stem_that_lies_outside_its_edge_square_is_not_reported() -> None:
    plant = (float(GROUND.x_body_m[-2, 256]), 0.0, 0.05, WEED)
    class_map = draw_plants(plant)
    assert len(find_plants(class_map)) == 1
    plants_in(class_map).way_px[1, -1] = 3.0  # below the last row
    assert find_plants(class_map) == []


def test_a_score_without_vegetation_is_no_plant() -> None:
    class_map = draw_plants((0.9, 0.0, 0.05, WEED), (1.2, 0.1, 0.05, CROP))
    class_map.class_id[class_map.class_id == CROP] = SOIL
    assert_found(class_map, (0.9, 0.0, 0.05, WEED))


def test_an_unlikely_stem_is_no_plant() -> None:
    disc = (0.9, 0.0, 0.05, WEED)
    assert find_plants(draw_plants(disc, score=LEAST_SCORE - 0.01)) == []
    assert len(find_plants(draw_plants(disc, score=LEAST_SCORE + 0.01))) == 1


def test_specks_smaller_than_the_smallest_plant_are_dropped() -> None:
    radius_m = 0.6 * math.sqrt(CONFIG.min_plant_area_m2 / math.pi)
    assert find_plants(draw_plants((0.8, 0.0, radius_m, WEED))) == []
    assert len(find_plants(draw_plants((0.8, 0.0, 2 * radius_m, WEED)))) == 1


def test_plants_beyond_the_range_are_left_for_a_later_frame() -> None:
    beyond, within = 0.3 + CONFIG.max_range_m + 0.05, 0.3 + CONFIG.max_range_m - 0.05
    far, near = (beyond, 0.0, 0.05, WEED), (within, 0.0, 0.05, CROP)
    assert_found(draw_plants(far, near), near)


def test_a_plant_above_the_horizon_is_not_on_the_ground() -> None:
    level = transform((0.0, 0.0, 0.5), (0.0, 0.2, 0.0)) @ LINK_FROM_OPTICAL
    ground = GroundLookup(CAMERA, level, (96, 128), 2.5)
    maps = PlantMaps(
        stem_score=np.zeros((2, 48, 64), np.uint8), way_px=np.zeros((2, 24, 32), np.float32)
    )
    maps.stem_score[0, [4, 44], 30] = 250
    weeds = np.full((96, 128), WEED, dtype=np.uint8)
    class_map = ClassMap(class_id=weeds, confidence=weeds + 250, scale_px=(5.0, 5.0), plants=maps)
    (plant,) = find_stem_plants(class_map, ground, CONFIG)
    assert plant.x_body_m == pytest.approx(float(ground.x_body_m[89:91, 61:63].mean()), abs=0.01)


@pytest.mark.parametrize(("aside_m", "ratio"), [(0.02, 0.95), (0.045, 0.4)])
def test_two_stems_too_close_for_their_plant_are_one_plant_at_the_surer_stem(
    aside_m: float, ratio: float
) -> None:
    """The less sure one of them is, the farther from the other it is still the same plant's."""
    plant = (0.9, 0.0, 0.07, CROP)
    (area_m2,) = (p.area_m2 for p in find_plants(draw_plants(plant)))
    other = (0.9, aside_m, 0.069, CROP)
    class_map = draw_plants(plant, other)
    lower_score(class_map, plant, other, ratio)
    class_map.class_id[number_pixels(plant) < 0] = SOIL
    (found,) = find_plants(class_map)
    assert off_m(found, plant) < 0.003
    assert found.area_m2 == pytest.approx(area_m2, rel=0.05)


def lower_score(class_map: ClassMap, surer: Disc, disc: Disc, ratio: float) -> None:
    """Let the squares that are nearer to the stem of one crop than to the other's score less."""
    scores = plants_in(class_map).stem_score
    rows, columns = np.indices(scores.shape[1:])
    other_px, own_px = (
        np.hypot(2 * columns + 0.5 - u, 2 * rows + 0.5 - v) for u, v in find_stems_px(surer, disc)
    )
    scores[1] = np.where(own_px < other_px, np.rint(ratio * scores[1]), scores[1])


def test_plants_as_near_as_carrots_are_each_a_plant_if_both_are_sure() -> None:
    row = tuple((0.9, 0.05 * index, 0.05, CROP) for index in range(4))
    assert_found(draw_plants(*row), *row)


def test_stems_of_two_classes_are_two_plants_however_close() -> None:
    close = ((0.9, 0.0, 0.07, CROP), (0.9, 0.03, 0.03, WEED))
    assert_found(draw_plants(*close), *close)


def test_the_class_is_as_sure_as_the_one_score_against_the_other() -> None:
    class_map = draw_plants((0.9, 0.0, 0.05, WEED), score=0.3)
    maps = plants_in(class_map)
    maps.stem_score[1] = maps.stem_score[0] * 3
    class_map.confidence[:] = UNSURE
    (plant,) = find_plants(class_map)
    assert plant.plant == CROP
    odds = 3.0**0.9  # to the power of how surely a stem stands there
    assert plant.confidence == pytest.approx(odds / (1.0 + odds), abs=0.01)


@pytest.mark.parametrize(("sure", "count"), [(0.05, 1), (-0.05, 0)])
def test_a_stem_that_may_be_a_weed_or_a_crop_is_neither(sure: float, count: int) -> None:
    class_map = draw_plants((0.9, 0.0, 0.05, WEED), (0.9, 0.3, 0.05, CROP), score=1.0)
    maps, share = plants_in(class_map), CONFIG.min_confidence + sure
    class_map.confidence[class_map.class_id == WEED] = UNSURE
    weeds = maps.stem_score[0]
    maps.stem_score[1] = np.maximum(maps.stem_score[1], weeds * ((1.0 - share) / share))
    assert [plant.plant for plant in find_plants(class_map)].count(WEED) == count
    assert [plant.plant for plant in find_plants(class_map)].count(CROP) == 1


def test_positions_grow_less_certain_with_distance_and_hold_under_a_tilt_of_the_body() -> None:
    near, far = (0.6, 0.0, 0.03, WEED), (1.7, 0.0, 0.03, WEED)
    one, other = ground_plants(draw_plants(near, far), GROUND, CONFIG)
    assert 0.006 < one.std_m < other.std_m < 0.05
    tilted = transform((0.3, 0.0, 0.7), (0.0, math.radians(50.5), 0.0)) @ LINK_FROM_OPTICAL
    ground = GroundLookup(CAMERA, tilted, GROUND.map_shape, CONFIG.max_range_m)
    plants = ground_plants(draw_plants(near, far), ground, CONFIG)
    for plant, disc, std_m in zip(plants, (near, far), (one.std_m, other.std_m), strict=True):
        assert 0.5 * std_m < off_m(plant, disc) < 1.1 * std_m


def test_a_scene_takes_its_plants_from_stems_and_the_rest_from_classes() -> None:
    frame = CameraFrame(t_s=3.0, index=7, image_rgb=np.zeros((480, 640, 3), np.uint8))
    class_map = draw_plants((0.9, 0.0, 0.05, CROP), (0.9, 0.09, 0.05, CROP))
    scene = observe(frame, class_map, GROUND, CONFIG, ready_s=3.2)
    classes = msgspec.structs.replace(class_map, plants=None)
    plain = observe(frame, classes, GROUND, CONFIG, ready_s=3.2)
    assert (len(scene.plants), len(plain.plants)) == (2, 1)
    assert scene.plants == tuple(ground_plants(class_map, GROUND, CONFIG))
    assert scene.crop_cover is not None and plain.crop_cover is not None
    assert len(scene.crop_cover.stems_body_m) == 2
    assert scene.weed_scores is not None and plain.weed_scores is None
    rest = msgspec.structs.replace(
        scene, plants=plain.plants, crop_cover=plain.crop_cover, weed_scores=None
    )
    assert rest == plain


def test_class_maps_of_another_size_or_without_stems_are_refused() -> None:
    small = GroundLookup(CAMERA, transform((0.3, 0.0, 0.7), (0.0, 0.9, 0.0)) @ LINK_FROM_OPTICAL,
                         (96, 128), CONFIG.max_range_m)  # fmt: skip
    with pytest.raises(PerceptionError, match="map_shape"):
        ground_plants(draw_plants(), small, CONFIG)
    with pytest.raises(PerceptionError, match="finds no plants"):
        find_stem_plants(draw(), GROUND, CONFIG)
