"""Frames of the simulated camera: where it looks from, when, and what the referee keeps."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.geo import rotation_from_rpy
from agribot.core.messages import ByteArray, FloatArray, PlantClass, RobotCommand, Vec3
from agribot.core.robot import CameraSpec, Origin, RobotSpec, Shape
from agribot.core.world import Light, Plant, WorldSpec
from agribot.sim.attitude import read_base_pose
from agribot.sim.camera_sensor import KEPT_MASKS, LOOK_PX, CameraSensor, TrueView
from agribot.sim.plant_states import PlantStates
from agribot.sim.platform import SimPlatform
from agribot.sim.random_streams import make_stream
from agribot.sim.state import HISTORY_COLUMNS
from agribot.sim.underside import Part
from tests.waiting import PATIENCE_S

MAST_M, TILT_RAD = 0.5, math.radians(40.0)

# Says which of the renderer's loops were still compiled, or loaded, for the first frames of a run.
COMPILED_LATE = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from agribot.core import config
from agribot.app.simulated_run import SimulatedRun, simulate

def compiled():
    modules = [m for name, m in sys.modules.items() if name.startswith("agribot.sim.camera")]
    loops = {loop for m in modules for loop in vars(m).values() if isinstance(loop, Dispatcher)}
    return {(loop.__name__, len(loop.signatures)) for loop in loops}

with simulate(config.load("farm", ["record.enabled=false"]), Path(sys.argv[1])) as session:
    before, frames = compiled(), 0
    for record in session.ticks():
        frames += len(record.batch.frames)
        if frames == 2:
            break
    print(sum(count for _, count in before) > 5, compiled() - before)
"""


@pytest.fixture(scope="module")
def seeing(rover: RobotSpec) -> RobotSpec:
    """The rover with a small camera on a mast, looking forward and down."""
    joints = tuple(
        msgspec.structs.replace(
            joint, origin=Origin(xyz_m=(0.1, 0.05, MAST_M), rpy_rad=(0.0, TILT_RAD, 0.0))
        )
        if joint.child == "camera_link"
        else joint
        for joint in rover.joints
    )
    assert rover.camera is not None
    camera = msgspec.structs.replace(rover.camera, width_px=160, height_px=120)
    return msgspec.structs.replace(rover, joints=joints, camera=camera)


@pytest.fixture(scope="module")
def garden(meadow: WorldSpec) -> WorldSpec:
    plant = Plant(
        species="sugar_beet", plant=PlantClass.CROP, x_map_m=2.0, y_map_m=1.3, yaw_rad=0.4,
        size_m=0.05, seed=3,
    )  # fmt: skip
    return msgspec.structs.replace(meadow, plants=(plant,))


def _row(
    robot: RobotSpec, x_m: float, y_m: float, rpy_rad: tuple[float, float, float]
) -> FloatArray:
    roll, pitch, yaw = (angle / 2 for angle in rpy_rad)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    row = np.zeros(HISTORY_COLUMNS)
    row[:3] = x_m, y_m, robot.base_height_m
    row[3:7] = (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )
    return row


def _camera(robot: RobotSpec) -> CameraSpec:
    assert robot.camera is not None
    return robot.camera


@pytest.mark.parametrize(
    ("x_m", "y_m", "rpy_deg"),
    [
        (1.0, 1.2, (0.0, 0.0, 0.0)),
        (1.2, 1.3, (0.0, 12.0, 10.0)),
        (1.1, 1.0, (-10.0, -4.0, 20.0)),
        (2.1, 0.3, (3.0, 0.0, 95.0)),
    ],
)
def test_a_plant_appears_where_the_pinhole_says_also_when_the_robot_tilts(
    seeing: RobotSpec,
    garden: WorldSpec,
    x_m: float,
    y_m: float,
    rpy_deg: tuple[float, float, float],
) -> None:
    roll, pitch, yaw = (math.radians(angle) for angle in rpy_deg)
    row = _row(seeing, x_m, y_m, (roll, pitch, yaw))
    assert read_base_pose(row)[:3, :3] == pytest.approx(rotation_from_rpy(roll, pitch, yaw))
    feed = CameraSensor(seeing, _camera(seeing), garden, None)
    frame = feed.sample(1.0, row)
    mask = feed.truth_mask(frame.index)
    assert mask is not None
    rows, columns = np.nonzero(mask == PlantClass.CROP)
    plant = garden.plants[0]
    p_map_m = np.array([plant.x_map_m, plant.y_map_m, plant.size_m / 2, 1.0])
    base_from_optical = seeing.body_from_camera()
    base_from_optical[2, 3] -= seeing.base_height_m
    p_camera_m = np.linalg.inv(read_base_pose(row) @ base_from_optical) @ p_map_m
    u_px, v_px, _ = _camera(seeing).matrix() @ (p_camera_m[:3] / p_camera_m[2])
    assert (columns.mean(), rows.mean()) == pytest.approx((u_px, v_px), abs=2.5)


