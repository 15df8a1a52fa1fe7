"""Checks find what is wrong with a set; splits keep fields and days together."""

from __future__ import annotations

import json
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image

from agribot.cli.main import main
from agribot.lab.dataset.pictures import PictureError
from agribot.lab.dataset.split import PARTS, assign, prove
from agribot.lab.train.photographs import find_pairs, read_pair
from tests import nightly

SHAPE = (12, 16)


def save(path: Path, pixels: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.asarray(pixels, np.uint8)).save(path)


def add_pair(folder: Path, name: str, value: int = 7) -> None:
    """A picture of its own, and a mask with one weed pixel and two crop pixels."""
    rng = np.random.default_rng([value, zlib.crc32(f"{folder}{name}".encode())])
    save(folder / "images" / f"{name}_image.png", rng.integers(0, 255, (*SHAPE, 3)))
    mask = np.full(SHAPE, 2)
    mask[3, 3], mask[5, 5:7] = 0, 1
    save(folder / "masks" / f"{name}_mask.png", mask)


def checked(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, Any]:
    status = main(["dataset", "check", str(folder), "--json", *words])
    return status, json.loads(capsys.readouterr().out.splitlines()[-1])


def problems(report: Any) -> set[tuple[str, str]]:
    return {(problem["kind"], Path(problem["file"]).name) for problem in report["problems"]}


def test_a_good_set_is_good_and_its_pixels_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in "abc":
        add_pair(tmp_path, name)
    status, report = checked(tmp_path, capsys)
    assert (status, report["ok"], report["pairs"]) == (0, True, 3)
    assert report["sizes"] == {"16x12": 3}
    assert report["pixel_ratio"] == pytest.approx(
        {"weed": 1 / 192, "crop": 2 / 192, "soil": 189 / 192}
    )


def add_field_pair(folder: Path, name: str, values: tuple[int, int, int]) -> None:
    """A green weed and a green crop plant on brown soil; `values` of weed, crop and soil."""
    image = np.full((80, 120, 3), (120, 90, 60))
    mask = np.full((80, 120), values[2])
    for value, columns in ((values[0], slice(10, 30)), (values[1], slice(50, 90))):
        image[20:60, columns] = (60, 140, 50)
        mask[20:60, columns] = value
    save(folder / "images" / f"{name}_image.png", image)
    save(folder / "masks" / f"{name}_mask.png", mask)


