"""What the definition of a message calls unknown is unknown in the sample, field by field."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

from agribot.core.errors import BridgeError
from agribot.core.messages import (
    WHEEL_NAMES,
    GnssFix,
    GnssQuality,
    GnssStatus,
    ImuSample,
    MagSample,
    WheelSample,
)
from agribot.core.platform import Sensor
from agribot.description.loader import load_robot
from agribot.ros.messages import gps_types, rosmsg
from agribot.ros.messages.cdr import ImuCdr
from agribot.ros.messages.sensor_readers import make_readers
from agribot.ros.messages.transforms import find_wheel_joints
from agribot.ros.ros1.types import load_ros1_types
from tests.record import record_samples as samples

ROBOT = load_robot()
NAN = math.nan
FIX = GnssFix(
    t_s=7.0, lat_deg=51.0, lon_deg=7.0, alt_m=500.0, pos_std_m=0.5, quality=GnssQuality.SINGLE,
    velocity_mps=(0.0, 2.0, 0.5), velocity_std_mps=0.05,
)  # fmt: skip
PLAIN_FIX = msgspec.structs.replace(FIX, velocity_mps=None, velocity_std_mps=0.1)
IMU = ImuSample(t_s=7.0, gyro_radps=(0.1, 0.2, 0.3), accel_mps2=(0.0, 1.0, 9.7))
MAG = MagSample(t_s=7.0, field_t=(1e-5, 2e-5, 3e-5))
WHEELS = WheelSample(t_s=7.0, angle_rad=(1.0, 2.0, 3.0, 4.0), speed_radps=(0.5, 0.6, 0.7, 0.8))
JOINTS = [joint.name for joint in find_wheel_joints(ROBOT, WHEEL_NAMES)]
USUAL_STD_M = 2.5  # of a fix without corrections


class Kind(NamedTuple):
    """A message of a sensor, and the sample that it is where all of it is known."""

    sensor: Sensor
    make: Callable[[], Any]
    sample: Any


KINDS = {
    "sensor_msgs/msg/NavSatFix": Kind("gnss", lambda: rosmsg.make_fix(FIX, "gps"), PLAIN_FIX),
    "gps_msgs/msg/GPSFix": Kind(
        "gnss", lambda: rosmsg.make_extended_fix(FIX, GnssStatus(t_s=7.0), "gps"), FIX
    ),
    "sensor_msgs/msg/Imu": Kind("imu", lambda: rosmsg.make_imu(IMU, "imu"), IMU),
    "sensor_msgs/msg/MagneticField": Kind(
        "mag", lambda: rosmsg.make_magnetic_field(MAG, "mag"), MAG
    ),
}


class Unknown(NamedTuple):
    """A field that says to be unknown by a value; `becomes` is what differs in the sample.

    None is no sample, a text the refusal.
    """

    field: str  # with a dot between a field and its part
    value: Any
    becomes: dict[str, Any] | str | None


def covariance(first: float, *, rest: float = 0.0) -> Any:
    return np.array([first, *[rest] * 8])


KEPT: dict[str, Any] = {}
NO_STD = {"pos_std_m": USUAL_STD_M}
OF_A_FIX = (
    Unknown("status.status", -1, None),
    Unknown("status.status", -2, None),  # STATUS_UNKNOWN of newer definitions
    Unknown("latitude", NAN, "no place on Earth"),
    Unknown("longitude", NAN, "no place on Earth"),
    Unknown("altitude", NAN, {"alt_m": NAN}),
)
TABLE: dict[str, tuple[Unknown, ...]] = {
    "sensor_msgs/msg/NavSatFix": (
        *OF_A_FIX,
        Unknown("position_covariance", covariance(0.0), NO_STD),
        Unknown("position_covariance", covariance(NAN, rest=NAN), NO_STD),
        Unknown("position_covariance", covariance(-1.0), NO_STD),
        Unknown("position_covariance_type", 0, NO_STD),
    ),
    "gps_msgs/msg/GPSFix": (
        *OF_A_FIX,
        Unknown("track", NAN, {"velocity_mps": None}),
        Unknown("speed", NAN, {"velocity_mps": None}),
        Unknown("climb", NAN, {"velocity_mps": (0.0, 2.0, NAN)}),
        Unknown("err_speed", NAN, {"velocity_std_mps": 0.1}),
        Unknown("err_speed", 0.0, {"velocity_std_mps": 0.1}),
        Unknown("err_horz", NAN, KEPT),
        # The horizontal error says the same at 95 %.
        Unknown("position_covariance", covariance(0.0), KEPT),
        Unknown("position_covariance", covariance(NAN, rest=NAN), KEPT),
        Unknown("position_covariance", covariance(-1.0), KEPT),
        Unknown("position_covariance_type", 0, KEPT),
    ),
    "sensor_msgs/msg/Imu": (
        Unknown("orientation_covariance", covariance(-1.0), KEPT),
        Unknown("angular_velocity.z", NAN, "angular velocity .* is not finite"),
        Unknown("angular_velocity_covariance", covariance(-1.0), "without angular velocity"),
        Unknown("angular_velocity_covariance", covariance(0.0), KEPT),
        Unknown("linear_acceleration.x", NAN, "linear acceleration .* is not finite"),
        Unknown("linear_acceleration_covariance", covariance(-1.0), {"accel_mps2": None}),
        Unknown("linear_acceleration_covariance", covariance(0.0), KEPT),
    ),
    "sensor_msgs/msg/MagneticField": (
        Unknown("magnetic_field.z", NAN, "without all three axes"),
        Unknown("magnetic_field_covariance", covariance(0.0), KEPT),
    ),
}
# What no sample has a place for, and the header, whose stamp `SampleQueue` reads.
NOT_READ = {
    "sensor_msgs/msg/NavSatFix": {"header"},
    "gps_msgs/msg/GPSFix": {
        "header", "pitch", "roll", "dip", "time", "gdop", "pdop", "hdop", "vdop", "tdop", "err",
        "err_vert", "err_track", "err_climb", "err_time", "err_pitch", "err_roll", "err_dip",
    },
    "sensor_msgs/msg/Imu": {"header", "orientation"},
    "sensor_msgs/msg/MagneticField": {"header"},
}  # fmt: skip


def read(kind: Kind, message: Any) -> Any:
    return make_readers(kind.sensor, ROBOT)[message.__msgtype__](message, 7.0)


def put(message: Any, field: str, value: Any) -> None:
    *outer, name = field.split(".")
    for part in outer:
        message = getattr(message, part)
    setattr(message, name, value)


def is_same(found: Any, wanted: Any) -> bool:
    """Compare samples; NaN equals NaN."""
    return repr(found) == repr(wanted)


@pytest.mark.parametrize("ros_type", TABLE)
def test_every_field_of_a_message_is_in_the_table_for_both_ros(ros_type: str) -> None:
    listed = {case.field.partition(".")[0] for case in TABLE[ros_type]} | NOT_READ[ros_type]
    ros1_type = ros_type.replace(gps_types.IN_ROS2, gps_types.IN_ROS1)
    for store, name in ((rosmsg.load_types(), ros_type), (load_ros1_types(), ros1_type)):
        assert {field for field, _ in store.fielddefs[name][1]} == listed


@pytest.mark.parametrize("ros_type", TABLE)
def test_a_message_that_knows_all_of_it_is_the_whole_sample(ros_type: str) -> None:
    kind = KINDS[ros_type]
    found = read(kind, kind.make())
    for name, value in msgspec.structs.asdict(kind.sample).items():
        assert getattr(found, name) == pytest.approx(value), name


@pytest.mark.parametrize(
    ("ros_type", "case"), [(name, case) for name, cases in TABLE.items() for case in cases]
)
def test_what_a_message_says_to_be_unknown_is_unknown(ros_type: str, case: Unknown) -> None:
    kind = KINDS[ros_type]
    whole, message = read(kind, kind.make()), kind.make()
    put(message, case.field, case.value)
    if isinstance(case.becomes, str):
        with pytest.raises(BridgeError, match=case.becomes):
            read(kind, message)
        return
    found = read(kind, message)
    if case.becomes is None:
        assert found is None
        return
    for name, value in msgspec.structs.asdict(whole).items():
        wanted = case.becomes.get(name, value)
        assert getattr(found, name) == pytest.approx(wanted, nan_ok=True), name


def test_a_gps_fix_without_any_accuracy_is_worth_what_its_kind_is_worth() -> None:
    kind = KINDS["gps_msgs/msg/GPSFix"]
    for error_m in (0.0, NAN):
        message = kind.make()
        message.position_covariance_type, message.err_horz = 0, error_m
        assert read(kind, message).pos_std_m == USUAL_STD_M


@pytest.mark.parametrize("number", [0.0, NAN])
def test_an_imu_whose_acceleration_has_no_numbers_measures_its_turn_alone(number: float) -> None:
    """A driver of a gyro leaves the other fields as they are made."""
    kind = KINDS["sensor_msgs/msg/Imu"]
    message = kind.make()
    for axis in "xyz":
        put(message, f"linear_acceleration.{axis}", number)
    assert read(kind, message) == msgspec.structs.replace(IMU, accel_mps2=None)


@pytest.mark.parametrize("variance_m2", [1e9, math.inf])
def test_a_variance_that_no_fix_has_is_refused_with_the_limit(variance_m2: float) -> None:
    for ros_type in ("sensor_msgs/msg/NavSatFix", "gps_msgs/msg/GPSFix"):
        message = KINDS[ros_type].make()
        message.position_covariance = covariance(variance_m2)
        with pytest.raises(BridgeError, match=r"variance of .* is not below 1e\+08"):
            read(KINDS[ros_type], message)


def test_what_a_sample_does_not_know_goes_out_as_unknown() -> None:
    fix = msgspec.structs.replace(PLAIN_FIX, alt_m=NAN)
    assert math.isnan(rosmsg.make_fix(fix, "gps").altitude)
    extended = rosmsg.make_extended_fix(fix, GnssStatus(t_s=7.0), "gps")
    for name in ("altitude", "speed", "track", "climb", "err_speed", "hdop", "pitch"):
        assert math.isnan(getattr(extended, name)), name
    got = gps_types.read_gps_fix(extended, 7.0)
    assert got is not None and got.velocity_mps is None
    gyro_only = msgspec.structs.replace(IMU, accel_mps2=None)
    for sample in (gyro_only, IMU):
        message = rosmsg.make_imu(sample, "imu")
        assert is_same(read(KINDS["sensor_msgs/msg/Imu"], message), sample)
        assert ImuCdr("imu")(7_000_000_000, sample) == rosmsg.to_cdr(message)


def make_joints(t_s: float, position: Any, velocity: Any) -> Any:
    message = rosmsg.make_joint_state(WHEELS, JOINTS)
    message.header.stamp = rosmsg.make_header(t_s, "").stamp
    message.position, message.velocity = np.array(position), np.array(velocity)
    message.effort = np.array([NAN] * 4)  # not read
    return message


NONE_TOLD: tuple[list[float], ...] = (
    [],
    [NAN] * 4,
)  # as the definition says, and as nodes of ros2_control do


@pytest.mark.parametrize("nothing", NONE_TOLD)
def test_speeds_that_joints_do_not_tell_follow_from_their_positions(nothing: list[float]) -> None:
    reader = make_readers("wheels", ROBOT)["sensor_msgs/msg/JointState"]
    assert reader(make_joints(7.0, [1.0, 2.0, 3.0, 4.0], nothing), 0.0) is None
    sample = reader(make_joints(7.1, [1.1, 1.8, 3.0, 4.05], nothing), 0.0)
    assert isinstance(sample, WheelSample)
    assert sample.angle_rad == (1.1, 1.8, 3.0, 4.05)
    assert sample.speed_radps == pytest.approx((1.0, -2.0, 0.0, 0.5))
    after_pause = reader(make_joints(60.0, [9.0] * 4, nothing), 0.0)
    assert after_pause is None, "positions a minute apart give no speed"


@pytest.mark.parametrize("nothing", NONE_TOLD)
def test_positions_that_joints_do_not_tell_follow_from_their_speeds(nothing: list[float]) -> None:
    reader = make_readers("wheels", ROBOT)["sensor_msgs/msg/JointState"]
    for tick in range(11):
        sample = reader(make_joints(7.0 + tick / 10.0, nothing, [1.0, -2.0, 0.0, 0.5]), 0.0)
    assert isinstance(sample, WheelSample)
    assert sample.angle_rad == pytest.approx((1.0, -2.0, 0.0, 0.5))
    assert sample.speed_radps == (1.0, -2.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("position", "velocity", "why"),
    [
        ([], [], "neither positions nor velocities"),
        ([1.0, 2.0, NAN, 4.0], [1.0] * 4, "positions .* are not all finite"),
        ([1.0, 2.0], [1.0] * 4, "2 positions for 4 joints"),
    ],
)
def test_joints_that_tell_no_motion_or_half_of_it_are_refused(
    position: list[float], velocity: list[float], why: str
) -> None:
    reader = make_readers("wheels", ROBOT)["sensor_msgs/msg/JointState"]
    with pytest.raises(BridgeError, match=why):
        reader(make_joints(7.0, position, velocity), 0.0)


def test_joints_without_speeds_and_without_a_stamp_are_refused() -> None:
    reader = make_readers("wheels", ROBOT)["sensor_msgs/msg/JointState"]
    with pytest.raises(BridgeError, match="without a stamp state no distance"):
        reader(make_joints(0.0, [1.0] * 4, []), 0.0)


def test_a_twist_that_is_not_known_turns_no_wheel() -> None:
    message = rosmsg.make_odometry(samples.estimate(7.0))
    message.twist.twist.angular.z = NAN
    with pytest.raises(BridgeError, match="twist"):
        make_readers("wheels", ROBOT)["nav_msgs/msg/Odometry"](message, 0.0)
