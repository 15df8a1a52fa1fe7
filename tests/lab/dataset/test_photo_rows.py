"""The row as teacher of photographs from straight above, whose truth the renderer knows."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.robot import CameraSpec
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.dataset.photo_rows import (
    PhotoRow,
    PhotoRowProfile,
    RowDirection,
    label_by_row,
    score_crop,
    search_row,
    turn,
)
from agribot.sim.camera.renderer import CameraRenderer
from tests import nightly

HEIGHT, WIDTH = 240, 320
RNG = np.random.default_rng


def draw_classes(
    row_px: float, turn_deg: float, rng: np.random.Generator, weeds: int = 40
) -> ClassMap:
    """Draw crops along a line, and weeds anywhere; every third weed is labelled crop."""
    kind = np.full((HEIGHT, WIDTH), PlantClass.SOIL, dtype=np.uint8)
    confidence = np.full(kind.shape, 250, dtype=np.uint8)

    def stamp(v: float, u: float, what: PlantClass, sure: int) -> None:
        rows, columns = np.ogrid[:HEIGHT, :WIDTH]
        disc = (rows - v) ** 2 + (columns - u) ** 2 <= 5**2
        kind[disc], confidence[disc] = what, sure

    for number in range(weeds):
        is_mistaken = number % 3 == 0
        what = PlantClass.CROP if is_mistaken else PlantClass.WEED
        stamp(rng.uniform(0, HEIGHT), rng.uniform(0, WIDTH), what, 180 if is_mistaken else 240)
    for v in np.arange(10.0, HEIGHT, 14.0):
        u = row_px + math.tan(math.radians(turn_deg)) * (v - (HEIGHT - 1) / 2.0)
        stamp(v, u + rng.normal(0.0, 2.0), PlantClass.CROP, 220)
    return ClassMap(class_id=kind, confidence=confidence, scale_px=(1.0, 1.0))


@pytest.mark.parametrize(("row_px", "turn_deg"), [(160.0, 0.0), (90.0, 8.0), (220.0, -10.0)])
def test_the_line_of_crop_is_found_among_weeds_that_are_called_crop(
    row_px: float, turn_deg: float
) -> None:
    for seed in range(5):
        found = search_row(score_crop(draw_classes(row_px, turn_deg, RNG(seed))))
        assert found.is_row
        assert found.row.across_ratio * WIDTH == pytest.approx(row_px, abs=6.0)
        assert math.degrees(found.row.turn_rad) == pytest.approx(turn_deg, abs=3.0)


def test_a_row_across_a_picture_is_that_of_the_turned_picture() -> None:
    classes = draw_classes(100.0, 5.0, RNG(1))
    score = score_crop(classes)
    assert search_row(turn(score.T, "across")).row == search_row(score).row


def test_carpets_and_two_rows_are_no_single_row() -> None:
    carpet = RNG(2).random((HEIGHT, WIDTH))
    assert not search_row(carpet).is_row
    one = score_crop(draw_classes(90.0, 0.0, RNG(3), weeds=0))
    other = score_crop(draw_classes(230.0, 0.0, RNG(4), weeds=0))
    assert search_row(one).is_row and search_row(other).is_row
    assert not search_row(np.maximum(one, other)).is_row
    assert not search_row(np.zeros((HEIGHT, WIDTH))).is_row


def test_what_grows_beside_the_row_is_weed_and_on_it_the_sure_word_of_the_network_counts() -> None:
    classes = draw_classes(160.0, 0.0, RNG(5))
    kind, confidence = classes.class_id, classes.confidence.copy()
    found = search_row(score_crop(classes)).row
    off_px = np.abs(np.arange(WIDTH) + 0.5 - found.across_ratio * WIDTH)[None].repeat(HEIGHT, 0)
    is_plant, is_crop = kind != PlantClass.SOIL, kind == PlantClass.CROP
    label = label_by_row(kind, confidence, found, half_ratio=0.05)
    assert (label[is_plant & (off_px > 0.08 * WIDTH)] == PlantClass.WEED).all()
    assert (label[is_crop & (off_px < 0.05 * WIDTH)] == PlantClass.CROP).all()
    assert (label[~is_plant] == PlantClass.SOIL).all()
    edge = (off_px > 0.05 * WIDTH) & (off_px < 0.08 * WIDTH)
    assert (label[is_crop & edge] == UNLABELLED).all()
    confidence[is_plant] = 140  # a network that is sure of no plant
    doubtful = label_by_row(kind, confidence, found, half_ratio=0.05)
    assert (doubtful[is_plant & (off_px < 0.05 * WIDTH)] == UNLABELLED).all()
    assert (doubtful[is_plant & (off_px > 0.08 * WIDTH)] == PlantClass.WEED).all()


def test_the_pictures_tell_how_wide_the_row_is() -> None:
    profile = PhotoRowProfile()
    for seed in range(8):
        score = score_crop(draw_classes(160.0, 0.0, RNG(seed)))
        profile.add(score, PhotoRow(0.5, 0.0))
    assert profile.find_half_ratio() * WIDTH == pytest.approx(
        7.0, abs=3.0
    )  # discs of 5 px, 2 px off
    with pytest.raises(ConfigError, match="no crop"):
        PhotoRowProfile().find_half_ratio()


@pytest.fixture(scope="module")
def photographs() -> list[tuple[ByteArray, ByteArray]]:
    """A row of lettuce among weeds from straight above, with the true classes."""
    plan = FieldSettings(
        rows=RowsSettings(count=1, length_m=8.0),
        crop=CropSettings(species="lettuce", spacing_m=0.16, height_m=0.09),
        weeds=WeedsSettings(density_per_m2=25.0, height_max_m=0.04),
    )
    world, rng = generate_field(plan, 5), RNG(7)
    middle_m = np.mean([(one.x_map_m, one.y_map_m) for one in world.plants if one.plant], axis=0)
    camera = CameraSpec(
        link="camera", width_px=480, height_px=360, hfov_rad=0.98, rate_hz=1.0, noise_std=0.005,
        clip_near_m=0.02, clip_far_m=100.0,
    )  # fmt: skip
    renderer = CameraRenderer(world, threads=1)
    drawn = []
    for number in range(4):
        place_m = (middle_m[0] + rng.normal(0.0, 0.04), middle_m[1] + rng.uniform(-3, 3), 0.75)
        yaw_rad = math.radians(plan.rows.yaw_deg + rng.normal(0.0, 2.0))
        looking_down = transform(place_m, (0.0, math.pi / 2.0, yaw_rad)) @ LINK_FROM_OPTICAL
        picture = renderer.render(looking_down, camera, noise_seed=number)
        drawn.append((picture.image_rgb, picture.class_id))
    return drawn


def save(folder: Path, images_rgb: list[ByteArray]) -> None:
    (folder / "images").mkdir(parents=True)
    for number, image_rgb in enumerate(images_rgb):
        Image.fromarray(image_rgb).save(folder / "images" / f"{number}.png")


@pytest.mark.parametrize(
    "direction",
    [
        "down",
        pytest.param(
            "across",
            marks=nightly.by_day("test_a_row_across_a_picture_is_that_of_the_turned_picture"),
        ),
    ],
)
def test_one_command_labels_photographs_of_a_field_that_training_reads(
    tmp_path: Path,
    direction: RowDirection,
    photographs: list[tuple[ByteArray, ByteArray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    flat = [class_id for _, class_id in photographs]
    is_down = direction == "down"
    truths = flat if is_down else [np.rot90(class_id) for class_id in flat]
    images_rgb = [image_rgb for image_rgb, _ in photographs]
    save(tmp_path / "field", images_rgb if is_down else [np.rot90(one) for one in images_rgb])
    (tmp_path / "field/images/torn.jpg").write_bytes(b"\xff\xd8 no picture")
    Image.fromarray(images_rgb[0]).save(tmp_path / "field/images/0.webp")  # masks of one name
    out = tmp_path / "photos"
    words = ["dataset", "label-by-rows", str(tmp_path / "field"), "--out", str(out), "--json"]
    assert main(words) == 1  # the torn one is named
    shown = capsys.readouterr()
    report = json.loads(shown.out.splitlines()[-1])
    assert "torn.jpg" in shown.err and "torn.jpg" in report["problems"][1]
    assert "0.webp: two files of one name" in report["problems"][0]
    assert report["rows"] == direction
    assert report["labelled"] + report["without_row"] + 2 == report["pictures"] == 6
    labels = {path.stem: np.asarray(Image.open(path)) for path in (out / "masks").iterdir()}
    assert report["labelled"] == len(labels) >= 3
    taught = np.stack(list(labels.values()))
    truth = np.stack([truths[int(name)] for name in labels])
    for kind, least in ((PlantClass.CROP, 0.95), (PlantClass.WEED, 0.9), (PlantClass.SOIL, 0.97)):
        assert (truth[taught == kind] == kind).mean() > least
        assert (taught[truth == kind] == kind).mean() > 0.3
    assert main(["dataset", "check", str(out)]) == 0
    assert main(words) == 2 and "no empty folder" in capsys.readouterr().err


def test_photographs_whose_rows_run_every_way_are_refused(
    tmp_path: Path,
    photographs: list[tuple[ByteArray, ByteArray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """What gathers down some pictures and across others is no row."""
    images_rgb = [image_rgb for image_rgb, _ in photographs[:2]]
    save(tmp_path / "field", images_rgb + [np.rot90(one) for one in images_rgb])
    words = ["dataset", "label-by-rows", str(tmp_path / "field"), "--out", str(tmp_path / "photos")]
    assert main(words) == 2
    assert "a line down 2 of them and across 2" in capsys.readouterr().err
    assert main([*words, "--rows", "across"]) == 2
    assert not (tmp_path / "photos").exists()


def test_photographs_without_a_row_are_refused_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = tmp_path / "field"
    field.mkdir()
    words = ["dataset", "label-by-rows", str(field), "--out", str(tmp_path / "photos")]
    assert main(words) == 2
    assert "neither the recording of a run" in capsys.readouterr().err
    Image.new("RGB", (320, 240), (110, 90, 70)).save(field / "soil.png")
    assert main(words) == 2
    assert "these show no rows" in capsys.readouterr().err
    assert main([*words, "--pitch", "0.5"]) == 2
    assert "--pitch" in capsys.readouterr().err
    assert main([*words[:3], str(field), *words[3:]]) == 2
    assert "one folder" in capsys.readouterr().err
    assert not (tmp_path / "photos").exists()
