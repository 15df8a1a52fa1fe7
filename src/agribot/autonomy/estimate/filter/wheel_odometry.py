"""Odometry from the wheel encoders alone: a pose that drifts, and how far it may have drifted."""

from __future__ import annotations

import math

import msgspec

from agribot.autonomy.estimate.filter.odometry import MAX_WHEEL_FACTOR, MAX_WHEEL_SLACK_RAD
from agribot.autonomy.estimate.filter.sensor_ranges import LEAST_STEP_S, MAX_READING
from agribot.core.config import EstimateConfig
from agribot.core.messages import WheelSample
from agribot.core.robot import DriveSpec

# 1 sigma of the way that wheels lose on soil that was not measured. Simulated, the worlds of
# `sim.preset` "field" cost 5 to 8 % straight ahead, those of "hard" 20 to 27 %.
SLIP_STD_RATIO = 0.1
# 1 sigma of the turn lost: 6 to 9 % in "field", about 30 % in "hard".
TURN_STD_RATIO = 0.2
# Way lost in turns besides, 1 sigma, m/rad: a turning robot digs in.
TURN_LOSS_STD_M_PER_RAD = 0.1
# 1 sigma of what a turn moves the centre of the robot, m per square root of radian.
TURN_SLIDE_M_PER_SQRT_RAD = 0.05

Triple = tuple[float, float, float]
Four = tuple[float, float, float, float]


