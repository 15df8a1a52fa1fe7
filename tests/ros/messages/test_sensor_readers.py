"""What other people's nodes say, as samples of the robot; and when they said it."""

from __future__ import annotations

import io
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image

from agribot.core.errors import BridgeError, ConfigError
from agribot.core.messages import (
    WHEEL_NAMES,
    CameraFrame,
    GnssFix,
    GnssQuality,
    ImuSample,
    LaserScan,
    MagSample,
    WheelSample,
)
from agribot.core.stamp_clock import StampClock
from agribot.description.lidar import fit_lidar
from agribot.description.loader import load_robot
from agribot.ros.messages import rosmsg
from agribot.ros.messages.device_rosmsg import make_laser_scan as rosmsg_of_scan
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.messages.sensor_readers import make_readers
from agribot.ros.messages.transforms import find_wheel_joints
from agribot.ros.messages.wheel_readers import JointReader, TwistReader
from tests.record import record_samples as samples

ROBOT = load_robot("agribot")


def read(sensor: Any, message: Any, t_s: float = 7.25, robot: Any = ROBOT) -> Any:
    return make_readers(sensor, robot)[message.__msgtype__](message, t_s)


def test_a_scan_that_went_out_comes_in_the_same_and_names_what_is_too_near_or_did_not_return() -> (
    None
):
    sent = LaserScan(t_s=7.25, min_angle_rad=-1.0, step_rad=0.5, range_min_m=0.15, range_max_m=8.0,
                     period_s=0.1, ranges_m=np.array([2.0, np.inf, -np.inf, np.nan]))  # fmt: skip
    robot = fit_lidar(ROBOT)
    message = rosmsg_of_scan(sent, "laser_link")
    got = read("scans", message, robot=robot)
    assert got.ranges_m.tolist() == pytest.approx(sent.ranges_m.tolist(), nan_ok=True)
    assert (got.t_s, got.min_angle_rad, got.step_rad) == (7.25, -1.0, 0.5)
    message.ranges = np.array([0.0, 0.1, 9.0], dtype=np.float32)
    told = read("scans", message, robot=robot).ranges_m.tolist()
    assert told == [math.inf, -math.inf, math.inf], "0 by many drivers, too near, too far"
    message.angle_increment = math.nan
    with pytest.raises(BridgeError, match="send rays and finite limits"):
        read("scans", message, robot=robot)
    with pytest.raises(ConfigError, match="description has no lidar"):
        make_readers("scans", ROBOT)


@pytest.mark.parametrize(
    ("quality", "std_m"),
    [(GnssQuality.SINGLE, 2.5), (GnssQuality.DGNSS, 0.8), (GnssQuality.RTK_FIXED, 0.012),
     (GnssQuality.RTK_FLOAT, 0.2)],
)  # fmt: skip
def test_a_fix_that_went_out_comes_in_the_same(quality: GnssQuality, std_m: float) -> None:
    sent = GnssFix(
        t_s=7.25, lat_deg=21.16, lon_deg=-72.7, alt_m=4.5, pos_std_m=std_m, quality=quality
    )
    got = read("gnss", rosmsg.make_fix(sent, "gps"))
    assert got == sent


def test_a_receiver_without_a_fix_says_nothing() -> None:
    fix = GnssFix(
        t_s=0.0, lat_deg=0.0, lon_deg=0.0, alt_m=0.0, pos_std_m=1.0, quality=GnssQuality.NONE
    )
    assert read("gnss", rosmsg.make_fix(fix, "gps")) is None
    boasting = msgspec.structs.replace(fix, quality=GnssQuality.SINGLE)
    assert read("gnss", rosmsg.make_fix(boasting, "gps")) is None, "0, 0 is no place"


def test_a_fix_of_unknown_covariance_is_worth_what_its_kind_is_worth() -> None:
    message = samples_fix()
    message.position_covariance_type = 0
    message.position_covariance = np.zeros(9)
    assert read("gnss", message).pos_std_m == 2.5


@pytest.mark.parametrize(
    ("field", "value"),
    [("latitude", math.nan), ("latitude", 91.0), ("longitude", 181.0), ("altitude", math.inf)],
)
def test_no_place_on_earth_is_refused(field: str, value: float) -> None:
    message = samples_fix()
    setattr(message, field, value)
    with pytest.raises(BridgeError, match="no place on Earth"):
        read("gnss", message)


