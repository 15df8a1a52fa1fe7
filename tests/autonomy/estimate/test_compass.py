from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.autonomy.estimate.sensors.compass import NoiseMeter, yaw_from_field
from agribot.core.geo import rotation_from_rpy, wrap_rad

UP = (0.0, 0.0, 1.0)
angles = st.floats(-math.pi, math.pi)
tilts = st.floats(-0.5, 0.5)


def body_field(
    yaw: float, roll: float, pitch: float, declination: float = 0.0
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Field and vertical in body axes; 38 uT towards magnetic North, 23 uT into the ground."""
    map_from_body = rotation_from_rpy(roll, pitch, yaw)
    field_enu = np.array([3.8e-5 * math.sin(declination), 3.8e-5 * math.cos(declination), -2.3e-5])
    fx, fy, fz = (map_from_body.T @ field_enu).tolist()
    ux, uy, uz = (map_from_body.T @ [0.0, 0.0, 1.0]).tolist()
    return (fx, fy, fz), (ux, uy, uz)


@given(yaw=angles, roll=tilts, pitch=tilts, declination=st.floats(-0.5, 0.5))
def test_heading_is_right_on_any_slope_and_with_any_declination(
    yaw: float, roll: float, pitch: float, declination: float
) -> None:
    field_t, up = body_field(yaw, roll, pitch, declination)
    found = yaw_from_field(field_t, up, declination)
    assert found is not None
    assert wrap_rad(found - yaw) == pytest.approx(0.0, abs=1e-9)


def test_facing_north_the_field_is_ahead_and_facing_east_it_is_left() -> None:
    assert yaw_from_field((1.0, 0.0, 0.0), UP, 0.0) == pytest.approx(math.pi / 2)
    assert yaw_from_field((0.0, 1.0, 0.0), UP, 0.0) == pytest.approx(0.0)


def test_a_needle_east_of_north_means_the_robot_looks_further_east() -> None:
    assert yaw_from_field((1.0, 0.0, 0.0), UP, 0.1) == pytest.approx(math.pi / 2 - 0.1)


@pytest.mark.parametrize("field_t", [(0.0, 0.0, -4e-5), (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)])
def test_a_field_without_horizontal_part_has_no_heading(
    field_t: tuple[float, float, float],
) -> None:
    assert yaw_from_field(field_t, UP, 0.0) is None


def test_noise_is_measured_whatever_the_heading_and_its_slow_bias_do() -> None:
    rng = np.random.default_rng(0)
    stds = []
    for _ in range(20):
        meter = NoiseMeter(floor_std_rad=0.07)
        for k in range(60):
            meter.add(wrap_rad(3.0 + 0.002 * k + 0.28 * float(rng.standard_normal())))
        stds.append(math.sqrt(meter.variance))
    assert 0.22 < float(np.mean(stds)) < 0.32


def test_a_clean_compass_is_not_believed_more_than_the_configuration_does() -> None:
    meter = NoiseMeter(floor_std_rad=0.07)
    for k in range(60):
        meter.add(0.001 * k)
    assert math.sqrt(meter.variance) == pytest.approx(0.07)
