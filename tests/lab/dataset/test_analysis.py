"""What `agribot dataset check --report` counts and writes of a set of images and masks."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.lab.dataset.analysis import GRID, SetAnalysis
from agribot.lab.dataset.layouts import Item

WEED, CROP, SOIL = 0, 1, 2


def item(name: str, group: str = "", *, has_mask: bool = True) -> Item:
    return Item(
        key=name, group=group, image=f"{name}.png", mask=f"{name}.png" if has_mask else None
    )


def counted(*classes: np.ndarray) -> SetAnalysis:
    analysis = SetAnalysis()
    for index, one in enumerate(classes):
        analysis.add(item(str(index)), np.zeros((*one.shape, 3), np.uint8), one)
    return analysis


def test_pixels_are_counted_by_class_and_without_one() -> None:
    classes = np.full((48, 64), SOIL, np.uint8)
    classes[:2], classes[2:6], classes[40:] = WEED, CROP, 255
    (one,) = counted(classes).pictures
    pixels = (one.weed_px, one.crop_px, one.soil_px, one.unlabelled_px)
    assert pixels == (2 * 64, 4 * 64, 34 * 64, 8 * 64)
    assert (one.width_px, one.height_px, one.known_px) == (64, 48, 40 * 64)


def test_where_a_class_is_adds_up_over_pictures_of_any_size() -> None:
    large, small = np.full((480, 640), SOIL, np.uint8), np.full((48, 64), SOIL, np.uint8)
    large[:240, :320], small[:24, :32] = CROP, WEED  # the upper left quarter
    where = counted(large, small).where
    assert where.shape == (2, *GRID)
    rows, columns = GRID[0] // 2, GRID[1] // 2
    assert (where[:, :rows, :columns] == 1.0).all()
    assert where.sum() == 2 * rows * columns


def test_a_picture_smaller_than_the_grid_leaves_fields_empty() -> None:
    where = counted(np.full((3, 5), WEED, np.uint8)).where
    assert where[WEED].sum() == 15 and where.max() == 1.0


def test_each_day_is_summed_up_with_the_images_that_have_no_mask() -> None:
    analysis = SetAnalysis()
    items = [item("a", "day1"), item("b", "day1", has_mask=False), item("c", "day2")]
    for one in (items[0], items[2]):
        classes = np.full((10, 10), CROP if one.group == "day2" else SOIL, np.uint8)
        analysis.add(one, np.zeros((10, 10, 3), np.uint8), classes)
    first, second = analysis.count_groups(items)
    assert (first.group, first.images, first.annotated, first.pictures) == ("day1", 2, 1, 1)
    assert (first.without_mask, first.soil_px, first.crop_px) == (("b.png",), 100, 0)
    assert (second.group, second.without_mask, second.crop_px) == ("day2", (), 100)


@pytest.fixture
def bonn(tmp_path: Path) -> Path:
    """Two days in the layout of Bonn; the second has an image without a mask."""
    colours = np.zeros((24, 32, 3), np.uint8)
    colours[2:9, 2:12], colours[12:16, 20:26] = (0, 255, 0), (255, 0, 0)
    picture = np.full((24, 32, 3), (90, 70, 50), np.uint8)
    picture[colours.any(axis=2)] = (60, 140, 40)
    for day, masks in (("CKA_160421", 2), ("CKA_160523", 1)):
        for number in range(2):
            for folder, pixels in (("images/rgb", picture), ("annotations/dlp/color", colours)):
                if folder == "images/rgb" or number < masks:
                    path = tmp_path / "bonn" / day / folder / f"bonirob_{number}.png"
                    path.parent.mkdir(parents=True, exist_ok=True)
                    Image.fromarray(pixels).save(path)
    return tmp_path / "bonn"


def test_a_report_holds_figures_tables_and_the_images_without_a_mask(
    bonn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "analysis"
    words = ["dataset", "check", str(bonn), "--data", "bonn", "--report", str(out), "--json"]
    assert main(words) == 1  # an image lacks its mask
    printed = capsys.readouterr()
    assert json.loads(printed.out)["annotated"] == {"CKA_160421": 2, "CKA_160523": 1}
    assert f"analysis: {out / 'analysis.html'}" in printed.err
    assert (out / "without-mask.txt").read_text() == "CKA_160523/images/rgb/bonirob_1.png\n"
    with (out / "sets.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["group"], row["images"], row["annotated"]) for row in rows] == [
        ("CKA_160421", "2", "2"),
        ("CKA_160523", "2", "1"),
    ]
    with (out / "pictures.csv").open() as file:
        assert [(row["crop_px"], row["weed_px"]) for row in csv.DictReader(file)] == [
            ("70", "24")
        ] * 3
    page = (out / "analysis.html").read_text()
    assert "3 of 4 images are annotated, in 2 set(s)" in page
    assert "CKA_160523/images/rgb/bonirob_1.png" in page
    for name in ("annotated", "classes", "shares", "greenness", "weed-places", "crop-places"):
        with Image.open(out / f"{name}.png") as figure:
            assert figure.width == 1200
            assert np.ptp(np.asarray(figure.convert("L"))) > 100


def test_a_set_without_any_mask_still_has_its_report(bonn: Path, tmp_path: Path) -> None:
    for mask in bonn.rglob("annotations/dlp/color/*.png"):
        mask.unlink()
    out = tmp_path / "analysis"
    assert main(["dataset", "check", str(bonn), "--report", str(out)]) == 1
    assert len((out / "without-mask.txt").read_text().splitlines()) == 4
    assert "0 of 4 images are annotated" in (out / "analysis.html").read_text()


def test_the_values_of_phenobench_are_known_to_a_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = np.zeros((40, 40), np.uint8)
    values[:10, :10], values[20:24, 20:24] = 3, 4  # a crop and a weed that the edge cuts
    picture = np.full((40, 40, 3), (90, 70, 50), np.uint8)
    picture[values > 0] = (60, 140, 40)
    for folder, pixels in (("images", picture), ("semantics", values)):
        (tmp_path / folder).mkdir()
        Image.fromarray(pixels).save(tmp_path / folder / "a.png")
    assert main(["dataset", "check", str(tmp_path), "--data", "phenobench", "--json"]) == 0
    ratio = json.loads(capsys.readouterr().out)["pixel_ratio"]
    assert ratio == {"weed": 0.01, "crop": 0.0625, "soil": 0.9275}
