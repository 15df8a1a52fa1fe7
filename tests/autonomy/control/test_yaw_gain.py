from __future__ import annotations

import math

import pytest

from agribot.autonomy.control.yaw_gain import HIGHEST_RATIO, LOWEST_RATIO, YawGain


def taught(true_ratio: float, seconds: float, speed_mps: float = 0.3) -> YawGain:
    gain, answer = YawGain(0.2), 0.0
    for _ in range(int(seconds / 0.02)):
        answer += (0.6 * true_ratio - answer) * 0.02 / 0.22
        gain.learn(0.3, 0.6, speed_mps, answer, 0.02)
    return gain


def test_before_any_turn_commands_are_taken_at_their_word() -> None:
    assert YawGain(0.2).ratio == 1.0


@pytest.mark.parametrize("true_ratio", [0.6, 0.9, 1.3])
def test_one_turn_teaches_what_the_soil_lets_through(true_ratio: float) -> None:
    assert taught(true_ratio, 5.0).ratio == pytest.approx(true_ratio, abs=0.02)


def test_a_ratio_beyond_belief_is_bounded() -> None:
    assert taught(0.0, 20.0).ratio == LOWEST_RATIO
    assert taught(5.0, 20.0).ratio == HIGHEST_RATIO


def test_a_robot_that_is_held_back_teaches_nothing() -> None:
    assert taught(0.0, 20.0, speed_mps=0.0).ratio == 1.0


def test_a_gyro_that_reports_no_number_teaches_nothing() -> None:
    gain = YawGain(0.2)
    for _ in range(100):
        gain.learn(0.3, 0.6, 0.3, math.nan, 0.02)
    assert gain.ratio == 1.0
