"""The layouts of known data sets, and what a command says of other folders."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main

RED, GREEN = (255, 0, 0), (0, 255, 0)


def save_pair(day: Path, masks: str, name: str, *, annotated: bool = True) -> None:
    """A picture, and a mask in colours with soil, crop and weed."""
    colours = np.zeros((24, 32, 3), np.uint8)
    colours[2:9, 2:12], colours[12:16, 20:26] = GREEN, RED
    picture = np.full((24, 32, 3), (90, 70, 50), np.uint8)
    picture[colours.any(axis=2)] = (60, 140, 40)
    for folder, pixels in (("images/rgb", picture), (masks, colours)):
        if annotated or folder == "images/rgb":
            (day / folder).mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(day / folder / f"{name}.png")


@pytest.mark.parametrize("masks", ["annotations/dlp/color", "annotations/dlp/colorCleaned"])
def test_the_layout_of_bonn_is_known_to_a_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], masks: str
) -> None:
    for number in range(3):
        save_pair(tmp_path, masks, f"bonirob_{number}")
    (tmp_path / "annotations" / "dlp" / "iMap").mkdir()
    Image.new("L", (32, 24)).save(tmp_path / "annotations" / "dlp" / "iMap" / "bonirob_0.png")
    assert main(["dataset", "check", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["pairs"], report["problems"]) == (3, [])


def test_a_check_counts_the_annotated_pictures_of_each_day(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for day, annotated in (("CKA_160421", 2), ("CKA_160523", 1)):
        for number in range(2):
            is_annotated = number < annotated
            save_pair(tmp_path / day, "annotations/dlp/color", f"{number}", annotated=is_annotated)
    assert main(["dataset", "check", str(tmp_path)]) == 1
    told = capsys.readouterr().err
    assert "CKA_160421: 2 of 2 annotated" in told
    assert "CKA_160523: 1 of 2 annotated" in told


def test_a_training_names_the_folders_that_it_wants_and_no_option_that_it_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "photos").mkdir()
    words = ["train", "--data", "bonn", "--data-dir", str(tmp_path), "--out", str(tmp_path / "o")]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert (
        "has no pair of folders with images (images/rgb) and masks (annotations/dlp/colorCleaned, "
        "annotations/dlp/color); call your folders so, or link them"
    ) in told
    assert "--masks" not in told


@pytest.mark.parametrize("words", [["dataset", "check"], ["eval"]])
def test_a_command_that_has_the_options_names_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert main([*words, str(tmp_path)]) == 2
    assert "name them with --images and --masks" in capsys.readouterr().err
