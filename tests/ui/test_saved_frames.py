"""Frames that an operator keeps, as `agribot dataset check` and training read them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import RecordingError
from agribot.core.messages import (
    ByteArray,
    CameraFrame,
    Estimate,
    GnssQuality,
    SensorBatch,
    TickRecord,
)
from agribot.core.request_text import describe_request
from agribot.ui import wire
from agribot.ui.robot_side.recent_frames import KEPT, RecentFrames, SeenFrame
from agribot.ui.robot_side.saved_frames import SavedFrames
from tests.ui.client import Browser, Page
from tests.ui.conftest import Robot

MASK: ByteArray = np.array([[0, 1], [2, 2]], np.uint8).repeat(24, 0).repeat(32, 1)


def estimate(*, ok: bool = True) -> Estimate:
    return Estimate(
        t_s=4.0, x_map_m=1.5, y_map_m=-2.0, yaw_map_rad=0.1, v_mps=0.0, yaw_rate_radps=0.0,
        slip_rad=0.0, pose_cov=(1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4),
        pos_std_m=0.01, yaw_std_rad=0.01, quality=GnssQuality.RTK_FIXED, ok=ok,
    )  # fmt: skip


def frame(index: int) -> CameraFrame:
    image = np.random.default_rng(index).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    return CameraFrame(t_s=4.0, index=index, image_rgb=image)


def tick(*frames: CameraFrame) -> TickRecord:
    record: Any = SimpleNamespace(batch=SensorBatch(t_s=4.0, frames=frames), estimate=estimate())
    return record  # type: ignore[no-any-return]


def saved_frames(tmp_path: Path, *changes: str) -> SavedFrames:
    return SavedFrames(config.load("farm", list(changes)), tmp_path / "first")


def test_kept_frames_are_a_set_that_passes_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = saved_frames(tmp_path)
    for index in (1, 2):
        told = frames.save(SeenFrame(frame(index), estimate(), MASK))
    folder = tmp_path / "frames"
    assert told == wire.KeptFrame(folder=str(folder), image="images/first-000002.png", count=2)
    assert main(["dataset", "check", str(folder), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert checked["pairs"] == 2
    assert checked["pixel_ratio"] == {"weed": 0.25, "crop": 0.25, "soil": 0.5}


def test_a_kept_pair_is_the_frame_and_the_mask_at_its_size(tmp_path: Path) -> None:
    saved_frames(tmp_path).save(SeenFrame(frame(7), estimate(), MASK))
    folder = tmp_path / "frames"
    with Image.open(folder / "images/first-000007.png") as image:
        assert np.array_equal(np.asarray(image), frame(7).image_rgb)
    with Image.open(folder / "masks/first-000007.png") as mask:
        assert np.array_equal(np.asarray(mask), MASK.repeat(2, 0).repeat(2, 1))
    note = json.loads((folder / "notes/first-000007.json").read_text())
    assert note["is_mask_from_network"] is True
    assert note["model"] == "agribot-sim"
    assert (note["pose"]["x_map_m"], note["t_s"], note["frame_index"]) == (1.5, 4.0, 7)


def test_an_unknown_pose_is_none(tmp_path: Path) -> None:
    saved_frames(tmp_path).save(SeenFrame(frame(7), estimate(ok=False), MASK))
    assert json.loads((tmp_path / "frames/notes/first-000007.json").read_text())["pose"] is None


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    stray = tmp_path / "frames/images/first-000007.png"
    stray.parent.mkdir(parents=True)
    stray.write_bytes(b"somebody's")
    names = [
        saved_frames(tmp_path).save(SeenFrame(frame(7), estimate(), MASK)).image for _ in range(2)
    ]
    assert names == ["images/first-000007-2.png", "images/first-000007-3.png"]
    assert stray.read_bytes() == b"somebody's"


def test_the_folder_is_chosen_and_the_disk_keeps_room(tmp_path: Path) -> None:
    chosen = f"record.frames_dir='{tmp_path / 'chosen'}'"
    told = saved_frames(tmp_path, chosen).save(SeenFrame(frame(1), estimate(), MASK))
    assert told.folder == str(tmp_path / "chosen")
    too_much_mb = shutil.disk_usage(tmp_path).total / 1e6 + 1.0
    full = saved_frames(tmp_path, f"record.min_free_mb={too_much_mb}")
    with pytest.raises(RecordingError, match=r"record\.min_free_mb"):
        full.save(SeenFrame(frame(1), estimate(), MASK))
    assert not list((tmp_path / "frames").glob("*/*"))


def test_the_newest_frame_is_one_that_the_network_has_seen() -> None:
    recent = RecentFrames()
    assert recent.newest() is None
    for index in range(3 * KEPT):
        recent.mask(index, MASK)  # the network may be quicker than the tick
        recent(tick(frame(index)))
    recent(tick(frame(3 * KEPT)))
    newest = recent.newest()
    assert newest is not None
    assert newest.frame.index == 3 * KEPT - 1


def test_only_the_seat_keeps_frames_and_is_told_where(robot: Robot) -> None:
    browser = Browser(robot.port)
    assert browser.ask("POST", "/api/v1/frames")[0] == 409
    value = {"folder": "/runs/frames", "image": "images/now-000001.png", "count": 1}
    with Page(robot.port, tab="f", additional_headers={"Cookie": browser.cookie}) as page:
        page.take_seat()
        robot.answers[wire.SaveFrame] = value
        assert browser.ask("POST", "/api/v1/frames") == (200, value)
        note = robot.wait_for_request("note", lambda note: "frame" in note.text)
        assert "images/now-000001.png" in describe_request(note.request)
        robot.refusals[wire.SaveFrame] = "only 3 MB are left"
        status, said = browser.ask("POST", "/api/v1/frames")
        assert (status, said["error"]) == (409, "only 3 MB are left")
        page.send(wire.LeaveSeat())
