"""Labels that lie beside the plants are found picture by picture; honest ones are believed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.placement import PlacementTally
from agribot.lab.train.photo_source import make_photo_source
from agribot.lab.train.photographs import find_pairs, read_pair
from tests.lab.train.command_line import parsed

WIDTH, HEIGHT = 240, 160
COUNT = 10
Change = Callable[[ByteArray], ByteArray]


def draw_label(rng: np.random.Generator) -> ByteArray:
    """Draw twelve leaves of several sizes anywhere."""
    down, right = np.mgrid[:HEIGHT, :WIDTH]
    label = np.full((HEIGHT, WIDTH), PlantClass.SOIL, np.uint8)
    for number in range(12):
        u, v = rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT)
        half = rng.uniform(4, 12, 2)
        is_leaf = ((right - u) / half[0]) ** 2 + ((down - v) / half[1]) ** 2 < 1.0
        label[is_leaf] = number % 2
    return label


def draw_picture(label: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Draw green leaves on brown soil, both with grain."""
    is_plant = (label < PlantClass.SOIL)[..., None]
    colour = np.where(is_plant, (60, 150, 50), (120, 90, 60))
    return (colour + rng.integers(-12, 12, (HEIGHT, WIDTH, 3))).astype(np.uint8)


def make_set(count: int = COUNT) -> list[tuple[ByteArray, ByteArray]]:
    rng = np.random.default_rng(1)
    labels = [draw_label(rng) for _ in range(count)]
    return [(draw_picture(label, rng), label) for label in labels]


def judge(pairs: list[tuple[ByteArray, ByteArray]]) -> PlacementTally:
    tally = PlacementTally()
    for number, (picture, label) in enumerate(pairs):
        tally.add(f"p{number}", picture, np.ascontiguousarray(label))
    return tally


def turn_on_its_side(label: ByteArray) -> ByteArray:
    """Turn labels in shares of the picture, made before its EXIF turn, as they are painted."""
    rows = np.arange(HEIGHT) * WIDTH // HEIGHT
    columns = np.arange(WIDTH) * HEIGHT // WIDTH
    turned: ByteArray = np.rot90(label)[rows[:, None], columns[None, :]]
    return turned


