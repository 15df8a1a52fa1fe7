"""`data-manipulation`: compass and gyro in; raw and filtered heading and heading error out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from agribot.autonomy.estimate.sensors.compass_heading import CompassHeading
from agribot.core import topics
from agribot.core.geo import compass_deg_from_yaw, wrap_rad
from agribot.core.messages import ImuSample, MagSample
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.messages.sensor_readers import NOT_MEASURED
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage

_BEARING_TIMEOUT_S = 2.0


class DataManipulation(EndlessStage):
    """Publishes the heading error with each compass sample, while the goal's bearing is fresh."""

    inputs = (topics.IMU, topics.MAGNETIC, topics.BEARING, topics.CMD_VEL)
    outputs = (topics.HEADING_RAW, topics.HEADING_FILTERED, topics.ANGLE)

    def __init__(self, heading: CompassHeading) -> None:
        self._heading = heading
        self._bearing_rad = math.nan
        self._bearing_s = -math.inf
        self.reason = f"no {topics.MAGNETIC.name} yet"

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        if topic is topics.IMU:
            if message.angular_velocity_covariance[0] != NOT_MEASURED:
                self._heading.update_imu(_read_imu(message))
        elif topic is topics.CMD_VEL:
            self._heading.update_command(message.linear.x, message.angular.z)
        elif topic is topics.BEARING:
            if math.isfinite(message.data):
                self._bearing_rad, self._bearing_s = math.radians(message.data), t_s
        elif topic is topics.MAGNETIC:
            return self._report_heading(message, t_s)
        return ()

    def _report_heading(self, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        field_t = _read_xyz(message.magnetic_field)
        yaws = self._heading.update_mag(
            MagSample(t_s=to_seconds(message.header.stamp), field_t=field_t)
        )
        if yaws is None:
            self.reason = f"{topics.MAGNETIC.name} shows no direction: {field_t}"
            return ()
        raw_rad, yaw_rad = yaws
        messages = [
            OutgoingMessage(topics.HEADING_RAW, rosmsg.make_float64(compass_deg_from_yaw(raw_rad))),
            OutgoingMessage(
                topics.HEADING_FILTERED, rosmsg.make_float64(compass_deg_from_yaw(yaw_rad))
            ),
        ]
        if t_s - self._bearing_s > _BEARING_TIMEOUT_S:
            self.reason = f"no {topics.BEARING.name} for {_BEARING_TIMEOUT_S:g} s"
            return messages
        self.reason = ""
        error_deg = math.degrees(wrap_rad(self._bearing_rad - yaw_rad))
        return [*messages, OutgoingMessage(topics.ANGLE, rosmsg.make_float64(error_deg))]


def _read_xyz(vector: Any) -> tuple[float, float, float]:
    return float(vector.x), float(vector.y), float(vector.z)


def _read_imu(message: Any) -> ImuSample:
    has_accel = message.linear_acceleration_covariance[0] != NOT_MEASURED
    return ImuSample(
        t_s=to_seconds(message.header.stamp),
        gyro_radps=_read_xyz(message.angular_velocity),
        accel_mps2=_read_xyz(message.linear_acceleration) if has_accel else None,
    )
