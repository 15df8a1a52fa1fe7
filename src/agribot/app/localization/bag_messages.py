"""ROS messages of foreign robots as log samples: fixes, IMU, magnetometer, odometry of any kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from agribot.app.localization.log import LogSample, LogSensor, TwistSample
from agribot.core.errors import BridgeError
from agribot.core.messages import WheelSample
from agribot.ros.messages.gps_types import GPSFIX_ROS1, GPSFIX_ROS2, read_gps_fix
from agribot.ros.messages.sensor_readers import read_fix, read_imu, read_mag, to_seconds

ReadMessage = Callable[[Any], LogSample | None]

ODOMETRY = "nav_msgs/msg/Odometry"
STAMPED_TWIST = "geometry_msgs/msg/TwistStamped"
COVARIANCE_TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
JOINTS = "sensor_msgs/msg/JointState"
TWIST = "geometry_msgs/msg/Twist"


def read_twist(twist: Any) -> TwistSample:
    """Read forward speed and yaw rate. Raises: BridgeError: one is not finite."""
    v_mps, yaw_rate_radps = float(twist.linear.x), float(twist.angular.z)
    if not math.isfinite(v_mps + yaw_rate_radps):
        raise BridgeError(f"a twist of {v_mps} m/s and {yaw_rate_radps} rad/s is not finite")
    return TwistSample(t_s=0.0, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)


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
            f"joints {', '.join(message.name)} have no {side} wheel with position and velocity"
        )
    angle_rad = sum(float(message.position[i]) for i in at) / len(at)
    speed_radps = sum(float(message.velocity[i]) for i in at) / len(at)
    if not math.isfinite(angle_rad + speed_radps):
        raise BridgeError(f"the {side} wheels have {angle_rad} rad and {speed_radps} rad/s")
    return angle_rad, speed_radps


# By sensor, the types that are read, the most trusted first.
READERS: Mapping[LogSensor, Mapping[str, ReadMessage]] = {
    "gnss": {
        "sensor_msgs/msg/NavSatFix": lambda m: read_fix(m, 0.0),
        GPSFIX_ROS1: lambda m: read_gps_fix(m, 0.0),
        GPSFIX_ROS2: lambda m: read_gps_fix(m, 0.0),
    },
    "imu": {"sensor_msgs/msg/Imu": lambda m: read_imu(m, 0.0)},
    "odom": {
        ODOMETRY: lambda m: read_twist(m.twist.twist),
        COVARIANCE_TWIST: lambda m: read_twist(m.twist.twist),
        STAMPED_TWIST: lambda m: read_twist(m.twist),
        JOINTS: read_joints,
        TWIST: read_twist,
    },
    "mag": {
        "sensor_msgs/msg/MagneticField": lambda m: read_mag(m.magnetic_field, 0.0),
        "geometry_msgs/msg/Vector3Stamped": lambda m: read_mag(m.vector, 0.0),
    },
}
# A command and any vector have the same types: these are read only where their topic is named.
ONLY_NAMED = frozenset({TWIST, "geometry_msgs/msg/Vector3Stamped"})


def read_stamp_s(message: Any) -> float:
    """Read the stamp of a header; 0 without one."""
    header = getattr(message, "header", None)
    return to_seconds(header.stamp) if header is not None else 0.0


def read_frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return str(header.frame_id).strip("/") if header is not None else ""
