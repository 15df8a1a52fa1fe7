"""ROS messages of foreign robots as log samples: fixes, IMU, magnetometer, odometry of any kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from agribot.app.localization.log import LogSample, LogSensor, TwistSample
from agribot.app.localization.places import check_place
from agribot.app.localization.wheel_ticks import TickWheels
from agribot.core.errors import BridgeError
from agribot.core.geo import wrap_rad
from agribot.core.messages import GnssFix, WheelSample
from agribot.core.pose import Pose2
from agribot.ros.messages.gps_types import GPSFIX_ROS1, GPSFIX_ROS2, read_gps_fix
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.messages.sensor_readers import read_fix, read_imu, read_mag

# Takes a message and its stamp, s.
ReadMessage = Callable[[Any, float], LogSample | None]
# Makes a reader for one pass over a log: some remember the message before.
MakeReader = Callable[[], ReadMessage]

# A pose that moves on by more in a step began anew: s, m/s.
LONGEST_STEP_S, FASTEST_MPS = 1.0, 30.0

ODOMETRY = "nav_msgs/msg/Odometry"
STAMPED_TWIST = "geometry_msgs/msg/TwistStamped"
COVARIANCE_TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
JOINTS = "sensor_msgs/msg/JointState"
TWIST = "geometry_msgs/msg/Twist"


def read_twist(twist: Any) -> TwistSample:
    """Read forward speed and yaw rate. Raises: BridgeError: one is not finite."""
    v_mps, yaw_rate_radps = float(twist.linear.x), float(twist.angular.z)
    if not math.isfinite(v_mps + yaw_rate_radps):
        raise BridgeError(
            f"a twist of {v_mps} m/s and {yaw_rate_radps} rad/s is not finite; it is left out"
        )
    return TwistSample(t_s=0.0, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)


class OdometryReader:
    """Reads the twist; where that is zero, how far the pose moved since the message before."""

    def __init__(self) -> None:
        self._last: tuple[float, Pose2] | None = None

    def __call__(self, message: Any, t_s: float) -> TwistSample:
        stated = read_twist(message.twist.twist)
        pose, last = _read_pose(message.pose.pose), self._last
        self._last = t_s, pose
        if stated.v_mps or stated.yaw_rate_radps or last is None:
            return stated
        dt_s = t_s - last[0]
        if not 0.0 < dt_s < LONGEST_STEP_S:
            return stated
        ahead_m, _ = last[1].locate(pose.x_m, pose.y_m)
        turned_rad = wrap_rad(pose.yaw_rad - last[1].yaw_rad)
        if not abs(ahead_m) < FASTEST_MPS * dt_s:  # begun anew
            return stated
        return TwistSample(t_s=0.0, v_mps=ahead_m / dt_s, yaw_rate_radps=turned_rad / dt_s)


def _read_pose(pose: Any) -> Pose2:
    q, at = pose.orientation, pose.position
    yaw_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return Pose2(float(at.x), float(at.y), yaw_rad)


class CountReader:
    """Reads the encoder counts of a left and a right wheel, each of a topic of its own."""

    def __init__(self, ticks_per_turn: float) -> None:
        self._wheels = TickWheels(ticks_per_turn)
        self._left: float | None = None

    def read_left(self, message: Any, _: float) -> None:
        self._left = float(message.data)

    def read_right(self, message: Any, t_s: float) -> WheelSample | None:
        if self._left is None:
            return None
        return self._wheels.turn(t_s, self._left, float(message.data))


def read_joints(message: Any) -> WheelSample | None:
    """Read wheels by the side in their names; the mean of those of a side stands for both.

    Raises: BridgeError: no joint of one side, or numbers that are not finite.
    """
    sides = {side: _find_side(message, side) for side in ("left", "right")}
    if not sides["left"] and not sides["right"]:
        return None  # a message of an arm
    (left_rad, left_radps), (right_rad, right_radps) = (
        _mean_wheel(message, at, side) for side, at in sides.items()
    )
    return WheelSample(
        t_s=0.0,
        angle_rad=(right_rad, left_rad, right_rad, left_rad),
        speed_radps=(right_radps, left_radps, right_radps, left_radps),
    )


def _find_side(message: Any, side: str) -> list[int]:
    names = [str(name).lower() for name in message.name]
    wheels = [i for i, name in enumerate(names) if side in name and "caster" not in name]
    named = [i for i in wheels if "wheel" in names[i]]
    return named or wheels


def _mean_wheel(message: Any, at: list[int], side: str) -> tuple[float, float]:
    if not at or max(at) >= min(len(message.position), len(message.velocity)):
        raise BridgeError(
            f"joints {', '.join(message.name)} have no {side} wheel with position and velocity; "
            "name the joints of wheels by their side"
        )
    angle_rad = sum(float(message.position[i]) for i in at) / len(at)
    speed_radps = sum(float(message.velocity[i]) for i in at) / len(at)
    if not math.isfinite(angle_rad + speed_radps):
        raise BridgeError(
            f"the {side} wheels have {angle_rad} rad and {speed_radps} rad/s; it is left out"
        )
    return angle_rad, speed_radps


def read_named_fix(message: Any) -> GnssFix | None:
    """Read a NavSatFix; for numbers that are not a place, name their unit."""
    if message.status.status >= 0:
        check_place(float(message.latitude), float(message.longitude))
    return read_fix(message, 0.0)


def _make(read: Callable[[Any], LogSample | None]) -> MakeReader:
    return lambda: lambda message, _: read(message)


# Types by sensor, the most trusted first.
READERS: Mapping[LogSensor, Mapping[str, MakeReader]] = {
    "gnss": {
        "sensor_msgs/msg/NavSatFix": _make(read_named_fix),
        GPSFIX_ROS1: _make(lambda m: read_gps_fix(m, 0.0)),
        GPSFIX_ROS2: _make(lambda m: read_gps_fix(m, 0.0)),
    },
    "imu": {"sensor_msgs/msg/Imu": _make(lambda m: read_imu(m, 0.0))},
    "odom": {
        ODOMETRY: OdometryReader,
        COVARIANCE_TWIST: _make(lambda m: read_twist(m.twist.twist)),
        STAMPED_TWIST: _make(lambda m: read_twist(m.twist)),
        JOINTS: _make(read_joints),
        TWIST: _make(read_twist),
    },
    "mag": {
        "sensor_msgs/msg/MagneticField": _make(lambda m: read_mag(m.magnetic_field, 0.0)),
        "geometry_msgs/msg/Vector3Stamped": _make(lambda m: read_mag(m.vector, 0.0)),
    },
}
COUNTS = tuple(
    f"std_msgs/msg/{name}"
    for name in ("Int16", "Int32", "Int64", "UInt32", "UInt64", "Float32", "Float64")
)
# Types that are read only where their topic is named: a command and any vector have the same types.
ONLY_NAMED = frozenset({TWIST, "geometry_msgs/msg/Vector3Stamped"})


def read_stamp_s(message: Any) -> float:
    """Read the stamp of a header; 0 without one."""
    header = getattr(message, "header", None)
    return to_seconds(header.stamp) if header is not None else 0.0


def read_frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return str(header.frame_id).strip("/") if header is not None else ""