@pytest.mark.parametrize(
    ("values", "ids", "reason"),
    [
        ((2, 1, 0), "0=soil,1=crop,2=weed", "weed covers 75.0% of the pixels"),
        ((0, 2, 1), "0=weed,1=soil,2=crop", "called soil is greener"),
    ],
)
def test_ids_that_look_swapped_are_doubted_until_somebody_says_what_they_mean(
    values: tuple[int, int, int],
    ids: str,
    reason: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    add_field_pair(tmp_path, "a", values)
    status, report = checked(tmp_path, capsys)
    assert (status, report["ok"]) == (1, False)
    ((kind, detail),) = ((p["kind"], p["detail"]) for p in report["problems"])
    assert kind == "classes look swapped"
    assert reason in detail
    assert "--ids 0=soil,1=crop,2=weed" in detail
    status, report = checked(tmp_path, capsys, "--ids", ids)
    assert (status, report["ok"]) == (0, True)
    assert report["pixel_ratio"] == pytest.approx({"weed": 1 / 12, "crop": 2 / 12, "soil": 9 / 12})


CLASS_RGB = ((255, 0, 0), (0, 255, 0), (0, 0, 0))  # weed, crop, soil
SWAPPED_RGB = ((0, 0, 0), (0, 255, 0), (255, 0, 0))
VOC_RGB = ((0, 0, 0), (128, 0, 0), (0, 128, 0))  # of the values 0, 1, 2
GREY_RGB = ((0, 0, 0), (1, 1, 1), (2, 2, 2))
FIELD_RATIO = {"weed": 1 / 12, "crop": 2 / 12, "soil": 9 / 12}


def save_field_colours(
    folder: Path, values: tuple[int, int, int], colours: tuple[tuple[int, ...], ...], mode: str
) -> None:
    """The field of `add_field_pair`, each value shown in its colour, as RGB or with a palette."""
    add_field_pair(folder, "a", values)
    path = folder / "masks" / "a_mask.png"
    indexes = np.asarray(Image.open(path))
    if mode == "P":
        mask = Image.fromarray(indexes)
        mask.putpalette([channel for colour in colours for channel in colour])
        assert mask.mode == "P"
        mask.save(path)
    else:
        save(path, np.array(colours)[indexes])


@pytest.mark.parametrize("mode", ["RGB", "P"])
def test_ids_silence_no_doubt_about_colours_that_they_do_not_speak_of(
    mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_field_colours(tmp_path, (0, 1, 2), SWAPPED_RGB, mode)
    status, report = checked(tmp_path, capsys)
    ((kind, detail),) = ((p["kind"], p["detail"]) for p in report["problems"])
    assert (status, kind) == (1, "classes look swapped")
    assert "red weed, green crop, black or blue soil. Paint yours so" in detail
    assert "--ids 0=soil,1=crop,2=weed" not in detail
    status, report = checked(tmp_path, capsys, "--ids", "0=soil,1=crop,2=weed")
    ((kind, detail),) = ((p["kind"], p["detail"]) for p in report["problems"])
    assert (status, report["pairs"], kind) == (1, 0, "no class mask")
    assert "shows colours, and --ids names values; leave --ids out" in detail


@pytest.mark.parametrize("mode", ["RGB", "P"])
def test_right_colours_are_never_read_as_other_values(
    mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The order of a palette says nothing: here soil comes first.
    save_field_colours(tmp_path, (1, 2, 0), (CLASS_RGB[2], *CLASS_RGB[:2]), mode)
    status, report = checked(tmp_path, capsys)
    assert (status, report["pixel_ratio"]) == (0, pytest.approx(FIELD_RATIO))
    status, report = checked(tmp_path, capsys, "--ids", "0=weed,1=crop,2=soil")
    assert (status, report["pairs"]) == (1, 0)


@pytest.mark.parametrize(("colours", "mode"), [(VOC_RGB, "P"), (GREY_RGB, "P"), (GREY_RGB, "RGB")])
def test_values_are_read_as_ids_say_however_they_are_stored(
    colours: tuple[tuple[int, ...], ...],
    mode: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    save_field_colours(tmp_path, (2, 1, 0), colours, mode)
    status, report = checked(tmp_path, capsys)
    assert status == 1
    (detail,) = (p["detail"] for p in report["problems"] if p["kind"] == "unknown class")
    assert "say which value is what: --ids 0=CLASS,1=CLASS,2=CLASS (found: 0 75.0%" in detail
    status, report = checked(tmp_path, capsys, "--ids", "0=soil,1=crop,2=weed")
    assert (status, report["pixel_ratio"]) == (0, pytest.approx(FIELD_RATIO))


def test_the_greys_of_a_palette_are_its_values_whatever_their_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A mask without crop, as programs that make PNG files smaller store it.
    save_field_colours(tmp_path, (1, 0, 0), (GREY_RGB[0], GREY_RGB[2]), "P")
    status, report = checked(tmp_path, capsys, "--ids", "0=soil,1=crop,2=weed")
    assert (status, report["pixel_ratio"]["weed"]) == (0, pytest.approx(1 / 12))


def test_a_field_full_of_weeds_passes_once_its_ids_are_confirmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(tmp_path / "images" / "a.png", np.full((8, 8, 3), (60, 140, 50)))
    save(tmp_path / "masks" / "a.png", np.zeros((8, 8)))
    assert checked(tmp_path, capsys)[0] == 1
    assert checked(tmp_path, capsys, "--ids", "0=weed,1=crop,2=soil")[0] == 0


@pytest.mark.parametrize("ids", ["0=soil,1=maize", "x=soil", "0=soil,0=crop", "70000=soil", ""])
def test_ids_that_name_no_class_are_refused_in_one_line(
    ids: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add_pair(tmp_path, "a")
    assert main(["dataset", "check", str(tmp_path), "--ids", ids]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"--ids {ids}: " in line


def test_pictures_saved_as_webp_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add_pair(tmp_path, "a")
    path = tmp_path / "images" / "a_image.png"
    Image.open(path).save(path.with_suffix(".webp"), lossless=True)
    path.unlink()
    status, report = checked(tmp_path, capsys)
    assert (status, report["pairs"]) == (0, 1)


def test_every_kind_of_damage_is_named_with_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in "abcdefg":
        add_pair(tmp_path, name)
    (tmp_path / "masks/a_mask.png").unlink()
    (tmp_path / "images/b_image.png").unlink()
    (tmp_path / "images/c_image.png").write_bytes(b"no picture")
    save(tmp_path / "masks/d_mask.png", np.full((6, 8), 2))
    save(tmp_path / "masks/e_mask.png", np.full(SHAPE, 77))
    save(tmp_path / "masks/g_mask.png", np.full(SHAPE, 255))
    broken = (tmp_path / "masks/f_mask.png").read_bytes()
    (tmp_path / "masks/f_mask.png").write_bytes(broken[: len(broken) // 2])
    status, report = checked(tmp_path, capsys)
    assert status == 1
    assert problems(report) == {
        ("image without mask", "a_image.png"),
        ("mask without image", "b_mask.png"),
        ("unreadable", "c_image.png"),
        ("sizes differ", "d_image.png"),
        ("unknown class", "e_mask.png"),
        ("unreadable", "f_mask.png"),
        ("nothing labelled", "g_mask.png"),
    }


def test_a_file_whose_name_is_no_text_is_named_and_spoils_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in "ab":
        add_pair(tmp_path, name)
    latin = os.fsdecode(b"R\xfcbe_image.png")  # of an archive that an old computer packed
    try:
        shutil.copy(tmp_path / "images/a_image.png", tmp_path / "images" / latin)
    except OSError:
        pytest.skip("a file system whose names are text")
    status, report = checked(tmp_path, capsys)
    assert (status, report["pairs"]) == (1, 2)
    (problem,) = report["problems"]
    assert problem["kind"] == "name is not text in UTF-8; rename it"
    assert problem["file"] == "images/R\\udcfcbe_image.png"
    words = ["--by", "image", "--ratios", "1,1,0", "-o", str(tmp_path / "split.json")]
    assert main(["dataset", "split", str(tmp_path), *words]) == 0
    pairs, problems_found = find_pairs(tmp_path, "folder")
    assert (len(pairs), len(problems_found)) == (2, 1)
    seen = tmp_path / "seen"
    assert main(["predict", str(tmp_path / "images"), "--only", "mask", "-o", str(seen)]) == 1
    assert "left out: " in capsys.readouterr().err
    assert len(list(seen.glob("*-mask.png"))) == 2


def test_a_photograph_is_checked_upright_as_a_training_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6  # to be turned by 90 degrees
    pixels = np.full((*SHAPE, 3), 90, np.uint8)
    (tmp_path / "images").mkdir()
    Image.fromarray(np.rot90(pixels)).save(tmp_path / "images/a.jpg", exif=exif)
    save(tmp_path / "masks/a.png", np.full(SHAPE, 2))
    status, report = checked(tmp_path, capsys)
    assert (status, report["sizes"]) == (0, {"16x12": 1})
    save(tmp_path / "masks/a.png", np.full(SHAPE[::-1], 2))  # of a tool that ignores EXIF
    status, report = checked(tmp_path, capsys)
    assert (status, problems(report)) == (1, {("sizes differ", "a.jpg")})
    pairs, _ = find_pairs(tmp_path, "folder")
    with pytest.raises(PictureError, match="12 x 16 pixels, its image 16 x 12"):
        read_pair(pairs[0])


def test_colours_mean_weed_crop_and_soil_whether_soil_is_blue_or_black(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add_pair(tmp_path, "a")
    colours = np.zeros((*SHAPE, 3))
    colours[:6, :, 2] = 255
    colours[0, :4] = (255, 0, 0)
    colours[1, :2] = (0, 255, 0)
    save(tmp_path / "masks" / "a_mask.png", colours)
    status, report = checked(tmp_path, capsys)
    assert status == 0
    assert report["pixel_ratio"] == pytest.approx(
        {"weed": 4 / 192, "crop": 2 / 192, "soil": 186 / 192}
    )


def test_a_folder_without_images_says_where_they_were_sought(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "check", str(tmp_path)]) == 2
    assert "--images" in capsys.readouterr().err


def split_of(folder: Path, tmp_path: Path, *words: str) -> tuple[int, Any]:
    out = tmp_path / "split.json"
    status = main(["dataset", "split", str(folder), "-o", str(out), *words])
    return status, json.loads(out.read_text()) if out.exists() else None


def days(folder: Path) -> None:
    for day in range(20, 28):
        for frame in range(4 + day % 3):
            add_pair(folder / f"CKA_1604{day}", f"frame_{frame:03d}")


@pytest.mark.parametrize("by", ["field", "day"])
def test_no_day_is_in_two_parts_and_no_image_is_lost(tmp_path: Path, by: str) -> None:
    days(tmp_path / "set")
    status, result = split_of(tmp_path / "set", tmp_path, "--by", by, "--ratios", "60,20,20")
    assert status == 0
    day_sets = [{Path(image).parts[0] for image in result[part]} for part in PARTS]
    assert all(day_sets) and sum(map(len, day_sets)) == len(set().union(*day_sets)) == 8
    images = [image for part in PARTS for image in result[part]]
    assert len(images) == len(set(images)) == result["proof"]["images_total"] == 40
    assert result["reached"]["train"] == pytest.approx(0.6, abs=0.1)


def test_the_seed_decides_and_repeats(tmp_path: Path) -> None:
    days(tmp_path / "set")
    splits = [split_of(tmp_path / "set", tmp_path, "--seed", seed)[1] for seed in "00123"]
    assert splits[0] == splits[1]
    assert len({tuple(s["test"]) for s in splits}) > 1


def test_the_images_of_one_generated_field_stay_together(tmp_path: Path) -> None:
    small = ["--width", "32", "--height", "24", "--views", "2", "--workers", "1"]
    folder = tmp_path / "set"
    assert main(["dataset", "generate", "--images", "8", "--out", str(folder), *small]) == 0
    assert main(["dataset", "check", str(folder)]) == 0
    status, result = split_of(folder, tmp_path, "--ratios", "50,25,25")
    assert status == 0
    for part, fields in (("train", 2), ("val", 1), ("test", 1)):
        numbers = sorted(int(Path(image).stem) for image in result[part])
        assert len({number // 2 for number in numbers}) == fields == len(numbers) // 2


def test_one_field_cannot_be_split_without_a_leak(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in "abcdef":
        add_pair(tmp_path / "set", name)
    assert split_of(tmp_path / "set", tmp_path) == (2, None)
    assert "--by image" in capsys.readouterr().err
    status, result = split_of(tmp_path / "set", tmp_path, "--by", "image")
    assert status == 0
    assert result["proof"]["groups_stay_together"] is False


def test_the_same_picture_in_two_parts_is_a_leak(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for day in ("160421", "160422", "160423"):
        add_pair(tmp_path / "set" / day, "a")
    first, second = (tmp_path / "set" / day / "images/a_image.png" for day in ("160421", "160422"))
    second.write_bytes(first.read_bytes())
    status, result = split_of(tmp_path / "set", tmp_path)
    assert status == 1
    assert len(result["proof"]["equal_files_in_two_parts"]) == 1
    assert "NOT OK" in capsys.readouterr().err


def test_the_proof_notices_a_group_that_was_torn_apart(tmp_path: Path) -> None:
    for name in "abc":
        (tmp_path / name).write_bytes(name.encode())
    images = {"train": ("a", "b"), "val": ("c",), "test": ("b",)}
    proof = prove(tmp_path, images, {"a": "x", "b": "y", "c": "x", "d": "z"}, "field")
    assert not proof.ok
    assert proof.groups_in_two_parts == ("x", "y")
    assert proof.images_in_two_parts == ("b",)
    assert proof.images_in_no_part == ("d",)


def test_every_part_that_wants_images_gets_a_group() -> None:
    wanted = {"train": 0.9, "val": 0.05, "test": 0.05}
    for seed in range(20):
        assert set(assign({"a": 50, "b": 3, "c": 2}, wanted, seed, "field").values()) == set(PARTS)
    only = assign({"a": 5, "b": 5}, {"train": 0.5, "val": 0.0, "test": 0.5}, 0, "field")
    assert sorted(only.values()) == ["test", "train"]


@nightly.by_day("test_a_good_set_is_good_and_its_pixels_are_counted")
@pytest.mark.skipif("AGRIBOT_DATA" not in os.environ, reason="AGRIBOT_DATA names no data folder")
def test_the_carrot_field_of_cwfid_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    status, report = checked(Path(os.environ["AGRIBOT_DATA"]) / "cwfid-train", capsys)
    assert (status, report["problems"]) == (0, [])
    assert report["pairs"] == report["images"] == report["masks"] >= 39
    assert report["sizes"] == {"1296x966": report["pairs"]}
    assert report["without_plants"] == 0
    assert 0.005 < report["pixel_ratio"]["crop"] < report["pixel_ratio"]["weed"] < 0.2