def _with_deck(robot: RobotSpec, deck: Shape) -> RobotSpec:
    links = tuple(
        msgspec.structs.replace(link, visuals=(deck,)) if link.name == "base_link" else link
        for link in robot.links
    )
    return msgspec.structs.replace(robot, links=links)


def test_the_robot_shades_what_it_sees_with_the_sun_behind_it_and_no_label_changes(
    seeing: RobotSpec, garden: WorldSpec
) -> None:
    robot = _with_deck(seeing, Shape(kind="box", size_m=(0.6, 0.6, 0.3)))

    def frame(to_sun: Vec3, has_body: bool) -> tuple[FloatArray, ByteArray]:
        lit = msgspec.structs.replace(garden, light=Light(to_sun=to_sun))
        feed = CameraSensor(robot, _camera(robot), lit, None, has_body=has_body)
        seen = feed.sample(0.0, _row(robot, 1.0, 1.2, (0.0, 0.0, 0.0)))
        mask = feed.truth_mask(seen.index)
        assert mask is not None
        return seen.image_rgb.astype(float), mask

    behind, ahead = (-0.9, 0.0, 0.44), (0.9, 0.0, 0.44)
    bare, bare_mask = frame(behind, False)
    shaded, shaded_mask = frame(behind, True)
    np.testing.assert_array_equal(bare_mask, shaded_mask)
    shadow = (bare - shaded).max(axis=2) > 20.0
    deck = np.abs(frame(ahead, False)[0] - frame(ahead, True)[0]).max(axis=2) > 0.0
    assert deck[:80].sum() == 0  # with the sun ahead, only the deck itself low in the picture
    assert (shadow & ~deck).sum() > 400


def test_a_visual_whose_mesh_is_missing_is_left_out_with_a_warning(
    seeing: RobotSpec, garden: WorldSpec, caplog: pytest.LogCaptureFixture
) -> None:
    lost = Shape(kind="mesh", size_m=(1.0, 1.0, 1.0), mesh="package://elsewhere/body.dae")
    robot = _with_deck(seeing, lost)
    feed = CameraSensor(robot, _camera(robot), garden, None, has_body=True)
    assert feed.sample(0.0, _row(robot, 1.0, 1.2, (0.0, 0.0, 0.0))).image_rgb.any()
    assert "elsewhere/body.dae" in caplog.text


def test_each_picture_that_shows_thirty_pixels_of_a_plant_is_a_look_at_it(
    seeing: RobotSpec, garden: WorldSpec
) -> None:
    """The robot looks at the plant twice, then away from it; a tap sees each true view."""
    tall = msgspec.structs.replace(garden.plants[0], size_m=0.2)
    garden = msgspec.structs.replace(garden, plants=(tall,))
    feed = CameraSensor(seeing, _camera(seeing), garden, None)
    views: list[TrueView] = []
    feed.view_taps.append(views.append)
    for yaw_rad in (0.0, 0.0, math.pi):
        feed.sample(1.0, _row(seeing, 1.0, 1.2, (0.0, 0.0, yaw_rad)))
    pixels = [int((view.picture.instance == 0).sum()) for view in views]
    assert [count >= LOOK_PX for count in pixels] == [True, True, False]
    assert feed.looks[0] == 2
    assert [view.frame_index for view in views] == [0, 1, 2]


def test_only_the_last_masks_are_kept(seeing: RobotSpec, garden: WorldSpec) -> None:
    feed = CameraSensor(seeing, _camera(seeing), garden, None)
    for k in range(KEPT_MASKS + 5):
        feed.sample(0.1 * k, _row(seeing, 1.0, 1.2, (0.0, 0.0, 0.0)))
    assert feed.truth_mask(4) is None
    assert feed.truth_mask(5) is not None
    assert feed.truth_mask(KEPT_MASKS + 4) is not None


