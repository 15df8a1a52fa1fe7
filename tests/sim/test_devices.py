"""Base station, second antenna, bumper, battery, tuned errors."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import ConfigError
from agribot.core.geo import MapFrame, wrap_rad
from agribot.core.messages import (
    BaseFix,
    DriveCommand,
    FloatArray,
    GnssFix,
    RobotCommand,
    SensorBatch,
)
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.platform import SimPlatform
from agribot.sim.sensors.presets import list_imus, load_imu
from tests import nightly


def _platform(
    rover: RobotSpec, world: WorldSpec, sensors: str = "ideal", seed: int = 0, **sim: object
) -> SimPlatform:
    settings = msgspec.convert({"sensors": sensors, **sim}, SimConfig)
    config = RunConfig(seed=seed, perception=PerceptionConfig(enabled=False), sim=settings)
    return SimPlatform(config, rover, world)


def _read(platform: SimPlatform, ticks: int, v: float = 0.0, w: float = 0.0) -> list[SensorBatch]:
    batches = []
    for _ in range(ticks):
        batches.append(platform.read())
        drive = DriveCommand(v_mps=v, yaw_rate_radps=w)
        platform.write(RobotCommand(t_s=0.0, drive=drive))
    return batches


def _pole(world: WorldSpec) -> WorldSpec:
    pole = Obstacle(
        name="Pole", kind="pole", x_map_m=-3.0, y_map_m=4.0, z_map_m=0.0, yaw_rad=0.0, shapes=()
    )
    return msgspec.structs.replace(world, obstacles=(pole,))


# ------------------------------------------------------------ base station


def _errors(world: WorldSpec, batches: list[SensorBatch]) -> tuple[FloatArray, FloatArray]:
    """Of a resting rover at the origin in metres, plain and after correction; (N, 2) each."""
    frame = MapFrame(world.datum)

    def east_north(lat_deg: float, lon_deg: float) -> tuple[float, float]:
        east_m, north_m, _ = frame.map_from_geodetic(lat_deg, lon_deg, 0.0)
        return east_m, north_m + 0.0

    plain, corrected = [], []
    for batch in batches:
        for fix, base in zip(batch.gnss, batch.base, strict=True):
            assert fix.t_s == base.t_s
            plain.append(east_north(fix.lat_deg, fix.lon_deg))
            lat_deg, lon_deg, _ = base.error()
            corrected.append(east_north(fix.lat_deg - lat_deg, fix.lon_deg - lon_deg))
    true = np.array([0.06, 0.0])  # the antenna, right of a robot that looks North
    return np.array(plain) - true, np.array(corrected) - true


def _north(world: WorldSpec) -> WorldSpec:
    return msgspec.structs.replace(_pole(world), spawn_yaw_map_rad=math.pi / 2)


@nightly.all_or_first("seeds", range(12), in_suite=5)
def test_common_drift_of_five_metres_cancels(
    rover: RobotSpec, meadow: WorldSpec, seeds: Sequence[int]
) -> None:
    world, plain, left = _north(meadow), [], []
    for seed in seeds:
        platform = _platform(rover, world, "seed", seed, base_station="common")
        before, after = _errors(world, _read(platform, 500))
        plain.append(np.hypot(*before.mean(axis=0)))
        left.append(np.hypot(*after.mean(axis=0)))
        # What is left is the white noise of two receivers, 0.1 m each per axis.
        assert np.std(after) == pytest.approx(0.1 * math.sqrt(2.0), rel=0.25)
    assert np.median(plain) > 3.0
    assert max(left) < 0.1


def test_legacy_drift_cancels_to_the_millimetre(rover: RobotSpec, meadow: WorldSpec) -> None:
    world = _north(meadow)
    platform = _platform(rover, world, "legacy", 3, base_station="common")
    before, after = _errors(world, _read(platform, 500))
    assert np.hypot(*before.T).min() > 0.5
    assert np.hypot(*after.T).max() < 2e-3


def test_independent_drift_makes_a_correction_worse(rover: RobotSpec, meadow: WorldSpec) -> None:
    world, plain, left = _north(meadow), [], []
    for seed in range(20):
        platform = _platform(rover, world, "legacy", seed, base_station="independent")
        before, after = _errors(world, _read(platform, 20))
        plain.append(before.mean(axis=0))
        left.append(after.mean(axis=0))
    ratio = np.std(left) / np.std(plain)
    assert ratio == pytest.approx(math.sqrt(2.0), rel=0.4)
    assert ratio > 1.0


def test_differencing_takes_the_slow_error_out_of_a_real_receiver(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    world, plain, left = _north(meadow), [], []
    for seed in range(12):
        platform = _platform(rover, world, "m8n", seed, base_station="common")
        before, after = _errors(world, _read(platform, 50))
        plain.append(before[-1])
        left.append(after[-1])
    assert np.std(plain) == pytest.approx(1.22, rel=0.4)
    # Two multipath errors of 0.25 m and two white ones of 0.05 m.
    assert np.std(left) == pytest.approx(math.hypot(0.25, 0.05) * math.sqrt(2.0), rel=0.4)


def test_base_station_stands_at_the_pole_and_speaks_five_times_a_second(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    world = _pole(meadow)
    batches = _read(_platform(rover, world, base_station="common"), 250)
    fixes: list[BaseFix] = [fix for batch in batches for fix in batch.base]
    assert len(fixes) == 25
    frame = MapFrame(world.datum)
    fix = fixes[-1]
    known = frame.map_from_geodetic(fix.known_lat_deg, fix.known_lon_deg, fix.known_alt_m)
    assert known == pytest.approx((-3.0, 4.0, 0.25), abs=1e-6)


def test_a_base_station_leaves_the_rover_as_it_was(rover: RobotSpec, meadow: WorldSpec) -> None:
    def fixes(station: str) -> list[GnssFix]:
        platform = _platform(rover, meadow, "seed", 5, base_station=station)
        return [fix for batch in _read(platform, 100) for fix in batch.gnss]

    assert fixes("off") == fixes("common") == fixes("independent")
    assert all(batch.base == () for batch in _read(_platform(rover, meadow), 50))


# ------------------------------------------------------------ second antenna


def test_dual_antenna_tells_the_heading_to_half_a_degree(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    platform = _platform(rover, meadow, "rtk-dual", 1)
    errors, yaw_at = [], {}
    times = []
    for _ in range(1000):
        (batch,) = _read(platform, 1, w=0.5)
        yaw_at[round(batch.t_s, 3)] = platform.truth().yaw_map_rad
        for heading in batch.headings:
            assert batch.t_s - heading.t_s >= 0.1 - 1e-9
            errors.append(wrap_rad(heading.yaw_map_rad - yaw_at[round(heading.t_s, 3)]))
            times.append(heading.t_s)
            assert heading.std_rad == 0.007
    assert np.std(errors) == pytest.approx(math.radians(0.4), rel=0.15)
    assert abs(np.mean(errors)) < 4 * 0.007 / math.sqrt(len(errors))
    assert np.diff(times) == pytest.approx(0.1)


def test_dual_antenna_is_silent_without_a_fixed_solution(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    from agribot.sim.sensors.dual_antenna import DualAntenna
    from agribot.sim.sensors.presets import HeadingErrors

    class Floating:
        is_fixed = False

    sensor = DualAntenna(
        HeadingErrors(std_rad=0.007),
        Floating(),  # type: ignore[arg-type]
        np.random.default_rng(0),
    )
    row = np.zeros(41)
    row[3] = 1.0
    assert sensor.sample(0.1, row) is None
    assert all(not batch.headings for batch in _read(_platform(rover, meadow, "rtk"), 50))


# ------------------------------------------------------------ bumper and battery


def test_bumper_tells_where_the_robot_touches(rover: RobotSpec, meadow: WorldSpec) -> None:
    shape = Shape(kind="box", size_m=(0.2, 0.2, 1.0), origin=Origin(xyz_m=(0.0, 0.0, 0.5)))
    post = Obstacle(
        name="post", kind="post", x_map_m=1.0, y_map_m=0.39, z_map_m=0.0, yaw_rad=0.0,
        shapes=(shape,),
    )  # fmt: skip
    platform = _platform(rover, msgspec.structs.replace(meadow, obstacles=(post,)))
    batches = _read(platform, 150, v=0.4)
    touches = [sample for batch in batches for sample in batch.bumper]
    # The left front wheel reaches 0.34 m ahead: it meets the post's face at x = 0.9.
    assert touches[0].t_s == pytest.approx((0.9 - 0.342) / 0.395 + 0.14, abs=0.15)
    assert touches[0].x_body_m == pytest.approx(0.342, abs=0.03)
    assert touches[0].y_body_m == pytest.approx(0.39, abs=0.03)
    assert not any(batch.bumper for batch in batches[:50])


def test_battery_pays_for_motors_and_electronics(rover: RobotSpec, meadow: WorldSpec) -> None:
    def spent(w: float) -> float:
        batches = _read(_platform(rover, meadow), 1000, w=w)
        samples = [sample for batch in batches for sample in batch.battery]
        assert len(samples) == 20
        ratios = [sample.charge_ratio for sample in samples]
        assert ratios == sorted(ratios, reverse=True)
        assert all(18.0 < sample.voltage_v < 25.2 for sample in samples)
        return (1.0 - ratios[-1]) * 22.2 * 10 * 3600

    resting_j, turning_j = spent(0.0), spent(0.8)
    assert resting_j == pytest.approx(15.0 * 20.0, rel=0.02)
    # Turning on the spot scrubs the tyres: work of friction, at the efficiency of the drive.
    wheel_radps = 0.8 * rover.drive.effective_separation_m / 2 / 0.09
    most_w = rover.mass_kg * 9.8 * 0.09 * wheel_radps / 0.7
    assert 0.2 * most_w * 20 < turning_j - resting_j < most_w * 20


# ------------------------------------------------------------ tuning


@pytest.mark.parametrize("sensor", ["gnss", "gnss_velocity", "accel", "gyro", "mag"])
def test_an_offset_shows_in_the_very_next_sample(
    rover: RobotSpec, meadow: WorldSpec, sensor: str
) -> None:
    frame = MapFrame(meadow.datum)

    def values(batch: SensorBatch) -> list[tuple[float, ...]]:
        table: dict[str, list[tuple[float, ...]]] = {
            "gnss": [frame.map_from_geodetic(f.lat_deg, f.lon_deg, f.alt_m) for f in batch.gnss],
            "gnss_velocity": [f.velocity_mps or () for f in batch.gnss],
            "accel": [s.accel_mps2 or () for s in batch.imu],
            "gyro": [s.gyro_radps for s in batch.imu],
            "mag": [s.field_t for s in batch.mag],
        }
        return table[sensor]

    platform = _platform(rover, meadow)
    before = [value for batch in _read(platform, 25) for value in values(batch)]
    platform.tune(sensor, "offset", 0.5)
    after = [value for batch in _read(platform, 25) for value in values(batch)]
    assert np.array(after) - before[-1] == pytest.approx(0.5, abs=1e-3)
    platform.tune(sensor, "offset", 0.0)
    restored = [value for batch in _read(platform, 25) for value in values(batch)]
    assert np.array(restored) == pytest.approx(
        np.array(before)[-1:].repeat(len(restored), 0), abs=1e-3
    )


def test_noise_scale_and_drift_do_what_their_names_say(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = _platform(rover, meadow)
    platform.tune("gyro", "gaussian_noise", 0.02)
    gyro = np.array([s.gyro_radps for b in _read(platform, 250) for s in b.imu])
    assert np.std(gyro) == pytest.approx(0.02, rel=0.06)
    platform.tune("accel", "scale_error", 1.1)
    accel = np.array([s.accel_mps2 for b in _read(platform, 50) for s in b.imu])
    assert accel[:, 2].mean() == pytest.approx(9.8 * 1.1, rel=1e-3)
    platform.tune("mag", "drift", 1e-5)
    field = np.array([s.field_t for b in _read(platform, 200) for s in b.mag])
    assert np.std(field, axis=0).max() < 1e-7  # slow, but off at once
    assert np.abs(field.mean(axis=0) - (3.8e-5, 0.0, -2.3e-5)).max() > 1e-6


def test_tuning_from_many_threads_loses_nothing(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = _platform(rover, meadow)

    def tune(sensor: str) -> None:
        for k in range(200):
            platform.tune(sensor, "offset", k / 100.0)

    threads = [threading.Thread(target=tune, args=(name,)) for name in ("gyro", "accel")]
    for thread in threads:
        thread.start()
    _read(platform, 20)
    for thread in threads:
        thread.join()
    (batch,) = _read(platform, 1)
    assert batch.imu[0].gyro_radps[2] == pytest.approx(1.99, abs=1e-3)
    assert (batch.imu[0].accel_mps2 or ())[2:] == pytest.approx((9.8 + 1.99,), abs=1e-2)


@pytest.mark.parametrize(
    ("sensor", "parameter", "value", "message"),
    [
        ("gps", "offset", 1.0, r"unknown sensor 'gps'; .*known: gnss, gnss_velocity"),
        ("gnss", "ofset", 1.0, "did you mean 'offset'"),
        ("gnss", "drift", -1.0, "negative; give 0 or more"),
        ("gnss", "drift", math.nan, "finite"),
    ],
)
def test_wrong_tuning_is_refused_by_name(
    rover: RobotSpec, meadow: WorldSpec, sensor: str, parameter: str, value: float, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        _platform(rover, meadow).tune(sensor, parameter, value)


# ------------------------------------------------------------ IMU presets, declination


def test_imu_presets_differ_as_their_data_sheets(rover: RobotSpec, meadow: WorldSpec) -> None:
    def gyro(imu: str, seed: int = 0) -> FloatArray:
        batches = _read(_platform(rover, meadow, "rtk", seed, imu=imu), 50)
        return np.array([s.gyro_radps for b in batches for s in b.imu])

    assert list_imus() == ["hector", "ideal", "mpu9265"]
    assert np.abs(gyro("ideal")).max() < 1e-4
    assert np.std(gyro("hector") - gyro("ideal")) == pytest.approx(1e-8, rel=0.1)
    white = load_imu("mpu9265").gyro_noise_radps_per_sqrt_hz * math.sqrt(100.0)
    assert np.std(np.diff(gyro("mpu9265"), axis=0)) == pytest.approx(white * math.sqrt(2), rel=0.1)
    biases = [gyro("mpu9265", seed).mean(axis=0) for seed in range(15)]
    assert np.std(biases) == pytest.approx(math.radians(5.0), rel=0.35)
    with pytest.raises(ConfigError, match=r"sim\.imu: .*did you mean 'mpu9265'"):
        gyro("mpu9250")


@pytest.mark.parametrize("sensors", ["ideal", "legacy"])
def test_declination_turns_the_compass(rover: RobotSpec, meadow: WorldSpec, sensors: str) -> None:
    def bearing_rad(declination_deg: float) -> float:
        platform = _platform(rover, meadow, sensors, 2, declination_deg=declination_deg)
        samples = [s for b in _read(platform, 300) for s in b.mag]
        x, y, _ = np.mean([s.field_t for s in samples], axis=0)
        return math.atan2(y, x)

    turned = wrap_rad(bearing_rad(10.0) - bearing_rad(0.0))
    # Magnetic North lies East of true North: clockwise.
    assert math.degrees(turned) == pytest.approx(-10.0, abs=0.5 if sensors == "ideal" else 3.0)
