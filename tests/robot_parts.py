"""Parts of robots on four wheels with known numbers, and the plainest robot made of them."""

from __future__ import annotations

from typing import Any

import msgspec

from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import DriveSpec, Joint, Link, Origin, RobotSpec, SensorMount, TyreSpec

HALF_TRACK_M, HALF_BASE_M, WHEEL_WIDTH_M = 0.3908, 0.2519, 0.05
DRIVE = DriveSpec(
    wheel_radius_m=0.13, wheel_width_m=WHEEL_WIDTH_M, track_m=2 * HALF_TRACK_M,
    wheelbase_m=2 * HALF_BASE_M, plugin_diameter_m=0.26, plugin_separation_m=0.65,
    yaw_multiplier=1.4, torque_nm=10.0, gear_ratio=1.0, encoder_ticks_per_rev=1000,
    command_timeout_s=0.5, max_speed_mps=1.0, max_yaw_rate_radps=1.5, max_accel_mps2=1.5,
    max_yaw_accel_radps2=4.0, rotor_inertia_kgm2=0.001, servo_gain_nmspr=1.0, rate_hz=100.0,
)  # fmt: skip


def change_drive(**changes: Any) -> DriveSpec:
    return msgspec.structs.replace(DRIVE, **changes)


def make_wheels(half_base_m: float, half_track_m: float, up_m: float, **more: Any) -> list[Joint]:
    """Joints of the wheels below base_link, in the order of their names."""
    corners = [(x, y) for x in (-half_base_m, half_base_m) for y in (-half_track_m, half_track_m)]
    return [
        Joint(
            name=f"{name}_joint", kind="continuous", parent="base_link", child=name,
            origin=Origin(xyz_m=(*corner, up_m)), **more,
        )
        for name, corner in zip(WHEEL_NAMES, corners, strict=True)
    ]  # fmt: skip


def plain_rover() -> RobotSpec:
    """A rover's footprint and drive, without what planning and following a path never see."""
    mount = SensorMount(link="base_link", rate_hz=50.0)
    return RobotSpec(
        name="rover", links=tuple(Link(name=name) for name in ("base_link", *WHEEL_NAMES)),
        joints=tuple(make_wheels(HALF_BASE_M, HALF_TRACK_M, 0.0)), drive=DRIVE, tyre=TyreSpec(),
        imu=mount, gnss=mount, mag=mount,
    )  # fmt: skip
