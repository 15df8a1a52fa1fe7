"""The protection level: rarely exceeded, never far from useful, and honest when the GNSS lies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.mission.caution import across_std_m
from agribot.core.config import EstimateConfig
from agribot.core.facts import GnssParts
from agribot.core.messages import CorrectPose, Estimate, GnssFix, SensorBatch
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, Recording, record, rows
from tests.autonomy.estimate.playback import batches, localizer, play
from tests.autonomy.estimate.test_localizer_faults import distance_m, shifted, with_fixes

DURATION_S = 30.0
TIME_TO_ALERT_TICKS = 25  # half a second


def exceeded(recording: Recording, estimates: list[Estimate]) -> list[bool]:
    """At each tick with a pose, whether the true error is beyond what was promised."""
    return [distance_m(recording, e) > e.protection_m for e in estimates if e.ok]


@nightly.all_or_first("seeds", range(100, 130), in_suite=2)
@pytest.mark.parametrize(("errors", "useful_m"), [(RTK, 0.4), (M8N, 6.5)], ids=["rtk", "m8n"])
def test_the_error_exceeds_its_level_no_more_often_than_promised(
    errors: Errors, useful_m: float, seeds: Sequence[int]
) -> None:
    beyond: list[bool] = []
    levels: list[float] = []
    for seed in seeds:
        recording = record(rows, DURATION_S, seed=seed, errors=errors)
        estimates = play(recording)
        beyond += exceeded(recording, estimates)
        levels += [e.protection_m for e in estimates[500:]]
    assert len(beyond) > len(seeds) * 1000
    assert np.mean(beyond) <= EstimateConfig().protection_risk
    assert np.median(levels) < useful_m


def test_a_level_for_a_rarer_excess_is_larger() -> None:
    recording = record(rows, 15.0, seed=1)
    usual = play(recording)[-1]
    rare = play(recording, localizer(config=EstimateConfig(protection_risk=1e-6)))[-1]
    assert rare.protection_m > 1.3 * usual.protection_m
    assert rare.pos_std_m == usual.pos_std_m


@pytest.mark.parametrize("risk", [1e-2, 1e-3, 1e-4])
def test_what_the_covariance_alone_makes_of_the_level_has_the_risk_of_the_settings(
    risk: float,
) -> None:
    recording = record(rows, 15.0, seed=1)
    estimates = play(recording, localizer(config=EstimateConfig(protection_risk=risk)))
    last = estimates[-1]
    sigmas = last.across_plain_m / across_std_m(last, last.yaw_map_rad)
    assert math.erfc(sigmas / math.sqrt(2.0)) == pytest.approx(risk, rel=0.05)
    assert all(0.0 < e.across_plain_m <= e.across_protection_m for e in estimates if e.ok)


def longest(flags: list[bool]) -> int:
    """The longest run of True."""
    longest = current = 0
    for flag in flags:
        current = current + 1 if flag else 0
        longest = max(longest, current)
    return longest


def jumped(recording: Recording, size_m: float) -> Recording:
    """From the twelfth second on the receiver is elsewhere, and sure of it."""
    return with_fixes(recording, lambda t: t > 12.0, lambda fix: shifted(fix, size_m, size_m))


def frozen(recording: Recording) -> Recording:
    """From the twelfth second on the receiver repeats one place; its velocity says nothing."""
    last = next(fix for _, fix in recording.fixes if fix.t_s > 12.0)

    def repeat(fix: GnssFix) -> GnssFix:
        return msgspec.structs.replace(last, t_s=fix.t_s, velocity_mps=None)

    return with_fixes(recording, lambda t: t > 12.0, repeat)  # fmt: skip


def crept(recording: Recording) -> Recording:
    """From the twelfth second on the receiver drifts away at 10 cm/s."""

    def drift(fix: GnssFix) -> GnssFix:
        return shifted(fix, 0.1 * (fix.t_s - 12.0))

    return with_fixes(recording, lambda t: t > 12.0, drift)  # fmt: skip


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
@nightly.one_by_one("seed", range(4), in_suite=1)
@nightly.one_by_one(
    "fault", ["jump of 0.4 m", "freeze", "jump of 3 m", "jump of 100 m"], in_suite=2
)
def test_a_receiver_that_jumps_or_freezes_is_covered_or_flagged(
    errors: Errors, seed: int, fault: str
) -> None:
    recording = record(rows, 45.0, seed=seed, errors=errors)
    size_m = {"jump of 0.4 m": 0.28, "jump of 3 m": 2.1, "jump of 100 m": 70.7}.get(fault)
    faulty = frozen(recording) if size_m is None else jumped(recording, size_m)
    assert longest(exceeded(faulty, play(faulty))) <= TIME_TO_ALERT_TICKS


@nightly.all_or_first("seeds", range(4), in_suite=1)
def test_a_slow_drift_of_a_precise_receiver_is_covered_until_it_is_named_and_afterwards(
    seeds: Sequence[int],
) -> None:
    for seed in seeds:
        faulty = crept(record(rows, 40.0, seed=seed))
        estimates = play(faulty)
        assert next(e.t_s for e in estimates if e.contradiction_fact) < 16.0
        assert distance_m(faulty, estimates[-1]) < 0.4
        assert np.mean(exceeded(faulty, estimates)) <= 0.01


def test_after_a_fault_that_ends_the_level_comes_back_down() -> None:
    recording = record(rows, 60.0, seed=3)
    faulty = with_fixes(recording, lambda t: 12.0 < t <= 20.0, lambda fix: shifted(fix, 2.0))
    estimates = play(faulty)
    level = {round(e.t_s, 2): e.protection_m for e in estimates}
    assert level[19.0] > 1.5
    assert level[55.0] < 0.5
    assert np.mean(exceeded(faulty, estimates)) <= EstimateConfig().protection_risk


def test_what_has_contradicted_a_standing_robot_for_five_minutes_is_believed() -> None:
    def halted(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if 3.0 < t_s < 10.0 else (0.0, 0.0)

    recording = jumped(record(halted, 325.0, seed=1), 1.4)
    fixes = [(t_s, msgspec.structs.replace(f, velocity_mps=None)) for t_s, f in recording.fixes]
    recording = msgspec.structs.replace(
        recording, fixes=fixes, wheels=recording.wheels[::5], imu=recording.imu[::5]
    )  # each costs; a robot that stands needs few
    level = {round(e.t_s, 1): e for e in play(recording, tick_hz=10.0)}
    for t_s, least_m, most_m in ((300.0, 1.3, 3.0), (324.0, 0.0, 0.2)):
        estimate = level[t_s]
        assert estimate.ok
        assert least_m < estimate.protection_m < most_m
        assert least_m < estimate.across_protection_m < most_m


def test_there_is_no_level_without_a_pose_and_a_new_one_when_a_person_tells_the_place() -> None:
    def halted(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if 3.0 < t_s < 14.0 else (0.0, 0.0)

    recording = jumped(record(halted, 22.0, seed=2), 2.1)
    into = localizer()
    for batch in batches(recording):
        estimate = into.update(batch)
        if not estimate.ok:
            assert estimate.protection_m == math.inf
    assert estimate.protection_m > 2.0
    pose = CorrectPose(
        x_map_m=estimate.x_map_m, y_map_m=estimate.y_map_m, yaw_map_rad=estimate.yaw_map_rad,
        std_m=0.02, std_rad=0.02,
    )  # fmt: skip
    event = ask(pose, t_s=estimate.t_s)
    assert into.update(SensorBatch(t_s=estimate.t_s, requests=(event,))).protection_m < 0.2


def test_a_jump_of_a_cheap_receiver_does_not_drag_the_robot_along_later() -> None:
    """What jumped is taken off the fixes; left in the bias, it would fade and pull."""
    recording = record(rows, 45.0, seed=3, errors=M8N)
    plain, faulty = play(recording), play(jumped(recording, 70.7))
    apart_m = math.dist((plain[-1].x_map_m, plain[-1].y_map_m),
                        (faulty[-1].x_map_m, faulty[-1].y_map_m))  # fmt: skip
    assert apart_m < 0.6


def test_a_level_bounds_a_creep_of_15_mm_s_and_stops_the_work_before_it_is_beside_the_row() -> None:
    recording = with_fixes(
        record(lambda t_s: (0.4 * (t_s > 3.0), 0.0), 30.0, seed=2),
        lambda t_s: t_s > 12.0,
        lambda fix: shifted(fix, 0.015 * (fix.t_s - 12.0), 0.0),
    )
    estimates = play(recording)
    assert not any(exceeded(recording, estimates))
    doubted = next(e for e in estimates if isinstance(e.fact, GnssParts))
    assert distance_m(recording, doubted) < 0.31 < doubted.across_protection_m
