"""The formulas of the filter: motion, velocity of an antenna, and their derivatives."""

from __future__ import annotations

import math

# Receivers understate their velocity noise, and wheels do not measure all of the motion.
VELOCITY_FACTOR = 1.4
VELOCITY_FLOOR_MPS = 0.02
# Ratio of learnt to stated noise that is not chance: what is learnt scatters by a third.
SURE_NOISE_RATIO = 1.5
# Far less than any step of the wheels.
NO_STEP_M2 = 1e-18
# Skidding moves the centre of the turn off the middle, for as long as the turn lasts.
TURN_CENTRE_STD_M, TURN_MEMORY_S = 0.03, 2.0


def motion(
    middle_rad: float,
    row_yaw_rad: float,
    wheel_scale: float,
    slip: float,
    distance_m: float,
    turn_rad: float,
    turn_s: float,
) -> tuple[float, float, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Move the body's centre in the map by a step with the yaw `middle_rad` on average.

    `turn_rad` is the step's turn by the gyro without its bias, and `turn_s` minus the derivative
    of the true turn by the bias.
    Returns: dx, dy, and their derivatives by yaw, gyro bias, wheel scale, slip and gyro scale.
    """
    cos, sin = math.cos(middle_rad), math.sin(middle_rad)
    kept_ratio = 1.0 - wheel_scale
    across_rad = middle_rad - row_yaw_rad
    slip_m = abs(distance_m) * math.cos(across_rad)
    left_m = slip * slip_m
    lost_m = slip * abs(distance_m) * math.sin(across_rad)  # left per yaw, negative
    raw_x_m = distance_m * cos - left_m * sin
    raw_y_m = distance_m * sin + left_m * cos
    dx_m, dy_m = kept_ratio * raw_x_m, kept_ratio * raw_y_m
    x_yaw, y_yaw = kept_ratio * lost_m * sin - dy_m, dx_m - kept_ratio * lost_m * cos
    half_s, half_rad, kept_slip_m = turn_s / 2.0, turn_rad / 2.0, kept_ratio * slip_m
    return dx_m, dy_m, (
        (x_yaw, -x_yaw * half_s, -raw_x_m, -kept_slip_m * sin, -x_yaw * half_rad),
        (y_yaw, -y_yaw * half_s, -raw_y_m, kept_slip_m * cos, -y_yaw * half_rad),
    )  # fmt: skip


def walk_across(
    dx_m: float, dy_m: float, distance_m: float, noise_m2_per_m: float
) -> tuple[float, float, float]:
    """Work out the covariance xx, yy, xy that a walk to the side adds on a step."""
    share = noise_m2_per_m * abs(distance_m) / (dx_m * dx_m + dy_m * dy_m + NO_STEP_M2)
    return share * dy_m * dy_m, share * dx_m * dx_m, -share * dx_m * dy_m


def antenna_velocity(
    yaw_rad: float,
    row_yaw_rad: float,
    wheel_scale: float,
    slip: float,
    wheel_mps: float,
    rate_radps: float,
    lever_m: tuple[float, float],
) -> tuple[float, float, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Predict the velocity of an antenna, east and north; and derivatives by yaw, scale, slip."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    forward_mps = wheel_mps * (1.0 - wheel_scale)
    slip_mps = abs(forward_mps) * math.cos(yaw_rad - row_yaw_rad)
    ahead_mps = forward_mps - rate_radps * lever_m[1]
    left_mps = slip * slip_mps + rate_radps * lever_m[0]
    east_mps, north_mps = cos * ahead_mps - sin * left_mps, sin * ahead_mps + cos * left_mps
    return east_mps, north_mps, (
        (-north_mps, -wheel_mps * cos, -slip_mps * sin),
        (east_mps, -wheel_mps * sin, slip_mps * cos),
    )  # fmt: skip


def velocity_variance(
    stated_mps: float,
    learnt_mps: float,
    rate_radps: float,
    since_last_s: float,
) -> float:
    """Work out the variance of one axis of a velocity: as stated, unless it is surely more.

    Innovation-based estimation of noise: Mehra 1970, "On the identification of variances and
    adaptive Kalman filtering", IEEE Transactions on Automatic Control 15(2).
    """
    is_more = learnt_mps > SURE_NOISE_RATIO * stated_mps
    white_mps = VELOCITY_FACTOR * (learnt_mps if is_more else stated_mps)
    lasting_m2ps2 = (TURN_CENTRE_STD_M * rate_radps) ** 2 * repeats(TURN_MEMORY_S, since_last_s)
    return white_mps**2 + VELOCITY_FLOOR_MPS**2 + lasting_m2ps2


def repeats(memory_s: float, since_last_s: float) -> float:
    """Count the epochs that share one error that lasts; their noise has to count that often."""
    return max(2.0 * memory_s / max(since_last_s, 0.01), 1.0)


def pair_distance2(r0: float, r1: float, total_0: float, total_1: float, cross: float) -> float:
    """Work out the squared Mahalanobis length of two residuals."""
    return (total_1 * r0 * r0 - 2.0 * cross * r0 * r1 + total_0 * r1 * r1) / (
        total_0 * total_1 - cross * cross
    )
