"""The wheels' odometry as a message, and what a filter's pose makes of its frame (REP-105)."""

from __future__ import annotations

from typing import Any

import numpy as np

from agribot.autonomy.estimate.filter.wheel_odometry import OdometryReading, WheelOdometry
from agribot.core import topics
from agribot.core.config import EstimateConfig
from agribot.core.messages import Estimate, SensorBatch
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.ros.messages import rosmsg
from agribot.ros.messages.cdr import CdrTemplate, TransformsCdr
from agribot.ros.messages.rosmsg import BODY_FRAME, MAP_FRAME, ODOM_FRAME, quaternion_from_yaw
from agribot.ros.messages.sensor_topics import MessageSink

# Variance of values outside the wheels' measurement: height, roll and pitch, and their rates.
UNMEASURED = 1e6
_POSE_AT = {(0, 0): 0, (0, 1): 1, (0, 5): 2, (1, 0): 3, (1, 1): 4, (1, 5): 5, (5, 0): 6,
            (5, 1): 7, (5, 5): 8}  # fmt: skip

Pose = tuple[float, float, float]  # x, y (m), yaw (rad)


def make_wheel_odometry(reading: OdometryReading) -> Any:
    """Make an Odometry of base_footprint in odom; what wheels do not measure has a variance 1e6."""
    return rosmsg.make_message(
        topics.ODOM.ros_type,
        rosmsg.make_header(reading.t_s, ODOM_FRAME),
        BODY_FRAME,
        rosmsg.make_message(
            "geometry_msgs/msg/PoseWithCovariance",
            rosmsg.make_pose(reading.x_m, reading.y_m, reading.yaw_rad),
            np.array(_pack_pose_cov(reading)),
        ),
        rosmsg.make_message(
            "geometry_msgs/msg/TwistWithCovariance",
            rosmsg.make_twist(reading.v_mps, reading.yaw_rate_radps),
            np.array(_pack_twist_cov(reading)),
        ),
    )


def _pack_pose_cov(reading: OdometryReading) -> list[float]:
    covariance = np.diag([0.0, 0.0, UNMEASURED, UNMEASURED, UNMEASURED, 0.0]).ravel().tolist()
    for (row, column), index in _POSE_AT.items():
        covariance[6 * row + column] = reading.pose_cov[index]
    return [float(number) for number in covariance]


def _pack_twist_cov(reading: OdometryReading) -> list[float]:
    forward, sideways, turn = reading.twist_var
    diagonal = (forward, sideways, UNMEASURED, UNMEASURED, UNMEASURED, turn)
    return [diagonal[k // 6] if k % 7 == 0 else 0.0 for k in range(36)]


class WheelOdometryWriter:
    """Writes `topics.ODOM` of each batch with wheels; `pose` is the newest, in the frame odom."""

    def __init__(
        self, write: MessageSink, robot: RobotSpec, config: EstimateConfig | None = None
    ) -> None:
        self._write = write
        self._odometry = WheelOdometry(robot.drive, config)
        still = OdometryReading(
            t_s=0.0, x_m=0.0, y_m=0.0, yaw_rad=0.0, pose_cov=(0.0,) * 9, v_mps=0.0,
            yaw_rate_radps=0.0, twist_var=(0.0, 0.0, 0.0),
        )  # fmt: skip
        self._template = CdrTemplate(make_wheel_odometry(still), "7d36d6d36d")
        self.pose: Pose = (0.0, 0.0, 0.0)

    def __call__(self, now_ns: int, batch: SensorBatch) -> None:
        reading = self._odometry.update(batch.wheels[-1]) if batch.wheels else None
        if reading is None:
            return
        self.pose = (reading.x_m, reading.y_m, reading.yaw_rad)
        t_ns = rosmsg.to_nanoseconds(reading.t_s)
        self._write(topics.ODOM, now_ns, self._pack(t_ns, reading), t_ns)

    def _pack(self, t_ns: int, reading: OdometryReading) -> bytes:
        _, _, z, w = quaternion_from_yaw(reading.yaw_rad)
        return self._template.fill_stamped(
            t_ns,
            *(reading.x_m, reading.y_m, 0.0, 0.0, 0.0, z, w),
            *_pack_pose_cov(reading),
            *(reading.v_mps, 0.0, 0.0, 0.0, 0.0, reading.yaw_rate_radps),
            *_pack_twist_cov(reading),
        )


class FrameChain:
    """TF of map -> odom -> base_footprint: odom never jumps, and the chain ends at the estimate."""

    def __init__(self) -> None:
        self._cdr = TransformsCdr(((MAP_FRAME, ODOM_FRAME), (ODOM_FRAME, BODY_FRAME)))

    def __call__(self, t_ns: int, estimate: Estimate, odom_from_body: Pose) -> bytes:
        map_from_body = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        map_from_odom = find_map_from_odom(map_from_body, odom_from_body)
        return self._cdr(t_ns, (_make_transform(map_from_odom), _make_transform(odom_from_body)))


class OdomTransform:
    """TF of odom -> base_footprint alone: the node that localizes the robot adds map -> odom."""

    def __init__(self) -> None:
        self._cdr = TransformsCdr(((ODOM_FRAME, BODY_FRAME),))

    def __call__(self, t_ns: int, odom_from_body: Pose) -> bytes:
        return self._cdr(t_ns, (_make_transform(odom_from_body),))


class MapTransform:
    """TF of map -> odom alone, from where the body is in both."""

    def __init__(self) -> None:
        self._cdr = TransformsCdr(((MAP_FRAME, ODOM_FRAME),))

    def __call__(self, t_ns: int, map_from_body: Pose, odom_from_body: Pose) -> bytes:
        return self._cdr(
            t_ns, (_make_transform(find_map_from_odom(map_from_body, odom_from_body)),)
        )


def find_map_from_odom(map_from_body: Pose, odom_from_body: Pose) -> Pose:
    """Find the frame odom in the map, from the body's pose in both."""
    yaw_rad = map_from_body[2] - odom_from_body[2]
    turned = Pose2(map_from_body[0], map_from_body[1], yaw_rad)
    x_m, y_m = turned.transform(-odom_from_body[0], -odom_from_body[1])
    return x_m, y_m, yaw_rad


def _make_transform(pose: Pose) -> tuple[float, ...]:
    x_m, y_m, yaw_rad = pose
    return (x_m, y_m, 0.0, *quaternion_from_yaw(yaw_rad))
