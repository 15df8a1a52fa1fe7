"""Heading from magnetometer, gyro and accelerometer alone, as the original's node had to."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.filter.heading import HeadingFilter
from agribot.autonomy.estimate.sensors.compass import yaw_from_field
from agribot.core.messages import ImuSample, MagSample, Vec3

_STILL_WINDOW_S = 1.0
_STILL_RATE_RADPS = 0.05  # rate above any turn-on bias, below any turn that counts
_STILL_SPREAD_RADPS = 0.02
_BIAS_WEIGHT = 0.2
_UP_TAU_S = 2.0  # accelerations of driving average out; slopes last longer
_MAX_GAP_S = 0.2


class CompassHeading:
    """Tilt-compensated raw yaw and the filtered one; the gyro's bias is learnt at standstill.

    Yaw is counter-clockwise from East, `declination_rad` that of magnetic North, East positive.
    """

    def __init__(self, declination_rad: float = 0.0, raw_std_rad: float = 0.28) -> None:
        self._declination_rad = declination_rad
        self._filter = HeadingFilter(raw_std_rad)
        self._up: Vec3 = (0.0, 0.0, 1.0)
        self._bias_radps = 0.0
        self._is_driven = False
        self._has_bias = False
        self._rates: list[float] = []
        self._window_s = 0.0
        self._last_imu_s: float | None = None
        self._turned_rad = self._turned_s = 0.0

    def update_imu(self, sample: ImuSample) -> None:
        """Turn the heading on; a sample that is not finite or not newer changes nothing."""
        values = (sample.t_s, *sample.gyro_radps, *(sample.accel_mps2 or ()))
        if not all(map(math.isfinite, values)):
            return
        last_s, self._last_imu_s = self._last_imu_s, sample.t_s
        if last_s is None or not 0.0 < sample.t_s - last_s <= _MAX_GAP_S:
            return
        dt_s = sample.t_s - last_s
        if sample.accel_mps2 is not None:
            self._level(dt_s, sample.accel_mps2)
        rate_radps = sum(g * u for g, u in zip(sample.gyro_radps, self._up, strict=True))
        self._watch_still(dt_s, rate_radps)
        self._turned_rad += (rate_radps - self._bias_radps) * dt_s
        self._turned_s += dt_s

    def update_mag(self, sample: MagSample) -> tuple[float, float] | None:
        """Give raw and filtered yaw after this sample; None where the field shows no direction."""
        if not math.isfinite(sample.t_s + sum(sample.field_t)):
            return None
        raw_rad = yaw_from_field(sample.field_t, self._up, self._declination_rad)
        if raw_rad is None:
            return None
        rate_radps = self._turned_rad / self._turned_s if self._turned_s > 0.0 else 0.0
        self._turned_rad = self._turned_s = 0.0
        return raw_rad, self._filter.update(sample.t_s, raw_rad, rate_radps)

    def update_command(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Note what drives the robot: a slow turn that is commanded is no bias."""
        self._is_driven = v_mps != 0.0 or yaw_rate_radps != 0.0

    def _level(self, dt_s: float, accel_mps2: Vec3) -> None:
        norm = math.hypot(*accel_mps2)
        if not 5.0 < norm < 15.0:
            return
        weight = dt_s / _UP_TAU_S
        mixed = [u + weight * (a / norm - u) for u, a in zip(self._up, accel_mps2, strict=True)]
        length = math.hypot(*mixed)
        self._up = (mixed[0] / length, mixed[1] / length, mixed[2] / length)

    def _watch_still(self, dt_s: float, rate_radps: float) -> None:
        if self._is_driven or abs(rate_radps) > _STILL_RATE_RADPS:
            self._rates, self._window_s = [], 0.0
            return
        self._rates.append(rate_radps)
        self._window_s += dt_s
        if self._window_s < _STILL_WINDOW_S:
            return
        mean = sum(self._rates) / len(self._rates)
        if max(self._rates) - min(self._rates) < _STILL_SPREAD_RADPS:
            weight = _BIAS_WEIGHT if self._has_bias else 1.0
            self._bias_radps += weight * (mean - self._bias_radps)
            self._has_bias = True
        self._rates, self._window_s = [], 0.0
