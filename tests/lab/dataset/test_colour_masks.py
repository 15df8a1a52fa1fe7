"""Masks of other tools: their colours by the table beside them, by --ids, or with what to write."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.classes import read_ids
from agribot.lab.labelling.guesses import Guess
from agribot.lab.labelling.label_folder import LabelFolder
from agribot.lab.train.photographs import find_pairs, read_pair

SHAPE = (40, 60)
# VOC and CVAT: soil, crop, weed.
VOC = {PlantClass.SOIL: 0x000000, PlantClass.CROP: 0x800000, PlantClass.WEED: 0x008000}
IDS = "000000=soil,800000=crop,008000=weed"
LABELMAP = "# label:color_rgb:parts:actions\nbackground:0,0,0::\ncrop:128,0,0::\nweed:0,128,0::\n"


def truth() -> ByteArray:
    label = np.full(SHAPE, PlantClass.SOIL, np.uint8)
    label[5:12, 5:15] = PlantClass.CROP
    label[25:30, 40:46] = PlantClass.WEED
    return label


def make_set(folder: Path, mask: Image.Image, name: str = "a.png") -> Path:
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True)
    plant = (truth() < PlantClass.SOIL)[..., None]
    picture = np.where(plant, (60, 150, 50), (120, 90, 60)).astype(np.uint8)
    Image.fromarray(picture).save(folder / "images" / "a.png")
    mask.save(folder / "masks" / name)
    return folder


def paint() -> Image.Image:
    colours = np.zeros((*SHAPE, 3), np.uint8)
    for kind, code in VOC.items():
        colours[truth() == kind] = (code >> 16, code >> 8 & 255, code & 255)
    return Image.fromarray(colours)


def in_values(mode: str, soil: int, crop: int, weed: int) -> Image.Image:
    """Write soil, crop and weed as values of a mode."""
    values = np.choose(truth(), (weed, crop, soil))
    if mode == "I;16":
        return Image.fromarray(values.astype(np.uint16))
    grey = Image.fromarray(values.astype(np.uint8))
    return Image.fromarray(values > 0) if mode == "1" else grey.convert(mode)


def read(folder: Path, ids: str | None = None) -> ByteArray:
    (pair,), problems = find_pairs(folder, "folder", ids=read_ids(ids))
    assert problems == []
    return read_pair(pair)[1]


def check(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, Any]:
    capsys.readouterr()
    status = main(["dataset", "check", str(folder), "--json", *words])
    return status, json.loads(capsys.readouterr().out.splitlines()[-1])


def test_colours_are_read_as_ids_name_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(tmp_path / "set", paint())
    assert np.array_equal(read(folder, IDS), truth())
    assert check(folder, capsys, "--ids", "#" + IDS.replace(",", ",#"))[0] == 0


def test_colours_that_nobody_named_are_listed_with_what_to_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(tmp_path / "set", paint())
    status, report = check(folder, capsys)
    (problem,) = report["problems"]
    assert (status, problem["kind"]) == (1, "unknown class")
    advice = "say which colour is what: --ids 000000=CLASS,800000=CLASS,008000=CLASS"
    assert f"{advice} (found: 000000 95.8%, 800000 2.9%, 008000 1.2%)" in problem["detail"]
    _, report = check(folder, capsys, "--ids", "000000=soil,800000=crop")
    assert report["problems"][0]["detail"].startswith("30 pixels; say which colour is what")


TABLES = {
    "labelmap.txt": LABELMAP,
    "masks/labelmap.txt": LABELMAP.replace("\n", "\r\n"),
    "class_dict.csv": "name,r,g,b\nbackground,0,0,0\ncrop,128,0,0\nweed,0,128,0\n",
    "label_colors.txt": "0 0 0\tVoid\n128 0 0\tcrop\n0 128 0\tweed\n",
    "masks/class_dict.csv": "name;r;g;b\nSoil;0;0;0\nCrop;128;0;0\nWeed;0;128;0\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_the_table_of_a_tool_beside_its_masks_is_read(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(tmp_path / "set", paint().quantize(8))
    (folder / name).write_text(TABLES[name], "utf-8-sig")
    assert np.array_equal(read(folder), truth())
    assert check(folder, capsys)[0] == 0


def test_a_table_of_values_as_roboflow_writes_it_is_read(tmp_path: Path) -> None:
    folder = make_set(tmp_path / "set", in_values("L", 0, 1, 2), "a_mask.png")
    table = "Pixel Value, Class\n0, background\n1, crop\n2, weed\n"
    (folder / "masks" / "_classes.csv").write_text(table)
    assert np.array_equal(read(folder), truth())


def test_names_of_a_table_that_are_no_class_are_asked_for_with_all_else_filled_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(tmp_path / "set", paint())
    (folder / "labelmap.txt").write_text(LABELMAP.replace("crop", "beet"))
    assert main(["dataset", "check", str(folder)]) == 2
    said = capsys.readouterr().err
    assert "labelmap.txt: 800000 is 'beet'; say which class of weed, crop, soil, ignore" in said
    assert "--ids 000000=soil,800000=CLASS,008000=weed" in said
    assert check(folder, capsys, "--ids", IDS)[0] == 0


@pytest.mark.parametrize("text", ["crop\n", "crop:300,0,0::\n", "", "crop:a,b,c::\n", "\0"])
def test_a_table_that_is_none_is_refused_by_name(text: str, tmp_path: Path) -> None:
    folder = make_set(tmp_path / "set", paint())
    (folder / "labelmap.txt").write_text(text)
    with pytest.raises(
        ConfigError, match=r"labelmap\.txt (is no table of colours|names no colour)"
    ):
        find_pairs(folder, "folder")


@pytest.mark.parametrize("mode", ["LA", "I;16", "L", "RGB"])
def test_grey_values_of_every_depth_are_read(mode: str, tmp_path: Path) -> None:
    folder = make_set(tmp_path / "set", in_values(mode, 0, 1, 2))
    assert np.array_equal(read(folder, "0=soil,1=crop,2=weed"), truth())
    usual = make_set(tmp_path / "usual", in_values(mode, 2, 1, 0))
    if mode != "RGB":
        assert np.array_equal(read(usual), truth())


def test_values_of_16_bits_are_named_by_ids_and_listed_without(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(tmp_path / "set", in_values("I;16", 500, 1000, 65535))
    assert np.array_equal(read(folder, "500=soil,1000=crop,65535=weed"), truth())
    _, report = check(folder, capsys, "--ids", "500=soil,1000=crop")
    advice = "--ids 500=CLASS,1000=CLASS,65535=CLASS (found: 500 95.8%, 1000 2.9%, 65535 1.2%)"
    assert report["problems"][0]["detail"] == f"30 pixels; say which value is what: {advice}"


def test_masks_of_jpeg_are_not_to_be_used_by_their_many_colours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = Image.fromarray(np.random.default_rng(1).integers(0, 9, (*SHAPE, 3), np.uint8))
    _, report = check(make_set(tmp_path / "set", noise), capsys)
    assert "export the masks as PNG" in report["problems"][0]["detail"]


@pytest.mark.parametrize("ids", ["0=soil,1=crop", "0=soil,255=crop"])
def test_a_mask_of_black_and_white_is_read_as_ids_say(ids: str, tmp_path: Path) -> None:
    folder = make_set(tmp_path / "set", in_values("1", 0, 1, 1))
    found = read(folder, ids)
    assert np.array_equal(found == PlantClass.CROP, truth() < PlantClass.SOIL)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("80000=crop", "a colour RRGGBB"),
        ("0=soil,800000=crop", "values and colours; name either"),
        ("800000=crop,800000=weed", "given twice"),
    ],
)
def test_colours_that_are_none_are_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_ids(text)


def test_masks_are_written_as_values_only(tmp_path: Path) -> None:
    def guess(_picture: ByteArray) -> Guess:
        raise AssertionError("no picture is looked at")

    folder = make_set(tmp_path / "set", paint())
    with pytest.raises(ConfigError, match="masks are written as values"):
        LabelFolder(folder, guess, "none", read_ids(IDS))
