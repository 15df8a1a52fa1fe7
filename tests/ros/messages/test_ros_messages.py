from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from agribot.core.config import RunConfig
from agribot.core.geo import MapFrame, rotation_from_rpy
from agribot.core.messages import (
    BumperSample,
    DriveCommand,
    GnssFix,
    GnssQuality,
    ImuSample,
    MagSample,
    MissionStatus,
    Path,
    PlantClass,
    WheelSample,
)
from agribot.ros.messages import cdr, rosmsg
from agribot.ros.messages.device_rosmsg import make_battery_state, make_contact_point, make_pole_fix
from agribot.ros.messages.markers import make_weed_markers
from tests.record import record_samples as samples

# Not the store of the code under test.
STORE = get_typestore(Stores.ROS2_JAZZY)
NAMES = ("joint_a", "b", "joint_cc", "d")
number = st.floats(-1e6, 1e6)
vec3 = st.tuples(number, number, number)
vec4 = st.tuples(number, number, number, number)
moment_s = st.floats(0.0, 2e9)


def _read_back(message: Any) -> Any:
    return STORE.deserialize_cdr(rosmsg.to_cdr(message), message.__msgtype__)


def _stamp_s(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9)


def test_imu_arrives_with_its_axes_and_says_that_it_has_no_orientation() -> None:
    sample = ImuSample(t_s=12.345678901, gyro_radps=(0.1, -0.2, 0.3), accel_mps2=(1.0, 2.0, 9.8))
    message = _read_back(rosmsg.make_imu(sample, "imu_link"))
    assert message.header.frame_id == "imu_link"
    assert _stamp_s(message) == pytest.approx(12.345678901, abs=1e-9)
    assert (message.angular_velocity.x, message.angular_velocity.y) == (0.1, -0.2)
    assert message.linear_acceleration.z == 9.8
    assert message.orientation_covariance[0] == -1.0


@pytest.mark.parametrize(
    ("quality", "status"),
    [
        (GnssQuality.NONE, -1),
        (GnssQuality.SINGLE, 0),
        (GnssQuality.DGNSS, 1),
        (GnssQuality.RTK_FLOAT, 2),
        (GnssQuality.RTK_FIXED, 2),
    ],
)
def test_fix_keeps_place_quality_and_variance(quality: GnssQuality, status: int) -> None:
    fix = GnssFix(
        t_s=1.5, lat_deg=21.1612891234, lon_deg=72.787, alt_m=4.475, pos_std_m=0.5, quality=quality
    )
    message = _read_back(rosmsg.make_fix(fix, "gps_link"))
    assert (message.latitude, message.longitude, message.altitude) == (21.1612891234, 72.787, 4.475)
    assert message.status.status == status
    assert message.position_covariance.reshape(3, 3)[1, 1] == pytest.approx(0.25)
    assert np.count_nonzero(message.position_covariance) == 3


def test_velocity_magnetometer_and_wheels_keep_their_numbers() -> None:
    velocity = _read_back(rosmsg.make_fix_velocity(2.0, (0.1, 0.4, -0.01)))
    assert (velocity.vector.x, velocity.vector.y, velocity.vector.z) == (0.1, 0.4, -0.01)
    mag = MagSample(t_s=2.0, field_t=(3.8e-5, -1e-6, -2e-5))
    field = _read_back(rosmsg.make_magnetic_field(mag, "imu_link")).magnetic_field
    assert (field.x, field.y, field.z) == mag.field_t
    wheels = WheelSample(t_s=2.0, angle_rad=(1.0, 2.0, 3.0, 4.0), speed_radps=(5.0, 6.0, 7.0, 8.0))
    joints = _read_back(rosmsg.make_joint_state(wheels, NAMES))
    assert tuple(joints.name) == NAMES
    assert tuple(joints.position) == wheels.angle_rad
    assert tuple(joints.velocity) == wheels.speed_radps


def test_efforts_of_the_wheels_reach_the_joint_states() -> None:
    wheels = WheelSample(
        t_s=2.5,
        angle_rad=(1.0, 2.0, 3.0, 4.0),
        speed_radps=(5.0, 6.0, 7.0, 8.0),
        effort_nm=(0.1, -0.2, 0.3, -0.4),
    )
    message = rosmsg.make_joint_state(wheels, NAMES)
    assert tuple(_read_back(message).effort) == wheels.effort_nm
    fast = cdr.JointStateCdr(NAMES)
    without = msgspec.structs.replace(wheels, effort_nm=None)
    for sample in (wheels, without, wheels):
        same = rosmsg.to_cdr(rosmsg.make_joint_state(sample, NAMES))
        assert fast(rosmsg.to_nanoseconds(sample.t_s), sample) == same


