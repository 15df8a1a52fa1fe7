"""The row as teacher: what it says of pictures whose truth the renderer knows."""

from __future__ import annotations

import io
import json
import math
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest
import tomli_w
from PIL import Image

from agribot.autonomy.perceive.ground import GroundLookup
from agribot.cli.main import main
from agribot.core import config, topics
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.toml_tree import drop_none
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)
from agribot.description.loader import export_urdf, load_robot
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.dataset.row_labels import (
    FAR_M,
    GreenHistogram,
    RowLabeller,
    RowPicture,
    RowProfile,
    measure_green,
)
from agribot.lab.train.farm import choose_row_pose
from agribot.record.mcap_file import McapFile
from agribot.record.recorder import CONFIG_ATTACHMENT, URDF_ATTACHMENT
from agribot.ros.messages import rosmsg
from agribot.sim.camera.renderer import CameraRenderer

PITCH_M, VIEWS = 0.8, 8
Pictures = list[tuple[ByteArray, ByteArray]]  # with the true classes of their pixels


@cache
def draw(species: str, spacing_m: float, height_m: float, weeds_per_m2: float) -> Pictures:
    """Draw what a robot sees along the rows of a crop that stand north to south."""
    plan = FieldSettings(
        rows=RowsSettings(count=3, length_m=6.0, pitch_m=PITCH_M),
        crop=CropSettings(species=species, spacing_m=spacing_m, height_m=height_m),
        weeds=WeedsSettings(density_per_m2=weeds_per_m2),
    )
    world, rng = generate_field(plan, 3), np.random.default_rng(5)
    robot = load_robot()
    assert robot.camera is not None
    renderer = CameraRenderer(world, robot, threads=1)
    pictures = []
    for _ in range(VIEWS):
        pose = choose_row_pose(rng, world, math.radians(plan.rows.yaw_deg))
        drawn = renderer.render(pose @ robot.body_from_camera(), robot.camera, noise_seed=1)
        pictures.append((drawn.image_rgb, drawn.class_id))
    return pictures


@pytest.fixture(scope="module")
def carrots() -> Pictures:
    """No packaged network knows them: pixel by pixel they are weeds to it."""
    return draw("carrot", 0.06, 0.1, 8.0)


@pytest.fixture(scope="module")
def labeller() -> RowLabeller:
    robot = load_robot()
    assert robot.camera is not None
    size_px = robot.camera.height_px, robot.camera.width_px
    lookup = GroundLookup(robot.camera, robot.body_from_camera(), size_px, FAR_M)
    return RowLabeller(lookup, PITCH_M)


def find_threshold(pictures: Pictures) -> float:
    green = GreenHistogram()
    for image_rgb, _ in pictures:
        green.add(measure_green(image_rgb))
    return green.find_threshold()


def look(labeller: RowLabeller, image_rgb: ByteArray, threshold: float) -> RowPicture | None:
    green = measure_green(image_rgb)
    line = labeller.find_line(green, threshold)
    return None if line is None else labeller.place(green, line)


def label_all(labeller: RowLabeller, pictures: Pictures) -> tuple[ByteArray, ByteArray]:
    """What the rows teach and what is true, of all pixels of pictures that show a row."""
    threshold, profile = find_threshold(pictures), RowProfile()
    looks = [(look(labeller, image_rgb, threshold), truth) for image_rgb, truth in pictures]
    shown = [(seen, truth) for seen, truth in looks if seen is not None]
    assert len(shown) >= VIEWS / 2
    for seen, _ in shown:
        profile.add(seen, threshold)
    half_row_m = profile.find_half_row_m()
    taught = [labeller.label(seen, threshold, half_row_m) for seen, _ in shown]
    return np.stack(taught), np.stack([truth for _, truth in shown])


def share_right(taught: ByteArray, truth: ByteArray, kind: PlantClass) -> float:
    """Of the pixels of plants that are called `kind`, how many are."""
    called = truth[(taught == kind) & (truth != PlantClass.SOIL)]
    return float((called == kind).mean())


@pytest.mark.parametrize(
    ("species", "height_m", "least_right"),
    [("carrot", 0.1, 0.93), pytest.param("onion", 0.16, 0.75, marks=pytest.mark.nightly)],
)
def test_the_row_tells_a_crop_that_no_network_knows_from_weeds(
    labeller: RowLabeller, species: str, height_m: float, least_right: float
) -> None:
    """Weeds in the row count as crop: among thin onions they are a fifth of what grows there."""
    taught, truth = label_all(labeller, draw(species, 0.06, height_m, 8.0))
    assert share_right(taught, truth, PlantClass.CROP) > least_right
    assert share_right(taught, truth, PlantClass.WEED) > 0.95
    is_soil = truth == PlantClass.SOIL
    assert is_soil[taught == PlantClass.SOIL].mean() > 0.99
    assert is_soil[taught == PlantClass.CROP].mean() < 0.02
    for kind, least in ((PlantClass.CROP, 0.2), (PlantClass.WEED, 0.15)):
        assert (taught == kind).sum() > least * (truth == kind).sum()


