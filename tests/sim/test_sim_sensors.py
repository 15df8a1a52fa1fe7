"""Error statistics of the simulated sensors, over time and over seeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import msgspec
import numpy as np
import pytest

from agribot.core.config import RunConfig, SimConfig
from agribot.core.errors import ConfigError
from agribot.core.geo import MapFrame, yaw_from_compass_deg
from agribot.core.messages import FloatArray, GnssFix, GnssQuality, WheelSample
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.attitude import read_roll_pitch_yaw
from agribot.sim.random_streams import make_stream
from agribot.sim.sensors.gnss import Antenna, HectorReceiver, OutageProcess, Receiver
from agribot.sim.sensors.imu import Imu
from agribot.sim.sensors.magnetometer import HectorMagnetometer, Magnetometer
from agribot.sim.sensors.noise import GaussMarkov, HectorNoise
from agribot.sim.sensors.presets import (
    FloatOutages,
    HectorGnss,
    HectorMag,
    ImuErrors,
    PhysicalGnss,
    PhysicalMag,
    WheelErrors,
    list_presets,
    load_preset,
)
from agribot.sim.sensors.suite import SensorSuite
from agribot.sim.sensors.wheel_encoders import WheelEncoders
from agribot.sim.state import (
    ANGULAR,
    HISTORY_COLUMNS,
    POSITION,
    QUATERNION,
    TORQUE,
    VELOCITY,
    VELOCITY_GAIN,
    WHEEL_ANGLE,
)
from tests import nightly

FIELD_T = (0.0, 3.8e-5, -2.3e-5)


def _row(yaw_rad: float = 0.0, x_m: float = 0.0, y_m: float = 0.0) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[POSITION] = x_m, y_m, 0.28
    row[QUATERNION] = math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)
    return row


def _enu(world: WorldSpec, fixes: list[GnssFix]) -> FloatArray:
    frame = MapFrame(world.datum)
    return np.array([frame.map_from_geodetic(f.lat_deg, f.lon_deg, f.alt_m) for f in fixes])


# ------------------------------------------------------------ the original error model


def test_legacy_position_error_has_the_moments_of_the_original(meadow: WorldSpec) -> None:
    preset = cast(HectorGnss, load_preset("legacy").gnss)
    first, steps, walked = [], [], []
    for seed in range(400):
        receiver = HectorReceiver(preset, Antenna(meadow.datum, (0.0, 0.0, 0.0)), seed)
        fixes = [receiver.sample(0.2 * k, _row()) for k in range(1, 4)]
        error = _enu(meadow, fixes)[:, :2]
        first.append(np.hypot(*error[0]))
        steps.append(np.diff(error, axis=0).ravel())
        walked.append(fixes[0].pos_std_m)
    # N(0, 5 m) per axis: Rayleigh with a median of 5.9 m, 0.21 m of spread over 400 seeds.
    assert 5.3 < np.median(first) < 6.5
    assert np.std(np.concatenate(steps)) == pytest.approx(0.0236, rel=0.05)
    assert set(walked) == {5.0}


def test_legacy_drift_walks_as_slowly_as_the_original() -> None:
    errors = []
    for seed in range(150):
        noise = HectorNoise(make_stream(seed, "gnss"), 5.0, 1.0 / 3600.0, 0.0)
        start = np.array(noise.step(0.2))
        for _ in range(300):
            end = noise.step(0.2)
        # What is left of the start has decayed by exp(-60 / 3600).
        errors.append(np.array(end) - start * math.exp(-60.0 / 3600.0))
    horizontal_rms = math.sqrt(np.mean(np.square(errors)) * 2)
    assert horizontal_rms == pytest.approx(0.0236 * math.sqrt(300 * 2), rel=0.06)


def test_hector_noise_scales_with_the_interval_not_its_root() -> None:
    def step_std(dt_s: float) -> float:
        noise = HectorNoise(np.random.default_rng(1), 5.0, 1e-6, 0.0)
        return float(np.std(np.diff([noise.step(dt_s)[0] for _ in range(4000)])))

    assert step_std(0.2) / step_std(0.05) == pytest.approx(4.0, rel=0.05)


def test_legacy_heading_error_is_sixteen_degrees() -> None:
    preset = cast(HectorMag, load_preset("legacy").mag)
    headings = []
    for seed in range(40):
        sensor = HectorMagnetometer(preset, FIELD_T, make_stream(seed, "mag"))
        for k in range(1, 101):
            x, y, _ = sensor.sample(0.2 * k, _row()).field_t
            headings.append(math.degrees(math.atan2(y, x)) - 90.0)
    errors = (np.array(headings) + 180.0) % 360.0 - 180.0
    assert np.std(errors) == pytest.approx(16.2, abs=0.7)
    assert np.percentile(np.abs(errors), 95) == pytest.approx(32.0, abs=2.0)
    assert abs(np.corrcoef(errors[:-1], errors[1:])[0, 1]) < 0.12


def test_seed_preset_adds_the_noise_that_was_promised(meadow: WorldSpec) -> None:
    preset = cast(HectorGnss, load_preset("seed").gnss)
    receiver = HectorReceiver(preset, Antenna(meadow.datum, (0.0, 0.0, 0.0)), 4)
    error = _enu(meadow, [receiver.sample(0.2 * k, _row()) for k in range(1, 2001)])
    assert np.std(np.diff(error[:, 0])) == pytest.approx(math.hypot(0.1414, 0.0236), rel=0.05)


# ------------------------------------------------------------ receivers


@nightly.all_or_first("seeds", range(12), in_suite=4)
def test_rtk_error_is_a_centimetre_while_fixed_and_decimetres_while_not(
    meadow: WorldSpec, seeds: Sequence[int]
) -> None:
    preset = cast(PhysicalGnss, load_preset("rtk").gnss)
    fixed: list[FloatArray] = []
    floating: list[FloatArray] = []
    for seed in seeds:
        receiver = Receiver(preset, Antenna(meadow.datum, (0.0, 0.0, 0.0)), seed)
        fixes = [receiver.sample(0.2 * k, _row()) for k in range(1, 3001)]
        for fix, error in zip(fixes, _enu(meadow, fixes), strict=True):
            chosen = fixed if fix.quality == GnssQuality.RTK_FIXED else floating
            chosen.append(error[:2])
            assert fix.pos_std_m == (0.014 if chosen is fixed else 0.3)
    assert np.std(fixed) == pytest.approx(math.hypot(0.008, 0.01), rel=0.15)
    assert np.std(floating) == pytest.approx(0.3, rel=0.25)
    # 15 s of outage after every 240 s on average.
    assert 0.03 < len(floating) / (len(fixed) + len(floating)) < 0.10


def test_outages_have_the_durations_of_the_preset() -> None:
    outages = FloatOutages(
        mean_gap_s=60.0, min_duration_s=5.0, max_duration_s=25.0, std_m=0.3, tau_s=20.0
    )
    process = OutageProcess(outages, 1.8, seed=3)
    is_float = np.array([process.step(0.1 * k, 0.1) is not None for k in range(200_000)])
    edges = np.flatnonzero(np.diff(is_float.astype(int)))
    starts, ends = edges[0::2], edges[1::2]
    durations = 0.1 * (ends[: len(starts)] - starts[: len(ends)])
    assert durations.min() > 4.8
    assert durations.max() < 25.2
    assert len(durations) == pytest.approx(20_000 / 75.0, rel=0.2)


def test_m8n_wanders_by_more_than_a_metre_but_its_velocity_is_good(meadow: WorldSpec) -> None:
    preset = cast(PhysicalGnss, load_preset("m8n").gnss)
    ends, velocities = [], []
    for seed in range(300):
        receiver = Receiver(preset, Antenna(meadow.datum, (0.0, 0.0, 0.0)), seed)
        fix = receiver.sample(0.2, _row())
        ends.append(fix)
        velocities.append(fix.velocity_mps)
    assert np.std(_enu(meadow, ends)[:, :2]) == pytest.approx(math.hypot(1.2, 0.25), rel=0.1)
    assert np.std(np.array(velocities, dtype=float)) == pytest.approx(0.05, rel=0.1)
    assert ends[0].quality == GnssQuality.SINGLE


def test_gauss_markov_keeps_its_spread_and_its_correlation() -> None:
    process = GaussMarkov(np.random.default_rng(2), (2.0, 2.0, 2.0), 10.0)
    values = np.array([process.step(1.0) for _ in range(20_000)])
    assert np.std(values) == pytest.approx(2.0, rel=0.05)
    lag = np.mean(values[10:] * values[:-10]) / np.mean(values**2)
    assert lag == pytest.approx(math.exp(-1.0), abs=0.05)


def test_position_and_velocity_are_those_of_the_antenna(meadow: WorldSpec) -> None:
    preset = cast(PhysicalGnss, load_preset("ideal").gnss)
    receiver = Receiver(preset, Antenna(meadow.datum, (0.3, -0.1, 0.5)), 0)
    row = _row(yaw_rad=math.pi / 2, x_m=4.0, y_m=-2.0)
    row[VELOCITY] = 0.2, 0.0, 0.0
    row[ANGULAR] = 0.0, 0.0, 2.0
    fix = receiver.sample(0.1, row)
    # Facing North: forward is North, left is West.
    assert _enu(meadow, [fix])[0] == pytest.approx([4.1, -1.7, 0.78], abs=1e-6)
    assert fix.velocity_mps == pytest.approx([0.2 - 0.6, 0.2, 0.0], abs=1e-12)


# ------------------------------------------------------------ other sensors


def test_imu_noise_has_the_density_of_the_preset() -> None:
    errors = ImuErrors(gyro_noise_radps_per_sqrt_hz=2e-4, accel_noise_mps2_per_sqrt_hz=3e-3)
    imu = Imu(errors, 200.0, np.random.default_rng(0))
    samples = [imu.sample(0.005 * k, np.zeros(HISTORY_COLUMNS)) for k in range(1, 8001)]
    gyro = np.array([s.gyro_radps for s in samples])
    accel = np.array([s.accel_mps2 for s in samples])
    # One-sided density over the band up to 100 Hz.
    assert np.std(gyro) == pytest.approx(2e-4 * 10.0, rel=0.03)
    assert np.std(accel) == pytest.approx(3e-3 * 10.0, rel=0.03)


def test_imu_bias_and_scale_are_drawn_per_run() -> None:
    errors = ImuErrors(gyro_bias_std_radps=1e-3, accel_scale_std_ratio=0.01)
    biases, scales = [], []
    row = np.zeros(HISTORY_COLUMNS)
    row[VELOCITY_GAIN] = 0.05, 0.05, 0.05
    for seed in range(400):
        imu = Imu(errors, 200.0, make_stream(seed, "imu"))
        sample = imu.sample(0.005, row)
        biases.append(sample.gyro_radps)
        scales.append(np.array(sample.accel_mps2) / 10.0)
    assert np.std(biases) == pytest.approx(1e-3, rel=0.1)
    assert np.std(scales) == pytest.approx(0.01, rel=0.1)


def test_imu_bias_walks_with_the_root_of_time() -> None:
    ends = []
    for seed in range(120):
        imu = Imu(ImuErrors(gyro_walk_radps_per_sqrt_s=1e-4), 50.0, make_stream(seed, "imu"))
        for k in range(1, 1251):
            sample = imu.sample(0.02 * k, np.zeros(HISTORY_COLUMNS))
        ends.append(sample.gyro_radps)
    assert np.std(ends) == pytest.approx(1e-4 * math.sqrt(25.0), rel=0.12)


@pytest.mark.parametrize("compass_deg", [0.0, 37.0, 90.0, 180.0, 290.0])
def test_clean_magnetometer_points_north(compass_deg: float) -> None:
    sensor = Magnetometer(PhysicalMag(), FIELD_T, np.random.default_rng(0))
    x, y, z = sensor.sample(0.1, _row(yaw_from_compass_deg(compass_deg))).field_t
    assert math.degrees(math.atan2(y, x)) % 360.0 == pytest.approx(compass_deg, abs=1e-9)
    assert z == pytest.approx(-2.3e-5)


def test_iron_turns_with_the_robot() -> None:
    means = []
    for seed in range(300):
        errors = PhysicalMag(hard_iron_std_t=2e-6)
        sensor = Magnetometer(errors, FIELD_T, make_stream(seed, "mag"))
        turns = [sensor.sample(0.1, _row(k * math.pi / 2)).field_t for k in range(4)]
        means.append(np.mean(turns, axis=0) - (0.0, 0.0, -2.3e-5))
    # A whole turn averages the Earth's field away and leaves the iron.
    assert np.std(means) == pytest.approx(2e-6, rel=0.1)


def test_motor_current_disturbs_the_compass_in_proportion() -> None:
    sensor = Magnetometer(
        PhysicalMag(motor_field_std_t_per_nm=1e-6), FIELD_T, np.random.default_rng(3)
    )
    row = _row()
    quiet = np.array(sensor.sample(0.1, row).field_t)
    row[TORQUE] = 2.0
    some = np.array(sensor.sample(0.2, row).field_t) - quiet
    row[TORQUE] = 4.0
    more = np.array(sensor.sample(0.3, row).field_t) - quiet
    assert np.linalg.norm(some) > 1e-7
    assert more == pytest.approx(2.0 * some)


def test_realistic_compass_is_off_by_a_few_degrees() -> None:
    preset = cast(PhysicalMag, load_preset("rtk").mag)
    errors = []
    for seed in range(300):
        sensor = Magnetometer(preset, FIELD_T, make_stream(seed, "mag"))
        x, y, _ = sensor.sample(0.1, _row(yaw_from_compass_deg(60.0))).field_t
        errors.append(math.remainder(math.degrees(math.atan2(y, x)) - 60.0, 360.0))
    assert 3.5 < np.std(errors) < 6.5


def test_encoders_give_whole_ticks_and_their_difference(rover: RobotSpec) -> None:
    drive = msgspec.structs.replace(rover.drive, encoder_ticks_per_rev=16, gear_ratio=10.0)
    encoders = WheelEncoders(WheelErrors(), drive)
    row = np.zeros(HISTORY_COLUMNS)
    tick_rad = math.tau / 160.0
    row[WHEEL_ANGLE] = 0.99 * tick_rad, 1.01 * tick_rad, -0.01 * tick_rad, 7.5 * tick_rad
    sample = encoders.sample(0.01, row)
    assert np.array(sample.angle_rad) / tick_rad == pytest.approx([0.0, 1.0, -1.0, 7.0])
    assert sample.speed_radps[3] == pytest.approx(700.0 * tick_rad)
    assert encoders.sample(0.02, row).speed_radps == (0.0, 0.0, 0.0, 0.0)


def test_ideal_encoders_are_exact(rover: RobotSpec) -> None:
    encoders = WheelEncoders(WheelErrors(quantised=False), rover.drive)
    row = np.zeros(HISTORY_COLUMNS)
    row[WHEEL_ANGLE] = 0.1234567, 0.0, 0.0, 0.0
    sample: WheelSample = encoders.sample(0.01, row)
    assert sample.angle_rad[0] == 0.1234567


def test_attitude_is_that_of_the_quaternion() -> None:
    # 20 degrees of pitch (nose down), then 90 degrees of yaw.
    half_pitch, half_yaw = math.radians(10.0), math.radians(45.0)
    row = _row()
    row[QUATERNION] = (
        math.cos(half_yaw) * math.cos(half_pitch),
        -math.sin(half_yaw) * math.sin(half_pitch),
        math.cos(half_yaw) * math.sin(half_pitch),
        math.sin(half_yaw) * math.cos(half_pitch),
    )
    roll, pitch, yaw = read_roll_pitch_yaw(row)
    assert [roll, pitch, yaw] == pytest.approx([0.0, math.radians(20.0), math.pi / 2])


# ------------------------------------------------------------ presets


def test_every_preset_builds_a_suite(rover: RobotSpec, meadow: WorldSpec) -> None:
    names = list_presets()
    assert set(names) >= {
        "ideal", "legacy", "m8n", "m8n-1", "m8n-urban", "rtk", "rtk-1", "rtk-dual", "rtk-trees",
        "seed",
    }  # fmt: skip
    for name in names:
        preset = load_preset(name)
        suite = SensorSuite(RunConfig(sim=SimConfig(sensors=name)), rover, meadow, 2_000_000)
        history = np.tile(_row(), (501, 1))
        fixes = suite.gnss.take_samples(0, 500, history, 1.0)
        rate_hz = preset.gnss.rate_hz or rover.gnss.rate_hz
        heard_s = 1.0 - getattr(preset.gnss, "latency_s", 0.0)
        assert len(fixes) == math.floor(heard_s * rate_hz + 1e-9)
        assert len(suite.imu.take_samples(0, 500, history)) == 200


def test_unknown_preset_names_the_nearest_one() -> None:
    with pytest.raises(ConfigError, match=r"'rkt'; did you mean 'rtk'\?; known: ideal"):
        load_preset("rkt")
