"""What the filter believes of a fix, by the way it was obtained."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.ekf import YAW
from agribot.autonomy.estimate.sensors.gnss_noise import PositionNoise, fix_noise, widen
from agribot.core.messages import GnssFix, GnssQuality
from tests import nightly
from tests.autonomy.estimate.noisy_rover import RTK, record, rows, stand
from tests.autonomy.estimate.playback import batches, error, localizer, play
from tests.autonomy.estimate.test_localizer_faults import with_fixes


def fix(quality: GnssQuality, pos_std_m: float) -> GnssFix:
    return GnssFix(
        t_s=0.0, lat_deg=21.0, lon_deg=72.0, alt_m=0.0, pos_std_m=pos_std_m, quality=quality
    )


@pytest.mark.parametrize("quality", [GnssQuality.SINGLE, GnssQuality.DGNSS])
def test_without_carrier_corrections_the_stated_error_is_a_slow_bias(quality: GnssQuality) -> None:
    noise = fix_noise(fix(quality, 2.0), 0.2)
    assert noise.bias_std_m == 2.0
    assert noise.variance_m2 < 0.02


def test_fixed_ambiguities_split_the_stated_error_between_noise_and_bias() -> None:
    noise = fix_noise(fix(GnssQuality.RTK_FIXED, 0.014), 0.1)
    assert noise.variance_m2 + noise.bias_std_m**2 == pytest.approx(0.014**2)


def test_float_solutions_weigh_the_same_whatever_their_rate() -> None:
    slow, fast = (fix_noise(fix(GnssQuality.RTK_FLOAT, 0.4), dt) for dt in (0.5, 0.05))
    assert fast.variance_m2 == pytest.approx(10.0 * slow.variance_m2)
    assert slow.variance_m2 > 0.4**2


def test_a_receiver_that_claims_no_error_at_all_is_not_taken_at_its_word() -> None:
    for std_m in (0.0, -1.0, 1e-9):
        assert fix_noise(fix(GnssQuality.RTK_FIXED, std_m), 0.1).variance_m2 > 1e-6


def scatter(std_m: float, step_s: float = 0.1, speed_mps: float = 0.0) -> PositionNoise:
    """Forty fixes that state 1.4 cm, of wheels that lead astray by a speed."""
    rng, noise = np.random.default_rng(3), PositionNoise()
    for t_s in (step_s * np.arange(40)).tolist():
        off_m = complex(*rng.normal(0.0, std_m, 2).tolist())
        noise.add(t_s, speed_mps * t_s + off_m, 0.014)
    return noise


@pytest.mark.parametrize("std_m", [0.01, 0.05, 0.5])
@pytest.mark.parametrize("speed_mps", [0.0, 0.4])
def test_the_scatter_of_positions_is_learnt_also_while_the_wheels_slip(
    std_m: float, speed_mps: float
) -> None:
    noise = scatter(std_m, speed_mps=speed_mps)
    assert noise.std_m == pytest.approx(std_m, rel=0.35)
    assert bool(noise.fault) == (std_m > 0.03)
    stated = fix_noise(fix(GnssQuality.RTK_FIXED, 0.014), 0.1)
    believed = widen(stated, noise.std_m)
    assert believed.bias_std_m == stated.bias_std_m
    is_more = std_m > 0.03
    assert believed.variance_m2 == (noise.std_m**2 if is_more else stated.variance_m2)


def test_before_enough_fixes_came_nothing_is_said_of_their_scatter() -> None:
    noise = PositionNoise()
    for tick in range(10):
        noise.add(0.1 * tick, complex((-1.0) ** tick), 0.014)
    assert noise.std_m == 0.0
    assert not noise.fault


def test_fixes_before_and_behind_a_gap_are_no_neighbours() -> None:
    """While the receiver is silent, wheels that slip lead away from its places."""
    noise = scatter(0.01)
    for tick in range(60):
        pair, second = divmod(tick, 2)
        noise.add(10.0 + 3.0 * pair + 0.1 * second, complex(0.2 * (-1.0) ** pair), 0.014)
    assert noise.std_m < 0.015


def test_standing_for_minutes_the_certainty_stops_at_the_receivers_slow_error() -> None:
    recording = record(stand, 60.0, seed=1, errors=RTK)
    last = play(recording)[-1]
    assert last.pos_std_m > 0.004
    assert math.hypot(*error(recording, last)[:2].tolist()) < 3.5 * last.pos_std_m


def test_a_tilted_robot_knows_that_its_antenna_leans() -> None:
    """2 m up on a slope of 0.1 rad the antenna leans by 20 cm; the robot itself does not."""
    recording = record(stand, 8.0, seed=1)
    lean_m = 2.0 * math.sin(0.1)
    pitched = [
        type(s)(
            t_s=s.t_s, gyro_radps=s.gyro_radps,
            accel_mps2=(-9.8 * math.sin(0.1), 0.0, 9.8 * math.cos(0.1)),
        )
        for s in recording.imu
    ]  # fmt: skip
    tilted = type(recording)(
        truth=recording.truth,
        wheels=recording.wheels,
        imu=pitched,
        mag=recording.mag,
        fixes=recording.fixes,
    )
    level, leaning = (play(r, localizer((0.0, 0.0, 2.0)))[-1] for r in (recording, tilted))
    # Nose down (positive pitch) and facing North, the antenna leans North of the robot.
    assert level.y_map_m - leaning.y_map_m == pytest.approx(lean_m, abs=0.02)
    assert level.x_map_m - leaning.x_map_m == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("std_mps", [0.3, 3.0])
@nightly.all_or_first("seeds", range(6), in_suite=1)
def test_velocities_that_suddenly_only_scatter_do_not_turn_the_robot_over(
    std_mps: float, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)

        def shake(told: GnssFix, rng: np.random.Generator = rng) -> GnssFix:
            assert told.velocity_mps is not None
            east, north, up = told.velocity_mps
            wrong = (east + rng.normal(0.0, std_mps), north + rng.normal(0.0, std_mps), up)
            return msgspec.structs.replace(told, velocity_mps=wrong)

        recording = record(rows, 30.0, seed=seed, errors=RTK)
        spoilt = with_fixes(recording, lambda t_s: t_s > 12.0, shake)
        off = [error(spoilt, estimate) for estimate in play(spoilt) if estimate.ok]
        assert max(abs(e[2]) for e in off[500:]) < math.radians(5.0)
        assert max(math.hypot(e[0], e[1]) for e in off[500:]) < 0.1


def test_a_heading_that_is_wrong_is_still_put_right_by_the_velocity() -> None:
    """A robot that was turned by hand has the same residual in every fix, unlike noise."""
    recording = record(rows, 20.0, seed=1, errors=RTK)
    into = localizer()
    for batch in batches(recording):
        estimate = into.update(batch)
        if batch.t_s == pytest.approx(8.0):
            turned_rad = estimate.yaw_map_rad + math.radians(60.0)
            into.pose.ekf.x[YAW] = turned_rad
    assert abs(error(recording, estimate)[2]) < math.radians(5.0)
