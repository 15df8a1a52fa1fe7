"""Driving, turning and standing: what motion teaches the filter."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.core.messages import Estimate, MagSample
from tests import nightly
from tests.autonomy.estimate.noisy_rover import QUIET, RTK, Recording, record, rows, stand
from tests.autonomy.estimate.playback import error, localizer, play


def straight(t_s: float) -> tuple[float, float]:
    return (0.4, 0.0) if t_s > 3.0 else (0.0, 0.0)


def spin(t_s: float) -> tuple[float, float]:
    return (0.0, 0.5) if t_s > 3.0 else (0.0, 0.0)


def stop_and_turn(t_s: float) -> tuple[float, float]:
    """Turns of 2 s and stops of 2 s."""
    return (0.0, 0.6) if t_s > 3.0 and (t_s - 3.0) % 4.0 < 2.0 else (0.0, 0.0)


def reverse(t_s: float) -> tuple[float, float]:
    return (-0.3, 0.1) if t_s > 3.0 else (0.0, 0.0)


def compass_turned(recording: Recording, angle_rad: float) -> Recording:
    """As if the compass always read `angle_rad` too far to the left."""
    cos, sin = math.cos(-angle_rad), math.sin(-angle_rad)
    mag = [
        MagSample(
            t_s=s.t_s,
            field_t=(
                cos * s.field_t[0] - sin * s.field_t[1],
                sin * s.field_t[0] + cos * s.field_t[1],
                s.field_t[2],
            ),
        )
        for s in recording.mag
    ]
    return msgspec.structs.replace(recording, mag=mag)


def yaw_error_deg(recording: Recording, estimate: Estimate) -> float:
    return math.degrees(float(error(recording, estimate)[2]))


def distance_m(recording: Recording, estimate: Estimate) -> float:
    return float(np.hypot(*error(recording, estimate)[:2]))


def at(estimates: list[Estimate], t_s: float) -> Estimate:
    return min(estimates, key=lambda e: abs(e.t_s - t_s))


def test_perfect_sensors_give_a_perfect_pose() -> None:
    recording = record(rows, 40.0, errors=QUIET)
    for estimate in play(recording)[250:]:
        assert distance_m(recording, estimate) < 0.004
        assert abs(yaw_error_deg(recording, estimate)) < 0.3


def test_speed_and_yaw_rate_are_those_of_the_ground() -> None:
    recording = record(rows, 40.0, seed=8)
    true_mps = np.hypot(*np.diff(recording.truth[:, 1:3], axis=0).T) / 0.01
    late = [e for e in play(recording) if e.t_s > 25.0]
    errors = [e.v_mps - true_mps[round(e.t_s * 100) - 1] for e in late]
    assert float(np.sqrt(np.mean(np.square(errors)))) < 0.02
    rates = np.diff(np.unwrap(recording.truth[:, 3])) / 0.01
    errors = [e.yaw_rate_radps - rates[round(e.t_s * 100) - 1] for e in late]
    assert float(np.sqrt(np.mean(np.square(errors)))) < 0.01


@nightly.all_or_first("seeds", range(3), in_suite=1)
def test_driving_corrects_a_compass_that_is_off_by_ten_degrees(seeds: Sequence[int]) -> None:
    for seed in seeds:
        recording = compass_turned(record(straight, 40.0, seed=seed), math.radians(10.0))
        estimates = play(recording)
        assert yaw_error_deg(recording, estimates[140]) == pytest.approx(10.0, abs=6.0)
        last = estimates[-1]
        # Slope and heading look alike on one straight: the last two degrees need a turn.
        assert abs(yaw_error_deg(recording, last)) < 2.5
        assert abs(yaw_error_deg(recording, last)) < 3.0 * math.degrees(last.yaw_std_rad)


def test_the_lever_arm_of_the_antenna_is_taken_into_account() -> None:
    arm_m = (0.5, -0.2, 0.6)
    recording = record(spin, 40.0, seed=1, antenna_body_m=arm_m)
    right = play(recording, localizer(arm_m))
    assert max(distance_m(recording, e) for e in right[250:]) < 0.06
    wrong = play(recording, localizer((0.0, 0.0, 0.6)))
    assert max(distance_m(recording, e) for e in wrong[250:]) > 0.3


def test_turning_in_place_keeps_position_and_heading() -> None:
    recording = record(spin, 60.0, seed=2)
    late = play(recording)[250:]
    assert max(distance_m(recording, e) for e in late) < 0.05
    assert max(abs(yaw_error_deg(recording, e)) for e in late) < 12.0
    assert max(abs(error(recording, e)[2]) / e.yaw_std_rad for e in late) < 3.5


def test_reversing_is_not_mistaken_for_driving_the_other_way() -> None:
    recording = record(reverse, 40.0, seed=2)
    last = play(recording)[-1]
    assert abs(yaw_error_deg(recording, last)) < 2.5
    assert distance_m(recording, last) < 0.05
    assert last.v_mps < -0.2


def test_standing_teaches_the_gyro_bias() -> None:
    """Then 20 s of straight driving on the gyro alone stay straight; 0.01 rad/s is 11 degrees."""
    errors = msgspec.structs.replace(
        RTK, gyro_bias_radps=0.01, yaw_gain_ratio=0.0, gyro_scale_ratio=0.0
    )
    recording = record(lambda t: (0.4, 0.0) if t > 10.0 else (0.0, 0.0), 30.0, 3, errors)
    assert abs(recording.gyro_bias_radps) > 0.005
    alone = msgspec.structs.replace(
        recording,
        mag=[s for s in recording.mag if s.t_s < 10.0],
        fixes=[f for f in recording.fixes if f[1].t_s < 10.0],
    )
    estimates = play(alone)
    drift_deg = yaw_error_deg(alone, estimates[-1]) - yaw_error_deg(alone, estimates[500])
    assert abs(drift_deg) < 0.6


def test_standing_does_not_turn_the_heading() -> None:
    errors = msgspec.structs.replace(RTK, gyro_bias_radps=0.01)
    recording = record(stand, 40.0, seed=3, errors=errors)
    yaws = [e.yaw_map_rad for e in play(recording)[500:]]
    assert math.degrees(max(yaws) - min(yaws)) < 1.5


@nightly.all_or_first("seeds", range(3), in_suite=1)
def test_stop_ramps_are_not_learned_as_gyro_bias(seeds: Sequence[int]) -> None:
    for seed in seeds:
        recording = record(stop_and_turn, 40.0, seed=seed)
        estimates = play(recording)
        stopped = [e.yaw_rate_radps for e in estimates if e.t_s > 10 and (e.t_s - 3) % 4 > 3.2]
        assert max(map(abs, stopped)) < 1e-6
        assert abs(error(recording, estimates[-1])[2]) < 3.0 * estimates[-1].yaw_std_rad


def turned_standing(recording: Recording, rate_radps: float, begin_s: float) -> Recording:
    """As if soft ground turned the standing robot from then on."""
    imu = [
        msgspec.structs.replace(s, gyro_radps=(*s.gyro_radps[:2], s.gyro_radps[2] + rate_radps))
        if s.t_s > begin_s
        else s
        for s in recording.imu
    ]
    truth = recording.truth.copy()
    truth[:, 3] += rate_radps * np.maximum(truth[:, 0] - begin_s, 0.0)
    return msgspec.structs.replace(recording, imu=imu, mag=recording.mag[:100], truth=truth)


@nightly.one_by_one("rate_deg_per_s", [-1.0, 0.5], in_suite=1)
def test_soft_ground_that_turns_a_standing_robot_is_not_taken_for_the_bias_of_its_gyro(
    rate_deg_per_s: float,
) -> None:
    """The compass is silent: only the gyro shows that the robot turns, with or without wheels."""
    recording = turned_standing(record(stand, 40.0, seed=4), math.radians(rate_deg_per_s), 30.0)
    estimates = play(recording)
    before_deg = yaw_error_deg(recording, at(estimates, 29.0))
    for each in estimates[1450:]:
        assert yaw_error_deg(recording, each) == pytest.approx(before_deg, abs=1.5)
    bias_radps = estimates[-1].yaw_rate_radps - math.radians(rate_deg_per_s)
    assert abs(bias_radps) < math.radians(0.2)


def test_a_gyro_whose_bias_has_changed_is_learnt_anew_while_the_robot_stands() -> None:
    recording = turned_standing(record(stand, 80.0, seed=4), math.radians(0.5), 20.0)
    assert abs(play(recording)[-1].yaw_rate_radps) < 1e-6


def test_a_rate_at_standstill_that_is_a_turn_or_a_bias_opens_the_heading() -> None:
    """The gyro is off by 0.01 rad/s while the robot stands, fixes end, and it drives on it."""
    stood = record(lambda t: (0.4, 0.0) if t > 32.0 else (0.0, 0.0), 42.0, seed=4)
    recording = msgspec.structs.replace(turned_standing(stood, 0.01, 20.0), truth=stood.truth)
    fixes = [fix for fix in recording.fixes if fix[1].t_s < 24.0]
    last = play(msgspec.structs.replace(recording, fixes=fixes))[-1]
    assert abs(yaw_error_deg(recording, last)) > 4.0
    assert abs(math.radians(yaw_error_deg(recording, last))) < 3.0 * last.yaw_std_rad
    assert 0.3 < distance_m(recording, last) < last.protection_m


def test_slip_on_a_slope_points_downhill_on_both_headings() -> None:
    """The robot crabs to the East on its way North and to the East on its way South."""
    errors = msgspec.structs.replace(QUIET, slope_rad=0.05)
    recording = record(rows, 50.0, seed=9, errors=errors)
    north = np.diff(recording.truth[500:1400, 1])
    slope_rad = -float(north.sum()) / float(np.diff(recording.truth[500:1400, 2]).sum())
    assert abs(slope_rad) > 0.01
    late = [e for e in play(recording) if e.t_s > 38.0 and abs(e.v_mps) > 0.2]
    for e in late:
        across = math.sin(e.yaw_map_rad)
        if abs(across) > 0.95:
            assert e.slip_rad * across == pytest.approx(slope_rad, abs=0.012)


def test_a_compass_that_is_sixty_degrees_off_is_overruled_by_driving() -> None:
    """Far outside of what the filter believes possible: it has to open its own gate."""
    recording = compass_turned(record(straight, 30.0, seed=1), math.radians(60.0))
    estimates = play(recording)
    assert abs(yaw_error_deg(recording, estimates[140])) > 50.0
    assert abs(yaw_error_deg(recording, estimates[-1])) < 5.0


def test_a_compass_that_jumps_while_driving_does_not_turn_the_robot() -> None:
    """Steel beside the track: the field turns by 60 degrees and stays so along a row."""
    recording = record(straight, 40.0, seed=1)
    disturbed = compass_turned(recording, math.radians(60.0))
    mag = [d if d.t_s > 20.0 else s for s, d in zip(recording.mag, disturbed.mag, strict=True)]
    recording = msgspec.structs.replace(recording, mag=mag)
    into = localizer()
    estimates = play(recording, into)
    assert into.rejected["mag outlier"] >= 20
    assert max(abs(yaw_error_deg(recording, e)) for e in estimates if e.t_s > 15.0) < 5.0


def test_an_antenna_off_the_centre_shows_the_heading_of_a_robot_that_spins() -> None:
    """Positions alone: the antenna's place on its circle, without any Doppler velocity."""
    arm_m = (0.5, 0.0, 0.6)
    recording = compass_turned(
        record(spin, 30.0, seed=1, errors=QUIET, antenna_body_m=arm_m), math.radians(15.0)
    )
    fixes = [(a, msgspec.structs.replace(f, velocity_mps=None)) for a, f in recording.fixes]
    recording = msgspec.structs.replace(recording, fixes=fixes)
    estimates = play(recording, localizer(arm_m))
    assert abs(yaw_error_deg(recording, estimates[145])) > 10.0
    assert abs(yaw_error_deg(recording, estimates[-1])) < 5.0


def test_wheels_that_spin_in_place_do_not_carry_the_pose_away() -> None:
    """Stuck for 10 s with turning wheels (4 m of wheel travel), then free again."""
    recording = record(straight, 40.0, seed=2, grip=lambda t: 0.0 if 15.0 < t < 25.0 else 1.0)
    into = localizer()
    estimates = play(recording, into)
    assert into.rejected["wheels spin"] >= 1
    assert max(distance_m(recording, e) for e in estimates[300:]) < 0.2
    settled = [e for e in estimates if 18.0 < e.t_s < 25.0 or e.t_s > 28.0]
    assert max(distance_m(recording, e) for e in settled) < 0.08
    assert abs(at(estimates, 24.0).v_mps) < 0.05
    assert at(estimates, 39.0).v_mps == pytest.approx(0.39, abs=0.03)
    assert max(e.yaw_std_rad for e in estimates[300:]) < 0.4