def samples_fix() -> Any:
    fix = GnssFix(
        t_s=1.0, lat_deg=21.0, lon_deg=72.0, alt_m=0.0, pos_std_m=1.0, quality=GnssQuality.SINGLE
    )
    return rosmsg.make_fix(fix, "gps")


def test_inertial_and_magnetic_samples_come_in_as_they_went_out() -> None:
    imu = ImuSample(t_s=7.25, gyro_radps=(0.1, -0.2, 0.3), accel_mps2=(0.0, 0.5, 9.8))
    assert read("imu", rosmsg.make_imu(imu, "imu")) == imu
    mag = MagSample(t_s=7.25, field_t=(1e-5, -2e-5, 3e-5))
    assert read("mag", rosmsg.make_magnetic_field(mag, "mag")) == mag
    seed = rosmsg.make_fix_velocity(
        7.25, mag.field_t
    )  # the original's magnetometer: Vector3Stamped
    assert read("mag", seed) == mag
    broken = rosmsg.make_imu(imu, "imu")
    broken.angular_velocity.y = math.nan
    with pytest.raises(BridgeError, match="angular velocity"):
        read("imu", broken)


def test_wheels_are_found_by_the_names_of_their_joints_in_any_order() -> None:
    names = [joint.name for joint in find_wheel_joints(ROBOT, WHEEL_NAMES)]
    wheels = WheelSample(t_s=7.25, angle_rad=(1.0, 2.0, 3.0, 4.0), speed_radps=(5.0, 6.0, 7.0, 8.0))
    message = rosmsg.make_joint_state(wheels, names)
    assert read("wheels", message) == wheels
    message.name = ["arm", *message.name[::-1]]
    message.position = np.array([9.0, *message.position[::-1]])
    message.velocity = np.array([9.0, *message.velocity[::-1]])
    assert read("wheels", message) == wheels
    message.name[1] = "steering"
    with pytest.raises(BridgeError, match="steering"):
        JointReader(ROBOT)(message, 0.0)


def test_a_base_that_tells_its_twist_only_turns_its_wheels_as_far_as_it_went() -> None:
    reader, estimate = TwistReader(ROBOT.drive), samples.ticks(1)[0].estimate
    message = rosmsg.make_odometry(estimate)
    message.twist.twist.linear.x, message.twist.twist.angular.z = 0.5, 0.0
    angles = []
    for index in range(11):
        message.header = rosmsg.make_header(100.0 + 0.1 * index, "odom")
        angles.append(reader(message, 0.0).angle_rad)
    for first, last in zip(angles[0], angles[-1], strict=True):
        assert (last - first) * ROBOT.drive.wheel_radius_m == pytest.approx(0.5)
    message.header = rosmsg.make_header(0.0, "odom")
    with pytest.raises(BridgeError, match="stamp"):
        reader(message, 0.0)


def test_pictures_come_in_in_the_colours_they_had() -> None:
    robot = samples.robot()
    assert robot.camera is not None
    rgb = samples.frame(0, 0.0).image_rgb
    message = rosmsg.make_image(0.0, rgb)
    assert np.array_equal(read("frames", message, robot=robot).image_rgb, rgb)
    message.encoding, message.data = "bgr8", rgb[:, :, ::-1].reshape(-1).copy()
    assert np.array_equal(read("frames", message, robot=robot).image_rgb, rgb)
    message.encoding = "bayer_rggb8"
    with pytest.raises(BridgeError, match="bayer"):
        read("frames", message, robot=robot)
    message.encoding, message.data = "rgb8", np.zeros(10, np.uint8)
    with pytest.raises(BridgeError, match="10 bytes"):
        read("frames", message, robot=robot)
    with pytest.raises(BridgeError, match="but the robot's description has"):
        read("frames", rosmsg.make_image(0.0, np.zeros((2, 2, 3), np.uint8)), robot=robot)


def test_compressed_pictures_come_in_or_are_refused() -> None:
    robot, rgb, buffer = samples.robot(), samples.frame(0, 0.0).image_rgb, io.BytesIO()
    Image.fromarray(rgb).save(buffer, format="PNG")
    message = rosmsg.make_compressed_image(0.0, buffer.getvalue())
    assert np.array_equal(read("frames", message, robot=robot).image_rgb, rgb)
    with pytest.raises(BridgeError, match="no picture"):
        read("frames", rosmsg.make_compressed_image(0.0, b"\xff\xd8 cut"), robot=robot)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("encoding", ["rgb16", "bgr16"])