def test_noise_differs_from_frame_to_frame_and_repeats_with_the_seed(
    seeing: RobotSpec, garden: WorldSpec
) -> None:
    row = _row(seeing, 1.0, 1.2, (0.0, 0.0, 0.0))

    def frames(seed: int | None) -> list[FloatArray]:
        noise = None if seed is None else make_stream(seed, "camera")
        feed = CameraSensor(seeing, _camera(seeing), garden, noise)
        return [feed.sample(0.1 * k, row).image_rgb.astype(float) for k in range(2)]

    first, second = frames(1)
    assert not np.array_equal(first, second)
    assert np.array_equal(first, frames(1)[0])
    assert not np.array_equal(first, frames(2)[0])
    clean, clean_again = frames(None)
    assert np.array_equal(clean, clean_again)


def test_frames_come_at_the_configured_rate(seeing: RobotSpec, garden: WorldSpec) -> None:
    config = RunConfig(
        perception=PerceptionConfig(enabled=True, camera_rate_hz=7.0),
        sim=SimConfig(sensors="ideal"),
    )
    platform = SimPlatform(config, seeing, garden)
    times, indices = [], []
    for _ in range(100):
        batch = platform.read()
        platform.write(RobotCommand(t_s=batch.t_s))
        times += [frame.t_s for frame in batch.frames]
        indices += [frame.index for frame in batch.frames]
        assert all(batch.t_s - 0.02 - 1e-9 < frame.t_s <= batch.t_s for frame in batch.frames)
    assert indices == list(range(14))
    assert np.array(times) - np.arange(1, 15) / 7.0 == pytest.approx(np.full(14, 1e-3), abs=1e-3)
    assert platform.truth_mask(13) is not None


def test_nothing_is_left_to_compile_when_a_run_begins(tmp_path: Path) -> None:
    command = [sys.executable, "-c", COMPILED_LATE, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    assert done.stdout.strip() == "True set()"


def _look(feed: CameraSensor, t_s: float, row: FloatArray) -> tuple[ByteArray, ByteArray]:
    seen = feed.sample(t_s, row)
    mask = feed.truth_mask(seen.index)
    assert mask is not None
    return seen.image_rgb, mask


def test_a_crop_that_was_crushed_lies_along_the_way_of_the_wheel_and_its_label_with_it(
    seeing: RobotSpec, garden: WorldSpec
) -> None:
    grown = msgspec.structs.replace(garden.plants[0], size_m=0.15)
    garden = msgspec.structs.replace(garden, plants=(grown,))
    states, row = PlantStates(1), _row(seeing, 1.2, 1.2, (0.0, 0.0, 0.0))
    feed = CameraSensor(seeing, _camera(seeing), garden, None, plants=states)
    image, mask = _look(feed, 1.0, row)
    untouched = _look(CameraSensor(seeing, _camera(seeing), garden, None), 1.0, row)
    np.testing.assert_array_equal(image, untouched[0])
    states.crush(0, 1.5, Part.WHEEL, math.pi / 2)  # a wheel that went to the left
    flat_image, flat_mask = _look(feed, 2.0, row)
    upright, flat = (np.nonzero(m == PlantClass.CROP) for m in (mask, flat_mask))
    assert flat[1].mean() < upright[1].mean() - 1.0  # columns: to the left
    assert flat[0].min() > upright[0].min() + 2  # rows: its top is lower
    changed = (image != flat_image).any(axis=2)
    assert changed[flat_mask != mask].mean() > 0.95
    _, later_mask = _look(feed, 3000.0, row)
    later_image = feed.sample(3000.0, row).image_rgb
    np.testing.assert_array_equal(later_mask, flat_mask)
    green = (flat_mask == PlantClass.CROP) & (later_mask == PlantClass.CROP)
    assert later_image[green].mean() < flat_image[green].mean() - 5.0  # it wilts


def test_a_weed_that_was_run_over_lies_in_the_picture_where_the_world_is_not_kind(
    seeing: RobotSpec, garden: WorldSpec
) -> None:
    weed = msgspec.structs.replace(garden.plants[0], plant=PlantClass.WEED, species="thistle")
    garden = msgspec.structs.replace(garden, plants=(weed,))
    row = _row(seeing, 1.2, 1.2, (0.0, 0.0, 0.0))

    def look(*, keeps_weeds: bool) -> tuple[ByteArray, ByteArray]:
        states = PlantStates(1)
        states.cut(0, 0.5, 0.0)
        feed = CameraSensor(
            seeing, _camera(seeing), garden, None, plants=states, keeps_weeds=keeps_weeds
        )
        return _look(feed, 1.0, row)

    untouched = _look(CameraSensor(seeing, _camera(seeing), garden, None), 1.0, row)
    np.testing.assert_array_equal(look(keeps_weeds=True)[0], untouched[0])
    lying = look(keeps_weeds=False)[1]
    assert (lying == PlantClass.WEED).any() and not np.array_equal(lying, untouched[1])