def test_odometry_has_the_planar_covariance_in_its_six_by_six() -> None:
    estimate = msgspec.structs.replace(
        samples.estimate(3.0), pose_cov=(1.0, 2.0, 3.0, 2.0, 4.0, 5.0, 3.0, 5.0, 6.0)
    )
    message = _read_back(rosmsg.make_odometry(estimate))
    covariance = message.pose.covariance.reshape(6, 6)
    assert covariance[0, 0] == 1.0
    assert covariance[1, 1] == 4.0
    assert covariance[5, 5] == 6.0
    assert covariance[0, 5] == covariance[5, 0] == 3.0
    assert not covariance[2:5].any()
    q = message.pose.pose.orientation
    assert 2.0 * math.atan2(q.z, q.w) == pytest.approx(estimate.yaw_map_rad)
    assert message.twist.twist.linear.x == estimate.v_mps
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base_footprint")


def test_pose_path_and_goals_keep_their_places() -> None:
    pose = _read_back(rosmsg.make_pose_stamped(samples.estimate(3.0))).pose
    assert pose.position.y == pytest.approx(3.2)
    plan = samples.plan()
    poses = _read_back(rosmsg.make_path(0.0, plan)).poses
    assert len(poses) == pytest.approx(len(plan.s_m) / 5, abs=2)
    assert (poses[-1].pose.position.x, poses[-1].pose.position.y) == tuple(plan.xy_map_m[-1])
    s_m = np.arange(0.0, 1000.0, 0.02)
    nothing = np.zeros(len(s_m))
    long = Path(
        xy_map_m=np.column_stack([s_m, nothing]), yaw_map_rad=nothing, curvature_radpm=nothing,
        s_m=s_m, row=nothing.astype(int),
    )  # fmt: skip
    ends = [pose.pose.position.x for pose in _read_back(rosmsg.make_path(0.0, long)).poses]
    assert ends == [0.0, s_m[-1]]
    goals = _read_back(rosmsg.make_goals(0.0, [(1.0, 2.0), (1.0, 12.0)])).poses
    assert [(g.position.x, g.position.y) for g in goals] == [(1.0, 2.0), (1.0, 12.0)]


def test_goal_fix_lies_where_the_waypoint_lies() -> None:
    frame = MapFrame(RunConfig().field.datum)
    message = _read_back(rosmsg.make_goal_fix(0.0, (3.0, 12.0), frame))
    east_m, north_m, _ = frame.map_from_geodetic(
        message.latitude, message.longitude, message.altitude
    )
    assert (east_m, north_m) == pytest.approx((3.0, 12.0), abs=1e-6)


def test_camera_info_projects_like_the_camera() -> None:
    camera = samples.robot().camera
    assert camera is not None
    message = _read_back(rosmsg.make_camera_info(0.0, camera))
    assert np.array_equal(message.k.reshape(3, 3), camera.matrix())
    assert np.array_equal(message.p.reshape(3, 4)[:, :3], camera.matrix())
    assert (message.width, message.height) == (64, 48)
    assert message.d.tolist() == [0.0] * 5
    bent = msgspec.structs.replace(camera, distortion=(-0.2, 0.05, 0.001, -0.002))
    message = _read_back(rosmsg.make_camera_info(0.0, bent))
    assert message.distortion_model == "plumb_bob"
    assert message.d.tolist() == [-0.2, 0.05, 0.001, -0.002, 0.0]


def test_status_and_command_arrive_whole() -> None:
    status = samples.status("paused", 2, 3.5, "operator")
    message = _read_back(rosmsg.make_status(status))
    assert msgspec.json.decode(message.data, type=MissionStatus) == status
    twist = _read_back(rosmsg.make_drive_twist(DriveCommand(v_mps=0.4, yaw_rate_radps=-0.2)))
    assert (twist.linear.x, twist.angular.z) == (0.4, -0.2)


def test_markers_sort_plants_into_weeds_treated_weeds_and_crops() -> None:
    plants = (
        samples.plant(1),
        samples.plant(2),
        samples.plant(3, treated_s=9.0),
        samples.plant(4, PlantClass.CROP),
    )
    markers = _read_back(make_weed_markers(5.0, plants)).markers
    assert {m.ns: len(m.points) for m in markers} == {"weed": 2, "treated": 1, "crop": 1}
    assert markers[0].points[0].x == plants[0].x_map_m


