"""As agribot.autonomy.estimate.compass, for many robots that stand on a marked start."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate.compass import (
    BIAS_MEMORY_RAD,
    BIAS_MEMORY_S,
    FIRST_SAMPLES,
    MAX_JUMP_RAD,
    NOISE_WEIGHT,
)
from agribot.autonomy.estimate.ekf import GYRO_BIAS, MAG_BIAS, YAW
from agribot.autonomy.estimate.start import StartMark
from agribot.core.config import EstimateConfig
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import ARRAYS
from agribot.lab.bench.nav.batch.ekf import BatchEkf, BatchRow
from agribot.lab.bench.nav.batch.motion import BatchGate, BatchHistory, BatchMotion

_ROW: BatchRow = ((YAW, 1.0), (MAG_BIAS, 1.0))


class BatchYaw(NamedTuple):
    """What all compasses say of the yaw; NaN-free array (N,)."""

    t_s: float
    yaw_map_rad: FloatArray


class BatchCompass:
    def __init__(
        self, ekf: BatchEkf, history: BatchHistory, config: EstimateConfig, start: StartMark
    ) -> None:
        count = ekf.x.shape[1]
        self.is_ready = False
        self._ekf, self._history, self._start = ekf, history, start
        self._bias_std_rad = config.mag_bias_std_rad
        self._floor = config.mag_std_rad**2
        self._variance = np.full(count, self._floor)
        self._last_rad: FloatArray | None = None
        self._jumps = self._first_count = 0
        self._gate = BatchGate(count, config.gate_sigma, config.recover_after)
        self._first_sum = np.zeros(count, dtype=np.complex128)

    def update(self, sample: BatchYaw) -> None:
        yaw_rad = sample.yaw_map_rad
        now, then = self._history.newest, self._history.at(sample.t_s)
        if now is None or then is None:
            return
        self._add_noise(yaw_rad - then.yaw_rad)
        if self.is_ready:
            self._correct(yaw_rad + now.yaw_rad - then.yaw_rad)
        else:
            self._begin(yaw_rad - then.yaw_rad, now)

    def _add_noise(self, heading_rad: FloatArray) -> None:
        if self._last_rad is not None:
            jump_rad = np.minimum(abs(ARRAYS.wrap(heading_rad - self._last_rad)), MAX_JUMP_RAD)
            self._jumps += 1
            weight = max(NOISE_WEIGHT, 1.0 / self._jumps)
            self._variance += weight * (jump_rad * jump_rad / 2.0 - self._variance)
        self._last_rad = heading_rad

    def _begin(self, offset_rad: FloatArray, now: BatchMotion) -> None:
        self._first_sum += np.exp(1j * offset_rad)
        self._first_count += 1
        if self._first_count < FIRST_SAMPLES:
            return
        ekf, marked_rad = self._ekf, self._start.yaw_map_rad
        yaw_rad = ARRAYS.wrap(np.angle(self._first_sum) + now.yaw_rad)
        variance = np.maximum(self._variance, self._floor) / self._first_count
        variance += ekf.cov[GYRO_BIAS, GYRO_BIAS]
        residual_rad = np.zeros_like(yaw_rad)
        if marked_rad is None:
            ekf.reset(YAW, yaw_rad, math.pi**2)
        else:
            at_rad = ARRAYS.wrap(marked_rad + now.yaw_rad)
            ekf.reset(YAW, at_rad, self._start.yaw_std_rad**2)
            residual_rad = ARRAYS.wrap(yaw_rad - ekf.x[YAW])
        ekf.reset(MAG_BIAS, 0.0, self._bias_std_rad**2)
        ekf.update(_ROW, residual_rad, variance)
        self.is_ready = True

    def _correct(self, yaw_rad: FloatArray) -> None:
        ekf, gate = self._ekf, self._gate
        residual_rad = ARRAYS.wrap(yaw_rad - ekf.x[YAW] - ekf.x[MAG_BIAS])
        variance = np.maximum(self._variance, self._floor)
        distance2 = ekf.update(_ROW, residual_rad, variance, gate.limit)
        _, recovers = gate.evaluate(distance2)
        if recovers.any():
            ekf.inflate(MAG_BIAS, recovers * residual_rad**2)
            ekf.update(_ROW, residual_rad, variance, mask=recovers)

    def ageing(self, dt_s: float, turn_abs_rad: FloatArray) -> tuple[int, FloatArray, FloatArray]:
        factor = np.exp(-dt_s / BIAS_MEMORY_S - turn_abs_rad / BIAS_MEMORY_RAD)
        return MAG_BIAS, factor, self._bias_std_rad**2 * (1.0 - factor * factor)
