"""Small pictures of weeds: what is cut, which is kept, how much of it."""

from __future__ import annotations

import io
import threading

import msgspec
import numpy as np
import pytest
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.ground import ground_to_pixels, pixels_to_ground
from agribot.core.messages import ByteArray, CameraFrame, FloatArray, GroundPlant, PlantClass, Scene
from agribot.description.loader import load_robot
from agribot.ui import wire
from agribot.ui.robot_side.plant_pictures import MAX_BYTES, PlantPictures
from agribot.ui.robot_side.recent_frames import RecentFrames, SeenFrame
from tests.ui.client import Browser
from tests.ui.conftest import Robot
from tests.ui.messages import make_weed
from tests.ui.test_saved_frames import MASK, estimate, tick
from tests.waiting import wait_for

ROBOT = load_robot("agribot")
REACH_M = 0.12
SOIL, WEED = (120, 90, 60), (60, 170, 50)
PATCH_PX = 3  # on either side


def plant_at(u_px: float, v_px: float, plant: PlantClass = PlantClass.WEED) -> GroundPlant:
    """A plant of 6 cm that stands where a pixel meets the ground."""
    assert ROBOT.camera is not None
    pixel, k_px = np.array([[u_px, v_px]]), ROBOT.camera.matrix()
    x_m, y_m = pixels_to_ground(pixel, k_px, ROBOT.body_from_camera())[0]
    return GroundPlant(
        x_body_m=x_m, y_body_m=y_m, plant=plant, area_m2=0.0028, confidence=0.9, std_m=0.01
    )


def seen(index: int, *plants: GroundPlant) -> tuple[Scene, SeenFrame]:
    """The scene of a frame in which every plant is drawn as a disc."""
    camera = ROBOT.camera
    assert camera is not None
    image = Image.new("RGB", (camera.width_px, camera.height_px), SOIL)
    pen = ImageDraw.Draw(image)
    for plant in plants:
        foot_m = np.array([[plant.x_body_m, plant.y_body_m]])
        u_px, v_px = ground_to_pixels(foot_m, camera.matrix(), ROBOT.body_from_camera())[0]
        pen.ellipse((u_px - 12, v_px - 12, u_px + 12, v_px + 12), fill=WEED)
    frame = CameraFrame(t_s=float(index), index=index, image_rgb=np.asarray(image))
    scene = Scene(
        t_s=frame.t_s, ready_s=frame.t_s + 0.2, frame_index=index, plants=plants, view_body_m=()
    )
    is_plant = np.all(frame.image_rgb == WEED, axis=2)
    class_id = np.where(is_plant, PlantClass.WEED, PlantClass.SOIL).astype(np.uint8)
    return scene, SeenFrame(frame, estimate(), class_id[::2, ::2])


def in_map(plant: GroundPlant) -> tuple[float, float]:
    pose = estimate()
    cos_yaw, sin_yaw = np.cos(pose.yaw_map_rad), np.sin(pose.yaw_map_rad)
    return (
        pose.x_map_m + cos_yaw * plant.x_body_m - sin_yaw * plant.y_body_m,
        pose.y_map_m + sin_yaw * plant.x_body_m + cos_yaw * plant.y_body_m,
    )


def pictures(kept: int = 100) -> PlantPictures:
    return PlantPictures(ROBOT, RecentFrames(), REACH_M, kept)


def pixels(jpeg: bytes) -> ByteArray:
    return np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))


def shade(cut: ByteArray, at_px: int) -> FloatArray:
    """Mean colour about a place on the diagonal: JPEG's single pixels ring by up to 23 levels."""
    patch = slice(at_px - PATCH_PX, at_px + PATCH_PX + 1)
    return cut[patch, patch].astype(float).mean(axis=(0, 1))  # type: ignore[no-any-return]


@pytest.mark.parametrize("pixel", [(320.0, 240.0), (200.0, 300.0), (450.0, 200.0)])
def test_the_plant_stands_in_the_middle_of_its_picture(pixel: tuple[float, float]) -> None:
    found, weed = pictures(), plant_at(*pixel)
    found.see(*seen(1, weed))
    picture = found.near(*in_map(weed))
    assert picture is not None
    cut = pixels(picture.jpeg)
    middle = cut.shape[0] // 2
    assert np.abs(shade(cut, middle) - WEED).max() < 10
    assert np.abs(shade(cut, PATCH_PX) - SOIL).max() < 10
    assert picture.t_s == 1.0


