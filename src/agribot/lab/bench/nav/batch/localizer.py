"""As autonomy.estimate.localizer, for many robots on a marked start that lose no wheels or gyro."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate.dual_heading import STD_FACTOR
from agribot.autonomy.estimate.ekf import GYRO_BIAS, SLIP, WHEEL_SCALE, YAW, X, Y
from agribot.autonomy.estimate.localizer import AGEING_PERIOD_S, STANDING_WINDOWS
from agribot.autonomy.estimate.priors import initial_std, motion_noise, slow_ageing
from agribot.autonomy.estimate.row_agreement import HELD_S
from agribot.autonomy.estimate.start import StartMark
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.arrays import ARRAYS
from agribot.lab.bench.nav.batch.compass import BatchCompass, BatchYaw
from agribot.lab.bench.nav.batch.ekf import BatchEkf, Mask
from agribot.lab.bench.nav.batch.gnss import BatchFix, BatchGnss
from agribot.lab.bench.nav.batch.integrity import BatchIntegrity
from agribot.lab.bench.nav.batch.motion import (
    BatchGate,
    BatchHistory,
    BatchMotion,
    BatchStandstill,
)
from agribot.lab.bench.nav.batch.row_lines import BatchLine, BatchRowLines


class BatchHeading(NamedTuple):
    """As devices.GnssHeading; NaN where the ambiguities are not fixed."""

    t_s: float
    yaw_map_rad: FloatArray
    std_rad: float


class BatchEstimate(NamedTuple):
    """As messages.Estimate; `cov` (3, 3, N)."""

    x_map_m: FloatArray
    y_map_m: FloatArray
    yaw_map_rad: FloatArray
    v_mps: FloatArray
    yaw_rate_radps: FloatArray
    slip_rad: FloatArray
    cov: FloatArray
    ok: bool


class BatchLocalizer:
    def __init__(
        self,
        count: int,
        config: EstimateConfig,
        field: FieldConfig,
        robot: RobotSpec,
        *,
        is_corrected: bool,
    ) -> None:
        self.ekf = BatchEkf(count, initial_std(config), math.radians(field.row_yaw_deg))
        self._config = config
        self._noise = motion_noise(config)
        self._history = BatchHistory()
        self._standstill = BatchStandstill(count)
        start = StartMark.of(field)
        self._compass = BatchCompass(self.ekf, self._history, config, start)
        x_m, y_m, _ = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
        self._gnss = BatchGnss(
            self.ekf, self._history, config, (x_m, y_m), start, is_corrected=is_corrected
        )
        self._row_lines = BatchRowLines(self.ekf, self._history, field)
        self._heading_gate = BatchGate(count, config.gate_sigma, config.recover_after)
        self._bias_gate = BatchGate(count, config.gate_sigma, STANDING_WINDOWS)
        self._gives_way = np.zeros(count, dtype=bool)
        zeros = np.zeros(count)
        self._motion = BatchMotion(0.0, zeros, zeros, zeros, zeros, zeros)
        self._unaged_s, self._unaged_rad = 0.0, np.zeros(count)
        self._integrity = BatchIntegrity(self.ekf, config)

    def bound(self, t_s: float) -> FloatArray:
        """Give how far each robot may be off across the rows, m (N,); call it at every tick."""
        return self._integrity.bound(t_s, t_s - self._row_lines.held_t_s <= HELD_S)

    @property
    def is_ready(self) -> bool:
        return self._gnss.is_ready

    def advance(self, t_s: float, distance_m: FloatArray, rate_radps: FloatArray) -> None:
        """One step of wheels and gyro up to `t_s`."""
        last, ekf = self._motion, self.ekf
        dt_s = t_s - last.t_s
        window = self._standstill.update(dt_s, distance_m, rate_radps)
        self._gives_way &= self._standstill.is_still
        still = self._standstill.is_still & ~self._gives_way
        turn_rad = np.where(still, ekf.x[GYRO_BIAS] * dt_s, rate_radps * dt_s)
        dx_m, dy_m, dyaw_rad = ekf.predict(distance_m, turn_rad, dt_s, self._noise)
        self._motion = BatchMotion(
            t_s, last.x_m + dx_m, last.y_m + dy_m, last.yaw_rad + dyaw_rad,
            distance_m / dt_s, dyaw_rad / dt_s,
        )  # fmt: skip
        self._history.append(self._motion)
        self._integrity.move(distance_m, dyaw_rad)
        if window is not None:
            self._learn_bias(*window)
        self._age(dt_s, dyaw_rad)

    def _learn_bias(self, quiet: Mask, mean_radps: FloatArray, variance: FloatArray) -> None:
        """As Localizer._learn_bias."""
        ekf, gate, row = self.ekf, self._bias_gate, ((GYRO_BIAS, 1.0),)
        off_radps = mean_radps - ekf.x[GYRO_BIAS]
        distance2 = ekf.update(row, off_radps, variance, gate.limit, quiet)
        accepted, recovers = gate.evaluate(distance2, quiet)
        gives_way = ~(accepted | recovers) & (gate.rejected_in_a_row > 1)
        self._gives_way = np.where(quiet, gives_way, self._gives_way)
        if recovers.any():
            ekf.inflate(GYRO_BIAS, recovers * off_radps**2)
            ekf.update(row, off_radps, variance, mask=recovers)

    def hear(
        self,
        mags: Sequence[BatchYaw] = (),
        fixes: Sequence[BatchFix] = (),
        headings: Sequence[BatchHeading] = (),
    ) -> None:
        """Take what arrived: compass yaws, fixes, headings of second antennas."""
        for sample in mags:
            self._compass.update(sample)
        if self._compass.is_ready:
            for fix in fixes:
                self._gnss.update(fix)
            for heading in headings:
                self._head(heading)

    def observe_line(self, line: BatchLine) -> None:
        if self._gnss.is_ready:
            self._row_lines.update(line)

    def estimate(self) -> BatchEstimate:
        x, motion = self.ekf.x, self._motion
        forward_mps = motion.wheel_mps * (1.0 - x[WHEEL_SCALE])
        return BatchEstimate(
            x_map_m=x[X].copy(),
            y_map_m=x[Y].copy(),
            yaw_map_rad=x[YAW].copy(),
            v_mps=forward_mps,
            yaw_rate_radps=motion.yaw_rate_radps,
            slip_rad=np.copysign(1.0, forward_mps) * x[SLIP] * self.ekf.slip_ratio(x[YAW]),
            cov=self.ekf.cov[:3, :3],
            ok=self._gnss.is_ready,
        )

    def _head(self, heading: BatchHeading) -> None:
        now, then = self._history.newest, self._history.at(heading.t_s)
        seen = np.isfinite(heading.yaw_map_rad)
        if now is None or then is None or not seen.any():
            return
        ekf, gate, row = self.ekf, self._heading_gate, ((YAW, 1.0),)
        measured_rad = np.where(seen, heading.yaw_map_rad, 0.0)
        residual_rad = ARRAYS.wrap(measured_rad + now.yaw_rad - then.yaw_rad - ekf.x[YAW])
        variance = (STD_FACTOR * heading.std_rad) ** 2
        _, recovers = gate.evaluate(ekf.update(row, residual_rad, variance, gate.limit, seen), seen)
        if recovers.any():
            ekf.inflate(YAW, recovers * residual_rad**2)
            ekf.update(row, residual_rad, variance, mask=recovers)

    def _age(self, dt_s: float, turn_rad: FloatArray) -> None:
        self._unaged_s += dt_s
        self._unaged_rad = self._unaged_rad + abs(turn_rad)
        if self._unaged_s < AGEING_PERIOD_S:
            return
        age_s, age_rad = self._unaged_s, self._unaged_rad
        self._unaged_s, self._unaged_rad = 0.0, np.zeros_like(age_rad)
        self.ekf.relax(
            [
                *slow_ageing(self._config, age_s),
                self._compass.ageing(age_s, age_rad),
                *self._gnss.ageing(age_s),
                *self._row_lines.ageing(age_s),
            ]
        )
