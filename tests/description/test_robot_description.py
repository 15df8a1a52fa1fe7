"""The packaged robot: its numbers, and that everything follows from them."""

from __future__ import annotations

import math
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.implement.hoe import HoeSpec
from agribot.core.messages import WHEEL_NAMES, FloatArray, Vec3
from agribot.core.robot import RobotSpec
from agribot.description.loader import export_urdf, load_robot
from agribot.description.package import ROOT

FRAMES: dict[str, tuple[Vec3, Vec3]] = {  # in base_link: xyz in m, rpy in rad
    "right_wheel_R": ((-0.2519, -0.3908, -0.1908), (0.0, 0.0, 1.57)),
    "left_wheel_R": ((-0.2519, 0.3908, -0.1908), (0.0, 0.0, 1.57)),
    "right_wheel_F": ((0.2519, -0.3908, -0.1908), (0.0, 0.0, 1.57)),
    "left_wheel_F": ((0.2519, 0.3908, -0.1908), (0.0, 0.0, 1.57)),
    "imu_link": ((0.0, 0.06, 0.0), (0.0, 0.0, 0.0)),
    "gps_link": ((0.0, -0.06, 0.0), (0.0, 0.0, 0.0)),
    "magnetometer_link": ((0.3, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "camera_link": ((0.32, 0.0, 0.62), (0.0, math.radians(50.0), 0.0)),
    "dummy_link": ((0.0, 0.0, -0.26), (0.0, 0.0, 0.0)),
    "base_link": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
}


@pytest.fixture(scope="module")
def robot() -> RobotSpec:
    return load_robot()


def _copied_set(folder: Path, **changes: str) -> Path:
    """The packaged xacro files elsewhere, with other values for some properties."""
    shutil.copytree(ROOT / "urdf", folder / "urdf", ignore=shutil.ignore_patterns("*.urdf"))
    for file in (folder / "urdf").glob("*.xacro"):
        text = file.read_text("utf-8")
        for name, value in changes.items():
            start = text.find(f'<xacro:property name="{name}" value="')
            if start >= 0:
                first = text.index('value="', start) + len('value="')
                text = text[:first] + value + text[text.index('"', first) :]
        file.write_text(text, "utf-8")
    return folder / "urdf" / "agribot_sensors.urdf.xacro"


def _urdf_forward_kinematics(urdf: str) -> dict[str, FloatArray]:
    """Poses in the root link, worked out from the XML alone."""
    poses = {"dummy_link": np.eye(4)}
    joints = list(ET.fromstring(urdf).findall("joint"))
    while joints:
        joint = joints.pop(0)
        parent, child = (joint.find(tag).get("link") for tag in ("parent", "child"))  # type: ignore[union-attr]
        if parent not in poses:
            joints.append(joint)
            continue
        origin = joint.find("origin")
        assert origin is not None and child is not None and parent is not None
        x, y, z = (float(word) for word in origin.get("xyz", "").split())
        roll, pitch, yaw = (float(word) for word in origin.get("rpy", "").split())
        poses[child] = poses[parent] @ transform((x, y, z), (roll, pitch, yaw))
    return poses


@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_is_where_the_machine_has_it(robot: RobotSpec, frame: str) -> None:
    np.testing.assert_allclose(robot.base_from_link(frame), transform(*FRAMES[frame]), atol=1e-9)


def test_exported_urdf_has_the_same_frames_as_the_spec(robot: RobotSpec) -> None:
    exported = _urdf_forward_kinematics(export_urdf())
    assert set(exported) == {link.name for link in robot.links}
    base_from_root = np.linalg.inv(exported["base_link"])
    for name, root_from_link in exported.items():
        np.testing.assert_allclose(
            base_from_root @ root_from_link, robot.base_from_link(name), atol=1e-9
        )


def test_base_stands_on_its_wheels_whatever_the_root_link_says(robot: RobotSpec) -> None:
    assert robot.base_height_m == pytest.approx(0.09 + 0.1908, abs=1e-12)
    lowest_m = robot.body_from_link("left_wheel_F")[2, 3] - robot.drive.wheel_radius_m
    assert lowest_m == pytest.approx(0.0, abs=1e-12)


def test_masses_and_inertias_are_those_of_the_machine(robot: RobotSpec) -> None:
    assert robot.mass_kg == pytest.approx(3.4672 + 4 * 0.411 + 0.001)
    base = robot.link("base_link")
    assert base.inertia_kgm2 == (0.045731, 0.077236, 0.049938, 0.0, 0.0, 0.0)
    for name in WHEEL_NAMES:
        wheel = robot.link(name)
        assert (wheel.mass_kg, wheel.com.xyz_m[0]) == (0.411, 1.6567e-5)
        assert wheel.inertia_kgm2[:3] == (0.0020959, 0.00113, 0.00113)


def test_inertias_are_those_of_real_bodies(robot: RobotSpec) -> None:
    for link in robot.links:
        if link.mass_kg > 0.0:
            ixx, iyy, izz = link.inertia_kgm2[:3]
            assert ixx + iyy > izz and iyy + izz > ixx and izz + ixx > iyy


def test_wheel_joints_have_their_limits_and_gears(robot: RobotSpec) -> None:
    wheels = [joint for joint in robot.joints if joint.kind == "continuous"]
    assert [joint.name for joint in wheels] == [f"base_link_to_{w}_joint" for w in WHEEL_NAMES]
    for joint in wheels:
        assert (joint.effort_nm, joint.velocity_radps, joint.gear_ratio) == (100.0, 100.0, 10.0)
        assert (joint.damping_nmspr, joint.friction_nm, joint.axis) == (0.0, 0.0, (1.0, 0.0, 0.0))


def test_drive_measures_the_geometry_and_keeps_what_the_plugin_was_told(robot: RobotSpec) -> None:
    drive = robot.drive
    assert (drive.wheel_radius_m, drive.wheel_width_m) == (0.09, 0.05)
    assert (drive.track_m, drive.wheelbase_m) == pytest.approx((0.7816, 0.5038), abs=1e-12)
    assert (drive.plugin_diameter_m, drive.plugin_separation_m) == (0.2, 0.65)
    assert (drive.torque_nm, drive.gear_ratio, drive.rate_hz) == (20.0, 10.0, 100.0)


def test_a_straight_command_turns_the_wheels_at_their_rolling_speed(robot: RobotSpec) -> None:
    left, right = robot.drive.wheel_speeds_radps(0.45, 0.0)
    assert left == right == pytest.approx(0.45 / 0.09)


def test_yaw_multiplier_is_that_of_equal_friction_at_all_four_wheels(robot: RobotSpec) -> None:
    """On the spot, each tyre pushes against its sliding velocity; the moments must cancel."""
    half_base_m, half_track_m = robot.drive.wheelbase_m / 2, robot.drive.track_m / 2
    rim_mps = robot.drive.effective_separation_m / 2  # at 1 rad/s
    sliding = np.array([half_track_m - rim_mps, half_base_m])  # forward and sideways, right front
    moment = float(np.dot(sliding, [half_track_m, half_base_m]))
    assert moment == pytest.approx(0.0, abs=1e-12)


def test_friction_is_the_smaller_of_tyre_and_ground(tmp_path: Path, robot: RobotSpec) -> None:
    assert robot.tyre.friction_longitudinal_ratio == robot.tyre.friction_lateral_ratio == 1.0
    top = _copied_set(tmp_path)
    drive = top.with_name("agribot_drive.urdf.xacro")
    slippery = drive.read_text().replace("<ground_mu1>100<", "<ground_mu1>0.4<")
    drive.write_text(slippery)
    tyre = load_robot(str(top)).tyre
    # fdir1 lies along the axle, so the first coefficient acts sideways.
    assert (tyre.friction_lateral_ratio, tyre.friction_longitudinal_ratio) == (0.4, 1.0)


def test_sensor_rates_come_from_the_tags(robot: RobotSpec) -> None:
    assert robot.mag is not None
    assert (robot.imu.rate_hz, robot.gnss.rate_hz, robot.mag.rate_hz) == (200.0, 5.0, 5.0)
    assert (robot.imu.link, robot.gnss.link, robot.mag.link) == (
        "imu_link", "gps_link", "magnetometer_link",
    )  # fmt: skip
    assert robot.gnss.tags["drift"].split() == ["5.0"] * 3
    assert float(robot.mag.tags["driftfrequency"].split()[0]) == 10.0


def test_camera_has_the_lens_of_the_original(robot: RobotSpec) -> None:
    camera = robot.camera
    assert camera is not None
    assert (camera.width_px, camera.height_px, camera.rate_hz) == (640, 480, 30.0)
    assert camera.focal_px == pytest.approx(381.36, abs=0.005)
    assert (camera.noise_std, camera.clip_near_m, camera.clip_far_m) == (0.007, 0.02, 300.0)


def test_camera_looks_at_the_soil_ahead_of_the_wheels(robot: RobotSpec) -> None:
    body_from_camera = robot.body_from_camera()
    ray = body_from_camera[:3, 2]
    ahead_m = body_from_camera[0, 3] - body_from_camera[2, 3] * ray[0] / ray[2]
    assert 0.6 < ahead_m < 1.5
    assert body_from_camera[:3, 0] @ np.array([0.0, 1.0, 0.0]) == pytest.approx(-1.0)


def test_optical_frame_of_the_urdf_is_that_of_the_spec(robot: RobotSpec) -> None:
    link_from_optical = np.linalg.inv(robot.base_from_link("camera_link"))
    np.testing.assert_allclose(
        link_from_optical @ robot.base_from_link("camera_optical_frame"),
        LINK_FROM_OPTICAL,
        atol=1e-9,
    )


def test_the_hoe_is_the_same_robot_with_blades_instead_of_the_boom(robot: RobotSpec) -> None:
    hoe = load_robot("agribot-hoe")
    assert isinstance(hoe.implement, HoeSpec)
    assert hoe.implement.width_m == pytest.approx(1.1)  # nothing is left between rows 1 m apart
    assert hoe.implement.section_width_m == hoe.implement.section_spacing_m
    assert sum(hoe.implement.section_y_body_m()) == pytest.approx(0.0)
    assert (hoe.drive, hoe.camera, hoe.imu) == (robot.drive, robot.camera, robot.imu)
    added = {link.name for link in hoe.links} - {link.name for link in robot.links}
    assert added == {"hoe_link"}
    assert hoe.mass_kg == pytest.approx(robot.mass_kg + 0.9)
    assert hoe.base_from_link("hoe_link")[0, 3] == hoe.tool_x_m == -0.35
    # A blade that is lifted hangs above the ground by its lift.
    lowest_m = min(
        (hoe.body_from_link("hoe_link") @ shape.origin.matrix())[2, 3] - shape.size_m[2] / 2.0
        for shape in hoe.link("hoe_link").visuals
    )
    assert lowest_m == pytest.approx(hoe.implement.lift_m, abs=0.01)
    assert not hoe.warnings


def test_sprayer_reaches_from_wheel_to_wheel(robot: RobotSpec) -> None:
    sprayer = robot.implement
    assert sprayer is not None
    nozzles = sprayer.section_y_body_m()
    assert len(nozzles) == 27 and nozzles[0] == pytest.approx(0.52)
    assert 2 * nozzles[0] + sprayer.section_width_m == pytest.approx(sprayer.width_m)
    assert sprayer.width_m == pytest.approx(1.08)
    assert sprayer.width_m > robot.drive.track_m
    assert sprayer.x_body_m == -0.35


def test_nothing_but_legs_and_wheels_hangs_lower_than_a_crop(robot: RobotSpec) -> None:
    crop_top_m, row_half_width_m = 0.22, 0.25
    for name in ("base_link", "camera_link", "camera_mast_link"):
        for shape in robot.link(name).collisions:
            body_from_shape = robot.body_from_link(name) @ shape.origin.matrix()
            reach_m = float(np.linalg.norm(shape.size_m)) / 2
            if abs(body_from_shape[1, 3]) < row_half_width_m and shape.kind == "box":
                assert body_from_shape[2, 3] - shape.size_m[2] / 2 > crop_top_m
            elif abs(body_from_shape[1, 3]) < row_half_width_m:
                assert body_from_shape[2, 3] - reach_m > crop_top_m


def test_seven_named_colours() -> None:
    materials = ET.fromstring(export_urdf()).findall("material")
    palette = {
        m.get("name"): tuple(float(v) for v in m.find("color").get("rgba", "").split())  # type: ignore[union-attr]
        for m in materials
    }
    assert palette == {
        "Black": (0, 0, 0, 1),
        "Gray": (0.7, 0.7, 0.7, 1),
        "DarkGray": (0.2, 0.2, 0.2, 1),
        "White": (1, 1, 1, 1),
        "Yellow": (0.8, 0.8, 0, 1),
        "WoodBrown": (0.7, 0.6, 0.4, 1),
        "Red": (1, 0, 0, 1),
    }


def test_sensor_boxes_wear_their_colours(robot: RobotSpec) -> None:
    colours = {name: robot.link(name).visuals[0].rgba for name in ("imu_link", "gps_link")}
    assert colours == {"imu_link": (0.8, 0.8, 0.0, 1.0), "gps_link": (0.0, 0.0, 0.0, 1.0)}


def test_one_number_changes_drive_height_frames_and_export(tmp_path: Path) -> None:
    top = _copied_set(tmp_path, wheel_radius="0.12")
    robot = load_robot(str(top))
    assert robot.drive.wheel_radius_m == 0.12
    assert robot.base_height_m == pytest.approx(0.12 + 0.1908)
    assert robot.body_from_camera()[2, 3] == pytest.approx(0.12 + 0.1908 + 0.62)
    assert robot.drive.wheel_speeds_radps(0.6, 0.0)[0] == pytest.approx(5.0)
    for name in WHEEL_NAMES:
        path = f"link[@name='{name}']/collision/geometry/cylinder"
        cylinder = ET.fromstring(export_urdf(str(top))).find(path)
        assert cylinder is not None and cylinder.get("radius") == "0.12"
    assert robot.link("left_wheel_F").visuals[0].size_m[1] == pytest.approx(0.12 / 0.09)


def test_a_wider_track_moves_the_wheels_and_the_yaw_multiplier(tmp_path: Path) -> None:
    robot = load_robot(str(_copied_set(tmp_path, track="1.0")))
    np.testing.assert_allclose(robot.wheel_xy_body_m()[:, 1], [-0.5, 0.5, -0.5, 0.5])
    expected = 1 + (0.2519 / 0.5) ** 2
    assert robot.drive.yaw_multiplier == pytest.approx(expected)


def test_legacy_camera_sits_level_in_the_chassis() -> None:
    robot = load_robot(mappings={"legacy_camera": "true"})
    np.testing.assert_allclose(robot.base_from_link("camera_link"), np.eye(4), atol=1e-12)
    assert all(link.name != "camera_mast_link" for link in robot.links)


def test_camera_can_be_mounted_elsewhere() -> None:
    robot = load_robot(mappings={"camera_xyz": "0.1 0.2 0.5", "camera_rpy": "0 1.2 0.3"})
    np.testing.assert_allclose(
        robot.base_from_link("camera_link"), transform((0.1, 0.2, 0.5), (0.0, 1.2, 0.3)), atol=1e-12
    )


def test_camera_inertia_bug_is_only_there_when_asked_for() -> None:
    assert max(load_robot().link("camera_link").inertia_kgm2) < 1e-5
    legacy = load_robot(mappings={"legacy_camera_inertia": "true"})
    assert legacy.link("camera_link").inertia_kgm2[:3] == (0.1, 0.1, 0.1)