def test_pictures_of_sixteen_bits_keep_the_upper_eight_of_those_that_the_camera_uses(
    encoding: str, is_bigendian: bool
) -> None:
    rgb = samples.frame(0, 0.0).image_rgb.copy()
    rgb[0, 0] = 255
    message = rosmsg.make_image(0.0, rgb)
    deep = (rgb.astype(np.uint16) << 4)[:, :, :: -1 if encoding == "bgr16" else 1]  # 12 bits
    message.data = np.frombuffer(deep.astype(">u2" if is_bigendian else "<u2").tobytes(), np.uint8)
    message.encoding, message.step = encoding, 2 * message.step
    message.is_bigendian = int(is_bigendian)
    assert np.array_equal(read("frames", message, robot=samples.robot()).image_rgb, rgb)


def test_a_dark_picture_after_a_bright_one_stays_dark() -> None:
    robot = samples.robot()
    assert robot.camera is not None
    shape = (robot.camera.height_px, robot.camera.width_px)
    reader = make_readers("frames", robot)["sensor_msgs/msg/CompressedImage"]
    for value, grey in ((4080, 255), (800, 50)):
        buffer = io.BytesIO()
        Image.fromarray(np.full(shape, value, np.uint16)).save(buffer, format="PNG")
        frame = reader(rosmsg.make_compressed_image(0.0, buffer.getvalue()), 0.0)
        assert isinstance(frame, CameraFrame)
        assert (frame.image_rgb == grey).all() and frame.image_rgb.shape == (*shape, 3)


def test_seconds_of_a_stamp() -> None:
    assert to_seconds(rosmsg.make_header(12.5, "").stamp) == 12.5


def time_of(clock: StampClock, stamp_s: float, arrived_s: float) -> float:
    clock.note_message(stamp_s, arrived_s)
    return clock.convert_to_robot_s(stamp_s, arrived_s)


def test_stamps_of_the_robots_own_clock_stay_what_they_are() -> None:
    clock = StampClock()
    assert [time_of(clock, t_s, t_s + 0.1) for t_s in (5.0, 5.1, 5.3)] == [5.0, 5.1, 5.3]


def test_stamps_of_another_clock_are_moved_by_the_shortest_delay() -> None:
    clock, epoch_s = StampClock(), 1.7e9
    delays_s = [0.05, 0.02, 0.3, 0.02]
    got = [
        time_of(clock, epoch_s + 0.1 * index, 10.0 + 0.1 * index + delay_s)
        for index, delay_s in enumerate(delays_s)
    ]
    assert got[1:] == pytest.approx([10.12, 10.22, 10.32], abs=1e-6)


def test_nothing_is_from_the_future_and_a_clock_set_anew_is_followed() -> None:
    clock = StampClock()
    arrived_s = np.arange(0.0, 10.0, 0.1) + 20.0
    offsets_s = np.where(arrived_s < 24.0, 1e9, np.where(arrived_s < 27.0, 1e9 + 50.0, 1e9 - 50.0))
    got = np.array(
        [
            time_of(clock, a + o, a)
            for a, o in zip(arrived_s.tolist(), offsets_s.tolist(), strict=True)
        ]
    )
    assert (got <= arrived_s).all()
    settled = (arrived_s < 27.0) | (arrived_s > 29.2)
    assert np.abs(got - arrived_s)[settled].max() < 1e-6


def test_messages_that_come_at_once_after_a_pause_keep_their_distances() -> None:
    """The sender stood still, for longer than the clock remembers, and its clock with it."""
    clock = StampClock()
    for t_s in (1.0, 1.1, 1.2):
        clock.note_message(t_s + 1e9, t_s)
    burst = [(1e9 + stamp_s, 5.0 + 1e-4 * i) for i, stamp_s in enumerate((1.3, 1.4, 1.5))]
    for stamp_s, arrived_s in burst:
        clock.note_message(stamp_s, arrived_s)
    assert [clock.convert_to_robot_s(*message) for message in burst] == pytest.approx(
        [4.8, 4.9, 5.0], abs=1e-3
    )


def test_without_a_stamp_the_arrival_counts() -> None:
    assert time_of(StampClock(), 0.0, 3.5) == 3.5