CHANGES: dict[str, tuple[Change, str]] = {
    "mirrored": (np.fliplr, "they would when mirrored left to right"),
    "upside down": (np.flipud, "they would when mirrored upside down"),
    "on its head": (lambda label: np.rot90(label, 2), "they would when turned by 180 degrees"),
    "on its side": (turn_on_its_side, "they would when turned by 90 degrees to the right"),
    "shifted": (
        lambda label: np.roll(label, (16, -24), (0, 1)),
        "they would when moved 24 px right and 16 px up",
    ),
    "at half scale": (
        lambda label: np.pad(label[::2, ::2], ((0, 80), (0, 120)), constant_values=2),
        "fit no place",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", CHANGES)
def test_labels_that_are_turned_or_moved_are_found_with_what_would_put_them_right(
    what: str,
) -> None:
    change, reason = CHANGES[what]
    pairs = make_set()
    wrong = (1, 4, 8)
    tally = judge([(p, change(m) if k in wrong else m) for k, (p, m) in enumerate(pairs)])
    assert set(tally.misplaced) == {f"p{number}" for number in wrong}
    assert sum(reason in said for said in tally.misplaced.values()) >= 2
    assert tally.judged == COUNT and tally.is_refused


def test_labels_of_the_next_picture_are_found_with_the_picture_that_they_are_of() -> None:
    pairs = make_set()
    shifted = [(picture, pairs[(k + 1) % COUNT][1]) for k, (picture, _) in enumerate(pairs)]
    tally = judge(shifted)
    assert tally.misplaced == {
        f"p{k}": f"they are those of p{(k + 1) % COUNT}" for k in range(COUNT)
    }


def test_few_labels_of_many_plants_and_halves_that_are_ignored_are_believed() -> None:
    pairs = make_set()
    crop = [(p, np.where(m == PlantClass.CROP, m, PlantClass.SOIL)) for p, m in pairs]
    half = [(p, np.where(np.arange(WIDTH) < WIDTH // 2, m, 255)) for p, m in pairs]
    for part in (pairs, crop, half):
        tally = judge([(p, m.astype(np.uint8)) for p, m in part])
        assert (tally.misplaced, tally.judged) == ({}, COUNT)


def test_pictures_that_show_no_green_are_not_judged() -> None:
    rng = np.random.default_rng(2)
    grain = rng.integers(0, 255, (COUNT, HEIGHT, WIDTH, 3), np.uint8)
    pairs = make_set()
    grey = [(np.repeat(p.mean(2, keepdims=True), 3, 2).astype(np.uint8), m) for p, m in pairs]
    for pictures in (grey, list(zip(grain, (m for _, m in pairs), strict=True))):
        tally = judge(pictures)
        assert (tally.misplaced, tally.judged) == ({}, 0)


def save_set(folder: Path, pairs: list[tuple[ByteArray, ByteArray]]) -> Path:
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for number, (picture, label) in enumerate(pairs):
        Image.fromarray(picture).save(folder / "images" / f"p{number}.png")
        Image.fromarray(np.ascontiguousarray(label)).save(folder / "masks" / f"p{number}.png")
    return folder


def mirror_some(pairs: list[tuple[ByteArray, ByteArray]], count: int) -> list[Any]:
    return [(p, np.fliplr(m) if k < count else m) for k, (p, m) in enumerate(pairs)]


def test_a_check_names_each_picture_unless_it_is_asked_to_believe_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(save_set(tmp_path / "set", mirror_some(make_set(), 1)))
    assert main(["dataset", "check", folder, "--json"]) == 1
    (problem,) = json.loads(capsys.readouterr().out.splitlines()[-1])["problems"]
    assert problem == {
        "kind": "labels off the plants",
        "file": "images/p0.png",
        "detail": "they would when mirrored left to right",
    }
    assert main(["dataset", "check", folder, "--keep-misplaced"]) == 0


def save_labelme(folder: Path, ahead: Callable[[int], int]) -> Path:
    """Save pictures of square leaves, each with the labels of the picture `ahead` of it."""
    folder.mkdir()
    rng = np.random.default_rng(3)
    scenes = []
    for _ in range(COUNT):
        corners = np.column_stack([rng.uniform(0, WIDTH - 24, 6), rng.uniform(0, HEIGHT - 24, 6)])
        scenes.append([[[u, v], [u + 20, v], [u + 20, v + 20], [u, v + 20]] for u, v in corners])
    for number, boxes in enumerate(scenes):
        label = np.full((HEIGHT, WIDTH), PlantClass.SOIL, np.uint8)
        for (u, v), _, (right, down), _ in boxes:
            label[round(v) : round(down), round(u) : round(right)] = PlantClass.CROP
        Image.fromarray(draw_picture(label, rng)).save(folder / f"p{number}.png")
        others = scenes[(number + ahead(number)) % len(scenes)]
        tree = {
            "shapes": [{"label": "crop", "points": box, "shape_type": "polygon"} for box in others],
            "imagePath": f"p{number}.png", "imageWidth": WIDTH, "imageHeight": HEIGHT,
        }  # fmt: skip
        (folder / f"p{number}.json").write_text(json.dumps(tree))
    return folder


def test_an_import_leaves_out_the_pictures_whose_labels_are_of_another_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = save_labelme(tmp_path / "labels", lambda number: int(number == 3))
    out = tmp_path / "set"
    assert main(["dataset", "import", str(folder), "--out", str(out), "--json"]) == 1
    printed = capsys.readouterr()
    assert (
        "left out: p3.png: its labels do not lie on its plants; they are those of p4" in printed.err
    )
    assert json.loads(printed.out.splitlines()[-1])["shapes"] == {"crop": 6 * (COUNT - 1)}
    assert sorted(os.listdir(out / "masks")) == sorted(
        f"p{number}.png" for number in range(COUNT) if number != 3
    )
    whole = ["dataset", "import", str(folder), "--out", str(tmp_path / "all"), "--keep-misplaced"]
    assert main(whole) == 0
    assert len(os.listdir(tmp_path / "all" / "masks")) == COUNT


def test_an_import_of_labels_that_are_all_of_the_next_picture_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = save_labelme(tmp_path / "labels", lambda _number: 1)
    assert main(["dataset", "import", str(folder), "--out", str(tmp_path / "set")]) == 2
    said = capsys.readouterr().err
    assert (
        "the labels of 10 of 10 pictures do not lie on their plants (p0: they are those of p1"
        in said
    )
    assert "more than 25% are not believed" in said and "--keep-misplaced" in said
    assert not (tmp_path / "set").exists()


REAL = {"carrot-weed": "folder", "cwfid-train": "cwfid", "peanut": "folder"}


@pytest.mark.parametrize("name", REAL)
def test_no_honest_photograph_is_called_misplaced_and_those_of_the_next_one_are(name: str) -> None:
    """Three photographs of each set; all 114 of them gave the same."""
    root = Path(os.environ.get("AGRIBOT_DATA", "/nowhere")) / name
    if not root.is_dir():
        pytest.skip(f"AGRIBOT_DATA has no {name}")
    pairs, _ = find_pairs(root, REAL[name])
    read = [read_pair(pair) for pair in pairs[:3]]
    assert judge(read).misplaced == {}
    assert judge(read).judged == 3
    swapped = [(p, read[(k + 1) % 3][1]) for k, (p, _) in enumerate(read)]
    assert len(judge(swapped).misplaced) == 3


OPTIONS = ("--data", "folder", "--out", "unused", "--model", "agribot-s")


def test_a_training_leaves_out_misplaced_labels_and_refuses_a_set_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = save_set(tmp_path / "few", mirror_some(make_set(), 2))
    lines: list[str] = []
    source = make_photo_source(parsed(*OPTIONS, "--data-dir", str(few)), lines.append)
    assert source.train_images == COUNT - 2
    names = [line.partition(": its labels do not lie on its plants")[0] for line in lines]
    assert names == [f"left out: {few}/images/p{number}.png" for number in (0, 1)]
    kept = parsed(*OPTIONS, "--data-dir", str(few), "--keep-misplaced")
    assert make_photo_source(kept, lines.append).train_images == COUNT
    many = save_set(tmp_path / "many", mirror_some(make_set(), 4))
    words = ["--data", "folder", "--data-dir", str(many), "--out", str(tmp_path / "out")]
    assert main(["train", *words]) == 2
    assert "the labels of 4 of 10 pictures do not lie on their plants" in capsys.readouterr().err
