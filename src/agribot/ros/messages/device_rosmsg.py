"""Readings of base station, bumper and battery as ROS 2 messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agribot.core.messages import BaseFix, BatterySample, BumperSample, ImuSample, Vec3
from agribot.ros.messages.rosmsg import (
    BODY_FRAME,
    make_header,
    make_imu,
    make_message,
    make_point,
    make_vector3,
)

POLE_FRAME = "gps_pole_link"
# Constants of sensor_msgs/BatteryState.
_DISCHARGING, _HEALTH_UNKNOWN, _LITHIUM_ION = 2, 0, 2


def make_pole_fix(fix: BaseFix) -> Any:
    """Make a NavSatFix; the vertical covariance is a guess from the horizontal: APPROXIMATED."""
    variance_m2 = fix.pos_std_m**2
    return make_message(
        "sensor_msgs/msg/NavSatFix",
        make_header(fix.t_s, POLE_FRAME),
        make_message("sensor_msgs/msg/NavSatStatus", 0, 1),
        fix.lat_deg,
        fix.lon_deg,
        fix.alt_m,
        np.diag([variance_m2, variance_m2, 4.0 * variance_m2]).ravel(),
        1,
    )


def make_pole_velocity(fix: BaseFix, velocity_mps: Vec3) -> Any:
    """Make a Vector3Stamped of what the pole's receiver takes for its velocity."""
    head = make_header(fix.t_s, POLE_FRAME)
    return make_message("geometry_msgs/msg/Vector3Stamped", head, make_vector3(*velocity_mps))


def make_imu_bias(t_s: float, frame: str, bias: tuple[Vec3, Vec3]) -> Any:
    """Make an Imu of the biases of accelerometer (m/s^2) and gyro (rad/s), without orientation."""
    accel_mps2, gyro_radps = bias
    return make_imu(ImuSample(t_s=t_s, gyro_radps=gyro_radps, accel_mps2=accel_mps2), frame)


def make_contact_point(sample: BumperSample) -> Any:
    place = make_point(sample.x_body_m, sample.y_body_m)
    return make_message(
        "geometry_msgs/msg/PointStamped", make_header(sample.t_s, BODY_FRAME), place
    )


def make_battery_state(sample: BatterySample) -> Any:
    """Make a BatteryState: a discharging current is negative, unknown values are NaN."""
    unknown = math.nan
    return make_message(
        "sensor_msgs/msg/BatteryState",
        make_header(sample.t_s, ""),
        sample.voltage_v,
        unknown,  # temperature
        -sample.current_a,
        unknown,  # charge
        unknown,  # capacity
        unknown,  # design capacity
        sample.charge_ratio,
        _DISCHARGING,
        _HEALTH_UNKNOWN,
        _LITHIUM_ION,
        True,
        np.empty(0, dtype=np.float32),
        np.empty(0, dtype=np.float32),
        "",
        "",
    )
