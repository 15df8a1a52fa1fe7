"""Turns on soft ground: they take more of the wheels' way than the straight, and slide aside."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.messages import Estimate, GnssQuality
from tests.autonomy.estimate.noisy_rover import RTK, Recording, record, rows
from tests.autonomy.estimate.playback import error, play

STRAIGHT_S, TURN_S, FIRST_S = 12.0, math.pi / 0.6, 3.0  # of the drive `rows`


def is_turning(t_s: float) -> bool:
    return t_s > FIRST_S and (t_s - FIRST_S) % (STRAIGHT_S + TURN_S) >= STRAIGHT_S


def let_float_in_turns(recording: Recording) -> Recording:
    """Give the receiver decimetres instead of centimetres for as long as the robot turns."""
    fixes = [
        (
            arrival_s,
            msgspec.structs.replace(fix, quality=GnssQuality.RTK_FLOAT, pos_std_m=0.4)
            if is_turning(fix.t_s)
            else fix,
        )
        for arrival_s, fix in recording.fixes
    ]
    return msgspec.structs.replace(recording, fixes=fixes)


def position_error_m(recording: Recording, estimate: Estimate) -> float:
    return float(np.hypot(*error(recording, estimate)[:2]))


@pytest.mark.parametrize("lost_ratio", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_a_soft_turn_while_the_fix_floats_leaves_a_pose_that_says_how_far_off_it_is(
    lost_ratio: float, seed: int
) -> None:
    """And the fix that comes back is believed: the robot was not carried, it slipped."""

    def grip(t_s: float) -> float:
        return 1.0 - lost_ratio if is_turning(t_s) else 1.0

    recording = let_float_in_turns(record(rows, 40.0, seed=seed, grip=grip))
    estimates = play(recording)[500:]
    ratios = [position_error_m(recording, each) / each.pos_std_m for each in estimates]
    assert max(ratios) < 3.5
    assert all(each.ok and not each.contradiction for each in estimates)


@pytest.mark.parametrize("slide_mps", [-0.15, 0.1, 0.15])
@pytest.mark.parametrize("seed", range(2))
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
    assert max(position_error_m(recording, each) for each in estimates) < 0.15
    assert max(abs(error(recording, each)[2]) for each in estimates) < math.radians(5.0)
    assert all(each.ok and not each.contradiction for each in estimates)
