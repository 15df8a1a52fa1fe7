"""The GNSS-free heading filter: steady on white noise, prompt in a turn, blind to 180 degrees."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.heading import HeadingFilter, circular_median
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray

PERIOD_S = 0.2
RAW_STD_RAD = math.radians(16.0)


def errors_rad(yaw_rad: float, rate_radps: float, seed: int, count: int = 600) -> FloatArray:
    """Filter error at 5 Hz, a compass of 16 degrees, a turn at a constant rate."""
    rng = np.random.default_rng(seed)
    heading = HeadingFilter()
    errors = []
    for k in range(count):
        true_rad = yaw_rad + rate_radps * k * PERIOD_S
        raw_rad = wrap_rad(true_rad + RAW_STD_RAD * float(rng.standard_normal()))
        rate = rate_radps + 0.002 * float(rng.standard_normal())
        errors.append(wrap_rad(heading.update(k * PERIOD_S, raw_rad, rate) - true_rad))
    return np.array(errors)


def test_median_ignores_an_outlier_and_the_seam_at_180_degrees() -> None:
    near = [math.radians(d) for d in (178, -179, 179, -178, 20, 180, -177)]
    assert abs(wrap_rad(circular_median(near) - math.pi)) < math.radians(1.5)


def test_median_turns_with_its_samples() -> None:
    samples = np.random.default_rng(0).normal(0.0, 0.3, 7).tolist()
    for turn_rad in np.linspace(-7.0, 7.0, 15).tolist():
        turned = circular_median([wrap_rad(s + turn_rad) for s in samples])
        assert wrap_rad(turned - circular_median(samples) - turn_rad) == pytest.approx(0, abs=1e-12)


def test_sixteen_degrees_of_white_noise_become_less_than_one_and_a_half() -> None:
    settled = np.concatenate([errors_rad(0.3, 0.0, seed)[300:] for seed in range(10)])
    assert math.degrees(float(np.sqrt(np.mean(settled**2)))) < 1.5


def test_lag_in_a_turn_of_half_a_radian_per_second_is_below_five_degrees() -> None:
    late = np.concatenate([errors_rad(0.0, 0.5, seed)[150:] for seed in range(5)])
    assert abs(math.degrees(float(np.mean(late)))) < 1.0
    assert math.degrees(float(np.max(np.abs(late)))) < 5.0


def test_error_at_180_degrees_equals_error_at_zero() -> None:
    for seed in range(3):
        north, south = errors_rad(0.0, 0.0, seed), errors_rad(math.pi, 0.0, seed)
        np.testing.assert_allclose(north, south, atol=1e-9)


def test_samples_that_are_not_finite_or_not_new_change_nothing() -> None:
    heading = HeadingFilter()
    heading.update(0.0, 0.5, 0.0)
    for t_s, raw_rad in ((0.2, math.nan), (0.0, 3.0), (-1.0, 3.0), (math.inf, 3.0)):
        assert heading.update(t_s, raw_rad, 0.0) == 0.5
    assert heading.update(0.4, 0.5, 0.0) == pytest.approx(0.5)
