"""The control law, for one robot or for many (see agribot.core.arithmetic)."""

from __future__ import annotations

from agribot.core.arithmetic import Arithmetic, Number

DAMPING = 0.9
MIN_FREQUENCY_RADPS = 0.25
MAX_FREQUENCY_RADPS = 2.0  # the delay of the drive allows no faster poles
MAX_ERROR_M = 0.4  # farther off, the approach angle stays the same

USUAL_ERROR_M = 0.04  # no reason to slow down
# Beyond it the robot slows down and comes back in a shorter distance, up to so much shorter.
SLOWING_M, HASTE_M, MAX_HASTE = 0.3, 0.1, 1.6


def offset(
    m: Arithmetic[Number], dx_m: Number, dy_m: Number, yaw_rad: Number
) -> tuple[Number, Number]:
    """Resolve an offset along and to the left of a direction."""
    cos, sin = m.cos(yaw_rad), m.sin(yaw_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m


def ahead(
    m: Arithmetic[Number],
    pose: tuple[Number, Number, Number],
    v_mps: Number,
    yaw_rate_radps: Number,
    slip_rad: Number,
    delay_s: float,
) -> tuple[Number, Number, Number]:
    """Predict the pose that the robot reaches before a new command takes effect."""
    x_m, y_m, yaw_rad = pose
    turned_rad = yaw_rate_radps * delay_s
    course_rad = yaw_rad + slip_rad + turned_rad / 2.0
    driven_m = v_mps * delay_s
    return (
        x_m + driven_m * m.cos(course_rad),
        y_m + driven_m * m.sin(course_rad),
        yaw_rad + turned_rad,
    )


def caution(m: Arithmetic[Number], cross_track_m: Number, heading_rad: Number) -> Number:
    """Say which part of the speed is left beside the line or looking elsewhere."""
    beside = m.most(0.25, 1.0 - _unusual_m(m, cross_track_m) / SLOWING_M)
    return beside * m.most(0.15, m.cos(m.least(1.2 * abs(heading_rad), 1.5)))


def _unusual_m(m: Arithmetic[Number], cross_track_m: Number) -> Number:
    return m.most(abs(cross_track_m) - USUAL_ERROR_M, 0.0)


def steer(
    m: Arithmetic[Number],
    errors: tuple[Number, Number, Number],
    slip_rad: Number,
    max_speed_mps: Number,
    yaw_gain_ratio: Number,
    length_m: float,
    max_yaw_rate_radps: float,
) -> tuple[Number, Number]:
    """Steer by `errors`: cross-track (left positive), heading, path curvature.

    `max_speed_mps` must be above zero.
    """
    cross_track_m, heading_rad, curvature_radpm = errors
    v_mps = max_speed_mps * caution(m, cross_track_m, heading_rad)
    haste = m.least(1.0 + _unusual_m(m, cross_track_m) / HASTE_M, MAX_HASTE)
    frequency = haste * v_mps / length_m
    frequency = m.least(m.most(frequency, MIN_FREQUENCY_RADPS), MAX_FREQUENCY_RADPS)
    # The approach angle of an error that is clipped stays the same.
    error_m = clamp(m, cross_track_m, MAX_ERROR_M / haste)
    stretch = m.most(0.3, 1.0 - curvature_radpm * error_m)
    yaw_rate = curvature_radpm * v_mps * m.cos(heading_rad) / stretch
    yaw_rate = yaw_rate - 2.0 * DAMPING * frequency * (heading_rad + slip_rad)
    yaw_rate = yaw_rate - frequency * frequency / v_mps * error_m
    yaw_rate = yaw_rate / yaw_gain_ratio
    fits = m.most(0.3, max_yaw_rate_radps / m.most(abs(yaw_rate), 1e-9))
    v_mps = m.choose(abs(yaw_rate) > max_yaw_rate_radps, v_mps * fits, v_mps)
    return v_mps, clamp(m, yaw_rate, max_yaw_rate_radps)


def clamp(m: Arithmetic[Number], value: Number, limit: Number | float) -> Number:
    return m.least(m.most(value, -limit), limit)


def ramp(m: Arithmetic[Number], wanted: Number, last: Number, step: float) -> Number:
    return m.least(m.most(wanted, last - step), last + step)
