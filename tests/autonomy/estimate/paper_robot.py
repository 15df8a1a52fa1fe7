"""The smallest robot description that an estimator needs."""

from __future__ import annotations

from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import (
    DriveSpec,
    Joint,
    Link,
    Origin,
    RobotSpec,
    SensorMount,
    TyreSpec,
)

RADIUS_M, HALF_TRACK_M, YAW_MULTIPLIER = 0.09, 0.39, 1.4


def robot(antenna_body_m: tuple[float, float, float] = (0.0, 0.0, 0.6)) -> RobotSpec:
    """Four wheels, an antenna, and every other sensor at the centre."""
    places = [(-0.25, -0.39), (-0.25, 0.39), (0.25, -0.39), (0.25, 0.39)]
    links = [Link(name="base_link"), Link(name="gps"), *(Link(name=name) for name in WHEEL_NAMES)]
    x_m, y_m, z_m = antenna_body_m
    joints = [
        Joint(
            name="gps_joint",
            kind="fixed",
            parent="base_link",
            child="gps",
            origin=Origin(xyz_m=(x_m, y_m, z_m - 0.28)),
        )
    ]
    for name, (wheel_x_m, wheel_y_m) in zip(WHEEL_NAMES, places, strict=True):
        place = Origin(xyz_m=(wheel_x_m, wheel_y_m, -0.19))
        joints.append(
            Joint(name=f"{name}_j", kind="continuous", parent="base_link", child=name, origin=place)
        )
    drive = DriveSpec(
        wheel_radius_m=RADIUS_M, wheel_width_m=0.08, track_m=2 * HALF_TRACK_M, wheelbase_m=0.5,
        plugin_diameter_m=0.18, plugin_separation_m=0.65, yaw_multiplier=YAW_MULTIPLIER,
        torque_nm=20.0, gear_ratio=10.0, encoder_ticks_per_rev=400, command_timeout_s=0.5,
        max_speed_mps=1.0, max_yaw_rate_radps=1.2, max_accel_mps2=1.5, max_yaw_accel_radps2=3.0,
        rotor_inertia_kgm2=1e-4, servo_gain_nmspr=1.0, rate_hz=100.0,
    )  # fmt: skip
    return RobotSpec(
        name="paper",
        links=tuple(links),
        joints=tuple(joints),
        drive=drive,
        tyre=TyreSpec(),
        imu=SensorMount(link="base_link", rate_hz=200.0),
        gnss=SensorMount(link="gps", rate_hz=10.0),
        mag=SensorMount(link="base_link", rate_hz=5.0),
    )
