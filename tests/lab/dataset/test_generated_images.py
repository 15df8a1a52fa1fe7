"""Generated data sets: what is written agrees with itself and does not depend on how it came."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.lab.dataset.run_lengths import instance_run_lengths
from tests import nightly

SMALL = ("--width", "96", "--height", "72", "--views", "2", "--seed", "5")
IMAGES = 4


def generate(folder: Path, images: int, *more: str) -> int:
    words = ["dataset", "generate", "--images", str(images), "--out", str(folder), *SMALL]
    return main([*words, "--workers", "1", *more])


def read(folder: Path, name: str) -> Any:
    with Image.open(folder / name) as image:
        return np.asarray(image)


def contents(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("generated") / "set"
    assert generate(folder, IMAGES, "--colour") == 0
    return folder


def decoded(segmentation: dict[str, Any]) -> Any:
    """A mask from compressed run lengths, written after the description of the COCO format."""
    counts: list[int] = []
    value = shift = 0
    for letter in segmentation["counts"].encode():
        code = letter - 48
        value |= (code & 31) << shift
        shift += 5
        if not code & 32:
            value -= (1 << shift) if code & 16 else 0
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value = shift = 0
    height, width = segmentation["size"]
    pixels = np.repeat(np.arange(len(counts)) % 2, counts)
    return pixels.reshape(width, height).T.astype(bool)


def test_every_annotation_is_the_plant_of_the_instance_mask(folder: Path) -> None:
    coco = json.loads((folder / "annotations.json").read_text())
    kinds = {entry["id"]: entry["supercategory"] for entry in coco["categories"]}
    assert len(coco["annotations"]) > 20
    for entry in coco["annotations"]:
        name = f"{entry['image_id']:06d}.png"
        mask = read(folder, f"instances/{name}") == entry["instance"]
        assert np.array_equal(decoded(entry["segmentation"]), mask)
        left, top, width, height = entry["bbox"]
        assert mask[top : top + height, left : left + width].sum() == mask.sum() == entry["area"]
        assert mask[top].any() and mask[:, left].any()
        classes = read(folder, f"masks/{name}")[mask]
        assert set(classes.tolist()) == {0 if kinds[entry["category_id"]] == "weed" else 1}


@nightly.by_day(
    "test_every_annotation_is_the_plant_of_the_instance_mask",
    "tests/lab/dataset/test_random_scenes.py::"
    "test_wide_fields_have_every_species_and_litter_on_the_soil",
)
def test_a_set_of_all_species_has_an_annotation_of_each_plant_too(tmp_path: Path) -> None:
    folder = tmp_path / "wide"
    assert generate(folder, 6, "--variety", "wide") == 0
    coco = json.loads((folder / "annotations.json").read_text())
    names = {entry["id"]: entry["name"] for entry in coco["categories"]}
    seen = {names[entry["category_id"]] for entry in coco["annotations"]}
    assert seen & {"carrot", "onion", "chickweed", "plantain", "charlock", "chamomile"}


@nightly.one_by_one("pictures", (6, 20), in_suite=1)
def test_seedlings_are_seen_in_red_and_infrared_from_above(pictures: int, tmp_path: Path) -> None:
    folder = tmp_path / "seedlings"
    assert generate(folder, pictures, "--variety", "seedlings", "--seed", "1") == 0
    with (folder / "plants.csv").open() as file:
        assert {"carrot", "chamomile"} <= {plant["species"] for plant in csv.DictReader(file)}
    leaf, soil = [], []
    for path in sorted((folder / "images").glob("*.png")):
        image, mask = read(folder, f"images/{path.name}"), read(folder, f"masks/{path.name}")
        assert np.array_equal(image[..., 0], image[..., 2]), "two bands, red shown twice"
        ratio = (image[..., 1] + 1.0) / (image[..., 0] + 1.0)
        leaf.append(np.median(ratio[mask != 2]))
        soil.append(np.median(ratio[mask == 2]))
    assert np.median(leaf) > 2.0, "2.75 in the photographs of CWFID, which have more pixels"
    assert 0.8 < np.median(soil) < 1.3
    assert (np.array(leaf) > 1.4 * np.array(soil)).all()


def test_a_picture_without_plants_has_no_run_lengths() -> None:
    assert instance_run_lengths(np.zeros((4, 6), dtype=np.int32)) == {}


def test_every_plant_pixel_belongs_to_one_annotation(folder: Path) -> None:
    coco = json.loads((folder / "annotations.json").read_text())
    for index in range(IMAGES):
        area = sum(e["area"] for e in coco["annotations"] if e["image_id"] == index)
        mask = read(folder, f"masks/{index:06d}.png")
        assert area == (mask != 2).sum() == (read(folder, f"instances/{index:06d}.png") > 0).sum()
        colour = read(folder, f"colour/{index:06d}.png")
        assert np.array_equal(colour.argmax(axis=2), mask)


def rotation(qx: float, qy: float, qz: float, qw: float) -> Any:
    cross = np.array([[0, -qz, qy], [qz, 0, -qx], [-qy, qx, 0]])
    return np.eye(3) + 2 * qw * cross + 2 * cross @ cross


def test_a_plant_projects_near_its_pixels_through_the_written_pose_and_depth(folder: Path) -> None:
    with (folder / "poses.csv").open() as file:
        poses = {row.pop("image"): row for row in csv.DictReader(file)}
    errors_m = []
    with (folder / "plants.csv").open() as file:
        for plant in csv.DictReader(file):
            pose = {name: float(text) for name, text in poses[plant["image"]].items()}
            name = Path(plant["image"]).name
            mask = read(folder, f"instances/{name}") == int(plant["instance"])
            rows, columns = np.nonzero(mask)
            z_m = read(folder, f"depth/{name}")[mask] / 1000.0
            x_m = (columns - pose["cx_px"]) / pose["focal_px"] * z_m
            y_m = (rows - pose["cy_px"]) / pose["focal_px"] * z_m
            turn = rotation(pose["qx"], pose["qy"], pose["qz"], pose["qw"])
            seen_m = turn @ np.stack([x_m, y_m, z_m])
            seen_m += np.array([[pose["x_map_m"]], [pose["y_map_m"]], [pose["z_map_m"]]])
            away_m = np.hypot(
                seen_m[0] - float(plant["x_map_m"]), seen_m[1] - float(plant["y_map_m"])
            )
            # Mixed pixels at the outline apart, leaves reach no farther than about their height.
            errors_m.append(float(np.median(away_m)) / float(plant["size_m"]))
    assert len(errors_m) > 20
    assert np.median(errors_m) < 0.6
    assert max(errors_m) < 3.0


def test_going_on_gives_the_bytes_of_an_uninterrupted_run(folder: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    assert generate(again, 3, "--colour") == 0
    (again / "records" / "000001.json").unlink()  # as if killed while writing image 1
    (again / "images" / "000001.png").write_bytes(b"half")
    assert generate(again, IMAGES, "--colour") == 0
    assert contents(again) == contents(folder)


def test_another_seed_or_view_is_another_image(folder: Path, tmp_path: Path) -> None:
    assert generate(tmp_path / "other", 2, "--seed", "6") == 0
    images = [read(folder, f"images/{k:06d}.png").tobytes() for k in range(IMAGES)]
    images += [read(tmp_path / "other", f"images/{k:06d}.png").tobytes() for k in range(2)]
    assert len(set(images)) == IMAGES + 2


def test_the_folder_of_another_recipe_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(folder)
    assert generate(folder, IMAGES, "--colour", "--seed", "9") == 2
    assert "seed 5, not 9" in capsys.readouterr().err
    assert contents(folder) == before


@pytest.mark.parametrize("words", [("--images", "0"), ("--supersample", "9"), ("--width", "3")])
def test_an_option_out_of_range_names_itself(
    words: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert generate(tmp_path / "set", 2, *words) == 2
    assert words[0] in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


@pytest.mark.slow
@nightly.one_by_one("workers", ("1", "2"), in_suite=1)
def test_an_interruption_leaves_readable_images_and_the_rest_can_be_drawn(
    workers: str, tmp_path: Path
) -> None:
    folder, images = tmp_path / "set", 400
    words = ["dataset", "generate", "--images", str(images), "--out", str(folder), *SMALL]
    command = [sys.executable, "-m", "agribot.cli", *words, "--workers", workers]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True) as process:
        deadline_s = time.monotonic() + 120.0
        while not list(folder.glob("records/*.json")) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(120) == 130
    records = list(folder.glob("records/*.json"))
    assert 0 < len(records) < images
    coco = json.loads((folder / "annotations.json").read_text())
    assert len(coco["images"]) == len(records)
    for entry in coco["images"]:
        assert read(folder, entry["file_name"]).shape == (72, 96, 3)
    assert not list(folder.rglob("*.new"))
