"""Our structs as ROS 2 messages, through the maintained types of rosbags; no ROS needed."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from agribot.core.geo import MapFrame
from agribot.core.messages import (
    ByteArray,
    DriveCommand,
    Estimate,
    FloatArray,
    GnssFix,
    GnssQuality,
    GnssStatus,
    ImuSample,
    MagSample,
    MiddleWheel,
    MissionStatus,
    Path,
    Vec3,
    WheelSample,
)
from agribot.core.robot import CameraSpec
from agribot.ros.messages import gps_types

MAP_FRAME = "map"
ODOM_FRAME = "odom"
BODY_FRAME = "base_footprint"
OPTICAL_FRAME = "camera_optical_frame"

Quaternion = tuple[float, float, float, float]  # x, y, z, w

# sensor_msgs/NavSatStatus: no fix, fix, satellite and ground based augmentation.
_NAVSAT_STATUS = {
    GnssQuality.NONE: -1,
    GnssQuality.SINGLE: 0,
    GnssQuality.DGNSS: 1,
    GnssQuality.RTK_FIXED: 2,
    GnssQuality.RTK_FLOAT: 2,
}
_PATH_STEP_M = 0.1
_PATH_POINTS = 5000  # points of a path; more take longer than a tick to write
_STRAIGHT_RAD = 1e-4  # smallest turn between two points


@functools.cache
def load_types() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    gps_types.register_gps_types(store, gps_types.IN_ROS2)
    return store


def make_message(ros_type: str, *values: Any) -> Any:
    """Make a message of `ros_type`, its fields in the order of the .msg file."""
    return load_types().types[ros_type](*values)


def to_cdr(message: Any) -> bytes:
    return bytes(load_types().serialize_cdr(message, message.__msgtype__))


def to_nanoseconds(t_s: float) -> int:
    return round(t_s * 1e9)


def to_seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def make_header(t_s: float, frame: str) -> Any:
    sec, nanosec = divmod(to_nanoseconds(t_s), 1_000_000_000)
    stamp = make_message("builtin_interfaces/msg/Time", sec, nanosec)
    return make_message("std_msgs/msg/Header", stamp, frame)


def make_vector3(x: float, y: float, z: float) -> Any:
    return make_message("geometry_msgs/msg/Vector3", x, y, z)


def make_point(x_m: float, y_m: float, z_m: float = 0.0) -> Any:
    return make_message("geometry_msgs/msg/Point", x_m, y_m, z_m)


def make_quaternion(xyzw: Quaternion) -> Any:
    return make_message("geometry_msgs/msg/Quaternion", *xyzw)


def make_pose(x_m: float, y_m: float, yaw_rad: float) -> Any:
    return make_message(
        "geometry_msgs/msg/Pose",
        make_point(x_m, y_m),
        make_quaternion(quaternion_from_yaw(yaw_rad)),
    )


def quaternion_from_yaw(yaw_rad: float) -> Quaternion:
    return (0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0))


def quaternion_from_matrix(rotation: FloatArray) -> Quaternion:
    """Convert a rotation (3, 3). Source: Shepperd 1978, by the largest of the four components."""
    m = rotation
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    squares = (float(m[0, 0]), float(m[1, 1]), float(m[2, 2]), trace)
    i = int(np.argmax(squares))
    if i == 3:
        q = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace)
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        xyz = [0.0, 0.0, 0.0]
        xyz[i] = 1.0 + 2.0 * squares[i] - trace
        xyz[j] = float(m[i, j] + m[j, i])
        xyz[k] = float(m[i, k] + m[k, i])
        q = (xyz[0], xyz[1], xyz[2], m[k, j] - m[j, k])
    norm = math.sqrt(sum(float(c) ** 2 for c in q))
    return (float(q[0]) / norm, float(q[1]) / norm, float(q[2]) / norm, float(q[3]) / norm)


def make_transform(t_s: float, parent: str, child: str, xyz_m: Vec3, xyzw: Quaternion) -> Any:
    transform = make_message(
        "geometry_msgs/msg/Transform", make_vector3(*xyz_m), make_quaternion(xyzw)
    )
    return make_message(
        "geometry_msgs/msg/TransformStamped", make_header(t_s, parent), child, transform
    )


def make_imu(sample: ImuSample, frame: str) -> Any:
    """Make an Imu; what it does not measure has the covariance -1, what it does an unknown one."""
    unknown, not_measured = np.zeros(9), np.zeros(9)
    not_measured[0] = -1.0
    return make_message(
        "sensor_msgs/msg/Imu",
        make_header(sample.t_s, frame),
        make_quaternion((0.0, 0.0, 0.0, 1.0)),
        not_measured,
        make_vector3(*sample.gyro_radps),
        unknown,
        make_vector3(*(sample.accel_mps2 or (0.0, 0.0, 0.0))),
        not_measured if sample.accel_mps2 is None else unknown,
    )


def make_magnetic_field(sample: MagSample, frame: str) -> Any:
    return make_message(
        "sensor_msgs/msg/MagneticField",
        make_header(sample.t_s, frame),
        make_vector3(*sample.field_t),
        np.zeros(9),
    )


def make_fix(fix: GnssFix, frame: str) -> Any:
    """Make a NavSatFix; the vertical covariance is a guess from the horizontal: APPROXIMATED."""
    variance_m2 = fix.pos_std_m**2
    covariance = np.diag([variance_m2, variance_m2, 4.0 * variance_m2]).ravel()
    status = make_message("sensor_msgs/msg/NavSatStatus", _NAVSAT_STATUS[fix.quality], 1)
    return make_message(
        "sensor_msgs/msg/NavSatFix",
        make_header(fix.t_s, frame),
        status,
        fix.lat_deg,
        fix.lon_deg,
        fix.alt_m,
        covariance,
        1,
    )


def make_extended_fix(fix: GnssFix, status: GnssStatus, frame: str) -> Any:
    """Make the GPSFix of gps_umd."""
    return gps_types.make_gps_fix(fix, status, make_header(fix.t_s, frame), load_types())


def make_fix_velocity(t_s: float, velocity_mps: Vec3) -> Any:
    """Make a Vector3Stamped of a velocity East, North, Up."""
    return make_message(
        "geometry_msgs/msg/Vector3Stamped", make_header(t_s, MAP_FRAME), make_vector3(*velocity_mps)
    )


def make_joint_state(sample: WheelSample, names: Sequence[str]) -> Any:
    middle, efforts_nm = sample.middle, sample.effort_nm
    return make_message(
        "sensor_msgs/msg/JointState",
        make_header(sample.t_s, ""),
        list(names[: len(sample.angle_rad) + len(middle)]),
        np.array([*sample.angle_rad, *(wheel.angle_rad for wheel in middle)]),
        np.array([*sample.speed_radps, *(wheel.speed_radps for wheel in middle)]),
        np.array([*efforts_nm, *_list_efforts_nm(middle)] if efforts_nm else ()),
    )


def _list_efforts_nm(middle: Sequence[MiddleWheel]) -> list[float]:
    return [math.nan if wheel.effort_nm is None else wheel.effort_nm for wheel in middle]


def make_twist(v_mps: float, yaw_rate_radps: float) -> Any:
    return make_message(
        "geometry_msgs/msg/Twist",
        make_vector3(v_mps, 0.0, 0.0),
        make_vector3(0.0, 0.0, yaw_rate_radps),
    )


def make_drive_twist(command: DriveCommand) -> Any:
    return make_twist(command.v_mps, command.yaw_rate_radps)


def make_odometry(estimate: Estimate) -> Any:
    """Make an Odometry: in the 6x6 covariance only x, y and yaw are set, none of the twist's."""
    covariance = np.zeros((6, 6))
    planar = np.ix_((0, 1, 5), (0, 1, 5))
    covariance[planar] = np.reshape(estimate.pose_cov, (3, 3))
    pose = make_pose(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    return make_message(
        "nav_msgs/msg/Odometry",
        make_header(estimate.t_s, MAP_FRAME),
        BODY_FRAME,
        make_message("geometry_msgs/msg/PoseWithCovariance", pose, covariance.ravel()),
        make_message(
            "geometry_msgs/msg/TwistWithCovariance",
            make_twist(estimate.v_mps, estimate.yaw_rate_radps),
            np.zeros(36),
        ),
    )


def make_pose_stamped(estimate: Estimate) -> Any:
    pose = make_pose(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    return make_message("geometry_msgs/msg/PoseStamped", make_header(estimate.t_s, MAP_FRAME), pose)


def make_path(t_s: float, planned: Path) -> Any:
    """Make a Path of a point every 10 cm; of a long one, straight parts by their ends."""
    last = len(planned.s_m) - 1
    some_steps_m = np.diff(planned.s_m)[:: 1 + last // _PATH_POINTS]
    step = max(1, round(_PATH_STEP_M / max(float(np.median(some_steps_m)), 1e-6)))
    picked = np.append(np.arange(0, last, step), last)
    if len(picked) > _PATH_POINTS:
        turned = np.abs(np.diff(planned.yaw_map_rad[picked])) > _STRAIGHT_RAD
        picked = picked[np.concatenate([[True], turned]) | np.concatenate([turned, [True]])]
    head = make_header(t_s, MAP_FRAME)
    places = np.column_stack([planned.xy_map_m, planned.yaw_map_rad])[picked].tolist()
    poses = [
        make_message("geometry_msgs/msg/PoseStamped", head, make_pose(x, y, yaw))
        for x, y, yaw in places
    ]
    return make_message("nav_msgs/msg/Path", head, poses)


def make_goals(t_s: float, goals_map_m: Sequence[tuple[float, float]]) -> Any:
    poses = [make_pose(x_m, y_m, 0.0) for x_m, y_m in goals_map_m]
    return make_message("geometry_msgs/msg/PoseArray", make_header(t_s, MAP_FRAME), poses)


def make_goal_fix(t_s: float, goal_map_m: tuple[float, float], frame: MapFrame) -> Any:
    lat_deg, lon_deg, alt_m = frame.geodetic_from_map(*goal_map_m)
    status = make_message("sensor_msgs/msg/NavSatStatus", 0, 1)
    return make_message(
        "sensor_msgs/msg/NavSatFix",
        make_header(t_s, MAP_FRAME),
        status,
        lat_deg,
        lon_deg,
        alt_m,
        np.zeros(9),
        0,
    )


def make_camera_info(t_s: float, camera: CameraSpec) -> Any:
    k_px = camera.matrix()
    projection = np.hstack([k_px, np.zeros((3, 1))])
    region = make_message("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    return make_message(
        "sensor_msgs/msg/CameraInfo",
        make_header(t_s, OPTICAL_FRAME),
        camera.height_px,
        camera.width_px,
        "plumb_bob",
        np.array([*camera.distortion, 0.0]),
        k_px.ravel(),
        np.eye(3).ravel(),
        projection.ravel(),
        0,
        0,
        region,
    )


def make_compressed_image(t_s: float, jpeg: bytes) -> Any:
    pixels = np.frombuffer(jpeg, dtype=np.uint8)
    return make_message(
        "sensor_msgs/msg/CompressedImage", make_header(t_s, OPTICAL_FRAME), "jpeg", pixels
    )


def read_compressed_image(data: bytes) -> bytes:
    """Read the file, such as a JPEG, out of a serialised CompressedImage."""
    image = load_types().deserialize_cdr(data, "sensor_msgs/msg/CompressedImage")
    return bytes(image.data)  # type: ignore[attr-defined]


def make_image(t_s: float, rgb: ByteArray) -> Any:
    """Make an uncompressed Image of `rgb` (height, width, 3)."""
    height_px, width_px, _ = rgb.shape
    head = make_header(t_s, OPTICAL_FRAME)
    data = np.ascontiguousarray(rgb).reshape(-1)
    return make_message(
        "sensor_msgs/msg/Image", head, height_px, width_px, "rgb8", 0, 3 * width_px, data
    )


def make_status(status: MissionStatus) -> Any:
    return make_text(msgspec.json.encode(status).decode())


def make_text(value: str) -> Any:
    return make_message("std_msgs/msg/String", value)


def make_float64(value: float) -> Any:
    return make_message("std_msgs/msg/Float64", value)
