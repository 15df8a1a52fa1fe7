"""Gyroscope and accelerometer: means over the sample interval, with bias, scale and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agribot.core.messages import FloatArray, ImuSample, Vec3
from agribot.sim.random_streams import BLOCK_ROWS
from agribot.sim.sensors.presets import ImuErrors
from agribot.sim.sensors.tuning import Tuning
from agribot.sim.state import ANGLE_GAIN, VELOCITY_GAIN

GAINS = slice(VELOCITY_GAIN.start, ANGLE_GAIN.stop)


class Imu:
    """Samples in body axes: means over the interval, as the sensor's low-pass filter gives."""

    def __init__(
        self,
        errors: ImuErrors,
        rate_hz: float,
        rng: np.random.Generator,
        tuning: tuple[Tuning, Tuning] | None = None,
    ) -> None:
        """Draw the fixed errors; `tuning` is that of the accelerometer and that of the gyro."""
        self._tuning = tuning
        scale = np.repeat([errors.accel_scale_std_ratio, errors.gyro_scale_std_ratio], 3)
        self._scale: list[float] = (1.0 + scale * rng.standard_normal(6)).tolist()
        self._errors = _generate_errors(errors, rate_hz, rng)
        self._gains = [0.0] * 6
        self._bias = [0.0] * 6
        self._t_s = 0.0

    @property
    def bias(self) -> tuple[Vec3, Vec3]:
        """Errors of a standing robot's last sample, without its noise."""
        a, b, c, d, e, f = self._bias
        accel, gyro = (a, b, c), (d, e, f)
        if self._tuning is not None:
            accel, gyro = self._tuning[0].shift(accel), self._tuning[1].shift(gyro)
        return accel, gyro

    def sample(self, t_s: float, row: FloatArray) -> ImuSample:
        """Return the reading for one row of the physics history."""
        rate = 1.0 / (t_s - self._t_s)
        now, last, scale = row[GAINS].tolist(), self._gains, self._scale
        error = next(self._errors)
        self._bias = error[6:]
        self._gains, self._t_s = now, t_s
        accel = (
            (now[0] - last[0]) * rate * scale[0] + error[0],
            (now[1] - last[1]) * rate * scale[1] + error[1],
            (now[2] - last[2]) * rate * scale[2] + error[2],
        )
        gyro = (
            (now[3] - last[3]) * rate * scale[3] + error[3],
            (now[4] - last[4]) * rate * scale[4] + error[4],
            (now[5] - last[5]) * rate * scale[5] + error[5],
        )
        if self._tuning is not None:
            accel, gyro = self._tuning[0].apply(t_s, accel), self._tuning[1].apply(t_s, gyro)
        return ImuSample(t_s=t_s, accel_mps2=accel, gyro_radps=gyro)


def _generate_errors(
    errors: ImuErrors, rate_hz: float, rng: np.random.Generator
) -> Iterator[list[float]]:
    """Yield the sum of bias, its random walk and white noise of each sample, then bias and walk.

    Six numbers of each: acceleration, m/s^2, then angular rate, rad/s.
    """
    bias = np.repeat([errors.accel_bias_std_mps2, errors.gyro_bias_std_radps], 3)
    bias = bias * rng.standard_normal(6)
    walk = np.repeat([errors.accel_walk_mps2_per_sqrt_s, errors.gyro_walk_radps_per_sqrt_s], 3)
    walk = walk / math.sqrt(rate_hz)
    white = np.repeat([errors.accel_noise_mps2_per_sqrt_hz, errors.gyro_noise_radps_per_sqrt_hz], 3)
    # A density of one-sided power over the band up to half the rate.
    white = white * math.sqrt(rate_hz / 2.0)
    while True:
        normal = rng.standard_normal((BLOCK_ROWS, 12))
        biases = bias + np.cumsum(walk * normal[:, :6], axis=0)
        bias = biases[-1]
        yield from np.hstack([biases + white * normal[:, 6:], biases]).tolist()
