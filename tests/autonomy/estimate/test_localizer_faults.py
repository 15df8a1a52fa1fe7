"""Sensors that lie, stop or repeat themselves, and a robot that is carried away."""

from __future__ import annotations

import math
from collections.abc import Callable
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.core.config import EstimateConfig
from agribot.core.facts import (
    DeadReckoning,
    FixesRejected,
    GnssJumped,
    GnssSilent,
    HeadingUnknown,
    NoDataYet,
    NoFixesYet,
    PoseClockWentBack,
    SensorSilent,
    Unspoken,
)
from agribot.core.messages import (
    Estimate,
    GnssFix,
    GnssQuality,
    ImuSample,
    SensorBatch,
    WheelSample,
)
from tests.autonomy.estimate.noisy_rover import Recording, record, rows, stand
from tests.autonomy.estimate.playback import batches, error, localizer, play
from tests.finding import holds, is_like

LAT_PER_M, LON_PER_M = 1.0 / 110719.0, 1.0 / 103858.0
Within = Callable[[float], bool]


def shifted(fix: GnssFix, east_m: float, north_m: float = 0.0) -> GnssFix:
    return msgspec.structs.replace(
        fix,
        lat_deg=fix.lat_deg + north_m * LAT_PER_M,
        lon_deg=fix.lon_deg + east_m * LON_PER_M,
    )


def with_fixes(
    recording: Recording, within: Within, change: Callable[[GnssFix], GnssFix | None]
) -> Recording:
    """The recording with the fixes inside a time span changed, or left out."""
    fixes = []
    for arrival_s, fix in recording.fixes:
        new = change(fix) if within(fix.t_s) else fix
        if new is not None:
            fixes.append((arrival_s, new))
    return msgspec.structs.replace(recording, fixes=fixes)


def without(recording: Recording, name: str, first_s: float, last_s: float) -> Recording:
    kept = [s for s in getattr(recording, name) if not first_s < s.t_s <= last_s]
    return msgspec.structs.replace(recording, **{name: kept})


def distance_m(recording: Recording, estimate: Estimate) -> float:
    return float(np.hypot(*error(recording, estimate)[:2]))


def at(estimates: list[Estimate], t_s: float) -> Estimate:
    return min(estimates, key=lambda e: abs(e.t_s - t_s))


def test_a_burst_of_outliers_is_rejected_and_leaves_no_mark() -> None:
    recording = record(rows, 30.0, seed=2)
    burst = with_fixes(recording, lambda t: 20.0 < t <= 21.0, lambda fix: shifted(fix, 3.0))
    into = localizer()
    estimates = play(burst, into)
    assert into.rejected["gnss outlier"] == 10
    assert max(distance_m(burst, e) for e in estimates[500:]) < 0.08
    contradiction = at(estimates, 20.98)
    assert contradiction.ok
    assert isinstance(contradiction.fact, FixesRejected)
    assert contradiction.fact.parts == ("gnss",)  # their velocities do not lead there


def test_one_accepted_outlier_does_not_shut_gnss_out_for_good() -> None:
    """After a long outage the gate is wide, and the first fix that comes is wrong and sure."""
    recording = with_fixes(record(rows, 50.0, seed=4), lambda t: 20.0 < t <= 35.0, lambda fix: None)
    lied = with_fixes(
        recording,
        lambda t: 35.0 < t <= 35.1001,
        lambda fix: msgspec.structs.replace(shifted(fix, 0.35), pos_std_m=0.005),
    )
    into = localizer()
    estimates = play(lied, into)
    assert distance_m(lied, at(estimates, 35.4)) > 0.2
    assert into.rejected["gnss outlier"] >= 20
    assert max(distance_m(lied, e) for e in estimates if e.t_s > 41.0) < 0.05


def halting(t_s: float) -> tuple[float, float]:
    return (0.4, 0.0) if 3.0 < t_s < 14.0 else (0.0, 0.0)


def test_a_robot_carried_two_metres_without_power_is_found_again_by_rtk() -> None:
    recording = with_fixes(record(halting, 25.0, seed=6), lambda t: t > 18.0,
                           lambda fix: shifted(fix, 2.0) if fix.t_s > 20.0 else None)  # fmt: skip
    estimates = play(recording)
    assert distance_m(recording, at(estimates, 19.0)) < 0.1
    moved = [error(recording, e)[:2] - (2.0, 0.0) for e in estimates if e.t_s > 23.0]
    assert max(float(np.hypot(*m)) for m in moved) < 0.08
    assert not any(e.contradiction_fact for e in estimates)


