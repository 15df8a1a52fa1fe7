"""Geometry of a robot description, on a small robot with known numbers."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import (
    CameraSpec,
    Joint,
    Link,
    Origin,
    RobotSpec,
    SensorMount,
    TyreSpec,
)
from tests.robot_parts import change_drive, make_wheels

WHEEL_RADIUS_M = 0.2
WHEEL_DROP_M = 0.05

DRIVE = change_drive(
    wheel_radius_m=WHEEL_RADIUS_M, wheel_width_m=0.1, track_m=0.8, wheelbase_m=0.5,
    plugin_diameter_m=0.36, yaw_multiplier=1.5, torque_nm=30.0, max_yaw_rate_radps=1.0,
    max_accel_mps2=1.0, max_yaw_accel_radps2=2.0, rotor_inertia_kgm2=0.01, servo_gain_nmspr=20.0,
)  # fmt: skip
WHEEL_XY_M = {
    "right_wheel_R": (-0.25, -0.4),
    "left_wheel_R": (-0.25, 0.4),
    "right_wheel_F": (0.25, -0.4),
    "left_wheel_F": (0.25, 0.4),
}
CAMERA = CameraSpec(
    link="camera_link",
    width_px=640,
    height_px=480,
    hfov_rad=math.pi / 2,
    rate_hz=10.0,
    noise_std=0.0,
    clip_near_m=0.05,
    clip_far_m=10.0,
)


def make_robot(camera: CameraSpec | None = CAMERA) -> RobotSpec:
    """A root link below a base link, four wheels, a mast and a camera that looks down ahead."""
    links = [Link(name="root"), Link(name="base_link", mass_kg=20.0), Link(name="mast")]
    links += [Link(name="camera_link", mass_kg=0.5)]
    links += [Link(name=name, mass_kg=2.0) for name in WHEEL_NAMES]
    joints = [
        Joint(
            name="root_joint",
            kind="fixed",
            parent="root",
            child="base_link",
            origin=Origin(xyz_m=(0.0, 0.0, 0.3), rpy_rad=(0.0, 0.0, 0.5)),
        ),
        Joint(
            name="mast_joint",
            kind="fixed",
            parent="base_link",
            child="mast",
            origin=Origin(xyz_m=(0.1, 0.0, 0.4), rpy_rad=(0.0, 0.0, math.pi / 2)),
        ),
        Joint(
            name="camera_joint",
            kind="fixed",
            parent="mast",
            child="camera_link",
            origin=Origin(xyz_m=(0.0, -0.2, 0.1), rpy_rad=(0.0, 0.0, -math.pi / 2)),
        ),
    ]
    joints += make_wheels(0.25, 0.4, -WHEEL_DROP_M, axis=(0.0, 1.0, 0.0))
    mount = SensorMount(link="mast", rate_hz=50.0)
    return RobotSpec(
        name="little",
        links=tuple(links),
        joints=tuple(joints),
        drive=DRIVE,
        tyre=TyreSpec(),
        imu=mount,
        gnss=mount,
        mag=mount,
        camera=camera,
    )


def test_the_base_stands_where_the_wheels_touch_the_ground() -> None:
    robot = make_robot()
    assert robot.base_height_m == pytest.approx(WHEEL_RADIUS_M + WHEEL_DROP_M)
    for name in WHEEL_NAMES:
        assert robot.body_from_link(name)[2, 3] == pytest.approx(WHEEL_RADIUS_M)


def test_wheel_contacts_come_in_the_order_of_the_wheel_names() -> None:
    expected = [WHEEL_XY_M[name] for name in WHEEL_NAMES]
    np.testing.assert_allclose(make_robot().wheel_xy_body_m(), expected)


def test_frames_chain_through_turned_parents() -> None:
    """The mast is turned left, so the camera's -0.2 across the mast is +0.2 ahead of it."""
    body_from_camera_link = make_robot().body_from_link("camera_link")
    np.testing.assert_allclose(body_from_camera_link[:3, 3], [0.3, 0.0, 0.25 + 0.5], atol=1e-12)
    np.testing.assert_allclose(body_from_camera_link[:3, :3], np.eye(3), atol=1e-12)


def test_a_link_above_the_base_in_the_tree_has_its_place_too() -> None:
    base_from_root = make_robot().base_from_link("root")
    root_from_base = Origin(xyz_m=(0.0, 0.0, 0.3), rpy_rad=(0.0, 0.0, 0.5)).matrix()
    np.testing.assert_allclose(base_from_root @ root_from_base, np.eye(4), atol=1e-12)


