"""How an IMU is mounted is found from gravity, turns and accelerations."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.app.localization.imu_mount import SQUARE, ImuMount
from agribot.app.localization.log import LogEntry, TwistSample
from agribot.app.localization.log_scan import LogScan
from agribot.app.localization.mounting import list_mount_notes
from agribot.core.messages import FloatArray, ImuSample
from agribot.core.robot import DriveSpec
from agribot.description.loader import load_robot
from tests.app.localization.drives import Drive, make_drive, rotation_deg


@pytest.fixture(scope="module")
def wheels() -> DriveSpec:
    return load_robot().drive


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive(duration_s=60.0)


def scan(
    drive: Drive,
    wheels: DriveSpec,
    body_from_imu: FloatArray,
    offset_mps2: FloatArray | float = 0.0,
) -> ImuMount | None:
    """The mount that is found of the drive with its IMU turned."""
    found = LogScan(wheels)
    gyro = drive.imu[:, 1:4] @ body_from_imu
    accel = (drive.imu[:, 4:] + offset_mps2) @ body_from_imu
    entries = [
        LogEntry("imu", t, t, "", ImuSample(t_s=0.0, gyro_radps=tuple(w), accel_mps2=tuple(a)))
        for t, w, a in zip(drive.imu[:, 0].tolist(), gyro.tolist(), accel.tolist(), strict=True)
    ]
    entries += [
        LogEntry("odom", t, t, "", TwistSample(t_s=0.0, v_mps=v, yaw_rate_radps=w))
        for t, v, w in drive.odom.tolist()
    ]
    for entry in sorted(entries, key=lambda each: each.stamp_s):
        found.note(entry)
        found.add(entry)
    return found.mount.solve()


def test_every_square_mount_is_found(drive: Drive, wheels: DriveSpec) -> None:
    assert len({each.tobytes() for each in SQUARE}) == 24
    for body_from_imu in SQUARE:
        mount = scan(drive, wheels, body_from_imu)
        assert mount is not None and mount.has_heading
        assert np.array_equal(mount.body_from_imu, body_from_imu)


def test_a_mount_that_is_not_square_is_found_to_some_degrees(
    drive: Drive, wheels: DriveSpec
) -> None:
    body_from_imu = rotation_deg(20.0, -30.0, 50.0)
    mount = scan(drive, wheels, body_from_imu)
    assert mount is not None
    off = mount.body_from_imu @ body_from_imu.T
    assert math.degrees(math.acos((np.trace(off) - 1.0) / 2.0)) < 6.0
    assert mount.body_from_imu[2] == pytest.approx(body_from_imu[2], abs=0.02)


def test_an_imu_a_few_degrees_off_square_is_taken_for_square(
    drive: Drive, wheels: DriveSpec
) -> None:
    mount = scan(drive, wheels, rotation_deg(2.0, -3.0, 90.0))
    assert mount is not None
    assert mount.body_from_imu == pytest.approx(rotation_deg(0.0, 0.0, 90.0), abs=1e-9)


def test_without_gravity_the_turns_show_the_vertical(drive: Drive, wheels: DriveSpec) -> None:
    up_side_down = rotation_deg(180.0, 0.0, 0.0)
    mount = scan(drive, wheels, up_side_down, np.array([0.0, 0.0, -9.81]))
    assert mount is not None and not mount.has_gravity
    assert mount.body_from_imu == pytest.approx(up_side_down, abs=1e-9)


def test_gravity_that_points_down_is_taken_with_the_other_sign(
    drive: Drive, wheels: DriveSpec
) -> None:
    turned = drive.imu.copy()
    turned[:, 4:] *= -1.0
    mount = scan(msgspec.structs.replace(drive, imu=turned), wheels, np.eye(3))
    assert mount is not None and mount.accel_sign == -1.0
    assert mount.body_from_imu == pytest.approx(np.eye(3), abs=1e-9)


def test_a_gyro_with_other_axes_than_its_accelerometer_is_noticed(
    drive: Drive, wheels: DriveSpec
) -> None:
    turned = drive.imu.copy()
    turned[:, 1:4] = turned[:, [3, 1, 2]]
    other = msgspec.structs.replace(drive, imu=turned)
    mount = scan(other, wheels, np.eye(3))
    assert mount is not None
    assert math.degrees(mount.apart_rad) == pytest.approx(90.0, abs=3.0)
    assert any("an axis 90 degrees off gravity" in note for note in list_mount_notes(mount))


def test_a_robot_that_only_stands_shows_the_vertical_alone(wheels: DriveSpec) -> None:
    standing = make_drive(duration_s=3.0, accel_noise_mps2=0.02)
    mount = scan(standing, wheels, rotation_deg(90.0, 0.0, 0.0))
    assert mount is not None and not mount.has_heading
    assert mount.turn((0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)


def test_an_imu_that_shakes_more_than_the_wheels_accelerate_leaves_the_heading_unknown(
    wheels: DriveSpec,
) -> None:
    rough = make_drive(duration_s=20.0, accel_noise_mps2=6.0)
    mount = scan(rough, wheels, np.eye(3))
    assert mount is not None and not mount.has_heading
    assert mount.body_from_imu[2] == pytest.approx((0.0, 0.0, 1.0))