@pytest.mark.parametrize(("jump_m", "creep_mps"), [(2.0, 0.0), (0.0, 0.05)])
def test_fixes_that_move_without_their_velocity_carry_no_robot_that_stands(
    jump_m: float, creep_mps: float
) -> None:
    recording = with_fixes(
        record(halting, 24.0, seed=6), lambda t: t > 18.0,
        lambda fix: shifted(fix, jump_m + creep_mps * (fix.t_s - 18.0)),
    )  # fmt: skip
    last = play(recording)[-1]
    assert isinstance(last.contradiction_fact, GnssJumped)
    assert distance_m(recording, last) < 0.2


@pytest.mark.parametrize(
    "spoilt",
    [
        {"lat_deg": math.nan},
        {"lon_deg": math.inf},
        {"pos_std_m": math.nan},
        {"quality": GnssQuality.NONE},
        {"t_s": math.nan},
    ],
)
def test_a_fix_that_is_not_finite_is_as_good_as_none(spoilt: dict[str, float]) -> None:
    recording = record(rows, 8.0, seed=1)
    span: Within = lambda t: 5.95 < t <= 6.55  # noqa: E731
    bad = with_fixes(recording, span, lambda fix: msgspec.structs.replace(fix, **spoilt))
    into = localizer()
    estimates = play(bad, into)
    assert estimates == play(with_fixes(recording, span, lambda fix: None))
    assert into.rejected["gnss not usable"] == 6


def test_a_velocity_that_is_not_finite_does_not_cost_the_position() -> None:
    recording = record(rows, 12.0, seed=1)
    nan = (math.nan, 0.0, 0.0)
    bad = with_fixes(recording, lambda t: t > 5.0,
                     lambda fix: msgspec.structs.replace(fix, velocity_mps=nan))  # fmt: skip
    estimates = play(bad)
    assert estimates == play(
        with_fixes(recording, lambda t: t > 5.0,
                   lambda fix: msgspec.structs.replace(fix, velocity_mps=None))
    )  # fmt: skip
    assert distance_m(bad, estimates[-1]) < 0.06


def test_wheel_and_imu_readings_that_are_nonsense_never_reach_the_state() -> None:
    into = localizer()
    clean = record(rows, 8.0, seed=1)
    estimates = []
    for batch in batches(clean):
        t_s = batch.t_s - 0.003
        wheels = WheelSample(t_s=t_s, angle_rad=(math.nan, 0, 0, 0), speed_radps=(0, 0, 0, 0))
        imu = ImuSample(t_s=t_s, gyro_radps=(0, 0, 1e300), accel_mps2=(0, -math.inf, 9.8))
        noisy = msgspec.structs.replace(
            batch, wheels=(wheels, *batch.wheels), imu=(imu, *batch.imu)
        )
        estimates.append(into.update(noisy))
    assert estimates == play(clean)
    assert into.rejected["wheels not finite"] == into.rejected["imu not finite"] == 400


def test_repeated_batches_change_nothing() -> None:
    recording = record(rows, 8.0, seed=1)
    into = localizer()
    estimates = []
    for batch in batches(recording):
        into.update(batch)
        estimates.append(into.update(batch))
    assert estimates == play(recording)
    assert into.rejected["wheels out of order"] == len(recording.wheels)


@pytest.mark.parametrize("name", ["wheels", "imu"])
def test_silent_wheels_or_imu_stop_the_estimate_with_a_reason_and_come_back(
    name: Unspoken,
) -> None:
    recording = without(record(rows, 16.0, seed=1), name, 8.0, 9.5)
    estimates = play(recording)
    assert at(estimates, 8.2).ok
    silent = at(estimates, 8.6)
    assert not silent.ok
    assert is_like(silent.fact, SensorSilent(name, 0.65, ANY, ANY), within=0.055)
    assert all(e.ok for e in estimates if e.t_s > 9.6)
    assert max(distance_m(recording, e) for e in estimates if e.t_s > 10.0) < 0.08


def test_a_turn_that_the_gyro_missed_is_taken_from_the_wheels_and_doubted() -> None:
    """Half a turn of 5 s in which the IMU is silent for 2 s; the wheels know it to 8 %."""
    for seed in range(4):
        recording = without(record(rows, 22.0, seed=seed), "imu", 16.0, 18.0)
        estimates = play(recording)
        before, after = at(estimates, 15.9), at(estimates, 18.06)
        assert after.ok
        assert after.yaw_std_rad > before.yaw_std_rad + 0.015
        assert abs(float(error(recording, after)[2])) < 3.0 * after.yaw_std_rad


def test_silence_of_everything_for_seconds_is_bridged_by_the_encoder_angles() -> None:
    recording = record(rows, 16.0, seed=1)
    for name in ("wheels", "imu", "mag"):
        recording = without(recording, name, 8.0, 11.0)
    recording = with_fixes(recording, lambda t: 7.9 < t < 11.0, lambda fix: None)
    estimates = play(recording)
    assert not at(estimates, 10.0).ok
    back = at(estimates, 11.02)
    assert back.ok
    assert distance_m(recording, back) < 3.0 * back.pos_std_m
    assert distance_m(recording, back) < 0.25
    assert distance_m(recording, estimates[-1]) < 0.05


