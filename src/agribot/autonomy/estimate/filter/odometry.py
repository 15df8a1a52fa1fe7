"""Wheels and IMU made into steps: how far and how much turned between two encoder readings."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator

import msgspec

from agribot.autonomy.estimate.filter.sensor_ranges import LEAST_STEP_S, MAX_READING
from agribot.autonomy.estimate.filter.slope import (
    heading_rate_radps,
    project_from_above,
    rotate,
    slide_m,
)
from agribot.autonomy.estimate.filter.standstill import Standstill
from agribot.core.messages import ImuSample, Vec3, WheelSample
from agribot.core.robot import DriveSpec

# A wheel cannot turn farther than this between two readings, whatever the ground does;
# more is an encoder that restarted from zero.
MAX_WHEEL_FACTOR, MAX_WHEEL_SLACK_RAD = 2.0, 0.3
# Averaging separates gravity from driving accelerations; a rover pitches slower than this.
TILT_AVERAGE_S = 0.5
# Range of gravity. Outside it the averaged acceleration is free fall, shocks, or that of an IMU
# that subtracts gravity itself. The robot then counts as level, as with an IMU that has none.
GRAVITY_MPS2 = (8.5, 11.1)
# Capture times lie before the batch that delivers them, but for rounding of the clocks.
MAX_AHEAD_S = 0.05


class Step(msgspec.Struct, gc=False):
    """Motion up to `t_s`: distance of the body's centre and turn as the map has them, uncorrected.

    `slide_m` is how far a slope takes the turning robot forward and left, at a guess. `is_blind`
    marks a gap without gyro, in which the turn comes from the wheels alone. `zero_rate` is a mean
    gyro rate at standstill and its variance, when a window completed. `wheel_turn_rad` is the turn
    as the wheels have it, whatever the gyro says, `speed_mps` what they say of the step's end.
    """

    t_s: float
    dt_s: float
    distance_m: float
    turn_rad: float
    is_still: bool
    is_blind: bool
    zero_rate: tuple[float, float] | None
    slide_m: tuple[float, float] = (0.0, 0.0)
    wheel_turn_rad: float = 0.0
    speed_mps: float = 0.0


class Odometry:
    """Merges encoder and IMU samples by their time; late, repeated and non-finite ones drop out.

    `rejected` counts what was dropped, `wheel_t_s` and `imu_t_s` are the last good times.
    """

    def __init__(self, drive: DriveSpec, imu_timeout_s: float, rejected: Counter[str]) -> None:
        self.wheel_t_s = self.imu_t_s = -math.inf
        self._drive = drive
        self._imu_timeout_s = imu_timeout_s
        self._rejected = rejected
        self._wheels: WheelSample | None = None
        self._queue: deque[ImuSample] = deque(maxlen=4096)
        self._standstill = Standstill()
        self._rate_radps: float | None = None
        self._rate_t_s = -math.inf
        self._gyro_radps: Vec3 = (0.0, 0.0, 0.0)
        self._accel_mps2: Vec3 | None = None  # acceleration of the newest samples, if they have one
        self._average_mps2: Vec3 | None = None
        self._up: Vec3 = (0.0, 0.0, 1.0)
        left_mps, right_mps = drive.wheel_speeds_radps(
            drive.max_speed_mps, drive.max_yaw_rate_radps
        )
        self._max_wheel_radps = MAX_WHEEL_FACTOR * max(abs(left_mps), abs(right_mps))

    @property
    def up_body(self) -> Vec3:
        """The vertical in body axes, from the acceleration averaged over the gyro's turns."""
        return self._up

    def steps(
        self, wheels: Iterable[WheelSample], imu: Iterable[ImuSample], now_s: float
    ) -> Iterator[Step]:
        """Yield the steps between the readings that arrived by `now_s`.

        One from the future is refused, because everything that follows it would count as late.
        """
        latest_s = now_s + MAX_AHEAD_S
        for sample in imu:
            self._enqueue(sample, latest_s)
        for reading in wheels:
            if not _is_sane(reading.t_s, reading.angle_rad + reading.speed_radps):
                self._rejected["wheels not finite"] += 1
            elif not self.wheel_t_s + LEAST_STEP_S < reading.t_s <= latest_s:
                self._rejected["wheels out of order"] += 1
            else:
                before, self._wheels = self._wheels, reading
                self.wheel_t_s = reading.t_s
                rate_radps, count = self._consume(reading.t_s)
                if before is not None:
                    yield self._step(before, reading, rate_radps, count)

    def _enqueue(self, sample: ImuSample, latest_s: float) -> None:
        if not _is_sane(sample.t_s, sample.gyro_radps + (sample.accel_mps2 or ())):
            self._rejected["imu not finite"] += 1
        elif not self.imu_t_s < sample.t_s <= latest_s:
            self._rejected["imu out of order"] += 1
        else:
            self.imu_t_s = sample.t_s
            self._queue.append(sample)

    def _consume(self, until_s: float) -> tuple[float | None, int]:
        """Mean heading rate of the samples up to a time, and how many they were."""
        wx = wy = wz = ax = ay = az = 0.0
        count = felt = 0
        queue = self._queue
        while queue and queue[0].t_s <= until_s:
            sample = queue.popleft()
            x, y, z = sample.gyro_radps
            wx, wy, wz = wx + x, wy + y, wz + z
            if sample.accel_mps2 is not None:
                x, y, z = sample.accel_mps2
                ax, ay, az = ax + x, ay + y, az + z
                felt += 1
            count += 1
            self._rate_t_s = sample.t_s
        if count:
            self._gyro_radps = (wx / count, wy / count, wz / count)
            self._rate_radps = heading_rate_radps(self._gyro_radps, self._up)
            self._accel_mps2 = (ax / felt, ay / felt, az / felt) if felt else None
        elif until_s - self._rate_t_s > self._imu_timeout_s:
            self._rate_radps = None
        return self._rate_radps, count

    def _step(
        self, before: WheelSample, after: WheelSample, rate_radps: float | None, count: int
    ) -> Step:
        dt_s = after.t_s - before.t_s
        radius_m = self._drive.wheel_radius_m
        rear_right, rear_left, front_right, front_left = travels_m = tuple(
            radius_m * self._angle(a, b, speed, dt_s)
            for a, b, speed in zip(
                before.angle_rad, after.angle_rad, after.speed_radps, strict=True
            )
        )
        right_m, left_m = (rear_right + front_right) / 2.0, (rear_left + front_left) / 2.0
        distance_m = (right_m + left_m) / 2.0
        wheel_turn_rad = (right_m - left_m) / self._drive.effective_separation_m
        speed_mps = radius_m * sum(after.speed_radps) / 4.0
        is_blind = rate_radps is None or count * self._imu_timeout_s < dt_s - self._imu_timeout_s
        if rate_radps is None or is_blind:
            self._standstill = Standstill()
            return Step(
                after.t_s, dt_s, distance_m, wheel_turn_rad, False, True, None,
                wheel_turn_rad=wheel_turn_rad, speed_mps=speed_mps,
            )  # fmt: skip
        if count:
            self._tilt(dt_s, rate_radps * distance_m / dt_s)
        zero_rate = self._standstill.update(dt_s, travels_m, rate_radps)
        still, turn_rad = self._standstill.is_still, rate_radps * dt_s
        slide = (0.0, 0.0) if still else slide_m(turn_rad, self._up, self._drive.wheelbase_m)
        level_m = project_from_above(distance_m, self._up)
        return Step(
            after.t_s, dt_s, level_m, turn_rad, still, False, zero_rate, slide, wheel_turn_rad,
            speed_mps,
        )  # fmt: skip

    def _angle(self, before_rad: float, after_rad: float, speed_radps: float, dt_s: float) -> float:
        """Turn of one wheel. The encoder's angle is exact over any gap, unless it restarted."""
        turned_rad = after_rad - before_rad
        if abs(turned_rad) > self._max_wheel_radps * dt_s + MAX_WHEEL_SLACK_RAD:
            self._rejected["encoder restarted"] += 1
            return speed_radps * dt_s
        return turned_rad

    def _tilt(self, dt_s: float, centripetal_mps2: float) -> None:
        if self._accel_mps2 is None:
            self._average_mps2, self._up = None, (0.0, 0.0, 1.0)
            return
        x, y, z = self._accel_mps2
        y -= centripetal_mps2
        part = min(dt_s / TILT_AVERAGE_S, 1.0)
        ax, ay, az = rotate(self._average_mps2 or (x, y, z), self._gyro_radps, dt_s)
        ax, ay, az = ax + part * (x - ax), ay + part * (y - ay), az + part * (z - az)
        self._average_mps2 = (ax, ay, az)
        norm = math.hypot(ax, ay, az)
        if GRAVITY_MPS2[0] < norm < GRAVITY_MPS2[1]:
            self._up = (ax / norm, ay / norm, az / norm)
        else:
            self._up = (0.0, 0.0, 1.0)


def _is_sane(t_s: float, values: tuple[float, ...]) -> bool:
    """Refuse NaN, infinity and numbers that no encoder or IMU can mean."""
    return math.isfinite(t_s) and sum(map(abs, values)) < MAX_READING
