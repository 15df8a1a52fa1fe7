"""`agribot run --platform hardware` with a camera, whose pictures the network sees in real time.

They show a drive along a row of the Farm world, and the robot's wheels turn on an emulated board.
"""

from __future__ import annotations

import math
import subprocess
import zlib
from pathlib import Path

import msgspec
import pytest

from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.cli.main import main
from agribot.core import config
from agribot.core.geo import transform
from agribot.core.messages import ByteArray, CameraFrame, PlantClass, Scene
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.drivers.camera.cameras import OpenCvGrabber
from agribot.record.replay import read_config, read_ticks, read_weed_map
from agribot.record.report import Report
from agribot.sim.camera import CameraRenderer
from tests import nightly
from tests.app.test_hardware_run import words
from tests.drivers.hardware_bench import HardwareBench
from tests.drivers.slow_clock import PACES, run_agribot

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
cv2 = pytest.importorskip("cv2", reason="OpenCV is missing (pip install -e '.[camera]')")
ROBOT = load_robot()
assert ROBOT.camera is not None
CAMERA, SIZE_PX = ROBOT.camera, (ROBOT.camera.width_px, ROBOT.camera.height_px)
PICTURES, RATE_HZ, SPEED_MPS = 12, 3.0, 0.4
ROW_X_M = 1.0
START = (ROW_X_M, 0.4, math.pi / 2.0)  # where the way into the first row begins
SETTINGS = [
    "perception.enabled=true", "tick_hz=20", "field.row_length_m=1.2",
    f"field.start_map_m=[{START[0]},{START[1]}]",
]  # fmt: skip


def plant_closely(world: WorldSpec) -> WorldSpec:
    """Grow a crop every 0.5 m, so that each picture has its row, and weeds beside it."""
    crop, weed = (next(p for p in world.plants if p.plant == plant)
                  for plant in (PlantClass.CROP, PlantClass.WEED))  # fmt: skip
    crops = tuple(
        msgspec.structs.replace(crop, x_map_m=ROW_X_M, y_map_m=2.0 + 0.5 * k) for k in range(8)
    )
    weeds = tuple(
        msgspec.structs.replace(weed, x_map_m=ROW_X_M + side_m, y_map_m=2.25 + 0.5 * k)
        for k in range(8)
        for side_m in (-0.25, 0.25)
    )
    return msgspec.structs.replace(world, plants=(*crops, *weeds))


def film(file: Path) -> dict[int, ByteArray]:
    """Film a drive along the row; gives the pictures that the file holds, by their checksum."""
    renderer = CameraRenderer(plant_closely(load_world("Farm", seed=0)), threads=1)
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), RATE_HZ, SIZE_PX)
    for k in range(PICTURES):
        body = transform((ROW_X_M, 2.0 + k * SPEED_MPS / RATE_HZ, 0.0), (0.0, 0.0, math.pi / 2.0))
        drawn = renderer.render(body @ ROBOT.body_from_camera(), CAMERA, noise_seed=k)
        writer.write(drawn.image_rgb[..., ::-1])
    writer.release()
    grabber = OpenCvGrabber(str(file), SIZE_PX)
    pictures = [grabber.read() for _ in range(PICTURES)]
    grabber.close()
    return {zlib.crc32(picture.data): picture for picture in pictures}


def look_again(scene: Scene, image_rgb: ByteArray, run: config.RunConfig) -> Scene:
    """What the network of the run makes of its picture."""
    settings = run.perception
    segmenter = Segmenter(settings.model, settings.threads)
    ground = GroundLookup(
        CAMERA, ROBOT.body_from_camera(), segmenter.map_shape, settings.max_range_m
    )
    frame = CameraFrame(t_s=scene.t_s, index=scene.frame_index, image_rgb=image_rgb)
    return observe(frame, segmenter.segment(image_rgb), ground, settings, scene.ready_s)


def drive(out: Path, video: Path, pace: float) -> tuple[subprocess.CompletedProcess[str], Report]:
    """Start a robot with board, receiver and camera plugged in, on its row."""
    sets = [word for setting in SETTINGS for word in ("--set", setting)]
    with HardwareBench(video.parent, START, config.load("farm").field, pace) as bench:
        options = words(bench, out, "--arm", "--for", "60", *sets)
        done = run_agribot([*options, "--source", f"camera=video:{video}"], pace)
    file = out / "report.json"
    assert file.exists(), done.stderr
    return done, msgspec.json.decode(file.read_bytes(), type=Report)


@nightly.by_day(
    "tests/app/test_hardware_run.py::"
    "test_a_builder_starts_the_robot_it_drives_to_a_place_and_a_replay_gives_the_same_commands",
    "tests/drivers/test_cameras.py::test_a_video_file_is_a_camera_that_begins_again_at_its_end",
    "tests/mission/test_farm_mission.py::"
    "test_four_of_five_weeds_are_found_and_four_of_five_finds_are_weeds",
    "tests/mission/test_repeatability.py::test_replaying_a_recording_gives_bit_identical_commands",
)
def test_what_a_robots_camera_shows_is_seen_mapped_and_treated_and_a_replay_does_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "row.avi"
    pictures = film(video)
    for pace in PACES:
        monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / f"home{pace}"))
        out = tmp_path / f"run{pace}"
        done, report = drive(out, video, pace)
        if report.ok and report.weeds.treated:
            break
    assert report.ok and report.weeds.treated, done.stderr
    assert "None" not in done.stderr, "what only a simulator knows"
    ticks = list(read_ticks(out / "run.mcap"))
    assert any(tick.command.implement.is_on for tick in ticks)
    scenes = [scene for tick in ticks for scene in tick.scenes]
    assert 0 < len(scenes) <= (report.perception.frames or 0)
    assert {scene.picture_crc32 for scene in scenes} <= pictures.keys()
    assert all(scene.t_s < tick.batch.t_s for tick in ticks for scene in tick.scenes)
    fullest = max(scenes, key=lambda scene: len(scene.plants))
    assert {plant.plant for plant in fullest.plants} == {PlantClass.CROP, PlantClass.WEED}
    picture = pictures[fullest.picture_crc32]
    assert look_again(fullest, picture, read_config(out / "run.mcap")) == fullest
    assert any(plant.treated_s is not None for plant in read_weed_map(out / "run.mcap"))
    assert main(["replay", str(out / "run.mcap"), "--check"]) == 0
    assert "identical" in capsys.readouterr().out
