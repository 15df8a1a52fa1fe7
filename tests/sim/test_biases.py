"""What a simulator states of its IMU's biases, and the receiver on the pole."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import BaseFix, FloatArray
from agribot.core.robot import RobotSpec
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.platform import SimPlatform
from agribot.sim.sensors.base_station import BaseStation
from agribot.sim.sensors.gnss import Antenna, HectorReceiver
from agribot.sim.sensors.presets import HectorGnss, load_preset


def stand(rover: RobotSpec, world: WorldSpec, sim: SimConfig) -> SimPlatform:
    config = RunConfig(seed=4, perception=PerceptionConfig(enabled=False), sim=sim)
    return SimPlatform(config, rover, world)


def mean_gyro(platform: SimPlatform, ticks: int) -> FloatArray:
    samples = [sample.gyro_radps for _ in range(ticks) for sample in platform.read().imu]
    return np.asarray(np.mean(samples, axis=0))


def test_the_bias_told_is_what_a_standing_gyro_reads(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = stand(rover, meadow, SimConfig(sensors="m8n", imu="mpu9265"))
    platform.read()
    _, told = platform.imu_bias
    noise = 0.001
    assert np.linalg.norm(told) > noise
    assert mean_gyro(platform, 100) == pytest.approx(told, abs=noise)


def test_an_offset_that_is_tuned_is_part_of_the_bias(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = stand(rover, meadow, SimConfig(sensors="ideal"))
    platform.read()
    assert platform.imu_bias == ((0.0,) * 3, (0.0,) * 3)
    platform.tune("gyro", "offset", 0.02)
    platform.tune("accel", "offset", -0.1)
    platform.read()
    assert platform.imu_bias == ((-0.1,) * 3, (0.02,) * 3)


def test_the_receiver_on_the_pole_stands_but_for_its_noise(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    fixes = _pole_fixes(
        stand(rover, meadow, SimConfig(sensors="m8n", base_station="independent")), 300
    )
    speeds = np.array([fix.velocity_mps for fix in fixes])
    assert len(speeds) > 20
    assert 0.005 < speeds.std() < 0.2
    assert abs(speeds.mean(axis=0)).max() < 0.05


def test_the_gate_of_a_world_is_its_base_station(meadow: WorldSpec) -> None:
    gate = Obstacle(
        name="entry_gate", kind="pole", x_map_m=3.0, y_map_m=-2.0, z_map_m=0.0, yaw_rad=0.0,
        shapes=(),
    )  # fmt: skip
    world = msgspec.structs.replace(meadow, obstacles=(gate,))
    errors = load_preset("ideal").gnss
    rover = HectorReceiver(HectorGnss(drift_m=0.0), Antenna(world.datum, (0.0, 0.0, 0.0)), 1)
    fix = BaseStation(errors, rover, world, 1, is_common=False).sample(0.2, np.zeros(40))
    known = (fix.known_lat_deg, fix.known_lon_deg, fix.known_alt_m)
    assert MapFrame(world.datum).map_from_geodetic(*known)[:2] == pytest.approx((3.0, -2.0))


def _pole_fixes(platform: SimPlatform, ticks: int) -> list[BaseFix]:
    return [fix for _ in range(ticks) for fix in platform.read().base]
