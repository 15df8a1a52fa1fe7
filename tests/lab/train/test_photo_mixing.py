"""Photographs of several folders in one training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("cv2")

from agribot.cli.data.train import run
from agribot.core.errors import ConfigError
from agribot.lab.train.photo_batches import ScaledPictures
from agribot.lab.train.photo_source import make_photo_source
from tests.lab.train.command_line import parsed
from tests.lab.train.photo_folder import photo_folder

FEW = ("--crop-px", "32", "--train-width", "96", "--size", "96x64")


def make_plain_folder(root: Path, value: int) -> Path:
    """Make a picture that is all soil (0), crop (1) or weed (2), in the layout of PhenoBench."""
    for name, picture in (
        ("images", Image.new("RGB", (90, 60), (60, 140, 50))),
        ("semantics", Image.new("L", (90, 60), value)),
    ):
        (root / name).mkdir(parents=True)
        picture.save(root / name / "0.png")
    return root


def test_the_first_of_three_folders_gives_two_thirds_of_the_photographs(tmp_path: Path) -> None:
    soil, crop, weed = (make_plain_folder(tmp_path / str(value), value) for value in range(3))
    words = ("--data", "phenobench", "--data-dir", str(soil), "--model", "agribot-sim", *FEW)
    more = ("--with", f"phenobench={crop}", "--with", f"phenobench={weed}")
    args = parsed(*words, *more, "--keep-misplaced", "--out", str(tmp_path))
    source = make_photo_source(args, lambda _text: None)
    assert source.train_images == 3
    labels = np.concatenate(
        [source.batches(np.random.default_rng(k))[1].numpy()[:, 0, 0] for k in range(40)]
    )
    shares = np.bincount(labels, minlength=3) / len(labels)
    assert shares == pytest.approx([1 / 6, 1 / 6, 2 / 3], abs=0.08)


def test_each_folder_holds_a_fold_out_and_is_named_by_it(tmp_path: Path) -> None:
    one, other = (photo_folder(tmp_path / name, count) for name, count in (("a", 4), ("b", 6)))
    words = ("--data", "cwfid", "--data-dir", str(one), "--with", f"cwfid={other}", *FEW)
    args = parsed(*words, "--folds", "2", "--fold", "0", "--out", str(tmp_path / "out"))
    source = make_photo_source(args, lambda _text: None)
    assert source.train_images == 2 + 3
    sizes = {name: len(list(pairs())) for name, pairs in source.tests.items()}
    assert sizes == {"fold 0 of 2 of a": 2, "fold 0 of 2 of b": 3}
    assert "--with cwfid=b" in source.command
    assert "; 3 of cwfid, labels " in source.recipe.data
    assert source.recipe.row_weights is None  # no rows among them


def test_pictures_of_another_shape_are_learnt_as_the_network_sees_them() -> None:
    pair = (np.zeros((120, 120, 3), np.uint8), np.zeros((120, 120), np.uint8))
    (level,) = ScaledPictures([pair], np.array([0.5]), 1_000_000, stretch=0.75)[0]
    assert level.image_rgb.shape == (45, 60, 3)
    assert level.label.shape == (45, 60)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--with", "cwfid=photos"), "--with cwfid=photos: adds to"),
        (("--drawn-share", "1"), "--drawn-share 1: out of range"),
        (("--data", "folder", "--data-dir", "x", "--with", "photos"), "write KIND=FOLDER"),
    ],
)
def test_a_mix_that_cannot_be_made_is_refused(
    words: tuple[str, ...], reason: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=reason):
        run(parsed(*words, "--steps", "1", "--out", str(tmp_path)))
