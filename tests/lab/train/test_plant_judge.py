from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.pictures import PictureClasses, SeenPicture
from agribot.autonomy.perceive.stems import CELL_PX, PlantMaps
from agribot.core.messages import PlantClass
from agribot.lab.dataset.drawing import draw_field, list_missing_fields
from agribot.lab.dataset.pictures import PictureError
from agribot.lab.dataset.records import Recipe, claim
from agribot.lab.labelled_plants import LabelledPlants, read_plants
from agribot.lab.plant_scores import PlantSegments
from agribot.lab.train.plant_judge import PicturePlantJudge, PicturePlantScores
from agribot.lab.train.plant_targets import WAY, WAY_UNIT_PX
from agribot.lab.train.plant_truth import PlantTruth
from tests.lab.train.whole_pictures import join_target_heat, tell_targets

WEED, CROP, SOIL = PlantClass.WEED, PlantClass.CROP, PlantClass.SOIL
SHAPE = (96, 128)
# Three crops whose leaves touch, and a weed: u, v, radius and class.
DISCS = (
    (24.0, 40.0, 12.0, CROP), (46.0, 41.0, 12.0, CROP), (68.0, 40.0, 12.0, CROP),
    (105.0, 60.0, 8.0, WEED),
)  # fmt: skip


def draw(*discs: tuple[float, float, float, PlantClass]) -> tuple[np.ndarray, PlantTruth]:
    rows, columns = np.indices(SHAPE)
    label, number = np.full(SHAPE, SOIL, np.uint8), np.zeros(SHAPE, np.uint16)
    for index, (u, v, radius_px, kind) in enumerate(discs, 1):
        disc = np.hypot(columns - u, rows - v) <= radius_px
        label[disc], number[disc] = kind, index
    stem_px = np.array([disc[:2] for disc in discs])
    return label, PlantTruth(number, stem_px, np.array([d[3] for d in discs], np.uint8))


def see(label: np.ndarray, plants: PlantTruth, doubt: float = 0.0) -> SeenPicture:
    """What a perfect network says; `doubt` is the other class's score over that of the stem.

    With it the leaves are as likely of either class.
    """
    target = tell_targets(label, plants)
    stems = join_target_heat(target)
    heat = np.maximum(stems, doubt * stems[::-1])
    maps = PlantMaps(stem_score=(255.0 * heat).astype(np.uint8), way_px=target[WAY] * WAY_UNIT_PX)
    sure = np.full(SHAPE, 128 if doubt else 255, np.uint8)
    class_map = ClassMap(class_id=label, confidence=sure, scale_px=(1.0, 1.0), plants=maps)
    return SeenPicture(PictureClasses(label, sure), class_map, (1.0, 1.0))


def judge(seen: SeenPicture | PictureClasses, truth: PlantTruth) -> PicturePlantScores:
    judge = PicturePlantJudge()
    judge.add(LabelledPlants(PlantSegments(truth.number, truth.kind), truth.stem_px), seen)
    scores = judge.compute_scores()
    assert scores is not None
    return scores


def test_a_perfect_answer_is_perfect() -> None:
    label, plants = draw(*DISCS)
    scores = judge(see(label, plants), plants)
    assert (scores.crops_truth, scores.weeds_truth) == (3, 1)
    assert scores.crop_recall == scores.crop_precision == scores.weed_recall == 1.0
    assert scores.pq is not None and scores.pq > 0.9
    assert scores.stem_error_p95_px == pytest.approx(0.0, abs=0.1)


def test_without_stems_crops_that_touch_are_one_piece() -> None:
    label, plants = draw(*DISCS)
    scores = judge(see(label, plants).classes, plants)
    assert (scores.crop_recall, scores.weed_recall) == (0.0, 1.0)
    assert scores.stem_error_median_px is None


def test_stems_are_off_by_as_much_as_they_were_moved() -> None:
    label, plants = draw(*DISCS)
    moved = PlantTruth(plants.number, plants.stem_px + np.array([CELL_PX, 0.0]), plants.kind)
    scores = judge(see(label, moved), plants)
    assert scores.stem_error_median_px == pytest.approx(CELL_PX, abs=0.1)


def test_an_undecided_stem_is_neither_weed_nor_crop() -> None:
    label, plants = draw(*DISCS)
    scores = judge(see(label, plants, doubt=0.9), plants)
    assert scores.unknown == len(DISCS)
    assert scores.crop_recall == scores.weed_recall == 0.0
    assert scores.crop_precision is None and scores.weed_precision is None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, recipe = tmp_path_factory.mktemp("drawn"), Recipe(supersample=1, views_per_field=1)
    claim(folder, recipe)
    for job in list_missing_fields(folder, recipe, 1):
        draw_field(job, lambda: False)
    return folder


def test_a_drawn_set_tells_its_plants_and_where_they_stand(folder: Path) -> None:
    mask = folder / "masks" / "000000.png"
    label = np.asarray(Image.open(mask))
    truth = read_plants(mask, label)
    assert truth is not None and len(truth.segments.kind) > 5
    for index, kind in enumerate(truth.segments.kind, 1):
        assert (label[truth.segments.number == index] == kind).all()
    rows, columns = np.nonzero(truth.segments.number == 1)
    gap_px = np.hypot(columns.mean() - truth.stem_px[0, 0], rows.mean() - truth.stem_px[0, 1])
    size_px = np.hypot(np.ptp(columns) + 1, np.ptp(rows) + 1)
    assert gap_px < size_px


def test_a_set_of_masks_alone_tells_no_plants(tmp_path: Path) -> None:
    assert read_plants(tmp_path / "masks" / "a.png", np.zeros(SHAPE, np.uint8)) is None


def test_instances_of_another_size_are_named(folder: Path) -> None:
    mask = folder / "masks" / "000000.png"
    with pytest.raises(PictureError, match=r"instances.000000.png: is 640 x 480"):
        read_plants(mask, np.zeros(SHAPE, np.uint8))