def test_what_is_too_far_off_to_tell_teaches_nothing(
    labeller: RowLabeller, carrots: Pictures
) -> None:
    taught, _ = label_all(labeller, carrots)
    assert (taught[:, :60] == UNLABELLED).all()


def test_a_picture_across_the_rows_is_left_out(labeller: RowLabeller, carrots: Pictures) -> None:
    threshold = find_threshold(carrots)
    across = np.ascontiguousarray(np.rot90(carrots[0][0][:, 80:560]))
    wide = np.zeros_like(carrots[0][0])
    wide[:, 80:560] = across
    assert look(labeller, wide, threshold) is None
    assert look(labeller, np.full_like(wide, 120), threshold) is None


def test_where_as_much_grows_between_the_rows_as_on_them_nothing_is_taught() -> None:
    left_m = np.tile(np.linspace(-0.5, 0.5, 200, dtype=np.float32), (50, 1))
    rng, profile = np.random.default_rng(2), RowProfile()
    profile.add(RowPicture(rng.random(left_m.shape, dtype=np.float32), left_m), 0.5)
    with pytest.raises(ConfigError, match="cannot teach"):
        profile.find_half_row_m()
    on_row = np.where(np.abs(left_m) < 0.12, 1.0, 0.0).astype(np.float32)
    rows = RowProfile()
    rows.add(RowPicture(on_row, left_m), 0.5)
    assert rows.find_half_row_m() == pytest.approx(0.12, abs=0.02)


def test_a_meadow_shows_no_row(labeller: RowLabeller) -> None:
    meadow = draw("carrot", 0.5, 0.05, 150.0)
    threshold = find_threshold(meadow)
    assert not any(look(labeller, image_rgb, threshold) for image_rgb, _ in meadow)


def record(path: Path, images_rgb: list[ByteArray]) -> None:
    file = McapFile(path)
    settings = drop_none(msgspec.to_builtins(config.load("beet")))
    file.attach(CONFIG_ATTACHMENT, "text/plain", tomli_w.dumps(settings).encode())
    file.attach(URDF_ATTACHMENT, "text/xml", export_urdf(config.load("beet").robot).encode())
    for number, image_rgb in enumerate(images_rgb):
        buffer = io.BytesIO()
        Image.fromarray(image_rgb).save(buffer, format="JPEG", quality=90)
        message = rosmsg.make_compressed_image(float(number), buffer.getvalue())
        now_ns = number * 1_000_000_000
        file.write(topics.IMAGE, now_ns, rosmsg.to_cdr(message), now_ns)
    file.close()


def test_one_command_makes_a_set_of_a_recording_that_training_reads(
    tmp_path: Path, carrots: Pictures, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = tmp_path / "run", tmp_path / "photos"
    images_rgb = [image_rgb for image_rgb, _ in carrots]
    record(run / "run.mcap", [*images_rgb, images_rgb[-1]])
    words = ["dataset", "label-by-rows", str(run), "--out", str(out), "--json"]
    assert main([*words, "--pitch", str(PITCH_M)]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["pictures"] == VIEWS + 1 and report["at_standstill"] == 1
    assert report["labelled"] == len(list((out / "masks").glob("*.png"))) >= VIEWS / 2
    assert report["labelled"] + report["without_row"] + report["at_standstill"] == VIEWS + 1
    assert report["pixel_ratio"]["crop"] > 0.005
    assert main(["dataset", "check", str(out)]) == 0
    assert main(words) == 2
    assert "no empty folder" in capsys.readouterr().err


def test_a_network_adapts_to_the_rows_of_a_recording(
    carrots: Pictures, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    record(tmp_path / "run.mcap", [image_rgb for image_rgb, _ in carrots])
    words = ["adapt", str(tmp_path), "-o", str(tmp_path / "field.onnx"), "--model", "agribot-sim"]
    assert main([*words, "--steps", "1", "--json"]) == 0
    adapted = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert adapted["pictures"] == VIEWS
    assert adapted["rows_seen"] >= 6
    assert adapted["before"]["on_rows"]["weed"] > 0.5  # it takes carrots for weeds


def test_a_recording_with_few_rows_is_refused_with_how_many_are_needed(
    carrots: Pictures, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    record(tmp_path / "run.mcap", [image_rgb for image_rgb, _ in carrots[:3]])
    words = ["adapt", str(tmp_path), "-o", str(tmp_path / "field.onnx"), "--model", "agribot-sim"]
    assert main([*words, "--steps", "1"]) == 2
    assert "pictures show rows, 6 are needed" in capsys.readouterr().err
    assert not (tmp_path / "field.onnx").exists()


def test_a_recording_without_pictures_is_refused_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "run.mcap", [])
    words = ["dataset", "label-by-rows", str(tmp_path / "run.mcap"), "--out", str(tmp_path / "new")]
    assert main(words) == 2
    assert "holds no pictures" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    assert main([*words, "--pitch", "0.01"]) == 2
    assert "--pitch 0.01" in capsys.readouterr().err