def test_the_base_is_its_own_origin() -> None:
    np.testing.assert_allclose(make_robot().base_from_link("base_link"), np.eye(4), atol=1e-12)


def test_right_in_the_image_is_right_of_the_robot_and_down_is_down() -> None:
    body_from_camera = make_robot().body_from_camera()
    place = body_from_camera[:3, 3]
    right = body_from_camera @ [1.0, 0.0, 0.0, 1.0]
    down = body_from_camera @ [0.0, 1.0, 0.0, 1.0]
    ahead = body_from_camera @ [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(right[:3] - place, [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(down[:3] - place, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(ahead[:3] - place, [1.0, 0.0, 0.0], atol=1e-12)


def test_a_plant_ahead_on_the_right_appears_low_on_the_right() -> None:
    camera_from_body = np.linalg.inv(make_robot().body_from_camera())
    x, y, z, _ = camera_from_body @ [1.3, -0.4, 0.0, 1.0]
    u_px, v_px, w = CAMERA.matrix() @ [x, y, z]
    assert z > 0.0
    assert u_px / w == pytest.approx(319.5 + 320.0 * 0.4 / 1.0)
    assert v_px / w == pytest.approx(239.5 + 320.0 * 0.75 / 1.0)


def test_the_outermost_pixel_edges_span_the_field_of_view() -> None:
    k = CAMERA.matrix()
    left = math.atan2(-0.5 - k[0, 2], k[0, 0])
    right = math.atan2(CAMERA.width_px - 0.5 - k[0, 2], k[0, 0])
    assert right - left == pytest.approx(CAMERA.hfov_rad)
    assert k[0, 0] == k[1, 1]


def test_driving_straight_turns_both_sides_alike() -> None:
    assert DRIVE.wheel_speeds_radps(0.4, 0.0) == pytest.approx((2.0, 2.0))


def test_turning_left_on_the_spot_turns_the_right_wheels_forward() -> None:
    left, right = DRIVE.wheel_speeds_radps(0.0, 0.5)
    assert left == -right
    assert right == pytest.approx(0.5 * 0.8 * 1.5 / 2.0 / 0.2)


def test_wheel_speeds_give_back_the_twist_through_the_effective_separation() -> None:
    left, right = DRIVE.wheel_speeds_radps(0.37, -0.21)
    radius, separation = DRIVE.wheel_radius_m, DRIVE.effective_separation_m
    assert (left + right) / 2 * radius == pytest.approx(0.37)
    assert (right - left) * radius / separation == pytest.approx(-0.21)


def test_nozzles_are_counted_from_the_left_and_centred() -> None:
    boom = SprayerSpec(
        x_body_m=0.0, section_count=4, section_spacing_m=0.1, section_width_m=0.1, latency_s=0.1
    )
    assert boom.section_y_body_m() == pytest.approx((0.15, 0.05, -0.05, -0.15))


def test_the_mass_is_that_of_all_links() -> None:
    assert make_robot().mass_kg == pytest.approx(20.0 + 0.5 + 4 * 2.0)


def test_an_unknown_link_is_answered_with_the_known_ones() -> None:
    with pytest.raises(DescriptionError, match=r"'little' has no link 'arm'; it has: base_link,"):
        make_robot().body_from_link("arm")


def test_a_robot_without_camera_says_so() -> None:
    with pytest.raises(DescriptionError, match="has no camera"):
        make_robot(camera=None).body_from_camera()


def test_a_robot_without_power_rolls_until_its_tyres_have_taken_all_its_energy() -> None:
    robot, v_mps = make_robot(), 0.8
    turning_j = 4 * DRIVE.rotor_inertia_kgm2 * (v_mps / WHEEL_RADIUS_M) ** 2 / 2.0
    moving_j = robot.mass_kg * v_mps**2 / 2.0
    resistance_n = robot.tyre.rolling_resistance_ratio * robot.mass_kg * 9.81
    rolled_m = robot.promise_roll_out_m(v_mps) - 0.2 * v_mps
    assert rolled_m == pytest.approx((turning_j + moving_j) / resistance_n)
    assert robot.promise_roll_out_m(v_mps) > robot.promise_stop_m(v_mps)


def test_a_robot_whose_tyres_roll_without_resistance_promises_no_end() -> None:
    slick = msgspec.structs.replace(make_robot(), tyre=TyreSpec(rolling_resistance_ratio=0.0))
    assert slick.promise_roll_out_m(0.8) == math.inf
