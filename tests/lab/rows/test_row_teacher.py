"""Labels that drawn rows teach, on drawn fields."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.messages import PlantClass
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.rows.teacher import label_plants
from agribot.lab.train.photographs import find_pairs, read_pair
from tests import nightly
from tests.lab.rows.drawn_rows import (
    PLANT_RGB,
    SOIL_RGB,
    draw_field,
    draw_labels,
    place_row,
    write_rows,
)

ROWS = (-1.0, 0.0, 1.0)
WEEDS = (-0.5, 0.5)
LINES = np.asarray(draw_labels(ROWS)) > 127


def at(row: float, v_px: int = 400) -> tuple[int, int]:
    return v_px, round(place_row(row, v_px))


def test_plants_on_a_row_teach_crop_and_plants_between_rows_weed() -> None:
    label = label_plants(draw_field(ROWS, WEEDS), LINES)
    assert [label[at(row)] for row in ROWS] == [PlantClass.CROP] * 3
    assert [label[at(row)] for row in WEEDS] == [PlantClass.WEED] * 2
    assert label[at(0.25)] == PlantClass.SOIL


def test_plants_beside_a_row_teach_nothing() -> None:
    label = label_plants(draw_field((*ROWS, 0.2)), LINES)
    assert label[at(0.2)] == UNLABELLED


def test_plants_at_the_top_teach_nothing() -> None:
    label = label_plants(draw_field(ROWS), LINES)
    assert label[at(0.0, 40)] == UNLABELLED
    assert label[at(0.0, 200)] == PlantClass.CROP


def test_a_leaf_of_crop_between_rows_is_no_weed() -> None:
    picture = draw_field(ROWS).copy()
    v_px, u_px = at(0.5)
    # A leaf that is one piece with its plant on the row.
    picture[v_px - 4 : v_px + 4, at(0.0)[1] : u_px + 4] = PLANT_RGB
    assert label_plants(picture, LINES)[v_px, u_px] == UNLABELLED


def test_a_glossy_spot_in_a_leaf_is_not_called_soil() -> None:
    picture = draw_field(ROWS).copy()
    v_px, u_px = at(0.0)
    picture[v_px - 1 : v_px + 2, u_px - 1 : u_px + 2] = 200
    assert label_plants(picture, LINES)[v_px, u_px] in {UNLABELLED, PlantClass.CROP}


def test_labels_have_the_size_of_their_photograph() -> None:
    photograph = np.asarray(Image.fromarray(draw_field(ROWS)).resize((640, 480)))
    assert label_plants(photograph, LINES).shape == (480, 640)


def test_bare_soil_teaches_soil() -> None:
    bare = np.full((512, 512, 3), SOIL_RGB, dtype=np.uint8)
    assert (label_plants(bare, LINES) == PlantClass.SOIL).all()


def test_sets_with_drawn_rows_and_sets_with_masks_are_read_side_by_side(tmp_path: Path) -> None:
    write_rows(tmp_path / "beet", {"1": draw_field(ROWS, WEEDS)}, ROWS)
    for part, value in (("images", 90), ("masks", int(PlantClass.CROP))):
        (tmp_path / "carrot" / part).mkdir(parents=True)
        mode = "RGB" if part == "images" else "L"
        Image.new("L", (32, 24), value).convert(mode).save(tmp_path / "carrot" / part / "1.png")
    pairs, problems = find_pairs(tmp_path, "rows")
    assert problems == []
    (_, by_lines), (_, by_mask) = (read_pair(pair) for pair in pairs)
    assert by_lines[at(0.5)] == PlantClass.WEED
    assert np.unique(by_mask).tolist() == [PlantClass.CROP]


def test_the_drawn_rows_of_a_folder_of_masks_are_masks(tmp_path: Path) -> None:
    write_rows(tmp_path, {"1": draw_field(ROWS)}, ROWS, 512)
    pairs, _ = find_pairs(tmp_path, "folder")
    assert not pairs[0].shows_rows


@pytest.mark.parametrize("side_px", [128, 256, 1024])
def test_the_size_of_the_drawing_does_not_matter(side_px: int, tmp_path: Path) -> None:
    write_rows(tmp_path, {"1": draw_field(ROWS, WEEDS)}, ROWS, side_px)
    pairs, _ = find_pairs(tmp_path, "rows")
    _, label = read_pair(pairs[0])
    assert [label[at(row)] for row in (0.0, 0.5)] == [PlantClass.CROP, PlantClass.WEED]


@nightly.by_day("test_sets_with_drawn_rows_and_sets_with_masks_are_read_side_by_side")
def test_a_training_learns_from_drawn_rows(tmp_path: Path) -> None:
    write_rows(tmp_path / "beet", {"1": draw_field(ROWS, WEEDS), "2": draw_field(ROWS)}, ROWS)
    words = ["--data-dir", str(tmp_path / "beet"), "--model", "agribot-sim", "--start", "random"]
    few = ["--steps", "2", "--size", "64x64", "--train-width", "64", "--crop-px", "64"]
    out = tmp_path / "out"
    few += ["--batch-size", "2", "--threads", "1", "--out", str(out)]
    assert main(["train", "--data", "rows", *words, *few]) == 0
    card = json.loads((out / "agribot-sim.json").read_text(encoding="utf-8"))
    assert card["train_images"] == 2
    assert "--data rows" in card["command"]
