"""Heading from the magnetometer: tilt, declination, hard iron and noise of unknown size."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from agribot.autonomy.estimate.filter.ekf import GYRO_BIAS, MAG_BIAS, YAW, Row
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.sensor_ranges import MAX_FIELD_T
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.mag_fit import Level, MagCalibration, MagFit
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.geo import wrap_rad
from agribot.core.messages import MagSample, SensorBatch, Vec3

# Samples whose mean is the first heading.
FIRST_SAMPLES = 8
# Turn after which the old bias says little about the new: hard iron turns with the robot.
BIAS_MEMORY_RAD = 1.0
# Once that is learnt, the mount's share stays; what the fit and the motors leave over turns.
LEARNT_MEMORY_RAD = 10.0
# Soft iron, motor currents and things beside the track change it in place.
BIAS_MEMORY_S = 120.0
# Weight of a new sample in the running noise estimate, and the largest jump that counts.
NOISE_WEIGHT = 0.1
MAX_JUMP_RAD = 1.0
# Heading good enough to learn iron from: the compass alone never gets there.
REFERENCE_STD_RAD = math.radians(2.0)
# Largest tilt of level ground. On a slope the vertical parts of field and iron enter too, and the
# curve is not an ellipse.
LEVEL_COSINE = math.cos(math.radians(4.0))
# Error of the heading without iron: the mounting of the sensor.
MOUNT_STD_RAD = math.radians(3.0)
_ROW: Row = ((YAW, 1.0), (MAG_BIAS, 1.0))


def level_field(field_t: Vec3, up_body: Vec3) -> Level | None:
    """Level the field: ahead and to the left of the body; None where nothing is horizontal."""
    # The body's x axis laid flat, and left of it, both written in body axes.
    ux, uy, uz = up_body
    norm = math.hypot(uy, uz)
    if norm < 0.1:
        return None
    forward = (norm, -ux * uy / norm, -ux * uz / norm)
    left = (0.0, uz / norm, -uy / norm)
    ahead_t = sum(a * b for a, b in zip(field_t, forward, strict=True))
    left_t = sum(a * b for a, b in zip(field_t, left, strict=True))
    total = math.hypot(*field_t)
    if not total <= MAX_FIELD_T or math.hypot(ahead_t, left_t) <= 1e-3 * total:
        return None
    return ahead_t, left_t


def yaw_from_field(field_t: Vec3, up_body: Vec3, declination_rad: float) -> float | None:
    """Find the body's yaw in the map; None where the field has no horizontal part.

    The declination is that of magnetic North, positive to the East.
    """
    level_t = level_field(field_t, up_body)
    return None if level_t is None else yaw_of(level_t, declination_rad)


def yaw_of(level_t: Level, declination_rad: float) -> float:
    return wrap_rad(math.pi / 2.0 - declination_rad - math.atan2(level_t[1], level_t[0]))


class NoiseMeter:
    """White noise of a heading from the jumps between neighbours.

    The difference of two samples, both turned back by the gyro, cancels heading and slow bias
    alike and keeps twice the white variance; it does not depend on the filter's own opinion.
    """

    def __init__(self, floor_std_rad: float) -> None:
        self._floor = floor_std_rad**2
        self._variance = self._floor
        self._last_rad: float | None = None
        self._count = 0

    @property
    def variance(self) -> float:
        return max(self._variance, self._floor)

    def add(self, heading_rad: float) -> None:
        if self._last_rad is not None:
            jump_rad = min(abs(wrap_rad(heading_rad - self._last_rad)), MAX_JUMP_RAD)
            self._count += 1
            weight = max(NOISE_WEIGHT, 1.0 / self._count)
            self._variance += weight * (jump_rad * jump_rad / 2.0 - self._variance)
        self._last_rad = heading_rad


class Compass(Correction[MagSample]):
    """Gives the filter its first heading, then slow corrections of it."""

    needs = None

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        config = pose.config
        self._declination_rad = math.radians(pose.field.declination_deg or 0.0)
        self._bias_std_rad = config.mag_bias_std_rad
        self._noise = NoiseMeter(config.mag_std_rad)
        self._set = MagCalibration(offset_t=config.mag_offset_t, shape=config.mag_shape)
        self._learns = config.mag_learn
        self._fit = MagFit()
        self._learnt: MagCalibration | None = None
        self._gate = Gate(config.gate_sigma, config.recover_after, "mag outlier")
        self.last_t_s = math.inf
        self._first_sum = 0j
        self._first_count = 0

    def samples(self, batch: SensorBatch) -> Sequence[MagSample]:
        return batch.mag

    def is_usable(self, sample: MagSample) -> bool:
        return level_field(sample.field_t, self.pose.up_body) is not None

    def measure(self, sample: MagSample, epoch: Epoch) -> Measurements:
        up_body, (then, now, _) = self.pose.up_body, epoch
        level_t = level_field(sample.field_t, up_body)
        if level_t is None:
            return
        is_level = up_body[2] > LEVEL_COSINE
        level_t = self._take_iron_off(level_t, then.yaw_rad - now.yaw_rad, is_level=is_level)
        yaw_rad = yaw_of(level_t, self._declination_rad)
        self._noise.add(yaw_rad - then.yaw_rad)
        self.pose.turns.add_compass(yaw_rad - then.yaw_rad, self._noise.variance)
        self.last_t_s = sample.t_s
        if "yaw" not in self.pose.known:
            self._begin(yaw_rad - then.yaw_rad, now.yaw_rad)
            return
        x = self.pose.ekf.x
        residual_rad = wrap_rad(yaw_rad + now.yaw_rad - then.yaw_rad - x[YAW] - x[MAG_BIAS])
        # The gyro carries the heading; after a run of outliers the field around the robot jumped.
        yield Measurement(
            (residual_rad,), (_ROW,), self._noise.variance, self._gate,
            opens=((MAG_BIAS, residual_rad**2),),
        )  # fmt: skip

    def _take_iron_off(self, level_t: Level, back_rad: float, *, is_level: bool) -> Level:
        """Remove the robot's own iron, as it is set and as it is learnt while others know better.

        `back_rad` is how far the robot has turned since, backwards.
        """
        level_t = self._set.correct(level_t)
        if not self._learns:
            return level_t
        ekf = self.pose.ekf
        is_sure = "yaw" in self.pose.known and ekf.cov[YAW, YAW] < REFERENCE_STD_RAD**2
        if is_level and is_sure:
            north_rad = math.pi / 2.0 - self._declination_rad - (ekf.x[YAW] + back_rad)
            if self._fit.add(level_t, north_rad):
                self._learn()
        return level_t if self._learnt is None else self._learnt.correct(level_t)

    def _learn(self) -> None:
        fitted = self._fit.solve()
        if fitted is None or fitted.complaints():
            return
        if self._learnt is None:  # only the mount's part of the bias is left
            self._bias_std_rad = min(self._bias_std_rad, MOUNT_STD_RAD)
            self.pose.ekf.reset(MAG_BIAS, 0.0, self._bias_std_rad**2)
        self._learnt = fitted.calibration
        self.pose.turns.restart()  # this subtraction is no turn of the compass

    def _begin(self, offset_rad: float, turned_rad: float) -> None:
        """Collect headings, each turned back to the start of the odometry; then set the yaw.

        Where the start is marked, the mark sets it, and the headings show the compass' bias.
        """
        self._first_sum += cmath.rect(1.0, offset_rad)
        self._first_count += 1
        if self._first_count < FIRST_SAMPLES:
            return
        ekf = self.pose.ekf
        yaw_rad = wrap_rad(cmath.phase(self._first_sum) + turned_rad)
        bias_rad2 = ekf.cov[GYRO_BIAS, GYRO_BIAS]
        variance = self._noise.variance / self._first_count + float(bias_rad2)
        ekf.reset(MAG_BIAS, 0.0, self._bias_std_rad**2)
        self.pose.first_heading.begin(yaw_rad, variance, "compass", _ROW)

    def ageing(self, dt_s: float, turn_abs_rad: float) -> Sequence[tuple[int, float, float]]:
        """Say how the bias ages; its spread stays what the config states."""
        memory_rad = BIAS_MEMORY_RAD if self._learnt is None else LEARNT_MEMORY_RAD
        factor = math.exp(-dt_s / BIAS_MEMORY_S - turn_abs_rad / memory_rad)
        return ((MAG_BIAS, factor, self._bias_std_rad**2 * (1.0 - factor * factor)),)