def test_a_plant_with_its_leaves_beside_its_foot_is_shown_by_its_leaves() -> None:
    found, weed, beside = pictures(), plant_at(320.0, 240.0), plant_at(320.0, 230.0)
    scene, shot = seen(1, beside)
    found.see(msgspec.structs.replace(scene, plants=(weed,)), shot)
    picture = found.near(*in_map(weed))
    assert picture is not None
    rows, columns = np.nonzero(pixels(picture.jpeg)[..., 0] < 90)
    half = pixels(picture.jpeg).shape[0] / 2
    assert abs(rows.mean() - half) < 3.0
    assert abs(columns.mean() - half) < 3.0


def test_the_frame_nearest_to_the_middle_is_kept() -> None:
    found = pictures()
    far, near = plant_at(330.0, 420.0), plant_at(322.0, 250.0)
    shift_m = far.x_body_m - near.x_body_m
    for index, plant in enumerate((far, near, far), 1):
        scene, shot = seen(index, plant)
        x_m = estimate().x_map_m + (shift_m if plant is near else 0.0)
        moved = msgspec.structs.replace(shot.estimate, x_map_m=x_m)
        found.see(scene, shot._replace(estimate=moved))
    picture = found.near(*in_map(far))
    assert picture is not None
    assert picture.t_s == 2.0


def test_crops_and_places_without_a_weed_have_no_picture() -> None:
    found = pictures()
    weed, crop = plant_at(250.0, 240.0), plant_at(400.0, 240.0, PlantClass.CROP)
    found.see(*seen(1, weed, crop))
    assert found.near(*in_map(weed)) is not None
    assert found.near(*in_map(crop)) is None


def test_only_the_newest_are_kept() -> None:
    found = pictures(kept=3)
    weeds = [plant_at(60.0 + 120.0 * n, 240.0) for n in range(5)]
    for index, weed in enumerate(weeds):
        found.see(*seen(index, weed))
    kept = [found.near(*in_map(weed)) is not None for weed in weeds]
    assert kept == [False, False, True, True, True]


def test_no_picture_is_large_however_busy_the_ground() -> None:
    found, weed = pictures(), plant_at(320.0, 240.0)
    scene, shot = seen(1, weed)
    noise = np.random.default_rng(1).integers(0, 255, shot.frame.image_rgb.shape, dtype=np.uint8)
    frame = CameraFrame(t_s=1.0, index=1, image_rgb=noise)
    found.see(scene, shot._replace(frame=frame))
    picture = found.near(*in_map(weed))
    assert picture is not None
    assert len(picture.jpeg) <= MAX_BYTES


def test_frames_and_scenes_meet_in_a_thread_of_their_own() -> None:
    recent = RecentFrames()
    found, weed = PlantPictures(ROBOT, recent, REACH_M), plant_at(320.0, 240.0)
    scene, shot = seen(1, weed)
    recent.mask(1, MASK)
    recent(tick(shot.frame))
    record = tick()
    record.scenes = (scene,)  # type: ignore[misc]
    found.start()
    found(record)
    patience = threading.Event()
    for _ in range(600):
        if found.near(*in_map(weed)):
            break
        patience.wait(0.1)
    found.close()
    assert found.near(*in_map(weed)) is not None


def test_a_browser_gets_the_picture_of_a_weed_and_when_it_was_taken(robot: Robot) -> None:
    robot.say(wire.WeedChanges(set=[make_weed(12, 3.5, 1.25)]))
    browser = Browser(robot.port)
    wait_for(lambda: browser.ask("GET", "/api/v1/weeds.geojson")[1]["features"], "the weed")
    path = "/api/v1/weeds/12/picture"
    robot.answers[wire.FindPlantPicture] = wire.PlantPictureFile(jpeg=b"picture", t_s=1.5)
    assert browser.ask("GET", path) == (200, b"picture")
    robot.answers[wire.FindPlantPicture] = wire.PlantPictureFile()
    status, said = browser.ask("GET", path)
    _, question = robot.wait_for_question(wire.FindPlantPicture)
    assert (question.x_map_m, question.y_map_m) == (3.5, 1.25)
    assert (status, "too long ago" in said["error"]) == (404, True)
    assert browser.ask("GET", "/api/v1/weeds/13/picture")[0] == 404
