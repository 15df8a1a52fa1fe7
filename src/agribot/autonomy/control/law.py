"""The control law: state feedback in distance, and the speed that errors leave."""

from __future__ import annotations

import math

DAMPING = 0.9
MIN_FREQUENCY_RADPS = 0.25
MAX_FREQUENCY_RADPS = 2.0  # the delay of the drive allows no faster poles
MAX_ERROR_M = 0.4  # error from which on the approach angle stays the same

USUAL_ERROR_M = 0.04  # error that is no reason to slow down
# Beyond it the robot slows down and returns in a distance shorter by at most this factor.
SLOWING_M, HASTE_M, MAX_HASTE = 0.3, 0.1, 1.6


def offset(dx_m: float, dy_m: float, yaw_rad: float) -> tuple[float, float]:
    """Resolve an offset along and to the left of a direction."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m


def ahead(
    pose: tuple[float, float, float],
    v_mps: float,
    yaw_rate_radps: float,
    slip_rad: float,
    delay_s: float,
) -> tuple[float, float, float]:
    """Predict the pose that the robot reaches before a new command takes effect."""
    x_m, y_m, yaw_rad = pose
    turned_rad = yaw_rate_radps * delay_s
    course_rad = yaw_rad + slip_rad + turned_rad / 2.0
    driven_m = v_mps * delay_s
    return (
        x_m + driven_m * math.cos(course_rad),
        y_m + driven_m * math.sin(course_rad),
        yaw_rad + turned_rad,
    )


def caution(cross_track_m: float, heading_rad: float) -> float:
    """Say which part of the speed is left beside the line or looking elsewhere."""
    beside = max(1.0 - _unusual_m(cross_track_m) / SLOWING_M, 0.25)
    return beside * max(math.cos(min(1.5, 1.2 * abs(heading_rad))), 0.15)


def _unusual_m(cross_track_m: float) -> float:
    return max(0.0, abs(cross_track_m) - USUAL_ERROR_M)


def steer(
    errors: tuple[float, float, float],
    slip_rad: float,
    max_speed_mps: float,
    yaw_gain_ratio: float,
    length_m: float,
    max_yaw_rate_radps: float,
) -> tuple[float, float]:
    """Steer by `errors`: cross-track (left positive), heading, path curvature.

    `max_speed_mps` must be above zero.
    """
    cross_track_m, heading_rad, curvature_radpm = errors
    v_mps = max_speed_mps * caution(cross_track_m, heading_rad)
    haste = min(MAX_HASTE, 1.0 + _unusual_m(cross_track_m) / HASTE_M)
    frequency = haste * v_mps / length_m
    frequency = min(MAX_FREQUENCY_RADPS, max(MIN_FREQUENCY_RADPS, frequency))
    # The approach angle of an error that is clipped stays the same.
    error_m = clamp(cross_track_m, MAX_ERROR_M / haste)
    stretch = max(1.0 - curvature_radpm * error_m, 0.3)
    yaw_rate = curvature_radpm * v_mps * math.cos(heading_rad) / stretch
    yaw_rate = yaw_rate - 2.0 * DAMPING * frequency * (heading_rad + slip_rad)
    yaw_rate = yaw_rate - frequency * frequency / v_mps * error_m
    yaw_rate = yaw_rate / yaw_gain_ratio
    fits = max(max_yaw_rate_radps / max(1e-9, abs(yaw_rate)), 0.3)
    if abs(yaw_rate) > max_yaw_rate_radps:
        v_mps *= fits
    return v_mps, clamp(yaw_rate, max_yaw_rate_radps)


def clamp(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))


def ramp(wanted: float, last: float, step: float) -> float:
    return min(last + step, max(last - step, wanted))