class OdometryReading(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Pose of the body in the frame `odom`, and its twist.

    `pose_cov` is the 3x3 covariance of x, y and yaw by rows; it grows with every metre and radian.
    `twist_var` are the variances of forward speed, sideways speed and yaw rate; the wheels measure
    no sideways speed, its variance is that of crabbing.
    """

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    pose_cov: tuple[float, ...]
    v_mps: float
    yaw_rate_radps: float
    twist_var: Triple


class WheelOdometry:
    """Integrates encoder readings from the place and heading of the first one.

    The error has two parts. Four numbers are unknown but constant: the scale of the way (wheel
    radius and slip), that of the turn, the crab angle and the way lost in turns; their errors add
    up along the way (`_gains`, the derivatives of the pose by them). The rest is a random walk of
    each side of wheels (`_walk`, its covariance).
    """

    def __init__(self, drive: DriveSpec, config: EstimateConfig | None = None) -> None:
        believed = EstimateConfig() if config is None else config
        self._drive = drive
        scale_std_ratio = math.hypot(believed.wheel_scale_std_ratio, SLIP_STD_RATIO)
        self._stds: Four = (
            scale_std_ratio, TURN_STD_RATIO, believed.slip_std_rad, TURN_LOSS_STD_M_PER_RAD,
        )  # fmt: skip
        self._walk_m2_per_m = believed.position_walk_m_per_sqrt_m**2
        tick_m = math.tau * drive.wheel_radius_m / (drive.encoder_ticks_per_rev * drive.gear_ratio)
        self._tick_m2 = tick_m**2 / 6.0  # variance of the difference of two rounded readings
        left, right = drive.wheel_speeds_radps(drive.max_speed_mps, drive.max_yaw_rate_radps)
        self._max_radps = MAX_WHEEL_FACTOR * max(abs(left), abs(right))
        self._last: WheelSample | None = None
        self._pose: Triple = (0.0, 0.0, 0.0)
        self._walk = _Walk()
        self._gains: list[Triple] = [(0.0, 0.0, 0.0)] * 4

    def update(self, sample: WheelSample) -> OdometryReading | None:
        """Move on to an encoder reading; None for one that is late, repeated or not finite."""
        numbers = sample.angle_rad + sample.speed_radps
        if not (math.isfinite(sample.t_s) and sum(map(abs, numbers)) < MAX_READING):
            return None
        last, self._last = self._last, sample
        if last is None:
            return self._read(sample.t_s, 0.0, 0.0, 0.0, math.inf)
        if sample.t_s <= last.t_s + LEAST_STEP_S:
            self._last = last
            return None
        return self._step(last, sample)

    def _step(self, last: WheelSample, sample: WheelSample) -> OdometryReading:
        dt_s = sample.t_s - last.t_s
        rear_right, rear_left, front_right, front_left = (
            self._drive.wheel_radius_m * self._find_turn_rad(before, after, speed, dt_s)
            for before, after, speed in zip(
                last.angle_rad, sample.angle_rad, sample.speed_radps, strict=True
            )
        )
        right_m, left_m = (rear_right + front_right) / 2.0, (rear_left + front_left) / 2.0
        distance_m = (right_m + left_m) / 2.0
        turn_rad = (right_m - left_m) / self._drive.effective_separation_m
        way_m = (abs(right_m) + abs(left_m)) / 2.0
        self._move(distance_m, turn_rad, way_m)
        return self._read(sample.t_s, distance_m / dt_s, turn_rad / dt_s, way_m, dt_s)

    def _find_turn_rad(self, before: float, after: float, speed: float, dt_s: float) -> float:
        """Find the turn of one wheel, by its speed where the encoder restarted from zero."""
        turned_rad = after - before
        if abs(turned_rad) > self._max_radps * dt_s + MAX_WHEEL_SLACK_RAD:
            return speed * dt_s
        return turned_rad

    def _move(self, distance_m: float, turn_rad: float, way_m: float) -> None:
        x_m, y_m, yaw_rad = self._pose
        middle_rad = yaw_rad + turn_rad / 2.0
        dx_m, dy_m = distance_m * math.cos(middle_rad), distance_m * math.sin(middle_rad)
        self._pose = (x_m + dx_m, y_m + dy_m, yaw_rad + turn_rad)
        half_x_m, half_y_m = -dy_m * turn_rad / 2.0, dx_m * turn_rad / 2.0
        lost = math.copysign(abs(turn_rad), distance_m) if distance_m else 0.0
        by_parameter = (
            (dx_m, dy_m, 0.0),
            (half_x_m, half_y_m, turn_rad),
            (-dy_m, dx_m, 0.0),
            (lost * math.cos(middle_rad), lost * math.sin(middle_rad), 0.0),
        )
        self._gains = [
            (gx - dy_m * gyaw + px, gy + dx_m * gyaw + py, gyaw + pyaw)
            for (gx, gy, gyaw), (px, py, pyaw) in zip(self._gains, by_parameter, strict=True)
        ]
        place_m2 = self._walk_m2_per_m * way_m + TURN_SLIDE_M_PER_SQRT_RAD**2 * abs(turn_rad)
        self._walk.move(dx_m, dy_m, place_m2, self._find_yaw_walk_rad2(way_m))

    def _find_yaw_walk_rad2(self, way_m: float) -> float:
        """Find the variance of the turn where both sides walk, so that their mean walks as set."""
        return 4.0 * self._walk_m2_per_m * way_m / self._drive.effective_separation_m**2

    def _read(
        self, t_s: float, v_mps: float, yaw_rate_radps: float, way_m: float, dt_s: float
    ) -> OdometryReading:
        x_m, y_m, yaw_rad = self._pose
        return OdometryReading(
            t_s=t_s,
            x_m=x_m,
            y_m=y_m,
            yaw_rad=math.remainder(yaw_rad, math.tau),
            pose_cov=self._walk.add_parameters(self._gains, self._stds),
            v_mps=v_mps,
            yaw_rate_radps=yaw_rate_radps,
            twist_var=self._find_twist_var(v_mps, yaw_rate_radps, way_m, dt_s),
        )

    def _find_twist_var(
        self, v_mps: float, yaw_rate_radps: float, way_m: float, dt_s: float
    ) -> Triple:
        scale_std, turn_std, crab_std, loss_std = self._stds
        separation_m = self._drive.effective_separation_m
        walk_m2 = self._walk_m2_per_m * way_m
        lost_mps = loss_std * yaw_rate_radps if v_mps else 0.0
        steady = (scale_std * v_mps) ** 2 + lost_mps**2
        forward = steady + (walk_m2 + self._tick_m2 / 4.0) / dt_s**2
        sideways = (crab_std * v_mps) ** 2 + walk_m2 / dt_s**2
        turn_rad2 = self._find_yaw_walk_rad2(way_m) + self._tick_m2 / separation_m**2
        turn = (turn_std * yaw_rate_radps) ** 2 + turn_rad2 / dt_s**2
        return forward, sideways, turn


class _Walk:
    """Covariance of x, y and yaw by the random walk of the wheels, in plain numbers."""

    def __init__(self) -> None:
        self._xx = self._xy = self._xt = self._yy = self._yt = self._tt = 0.0

    def move(self, dx_m: float, dy_m: float, place_m2: float, yaw_rad2: float) -> None:
        """Carry the error of the yaw over a step, and add the errors of the step itself."""
        xt, yt, tt = self._xt, self._yt, self._tt
        self._xx += -2.0 * dy_m * xt + dy_m * dy_m * tt + place_m2
        self._yy += 2.0 * dx_m * yt + dx_m * dx_m * tt + place_m2
        self._xy += dx_m * xt - dy_m * yt - dx_m * dy_m * tt
        self._xt, self._yt = xt - dy_m * tt, yt + dx_m * tt
        self._tt = tt + yaw_rad2

    def add_parameters(self, gains: list[Triple], stds: Four) -> tuple[float, ...]:
        """Return the 3x3 covariance by rows, with the constant errors in it."""
        xx, xy, xt = self._xx, self._xy, self._xt
        yy, yt, tt = self._yy, self._yt, self._tt
        for (gx, gy, gyaw), std in zip(gains, stds, strict=True):
            variance = std * std
            xx, xy, xt = xx + variance * gx * gx, xy + variance * gx * gy, xt + variance * gx * gyaw
            yy, yt, tt = (
                yy + variance * gy * gy, yt + variance * gy * gyaw, tt + variance * gyaw * gyaw,
            )  # fmt: skip
        return (xx, xy, xt, xy, yy, yt, xt, yt, tt)
