"""Stamps of a board's clock on the robot's clock, and how well they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.core.messages import MagSample
from agribot.core.stamp_clock import SampleQueue, StampClock

PERIOD_S, JITTER_S, DRIFT = 0.01, 0.003, 5e-5
BEGAN_S = 812.3  # of the robot's clock, when the board's began


def run_board(clock: StampClock, seed: int, seconds: float = 3.0) -> float:
    """Note reports with delays of an exponential law; gives the error of the last capture, s."""
    rng = np.random.default_rng(seed)
    converted_s = captured_s = 0.0
    for k in range(1, round(seconds / PERIOD_S)):
        captured_s = BEGAN_S + k * PERIOD_S
        stamp_s = k * PERIOD_S * (1.0 + DRIFT)
        arrived_s = captured_s + float(rng.exponential(JITTER_S))
        clock.note_message(stamp_s, arrived_s)
        converted_s = clock.convert_to_robot_s(stamp_s, arrived_s)
    return converted_s - captured_s


def test_the_stated_uncertainty_holds_as_often_as_an_exponential_law_says() -> None:
    held = []
    for seed in range(100):
        clock = StampClock(is_of_its_own=True)
        error_s = run_board(clock, seed)
        assert abs(error_s) < 2e-3, "far below the jitter of a single report"
        assert 1e-5 < clock.uncertainty_s < 1e-3
        held.append(abs(error_s) <= 3.0 * clock.uncertainty_s)
    assert np.mean(held) >= 0.95  # exp(-3) = 5 % are beyond three mean excesses


def test_two_reports_at_least_make_an_uncertainty() -> None:
    clock = StampClock(is_of_its_own=True)
    assert clock.uncertainty_s == float("inf")
    clock.note_message(1.0, 5.0)
    assert clock.uncertainty_s == float("inf")
    clock.note_message(1.01, 5.012)
    assert clock.uncertainty_s == pytest.approx(0.001 + 2e-4)


def run_camera(clock: StampClock, seed: int, *, mean_late_s: float) -> None:
    """Note pictures at 20 Hz without stamps; every seventh is lost."""
    rng = np.random.default_rng(seed)
    for k in range(200):
        late_s = float(rng.exponential(mean_late_s))
        if k % 7:
            clock.note_message(0.0, 10.0 + 0.05 * k + late_s)


@pytest.mark.parametrize("mean_late_s", [0.0005, 0.004])
def test_without_stamps_the_uncertainty_is_how_late_arrivals_come_on_average(
    mean_late_s: float,
) -> None:
    told_s = []
    for seed in range(50):
        clock = StampClock()
        run_camera(clock, seed, mean_late_s=mean_late_s)
        told_s.append(clock.uncertainty_s)
    assert np.mean(told_s) == pytest.approx(mean_late_s, rel=0.15)
    assert max(told_s) < 2.5 * mean_late_s


def test_lines_that_come_in_heaps_are_known_to_their_period() -> None:
    clock = StampClock()
    for k in range(40):
        clock.note_message(0.0, 1.0 + 0.3 * (k // 4))
    assert 0.5 * 0.075 < clock.uncertainty_s < 2.0 * 0.075


def test_lines_that_all_come_at_once_tell_nothing_of_when_they_were_sent() -> None:
    clock = StampClock()
    for _ in range(5):
        clock.note_message(0.0, 1.0)
    assert clock.uncertainty_s == math.inf


def test_a_board_that_began_with_the_robot_is_not_taken_for_the_robots_own_clock() -> None:
    """Its clock is off by half a second, which a peer's delay might be, too."""
    own, peer = StampClock(is_of_its_own=True), StampClock()
    for k in range(1, 50):
        for clock in (own, peer):
            clock.note_message(k * PERIOD_S, 0.5 + k * PERIOD_S)
    assert own.convert_to_robot_s(0.49, 0.99) == pytest.approx(0.99)
    assert peer.convert_to_robot_s(0.49, 0.99) == pytest.approx(0.49)


def test_a_clock_that_began_anew_is_followed_at_once() -> None:
    clock = StampClock(is_of_its_own=True)
    for k in range(1, 100):
        clock.note_message(100.0 + k * PERIOD_S, k * PERIOD_S)
    clock.note_message(0.05, 1.2)
    assert clock.convert_to_robot_s(0.05, 1.2) == pytest.approx(1.2)


def test_a_clock_of_others_that_steps_back_far_is_followed_at_once() -> None:
    clock = StampClock()
    for k in range(20):
        clock.note_message(1000.0 + 0.1 * k, 50.0 + 0.1 * k)
    clock.note_message(10.0, 52.0)
    assert clock.convert_to_robot_s(10.0, 52.0) == 52.0


def test_samples_that_come_later_than_others_of_their_device_are_late_however_long_it_lasts() -> (
    None
):
    now_s = [0.0]
    states: SampleQueue[MagSample] = SampleQueue(lambda: now_s[0], is_of_its_own=True)
    readings: SampleQueue[MagSample] = SampleQueue(lambda: now_s[0], clock=states.clock)
    late_s, sample = 0.25, MagSample(t_s=0.0, field_t=(0.0, 0.0, 0.0))
    ages_s = []
    for k in range(1, 1000):
        now_s[0] = k * PERIOD_S
        states.put(50.0 + now_s[0], now_s[0], sample)
        readings.put(50.0 + now_s[0] - late_s, now_s[0], sample)
        states.take(now_s[0])
        ages_s += [now_s[0] - taken.t_s for taken in readings.take(now_s[0])]
    assert ages_s[-100:] == pytest.approx([late_s] * 100)
