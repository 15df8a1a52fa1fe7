"""What further devices say as ROS 2 messages: base station, bumper, battery."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agribot.core.messages import BaseFix, BatterySample, BumperSample
from agribot.ros.messages.rosmsg import BODY_FRAME, header, make, point

POLE_FRAME = "gps_pole_link"
# sensor_msgs/BatteryState: what its constants are called there.
_DISCHARGING, _HEALTH_UNKNOWN, _LITHIUM_ION = 2, 0, 2


def pole_fix(fix: BaseFix) -> Any:
    """A receiver tells a horizontal sigma only; the vertical one is a guess: APPROXIMATED."""
    variance_m2 = fix.pos_std_m**2
    return make(
        "sensor_msgs/msg/NavSatFix",
        header(fix.t_s, POLE_FRAME),
        make("sensor_msgs/msg/NavSatStatus", 0, 1),
        fix.lat_deg,
        fix.lon_deg,
        fix.alt_m,
        np.diag([variance_m2, variance_m2, 4.0 * variance_m2]).ravel(),
        1,
    )


def touched_point(sample: BumperSample) -> Any:
    place = point(sample.x_body_m, sample.y_body_m)
    return make("geometry_msgs/msg/PointStamped", header(sample.t_s, BODY_FRAME), place)


def battery_state(sample: BatterySample) -> Any:
    """ROS counts a current out of the battery negative; what is unknown is NaN."""
    unknown = math.nan
    return make(
        "sensor_msgs/msg/BatteryState",
        header(sample.t_s, ""),
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
