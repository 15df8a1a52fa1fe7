"""Turns on soft ground: they take more of the wheels' way than the straight, and slide aside."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import GnssFix, GnssQuality
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Recording, record, rows
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import error, play
from tests.autonomy.estimate.test_localizer_faults import distance_m, shifted, with_fixes

START = (1.0, 2.0, math.pi / 2)
MARKED = FieldConfig(start_map_m=START[:2], start_yaw_deg=90.0)
STRAIGHT_S, TURN_S, FIRST_S = 12.0, math.pi / 0.6, 3.0  # of the drive `rows`


def is_turning(t_s: float) -> bool:
    return t_s > FIRST_S and (t_s - FIRST_S) % (STRAIGHT_S + TURN_S) >= STRAIGHT_S


def let_float(fix: GnssFix) -> GnssFix:
    return msgspec.structs.replace(fix, quality=GnssQuality.RTK_FLOAT, pos_std_m=0.4)


def let_float_in_turns(recording: Recording) -> Recording:
    """Give the receiver decimetres instead of centimetres for as long as the robot turns."""
    fixes = [
        (arrival_s, let_float(fix) if is_turning(fix.t_s) else fix)
        for arrival_s, fix in recording.fixes
    ]
    return msgspec.structs.replace(recording, fixes=fixes)


def record_floating_turns(lost_ratio: float, seed: int) -> Recording:
    """Drive rows; in turns the wheels lose that share of their way while the fix floats."""

    def grip(t_s: float) -> float:
        return 1.0 - lost_ratio if is_turning(t_s) else 1.0

    return let_float_in_turns(record(rows, 40.0, seed=seed, grip=grip))


@nightly.one_by_one("lost_ratio", [0.5, 0.3, 0.0], in_suite=1)
@nightly.one_by_one("seed", range(3), in_suite=1)
def test_while_fixes_float_the_velocities_lead_through_a_turn_that_the_wheels_lose(
    lost_ratio: float, seed: int
) -> None:
    recording = record_floating_turns(lost_ratio, seed)
    off_m = [distance_m(recording, each) for each in play(recording) if each.t_s > 10.0]
    assert max(off_m) < 0.1


@pytest.mark.parametrize(
    ("lost_ratio", "most_m"), [(0.3, 0.25), pytest.param(0.0, 0.2, marks=pytest.mark.nightly)]
)
@nightly.one_by_one("seed", range(1, 4), in_suite=1)
def test_without_corrections_the_velocities_lead_through_turns_that_the_wheels_lose(
    lost_ratio: float, most_m: float, seed: int
) -> None:
    """The fixes wander by a metre meanwhile; the marked start is what is known of the place."""
    recording = record(
        rows, 60.0, seed=seed, errors=M8N, start=START,
        grip=lambda t_s: 1.0 - lost_ratio if is_turning(t_s) else 1.0,
    )  # fmt: skip
    into = Localizer(EstimateConfig(), MARKED, robot((0.0, 0.0, 0.6)))
    estimates = play(recording, into)[400:]
    off_m = [distance_m(recording, each) for each in estimates]
    assert max(off_m) < most_m
    assert max(m / each.pos_std_m for m, each in zip(off_m, estimates, strict=True)) < 2.0


@nightly.one_by_one("seed", range(4), in_suite=1)
def test_while_fixes_float_the_pose_goes_with_a_robot_that_clods_push_aside(seed: int) -> None:
    """The wheels lose half of their way besides; the pose says how far off it may be."""

    def slide(t_s: float) -> float:
        return 0.08 if 15.0 < t_s < 19.0 else 0.0

    recording = record(
        rows, 40.0, seed=seed, slide_mps=slide, grip=lambda t_s: 0.5 if 20.0 < t_s < 26.0 else 1.0
    )
    fixes = [
        (arrival_s, let_float(fix) if 14.0 < fix.t_s < 30.0 else fix)
        for arrival_s, fix in recording.fixes
    ]
    estimates = play(msgspec.structs.replace(recording, fixes=fixes))
    floating = [each for each in estimates if 14.0 < each.t_s < 30.0]
    assert max(distance_m(recording, each) for each in floating) < 0.15
    assert max(distance_m(recording, each) / each.pos_std_m for each in floating) < 3.0
    assert not any(each.contradiction_fact for each in estimates)


@nightly.one_by_one("seed", range(3), in_suite=1)
def test_wheels_that_find_their_grip_again_on_the_straight_are_no_jump_of_the_fixes(
    seed: int,
) -> None:
    """They had been learnt to lose most of their way; the robot is then faster than expected."""

    def drive(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if t_s > FIRST_S else (0.0, 0.0)

    recording = record(drive, 40.0, seed=seed, grip=lambda t: 0.2 if 15.0 < t < 25.0 else 1.0)
    estimates = play(recording)
    assert not any(each.contradiction_fact for each in estimates)
    assert max(distance_m(recording, each) for each in estimates[500:]) < 0.2


def is_on_straight(t_s: float) -> bool:
    """Whether a turn is over since a second."""
    return not is_turning(t_s) and not is_turning(t_s - 1.0)


@nightly.one_by_one("lost_ratio", [0.5, 0.3, 0.0], in_suite=1)
@nightly.one_by_one("seed", range(2), in_suite=1)
def test_a_soft_turn_while_the_fix_floats_is_no_jump_of_the_fix_that_comes_back(
    lost_ratio: float, seed: int
) -> None:
    """The velocities lead to it, so that the robot was not carried either: it slipped."""
    recording = record_floating_turns(lost_ratio, seed)
    estimates = play(recording)[500:]
    assert all(each.ok and not each.contradiction_fact for each in estimates)
    errors_m = [distance_m(recording, each) for each in estimates]
    after = [m for m, each in zip(errors_m, estimates, strict=True) if is_on_straight(each.t_s)]
    assert max(after) < 0.08
    beyond = [m > each.protection_m for m, each in zip(errors_m, estimates, strict=True)]
    assert np.mean(beyond) <= 0.02


@nightly.one_by_one("slide_mps", [-0.15, 0.1, 0.15], in_suite=1)
@nightly.one_by_one("seed", range(2), in_suite=1)
def test_a_robot_that_slides_aside_in_a_slow_turn_keeps_its_heading(
    slide_mps: float, seed: int
) -> None:
    """The velocity of the receiver points aside; the gyro knows that the robot did not turn."""

    def drive(t_s: float) -> tuple[float, float]:
        if t_s < FIRST_S:
            return 0.0, 0.0
        return (0.05, 0.2) if 13.0 < t_s < 20.0 else (0.4, 0.0)

    def slide(t_s: float) -> float:
        return slide_mps if 14.0 < t_s < 18.0 else 0.0

    recording = record(drive, 24.0, seed=seed, errors=RTK, slide_mps=slide)
    estimates = [each for each in play(recording) if each.t_s > 14.0]
    assert max(distance_m(recording, each) for each in estimates) < 0.3
    assert max(abs(error(recording, each)[2]) for each in estimates) < math.radians(5.0)
    assert all(each.ok and not each.contradiction_fact for each in estimates)


@pytest.mark.parametrize("jolt_mps", [-0.4, 0.4])
@nightly.one_by_one("seed", (0, 2, 3), in_suite=1)
def test_a_robot_that_turns_about_a_wheel_that_a_clod_holds_keeps_its_heading(
    jolt_mps: float, seed: int
) -> None:
    """It is pushed aside while its wheels spin, and jolted for a moment."""

    def drive(t_s: float) -> tuple[float, float]:
        if t_s < FIRST_S:
            return 0.0, 0.0
        return (0.3, 0.5) if 13.0 < t_s < 17.0 else (0.4, 0.0)

    def slide(t_s: float) -> float:
        if 14.6 < t_s < 15.0:
            return jolt_mps
        return jolt_mps / 2.0 if 14.0 < t_s < 16.0 else 0.0

    def grip(t_s: float) -> float:
        return 0.05 if 13.5 < t_s < 16.0 else 1.0

    recording = record(drive, 22.0, seed=seed, errors=RTK, slide_mps=slide, grip=grip)
    estimates = [each for each in play(recording) if each.t_s > 13.0]
    assert max(abs(error(recording, each)[2]) for each in estimates) < math.radians(3.0)
    assert max(distance_m(recording, each) for each in estimates) < 0.3
    assert not any(each.contradiction_fact for each in estimates)


def soft(t_s: float) -> float:
    return 0.5 if is_turning(t_s) else 1.0


@nightly.one_by_one("seed", range(3), in_suite=1)
def test_wheels_that_lose_half_their_way_in_turns_do_not_speak_against_the_fixes(seed: int) -> None:
    """The velocity of the receiver vouches for them: the next row is entered without a stop."""
    recording = record(rows, 60.0, seed=seed, grip=soft)
    estimates = play(recording)[500:]
    straight = [each for each in estimates if is_on_straight(each.t_s)]
    assert max(each.across_protection_m for each in straight) < 0.31
    assert not any(each.contradiction_fact for each in estimates)
    for each in estimates:
        assert distance_m(recording, each) < each.protection_m


@pytest.mark.parametrize("is_single", [False, True], ids=["silent", "without corrections"])
def test_a_receiver_that_falls_silent_in_a_soft_turn_vouches_for_nothing(
    *, is_single: bool
) -> None:
    recording = record(rows, 24.0, seed=2, grip=soft)
    begin_s = FIRST_S + STRAIGHT_S + 1.0
    fixes = [
        (arrival_s, msgspec.structs.replace(fix, quality=GnssQuality.SINGLE, pos_std_m=1.3))
        for arrival_s, fix in recording.fixes
    ]
    later = [each for each in fixes if each[1].t_s > begin_s] if is_single else []
    before = [each for each in recording.fixes if each[1].t_s <= begin_s]
    estimates = play(msgspec.structs.replace(recording, fixes=before + later))[500:]
    levels = {round(each.t_s, 2): each.protection_m for each in estimates}
    assert levels[begin_s + 4.0] > levels[begin_s] + 0.2
    for each in estimates:
        assert distance_m(recording, each) < each.protection_m


@nightly.one_by_one("heading_rad", [0.0, 2.0, 4.0], in_suite=1)
def test_fixes_that_creep_off_in_a_soft_turn_are_covered_until_they_are_named(
    heading_rad: float,
) -> None:
    def creep(fix: GnssFix) -> GnssFix:
        off_m = 0.1 * (fix.t_s - FIRST_S - STRAIGHT_S)
        return shifted(fix, off_m * math.cos(heading_rad), off_m * math.sin(heading_rad))

    recording = record(rows, 30.0, seed=1, grip=soft)
    faulty = with_fixes(recording, lambda t_s: t_s > FIRST_S + STRAIGHT_S, creep)
    estimates = play(faulty)[500:]
    halted = next(each for each in estimates if each.contradiction_fact)
    assert halted.t_s < FIRST_S + STRAIGHT_S + 9.0
    off = [e for e in estimates if distance_m(recording, e) > e.protection_m]
    assert len(off) <= 0.02 * len(estimates)
