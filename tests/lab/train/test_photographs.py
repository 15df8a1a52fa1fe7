from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass
from agribot.lab.dataset.pictures import PictureError
from agribot.lab.train.photographs import (
    KINDS,
    Pair,
    find_pairs,
    read_label,
    read_pairs,
    split_fold,
)
from tests.lab.train.drawn_images import drawn_image
from tests.lab.train.photo_folder import photo_folder, spoil


def test_every_pair_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    pairs, problems = find_pairs(photo_folder(tmp_path, 3), "cwfid")
    assert problems == []
    for index, (image_rgb, label) in enumerate(read_pairs(pairs, problems.append)):
        expected_image, expected_label = drawn_image(np.random.default_rng(index))
        np.testing.assert_array_equal(image_rgb, expected_image)
        np.testing.assert_array_equal(label, expected_label)
    assert len(pairs) == 3


def test_broken_pairs_are_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path, 7)
    broken = spoil(folder)
    pairs, problems = find_pairs(folder, "cwfid")
    assert len(list(read_pairs(pairs, problems.append))) == 2
    assert len(problems) == len(broken)
    for name in broken:
        assert sum(name in problem for problem in problems) == 1
    reasons = " ".join(problems)
    for reason in ("0 bytes", "decoded", "9 x 9", "without a mask", "25 pixels"):
        assert reason in reasons


def test_a_folder_without_a_whole_pair_is_refused(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path, 1)
    (folder / "annotations" / "000_annotation.png").unlink()
    with pytest.raises(ConfigError, match="no image with a mask"):
        find_pairs(folder, "cwfid")


def test_the_bonn_layout_pairs_by_name_and_keeps_days_apart(tmp_path: Path) -> None:
    for day in ("CKA_160421", "CKA_160523"):
        for folder in ("images/rgb", "annotations/dlp/colorCleaned"):
            (tmp_path / day / folder).mkdir(parents=True)
            Image.new("RGB", (8, 6), (0, 255, 0)).save(tmp_path / day / folder / "bonirob_1.png")
    pairs, problems = find_pairs(tmp_path, "bonn")
    assert [pair.group for pair in pairs] == ["CKA_160421", "CKA_160523"]
    assert problems == []
    train, held = split_fold(pairs, 2, 1)
    assert [pair.group for pair in train] == ["CKA_160421"]
    assert [pair.group for pair in held] == ["CKA_160523"]


def test_the_ids_of_phenobench_become_our_classes(tmp_path: Path) -> None:
    path = tmp_path / "semantics.png"
    for dtype in (np.uint8, np.uint16):
        Image.fromarray(np.array([[0, 1, 2, 3, 4]], dtype)).save(path)
        label = read_label(path, KINDS["phenobench"].ids)
        soil, crop, weed = PlantClass.SOIL, PlantClass.CROP, PlantClass.WEED
        assert label.tolist() == [[soil, crop, weed, crop, weed]]
    Image.fromarray(np.full((2, 2), 9, np.uint8)).save(path)
    with pytest.raises(PictureError, match=r"4 pixels .*: values 0, 1, 2, 3, 4; .*: --ids 9=CLASS"):
        read_label(path, KINDS["phenobench"].ids)


def test_a_mask_of_colours_where_values_are_wanted_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    Image.new("RGB", (2, 2), (255, 0, 0)).save(path)
    assert (read_label(path, {}) == PlantClass.WEED).all()
    with pytest.raises(PictureError, match="masks of this --data hold values"):
        read_label(path, KINDS["phenobench"].ids)
    with pytest.raises(PictureError, match="--ids names values; leave --ids out"):
        read_label(path, {0: PlantClass.SOIL}, is_named=True)


def test_a_refusal_names_the_values_of_the_data_or_those_that_were_given(tmp_path: Path) -> None:
    for name, value in (("images", 90), ("semantics", 9)):
        (tmp_path / name).mkdir()
        Image.new("L", (8, 8), value).save(tmp_path / name / "a.png")
    for ids, said in ((None, "values 0, 1, 2, 3, 4"), ({7: 0}, "values 7, as --ids says")):
        pairs, problems = find_pairs(tmp_path, "phenobench", ids=ids)
        assert list(read_pairs(pairs, problems.append)) == []
        assert f"allowed: {said}; say which value is what: --ids 9=CLASS" in problems[0]


def test_a_phenobench_folder_is_read(tmp_path: Path) -> None:
    for name, value in (("images", 90), ("semantics", 1)):
        (tmp_path / name).mkdir()
        Image.new("L", (8, 8), value).save(tmp_path / name / "05-15_00028.png")
    pairs, _ = find_pairs(tmp_path, "phenobench")
    ((_, label),) = read_pairs(pairs, pytest.fail)
    assert (label == PlantClass.CROP).all()


def pair(name: str, group: str = "") -> Pair:
    return Pair(image=Path(f"{name}.png"), mask=Path(f"{name}-mask.png"), group=group)


def test_folds_share_nothing_and_cover_everything() -> None:
    pairs = [pair(str(index)) for index in range(39)]
    held = [split_fold(pairs, 5, fold)[1] for fold in range(5)]
    names = [p.image for part in held for p in part]
    assert sorted(names) == sorted(p.image for p in pairs)
    for fold in range(5):
        train, test = split_fold(pairs, 5, fold)
        assert not {p.image for p in train} & {p.image for p in test}
        assert len(train) + len(test) == 39


def test_a_field_is_never_on_both_sides() -> None:
    pairs = [pair(f"{group}{index}", group) for group in "abcdef" for index in range(4)]
    for fold in range(3):
        train, test = split_fold(pairs, 3, fold)
        assert not {p.group for p in train} & {p.group for p in test}


@pytest.mark.parametrize(("folds", "fold"), [(1, 0), (9, 0), (3, 3), (3, -1)])
def test_impossible_folds_are_refused(folds: int, fold: int) -> None:
    with pytest.raises(ConfigError, match="--fold"):
        split_fold([pair(str(index)) for index in range(8)], folds, fold)