def test_an_encoder_that_restarts_from_zero_moves_the_robot_no_further() -> None:
    recording = record(rows, 12.0, seed=1)
    offsets = (40.0, 40.0, 40.0, 40.0)
    wheels = [
        msgspec.structs.replace(
            s, angle_rad=tuple(a + o for a, o in zip(s.angle_rad, offsets, strict=True))
        )
        if s.t_s < 8.0
        else s
        for s in recording.wheels
    ]
    into = localizer()
    estimates = play(msgspec.structs.replace(recording, wheels=wheels), into)
    assert into.rejected["encoder restarted"] == 4
    assert max(distance_m(recording, e) for e in estimates[300:]) < 0.08


def test_without_gnss_dead_reckoning_goes_on_while_it_is_worth_something() -> None:
    recording = with_fixes(record(rows, 60.0, seed=3), lambda t: t > 10.0, lambda fix: None)
    config = EstimateConfig(dead_reckoning_std_m=0.25)
    estimates = play(recording, localizer(config=config))
    early = at(estimates, 22.0)
    assert early.ok
    assert early.quality is GnssQuality.NONE
    assert holds(early.fact, GnssSilent(12.0), within=0.05)
    late = estimates[-1]
    assert not late.ok
    assert is_like(late.fact, DeadReckoning(ANY, ANY, 0.25, is_lost=True))
    assert distance_m(recording, late) < 3.0 * late.pos_std_m


def test_there_is_no_pose_before_there_is_a_heading_and_a_position() -> None:
    recording = record(stand, 6.0, seed=1)
    reasons = [
        play(msgspec.structs.replace(recording, **{name: []}))[-1]
        for name in ("mag", "fixes", "wheels", "imu")
    ]
    assert not any(e.ok for e in reasons)
    lacks = (
        HeadingUnknown(True, ANY),
        NoFixesYet(),
        NoDataYet("wheels", ANY),
        NoDataYet("imu", ANY),
    )
    for estimate, lack in zip(reasons, lacks, strict=True):
        assert is_like(estimate.fact, lack), estimate.fact
    first = localizer().update(SensorBatch(t_s=0.02))
    assert not first.ok
    assert is_like(first.fact, NoDataYet("wheels", ANY))


def test_one_wrong_fix_among_the_first_does_not_set_the_origin() -> None:
    recording = record(rows, 6.0, seed=1)
    wrong = with_fixes(recording, lambda t: 1.75 < t < 1.85, lambda fix: shifted(fix, 50.0))
    estimates = play(wrong)
    assert any(e.ok for e in estimates)
    assert max(distance_m(wrong, e) for e in estimates if e.ok) < 0.1


def test_an_unbelievable_fix_time_is_counted_and_ignored() -> None:
    recording = record(rows, 8.0, seed=1)
    future = with_fixes(recording, lambda t: 5.95 < t < 6.05,
                        lambda fix: msgspec.structs.replace(fix, t_s=1e6))  # fmt: skip
    into = localizer()
    assert distance_m(future, play(future, into)[-1]) < 0.05
    assert into.rejected["gnss without odometry"] == 1


def test_one_reading_from_the_future_does_not_make_all_later_ones_late() -> None:
    recording = record(rows, 8.0, seed=1)
    into = localizer()
    estimates = []
    for batch in batches(recording):
        wheels, imu = batch.wheels, batch.imu
        if abs(batch.t_s - 5.0) < 1e-6:
            wheels = (*wheels, msgspec.structs.replace(wheels[-1], t_s=1e9))
            imu = (*imu, msgspec.structs.replace(imu[-1], t_s=5.5))
        estimates.append(into.update(msgspec.structs.replace(batch, wheels=wheels, imu=imu)))
    assert estimates == play(recording)


def test_a_clock_that_goes_back_is_reported() -> None:
    into = localizer()
    into_batches = list(batches(record(rows, 6.0, seed=1)))
    assert [into.update(batch) for batch in into_batches][-1].ok
    again = into.update(into_batches[100])
    assert not again.ok
    assert is_like(again.fact, PoseClockWentBack(3.98))


def test_a_night_between_two_readings_is_over_at_once_and_leaves_doubt() -> None:
    recording = record(rows, 8.0, seed=1)
    into = localizer()
    play(recording, into)
    night_s = 30000.0
    reading, sample = recording.wheels[-1], recording.imu[-1]
    t_s = reading.t_s + night_s
    estimate = into.update(
        SensorBatch(
            t_s=t_s,
            wheels=(msgspec.structs.replace(reading, t_s=t_s),),
            imu=(msgspec.structs.replace(sample, t_s=t_s),),
        )
    )
    assert estimate.yaw_std_rad > 1.0
    assert math.isfinite(estimate.x_map_m + estimate.pos_std_m)