@given(angles=st.tuples(*[st.floats(-math.pi, math.pi)] * 3))
def test_quaternion_of_a_matrix_turns_vectors_like_the_matrix(
    angles: tuple[float, float, float],
) -> None:
    rotation = rotation_from_rpy(*angles)
    x, y, z, w = rosmsg.quaternion_from_matrix(rotation)
    assert math.hypot(x, y, z, w) == pytest.approx(1.0)
    vector = np.array([0.3, -1.2, 2.0])
    axis = np.array([x, y, z])
    turned = vector + 2.0 * np.cross(axis, np.cross(axis, vector) + w * vector)
    assert turned == pytest.approx(rotation @ vector, abs=1e-9)


@given(t_s=moment_s, gyro=vec3, accel=vec3)
def test_fast_imu_bytes_are_those_of_rosbags(
    t_s: float, gyro: tuple[float, float, float], accel: tuple[float, float, float]
) -> None:
    sample = ImuSample(t_s=t_s, gyro_radps=gyro, accel_mps2=accel)
    fast = cdr.ImuCdr("imu_link")(rosmsg.to_nanoseconds(t_s), sample)
    assert fast == rosmsg.to_cdr(rosmsg.make_imu(sample, "imu_link"))


@given(t_s=moment_s, angle=vec4, speed=vec4)
def test_fast_joint_state_bytes_are_those_of_rosbags(
    t_s: float,
    angle: tuple[float, float, float, float],
    speed: tuple[float, float, float, float],
) -> None:
    sample = WheelSample(t_s=t_s, angle_rad=angle, speed_radps=speed)
    fast = cdr.JointStateCdr(NAMES)(rosmsg.to_nanoseconds(t_s), sample)
    assert fast == rosmsg.to_cdr(rosmsg.make_joint_state(sample, NAMES))


@given(
    t_s=moment_s, pose=vec3, covariance=st.tuples(*[number] * 9), twist=st.tuples(number, number)
)
def test_fast_odometry_bytes_are_those_of_rosbags(
    t_s: float,
    pose: tuple[float, float, float],
    covariance: tuple[float, ...],
    twist: tuple[float, float],
) -> None:
    estimate = msgspec.structs.replace(
        samples.estimate(0.0),
        t_s=t_s, x_map_m=pose[0], y_map_m=pose[1], yaw_map_rad=pose[2],
        pose_cov=covariance, v_mps=twist[0], yaw_rate_radps=twist[1],
    )  # fmt: skip
    fast = cdr.OdometryCdr()(rosmsg.to_nanoseconds(t_s), estimate)
    assert fast == rosmsg.to_cdr(rosmsg.make_odometry(estimate))


@given(t_s=moment_s, first=vec3, second=vec3)
def test_fast_transform_bytes_are_those_of_rosbags(
    t_s: float, first: tuple[float, float, float], second: tuple[float, float, float]
) -> None:
    frames = (("map", "odom"), ("odom", "base_footprint"))
    turn = rosmsg.quaternion_from_yaw(0.7)
    fast = cdr.TransformsCdr(frames)(
        rosmsg.to_nanoseconds(t_s), ((*first, *turn), (*second, *turn))
    )
    slow = [
        rosmsg.make_transform(t_s, parent, child, xyz_m, turn)
        for (parent, child), xyz_m in zip(frames, (first, second), strict=True)
    ]
    assert fast == rosmsg.to_cdr(rosmsg.make_message("tf2_msgs/msg/TFMessage", slow))


@given(a=number, b=number)
def test_fast_twist_and_number_bytes_are_those_of_rosbags(a: float, b: float) -> None:
    assert cdr.TwistCdr()(a, b) == rosmsg.to_cdr(rosmsg.make_twist(a, b))
    assert cdr.Float64Cdr()(a) == rosmsg.to_cdr(rosmsg.make_float64(a))


def test_base_station_bumper_and_battery_keep_their_numbers() -> None:
    fix = _read_back(make_pole_fix(samples.base_fix(2.5)))
    assert (fix.latitude, fix.longitude, fix.altitude) == (21.1613, 72.78703, 9.5)
    assert fix.position_covariance[0] == pytest.approx(1.5**2)
    assert fix.header.frame_id == "gps_pole_link"
    touch = _read_back(make_contact_point(BumperSample(t_s=1.0, x_body_m=0.35, y_body_m=-0.1)))
    assert (touch.point.x, touch.point.y, touch.header.frame_id) == (0.35, -0.1, "base_footprint")
    state = _read_back(make_battery_state(samples.battery(3.0)))
    assert state.voltage == pytest.approx(24.5)
    assert state.current == pytest.approx(-1.25)  # out of the battery
    assert state.percentage == pytest.approx(0.9)
    assert state.power_supply_status == 2  # discharging
    assert math.isnan(state.temperature)
