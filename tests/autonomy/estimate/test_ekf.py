"""The filter's algebra against the textbook formulas written with full matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.ekf import (
    GNSS_BIAS_X,
    GNSS_BIAS_Y,
    GYRO_BIAS,
    GYRO_SCALE,
    MAG_BIAS,
    SLIP,
    STATES,
    WAY_X,
    WHEEL_SCALE,
    YAW,
    Ekf,
    MotionNoise,
    Row,
    X,
    Y,
)
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.core.messages import FloatArray

NO_NOISE = MotionNoise(
    along_m2_per_m=0.0, across_m2_per_m=0.0, position_m2_per_rad=0.0, yaw_rad2_per_s=0.0
)
SOME_NOISE = MotionNoise(
    along_m2_per_m=1e-3, across_m2_per_m=3e-3, position_m2_per_rad=2e-3, yaw_rad2_per_s=1e-5
)


def filter_with(rng: np.random.Generator, state: list[float]) -> Ekf:
    """A filter with a full random covariance."""
    ekf = Ekf([1.0] * STATES, row_yaw_rad=0.4)
    ekf.x = list(state)
    root = rng.standard_normal((STATES, STATES)) * 0.1
    ekf.cov[:] = root @ root.T + 0.01 * np.eye(STATES)
    return ekf


def dense(row: Row) -> FloatArray:
    h = np.zeros(STATES)
    for state, weight in row:
        h[state] = weight
    return h


STATE = [3.0, -2.0, 0.7, 0.01, 0.04, 0.03, 0.02, 0.5, -0.4, 0.1, 0.02, 0.03, 0.01, -0.02]


def test_prediction_equals_numerical_jacobian_times_covariance() -> None:
    ekf = filter_with(np.random.default_rng(1), STATE)
    before = ekf.cov.copy()
    distance_m, turn_rad, dt_s = 0.05, 0.08, 0.1

    def moved(state: list[float]) -> FloatArray:
        other = Ekf([1.0] * STATES, row_yaw_rad=0.4)
        other.x = list(state)
        other.predict(distance_m, turn_rad, dt_s, NO_NOISE)
        return np.array(other.x)

    jacobian = np.zeros((STATES, STATES))
    for column in range(STATES):
        step = np.zeros(STATES)
        step[column] = 1e-6
        up, down = (
            moved((np.array(STATE) + step).tolist()),
            moved((np.array(STATE) - step).tolist()),
        )
        jacobian[:, column] = (up - down) / 2e-6
    ekf.predict(distance_m, turn_rad, dt_s, NO_NOISE)
    np.testing.assert_allclose(ekf.cov, jacobian @ before @ jacobian.T, atol=1e-9)


def test_scalar_update_equals_the_textbook() -> None:
    ekf = filter_with(np.random.default_rng(2), STATE)
    before, x = ekf.cov.copy(), np.array(ekf.x)
    row = ((X, 1.0), (YAW, -0.3), (GNSS_BIAS_X, 1.0))
    h = dense(row)
    s = h @ before @ h + 0.04
    gain = before @ h / s
    distance2 = ekf.update(row, 0.2, 0.04)
    np.testing.assert_allclose(ekf.x, x + gain * 0.2, atol=1e-12)
    np.testing.assert_allclose(ekf.cov, before - np.outer(gain, gain) * s, atol=1e-12)
    assert distance2 == pytest.approx(0.2**2 / s)
    np.testing.assert_array_equal(ekf.cov, ekf.cov.T)


def test_pair_update_equals_one_two_dimensional_update() -> None:
    ekf = filter_with(np.random.default_rng(3), STATE)
    before, x = ekf.cov.copy(), np.array(ekf.x)
    rows = (((X, 1.0), (YAW, -0.3)), ((Y, 1.0), (YAW, 0.5), (GNSS_BIAS_Y, 1.0)))
    h = np.array([dense(row) for row in rows])
    s = h @ before @ h.T + 0.04 * np.eye(2)
    gain = before @ h.T @ np.linalg.inv(s)
    residual = np.array([0.2, -0.1])
    distance2 = ekf.update_pair(rows, (0.2, -0.1), 0.04)
    np.testing.assert_allclose(ekf.x, x + gain @ residual, atol=1e-12)
    np.testing.assert_allclose(ekf.cov, before - gain @ s @ gain.T, atol=1e-12)
    assert distance2 == pytest.approx(residual @ np.linalg.solve(s, residual))


def test_gated_update_leaves_the_filter_untouched() -> None:
    ekf = filter_with(np.random.default_rng(4), STATE)
    before, x = ekf.cov.copy(), list(ekf.x)
    assert ekf.update(((X, 1.0),), 10.0, 0.01, gate=16.0) > 16.0
    assert ekf.update_pair((((X, 1.0),), ((Y, 1.0),)), (10.0, 0.0), 0.01, gate=16.0) > 16.0
    assert ekf.x == x
    np.testing.assert_array_equal(ekf.cov, before)


def test_covariance_stays_positive_after_thousands_of_mixed_steps() -> None:
    rng = np.random.default_rng(5)
    std = [1e3, 1e3, 3.0, 0.01, 0.03, 0.03, 0.01, 1.0, 1.0, 0.1, 0.01, 0.03, 0.1, 0.1]
    ekf = Ekf(std, row_yaw_rad=0.0)
    for k in range(3000):
        ekf.predict(0.004, float(rng.normal(0.0, 0.01)), 0.01, SOME_NOISE)
        if k % 10 == 0:
            rows = (((X, 1.0), (GNSS_BIAS_X, 1.0)), ((Y, 1.0), (GNSS_BIAS_Y, 1.0)))
            ekf.update_pair(rows, (float(rng.normal()), float(rng.normal())), 1e-4)
            ekf.update(((YAW, 1.0), (MAG_BIAS, 1.0)), float(rng.normal(0.0, 0.1)), 0.01)
    assert np.linalg.eigvalsh(ekf.cov).min() > 0.0
    np.testing.assert_allclose(ekf.cov, ekf.cov.T, atol=1e-12)


def test_process_noise_does_not_depend_on_the_rate() -> None:
    grown = []
    for pieces in (10, 1000):
        ekf = Ekf([0.0] * STATES, row_yaw_rad=0.0)
        for _ in range(pieces):
            ekf.predict(4.0 / pieces, 0.0, 10.0 / pieces, SOME_NOISE)
        grown.append(np.diag(ekf.cov)[:3])
    # Along the way exactly; across it the yaw noise adds up as a sum instead of an integral.
    np.testing.assert_allclose(grown[0][[0, 2]], grown[1][[0, 2]], rtol=1e-9)
    np.testing.assert_allclose(grown[0][1], grown[1][1], rtol=0.02)


def test_a_robot_is_pushed_aside_more_than_its_wheels_miscount() -> None:
    ekf = Ekf([0.0] * STATES, row_yaw_rad=0.0)
    ekf.x[YAW] = 0.7
    for _ in range(100):
        ekf.predict(0.04, 0.0, 0.1, SOME_NOISE)
    body_from_map = np.array([[math.cos(0.7), math.sin(0.7)], [-math.sin(0.7), math.cos(0.7)]])
    ekf_m2 = body_from_map @ ekf.cov[:2, :2] @ body_from_map.T
    assert ekf_m2[0, 0] == pytest.approx(4.0 * SOME_NOISE.along_m2_per_m)
    assert ekf_m2[1, 1] > 4.0 * SOME_NOISE.across_m2_per_m
    assert ekf_m2[0, 1] == pytest.approx(0.0, abs=1e-9)


def test_a_turn_that_is_seen_from_outside_shows_how_far_off_the_gyro_counts() -> None:
    """Two percent too much, with one percent expected; turns to and fro alone show nothing."""
    ekf = Ekf([0.0] * 6 + [0.01] + [0.0] * 4, row_yaw_rad=0.0)
    for turn_rad in (0.3, -0.3) * 20:
        ekf.predict(0.0, 1.02 * turn_rad, 1.0, NO_NOISE)
    assert ekf.cov[YAW, YAW] == pytest.approx(0.0, abs=1e-12)
    for _ in range(10):
        ekf.predict(0.0, 1.02 * 0.3, 1.0, NO_NOISE)
    assert math.sqrt(ekf.cov[YAW, YAW]) == pytest.approx(0.03, rel=0.1)
    ekf.update(((YAW, 1.0),), 3.0 - ekf.x[YAW], 1e-6)
    assert ekf.x[GYRO_SCALE] == pytest.approx(0.02, abs=0.001)
    assert ekf.predict(0.0, 1.02, 1.0, NO_NOISE)[2] == pytest.approx(1.0, abs=0.002)


def test_slip_pushes_to_the_same_side_of_the_field_in_both_directions_and_in_reverse() -> None:
    for yaw_rad, distance_m in ((0.0, 1.0), (math.pi, 1.0), (0.0, -1.0)):
        ekf = Ekf([0.1] * STATES, row_yaw_rad=0.0)
        ekf.x[YAW], ekf.x[SLIP] = yaw_rad, 0.05
        ekf.predict(distance_m, 0.0, 1.0, NO_NOISE)
        assert ekf.x[Y] == pytest.approx(0.05)


def test_bias_and_scale_are_taken_out_of_the_motion() -> None:
    ekf = Ekf([0.1] * STATES, row_yaw_rad=0.0)
    ekf.x[GYRO_BIAS], ekf.x[WHEEL_SCALE] = 0.02, 0.1
    assert ekf.predict(1.0, 0.02 * 0.5, 0.5, NO_NOISE) == pytest.approx((0.9, 0.0, 0.0))


def test_a_way_that_is_doubted_and_then_told_moves_the_position_as_much() -> None:
    """The position takes nearly all of a way that is off by 10 cm and stated to 1 cm."""
    ekf = Ekf([0.02] * WAY_X, row_yaw_rad=0.0)
    ekf.doubt_way(0.3**2)
    ekf.update(((WAY_X, 1.0),), 0.1, 0.01**2)
    ekf.forget_way()
    assert ekf.x[X] == pytest.approx(0.1, abs=0.001) and ekf.x[Y] == 0.0
    assert ekf.cov[X, X] == pytest.approx(0.02**2 + 0.01**2, rel=0.01)
    assert ekf.cov[Y, Y] == pytest.approx(0.02**2 + 0.3**2)
    assert ekf.x[WAY_X] == 0.0 and not ekf.cov[WAY_X].any()


def test_reset_forgets_value_and_correlations() -> None:
    ekf = filter_with(np.random.default_rng(6), STATE)
    ekf.reset(YAW, 1.0, 0.25)
    assert ekf.x[YAW] == 1.0
    expected = np.zeros(STATES)
    expected[YAW] = 0.25
    np.testing.assert_array_equal(ekf.cov[YAW], expected)
    np.testing.assert_array_equal(ekf.cov[:, YAW], expected)


def test_gate_opens_after_a_run_of_rejections_and_only_then() -> None:
    gate = Gate(sigma=4.0, recover_after=3)
    assert [gate.evaluate(d2) for d2 in (15.9, 17.0, 17.0, 1.0)] == [
        "accept", "reject", "reject", "accept",
    ]  # fmt: skip
    assert [gate.evaluate(99.0) for _ in range(4)] == ["reject", "reject", "recover", "reject"]


def test_gate_rejects_what_is_not_a_number() -> None:
    assert Gate(sigma=4.0, recover_after=3).evaluate(math.nan) == "reject"
