"""The smallest robot description that an estimator needs."""

from __future__ import annotations

from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import (
    Joint,
    Link,
    Origin,
    RobotSpec,
    SensorMount,
    TyreSpec,
)
from tests.robot_parts import change_drive, make_wheels

RADIUS_M, HALF_TRACK_M, YAW_MULTIPLIER = 0.09, 0.39, 1.4


def robot(antenna_body_m: tuple[float, float, float] = (0.0, 0.0, 0.6)) -> RobotSpec:
    """Four wheels, an antenna, and every other sensor at the centre."""
    links = [Link(name="base_link"), Link(name="gps"), *(Link(name=name) for name in WHEEL_NAMES)]
    x_m, y_m, z_m = antenna_body_m
    antenna = Joint(
        name="gps_joint", kind="fixed", parent="base_link", child="gps",
        origin=Origin(xyz_m=(x_m, y_m, z_m - 0.28)),
    )  # fmt: skip
    drive = change_drive(
        wheel_radius_m=RADIUS_M, wheel_width_m=0.08, track_m=2 * HALF_TRACK_M, wheelbase_m=0.5,
        plugin_diameter_m=0.18, yaw_multiplier=YAW_MULTIPLIER, torque_nm=20.0, gear_ratio=10.0,
        encoder_ticks_per_rev=400, max_yaw_rate_radps=1.2, max_yaw_accel_radps2=3.0,
        rotor_inertia_kgm2=1e-4,
    )  # fmt: skip
    return RobotSpec(
        name="paper",
        links=tuple(links),
        joints=(antenna, *make_wheels(0.25, HALF_TRACK_M, -0.19)),
        drive=drive,
        tyre=TyreSpec(),
        imu=SensorMount(link="base_link", rate_hz=200.0),
        gnss=SensorMount(link="gps", rate_hz=10.0),
        mag=SensorMount(link="base_link", rate_hz=5.0),
    )
