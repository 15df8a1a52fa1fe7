"""A bare rover with the numbers of the original robot, not by the reader, and the packaged one."""

from __future__ import annotations

import math

import pytest

from agribot.core.geo import Datum
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import (
    CameraSpec,
    Joint,
    Link,
    Origin,
    RobotSpec,
    SensorMount,
    Shape,
    TyreSpec,
)
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from tests.robot_parts import HALF_BASE_M, HALF_TRACK_M, change_drive

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)


def _sensor(name: str, xyz_m: tuple[float, float, float]) -> Joint:
    return Joint(
        name=f"{name}_joint",
        kind="fixed",
        parent="base_link",
        child=f"{name}_link",
        origin=Origin(xyz_m=xyz_m),
    )


def _wheel(name: str) -> Joint:
    x_m = HALF_BASE_M if name.endswith("F") else -HALF_BASE_M
    y_m = HALF_TRACK_M if name.startswith("left") else -HALF_TRACK_M
    return Joint(
        name=f"base_link_to_{name}_joint",
        kind="continuous",
        parent="base_link",
        child=name,
        origin=Origin(xyz_m=(x_m, y_m, -0.1908), rpy_rad=(0.0, 0.0, math.pi / 2)),
    )


@pytest.fixture(scope="session")
def rover() -> RobotSpec:
    chassis = Link(
        name="base_link",
        mass_kg=3.4682,
        inertia_kgm2=(0.045731, 0.077236, 0.049938, 0.0, 0.0, 0.0),
        collisions=(Shape(kind="box", size_m=(0.56, 0.60, 0.12)),),
    )
    wheels = tuple(
        Link(name=name, mass_kg=0.411, inertia_kgm2=(0.0020959, 0.00113, 0.00113, 0.0, 0.0, 0.0))
        for name in WHEEL_NAMES
    )
    bare = ("dummy_link", "imu_link", "gps_link", "mag_link", "camera_link")
    drive = change_drive(
        wheel_radius_m=0.09, plugin_diameter_m=0.2,
        yaw_multiplier=1 + (HALF_BASE_M / HALF_TRACK_M) ** 2, torque_nm=20.0, gear_ratio=10.0,
        encoder_ticks_per_rev=4096, rotor_inertia_kgm2=1.42e-3,
    )  # fmt: skip
    return RobotSpec(
        name="rover",
        links=(chassis, *wheels, *(Link(name=name) for name in bare)),
        joints=(
            Joint(
                name="base_joint",
                kind="fixed",
                parent="dummy_link",
                child="base_link",
                origin=Origin(xyz_m=(0.0, 0.0, 0.26)),
            ),
            *(_wheel(name) for name in WHEEL_NAMES),
            _sensor("imu", (0.0, 0.06, 0.0)),
            _sensor("gps", (0.0, -0.06, 0.0)),
            _sensor("mag", (0.3, 0.0, 0.0)),
            _sensor("camera", (0.0, 0.0, 0.0)),
        ),
        drive=drive,
        tyre=TyreSpec(),
        imu=SensorMount(link="imu_link", rate_hz=200.0),
        gnss=SensorMount(link="gps_link", rate_hz=5.0),
        mag=SensorMount(link="mag_link", rate_hz=5.0),
        camera=CameraSpec(
            link="camera_link",
            width_px=640,
            height_px=480,
            hfov_rad=1.3962634,
            rate_hz=30.0,
            noise_std=0.007,
            clip_near_m=0.02,
            clip_far_m=300.0,
        ),
        implement=SprayerSpec(
            x_body_m=-0.4,
            section_count=8,
            section_spacing_m=0.1,
            section_width_m=0.1,
            latency_s=0.1,
        ),
    )


@pytest.fixture(scope="session")
def robot() -> RobotSpec:
    """The packaged robot."""
    return load_robot()


@pytest.fixture(scope="session")
def meadow() -> WorldSpec:
    return WorldSpec(name="meadow", datum=DATUM)
