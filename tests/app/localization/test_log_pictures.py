"""Pictures of a log: what the network and the rows say of them, at the poses of the filter."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.picture_rows import PictureRows
from agribot.cli.main import main
from agribot.core.messages import ByteArray
from agribot.record.bag.definitions import ros1_store
from agribot.record.localization.camera import ViewedPicture
from tests.app.localization import drives
from tests.app.localization.drives import Message, Messages, make_drive

TOPIC = "/front/image_raw/compressed"
KIND = "sensor_msgs/msg/CompressedImage"
PHOTOGRAPHS = Path(os.environ.get("AGRIBOT_DATA", "")) / "crdld-rows"


def draw_field() -> ByteArray:
    """Brown ground with two rows of green plants that run to the horizon."""
    pixels = np.full((240, 320, 3), (110, 85, 60), dtype=np.uint8)
    for foot_px in (80, 240):
        for v_px in range(60, 240, 12):
            u_px = round(160 + (foot_px - 160) * (v_px - 20) / 220)
            pixels[v_px : v_px + 8, max(u_px - 6, 0) : u_px + 6] = (40, 140, 40)
    return pixels


def encode(pixels: ByteArray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="JPEG")
    return buffer.getvalue()


def write_log(path: Path, jpegs: Sequence[bytes], every_s: float) -> drives.Drive:
    """Write a bag of a short drive with pictures from 12 s on; the third one is damaged."""
    drive = make_drive(duration_s=30.0)
    made = Messages(drive, ros1_store())
    pictures: list[Message] = [
        (t_s, TOPIC, KIND, make_picture(made, t_s, jpeg))
        for t_s, jpeg in ((12.0 + k * every_s, jpeg) for k, jpeg in enumerate(jpegs))
    ]
    drives.write_ros1(path, sorted([*made.list(), *pictures], key=lambda each: each[0]))
    return drive


def make_picture(made: Messages, t_s: float, jpeg: bytes) -> Any:
    data = np.frombuffer(jpeg, dtype=np.uint8)
    return made.make(KIND, made.header(t_s, "camera"), "jpeg", data)


def localize(path: Path, *options: str) -> int:
    return main(["localize", str(path), "--out", str(path.parent / "out"), "--json", *options])


def read_table(folder: Path) -> list[dict[str, str]]:
    with (folder / "out" / "pictures.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_pictures_of_a_log_are_judged_at_the_poses_of_the_filter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    jpegs = [encode(draw_field()), encode(draw_field()), b"no picture", encode(draw_field())]
    drive = write_log(tmp_path / "a.bag", jpegs, every_s=4.0)
    assert localize(tmp_path / "a.bag", "--camera") == 0
    camera = json.loads(capsys.readouterr().out.splitlines()[-1])["camera"]
    assert (camera["topic"], camera["messages"]) == (TOPIC, 4)
    assert (camera["pictures"], camera["refused"]) == (3, 1)
    assert camera["rows_found"] == 0  # of fewer pictures than rows are sought in
    table = read_table(tmp_path)
    times_s = np.array([float(row["t_s"]) for row in table])
    assert times_s == pytest.approx([12.0, 16.0, 24.0], abs=0.03)
    places_m = np.array([[float(row["x_map_m"]), float(row["y_map_m"])] for row in table])
    driven_m, true_m = np.diff(places_m, axis=0), np.diff(drive.places(times_s), axis=0)
    assert driven_m == pytest.approx(true_m, abs=1.0)  # fixes of 0.5 m; the way is about 10 m
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert page.count("<figcaption>") == 3
    assert "10 bytes are no picture" in page


def test_a_topic_without_pictures_is_refused_with_those_that_have_some(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "a.bag", [encode(draw_field())], every_s=1.0)
    assert localize(tmp_path / "a.bag", "--camera", "/odom") == 2
    assert f"--camera /odom: the log has no pictures there; name one of {TOPIC}" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(("foot_ratio", "offset"), [(0.6, 0.25), (0.35, -0.375), (0.95, 0.125)])
def test_the_row_of_a_picture_is_the_one_nearest_to_the_middle_of_its_lower_edge(
    foot_ratio: float, offset: float
) -> None:
    """Rows 0.4 of the width apart that meet in the middle of the upper edge."""
    rows = PictureRows(0.5, 0.0, foot_ratio, 0.4, score=0.5, evidence=9.0, sure=0.9)
    plain = ViewedPicture(
        t_s=0.0, crop_ratio=0.1, weed_ratio=0.0, doubt=None, unfit="",
        shown=np.zeros((300, 400, 3), np.uint8),
    )  # fmt: skip
    seen = plain.with_rows(rows)
    assert seen.row_offset_ratio == pytest.approx(offset)
    angle_deg = math.degrees(math.atan2(offset * 0.4 * 400.0, 300.0))
    assert seen.row_angle_deg == pytest.approx(angle_deg)
    assert seen.shown.any() and not plain.shown.any()  # the lines are drawn


@pytest.mark.nightly
@pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason="AGRIBOT_DATA holds no crdld-rows")
def test_rows_are_found_in_photographs_of_a_real_robot_in_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = sorted((PHOTOGRAPHS / "images").iterdir())[::10][:30]
    write_log(tmp_path / "a.bag", [file.read_bytes() for file in files], every_s=0.5)
    assert localize(tmp_path / "a.bag", "--camera", TOPIC) == 0
    camera = json.loads(capsys.readouterr().out.splitlines()[-1])["camera"]
    assert camera["pictures"] == len(files)
    assert camera["rows_found"] >= 0.8 * len(files)
