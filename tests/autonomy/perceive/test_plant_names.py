from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.stems import PlantMaps
from agribot.core.messages import PlantClass
from tests.autonomy.perceive.drawn_field import GROUND
from tests.autonomy.perceive.drawn_plants import draw_plants, number_pixels

WEED, CROP, SOIL = PlantClass.WEED, PlantClass.CROP, PlantClass.SOIL
PAIR = ((0.9, 0.1, 0.05, CROP), (0.9, -0.15, 0.05, WEED))


def misname(class_map: ClassMap, disc: int, wrong_ratio: float, sure: float) -> ClassMap:
    """Give `wrong_ratio` of a disc's pixels the other name, all with the confidence `sure`."""
    class_id, confidence = class_map.class_id.copy(), class_map.confidence.copy()
    rows, columns = np.nonzero(number_pixels(*PAIR) == disc)
    wrong = rows[: round(wrong_ratio * len(rows))], columns[: round(wrong_ratio * len(rows))]
    class_id[wrong] = 1 - class_id[wrong]
    confidence[rows, columns] = round(255 * sure)
    return msgspec.structs.replace(class_map, class_id=class_id, confidence=confidence)


def doubt_stem(class_map: ClassMap, kind: PlantClass, weed: float, crop: float) -> ClassMap:
    """Let the stems of one class score so as a weed and as a crop."""
    assert class_map.plants is not None
    score = class_map.plants.stem_score.copy()
    peak = score[kind] / max(int(score[kind].max()), 1)
    score[kind] = 0
    score = np.maximum(score, np.rint(255 * np.array([weed, crop])[:, None, None] * peak))
    plants = PlantMaps(stem_score=score.astype(np.uint8), way_px=class_map.plants.way_px)
    return msgspec.structs.replace(class_map, plants=plants)


def test_leaves_of_two_names_get_the_one_of_their_plant() -> None:
    mixed = misname(draw_plants(*PAIR), 0, wrong_ratio=0.4, sure=0.9)
    named = name_plants(mixed).class_id
    number = number_pixels(*PAIR)
    assert (named[number == 0] == CROP).all()
    assert (named[number == 1] == WEED).all()
    assert (named[number == -1] == SOIL).all()


@pytest.mark.parametrize(("crop_of_stem", "name"), [(0.35, WEED), (0.55, CROP)])
def test_the_odds_of_stem_and_leaves_make_the_name(crop_of_stem: float, name: int) -> None:
    # of the leaves 54 % speak for a crop
    leaves = misname(draw_plants(*PAIR), 0, wrong_ratio=0.46, sure=0.95)
    torn = doubt_stem(leaves, CROP, 0.9 * (1.0 - crop_of_stem), 0.9 * crop_of_stem)
    found = name_plants(torn)
    assert (found.class_id[number_pixels(*PAIR) == 0] == name).all()
    assert found.owned is not None
    kinds = found.owned.stems.kind_scores.argmax(axis=1)
    assert sorted(kinds.tolist()) == sorted([WEED, name])


def test_the_confidence_of_a_pixel_is_shared_with_its_plant() -> None:
    mixed = misname(draw_plants(*PAIR), 0, wrong_ratio=0.0, sure=0.64)
    found = name_plants(mixed).confidence[number_pixels(*PAIR) == 0] / 255.0
    odds = (0.98 / 0.02) ** 0.9 * 0.64 / 0.36  # of its stem, which scores 0.9, and of its leaves
    plant = odds / (1.0 + odds)
    assert found == pytest.approx(np.sqrt(plant * 0.64), abs=0.003)


@pytest.mark.parametrize(("score", "name"), [(0.9, WEED), (0.3, CROP)])
def test_a_stem_counts_as_much_as_it_is_sure_to_stand_there(score: float, name: int) -> None:
    leaves = misname(draw_plants(*PAIR), 0, wrong_ratio=0.0, sure=0.9)
    torn = doubt_stem(leaves, CROP, score, 0.02 * score)
    assert (name_plants(torn).class_id[number_pixels(*PAIR) == 0] == name).all()


def test_leaves_without_a_stem_keep_the_names_of_their_pixels() -> None:
    faint = misname(draw_plants(*PAIR, score=0.1), 0, wrong_ratio=0.4, sure=0.9)
    named = name_plants(faint)
    assert np.array_equal(named.class_id, faint.class_id)
    assert np.array_equal(named.confidence, faint.confidence)


def test_a_map_of_classes_alone_stays_as_it_is() -> None:
    classes = msgspec.structs.replace(draw_plants(*PAIR), plants=None)
    assert name_plants(classes) is classes
    assert GROUND.map_shape == classes.class_id.shape
