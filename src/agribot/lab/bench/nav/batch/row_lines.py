"""As agribot.autonomy.estimate.row_lines, for many robots whose cameras look at the same times."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate import row_model as model
from agribot.autonomy.estimate.ekf import ROW_BIAS, YAW, X, Y
from agribot.autonomy.estimate.field_rows import FieldRows
from agribot.autonomy.estimate.row_line_noise import JUMP2_MEDIAN, MAX_GAP_S, MOST_JUMPS, SURE_RATIO
from agribot.core.config import FieldConfig
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import ARRAYS, clamp
from agribot.lab.bench.nav.batch.ekf import BatchEkf, BatchRow, Mask
from agribot.lab.bench.nav.batch.motion import BatchGate, BatchHistory, BatchMotion


class BatchLine(NamedTuple):
    """As devices.RowLine; arrays (N,), NaN where a robot does not see it."""

    t_s: float
    offset_m: FloatArray
    heading_rad: FloatArray
    start_ahead_m: FloatArray
    end_ahead_m: FloatArray
    offset_std_m: float
    heading_std_rad: float
    range_std_m: float


class BatchNoiseRatio:
    """As autonomy.estimate.row_line_noise.NoiseRatio; each robot sees lines at its own times."""

    def __init__(self, count: int) -> None:
        self._jumps2 = np.full((MOST_JUMPS, count), JUMP2_MEDIAN)
        self._next = np.zeros(count, dtype=np.intp)
        self._last_t_s, self._last = np.full(count, -math.inf), np.zeros(count)
        self.ratio = np.ones(count)

    def add(self, t_s: float, residual: FloatArray, variance: float, seen: Mask) -> None:
        jumps = seen & (t_s - self._last_t_s <= MAX_GAP_S)
        if jumps.any():
            robots = np.flatnonzero(jumps)
            jumps2 = (residual[robots] - self._last[robots]) ** 2 / variance
            self._jumps2[self._next[robots], robots] = jumps2
            self._next[robots] = (self._next[robots] + 1) % MOST_JUMPS
            ratio = np.sqrt(np.median(self._jumps2[:, robots], axis=0) / JUMP2_MEDIAN)
            self.ratio[robots] = np.where(ratio > SURE_RATIO, ratio, 1.0)
        self._last_t_s[seen], self._last[seen] = t_s, residual[seen]


class BatchRowLines:
    def __init__(self, ekf: BatchEkf, history: BatchHistory, field: FieldConfig) -> None:
        count = ekf.x.shape[1]
        self._ekf, self._history = ekf, history
        self._field, self._last_row = FieldRows(field), field.row_count - 1
        self._offset_gate = BatchGate(count, model.GATE_SIGMA, model.RECOVER_AFTER)
        self._heading_gate = BatchGate(count, model.GATE_SIGMA, model.RECOVER_AFTER)
        self._range_gate = BatchGate(count, model.RANGE_GATE_SIGMA, model.RANGE_RECOVER_AFTER)
        self._last_t_s = np.full(count, -math.inf)
        self._bias_std_m = np.zeros(count)
        self._offset_noise, self._heading_noise = BatchNoiseRatio(count), BatchNoiseRatio(count)
        self.held_t_s = np.full(count, -math.inf)  # of the last line that was believed

    def update(self, line: BatchLine) -> None:
        now, then = self._history.newest, self._history.at(line.t_s)
        seen = np.isfinite(line.offset_m)
        if now is None or then is None:
            return
        since_last_s = np.minimum(line.t_s - self._last_t_s, model.LASTING_MEMORY_S)
        self._last_t_s[seen] = line.t_s
        self._bias_std_m[seen] = model.LASTING_RATIO * line.offset_std_m
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        sign = np.where(np.cos(yaw_rad - self._ekf.row_yaw_rad) >= 0.0, 1.0, -1.0)
        # NaN of the blind would spread through products with zero.
        clean = line._replace(
            offset_m=np.where(seen, line.offset_m, 0.0),
            heading_rad=np.where(seen, line.heading_rad, 0.0),
        )
        if seen.any():
            turned_rad = self._turned_rad(clean, sign, now, then)
            self._heading_noise.add(line.t_s, turned_rad, line.heading_std_rad**2, seen)
            fits = self._offset(clean, sign, now, then, seen)
            if fits.any():
                self.held_t_s[fits] = line.t_s
                self._heading(clean, sign, since_last_s, now, then, fits)
        length_m = self._field.length_m
        first_m = np.where(sign > 0.0, 0.0, length_m)
        for ahead_m, at_m in (
            (line.start_ahead_m, first_m),
            (line.end_ahead_m, length_m - first_m),
        ):
            has = np.isfinite(ahead_m)
            if has.any():
                place_m = at_m - sign * np.where(has, ahead_m, 0.0)
                self._range(place_m, line.range_std_m, now, then, has)

    def ageing(self, dt_s: float) -> list[tuple[int, FloatArray | float, FloatArray]]:
        factor = math.exp(-dt_s / model.LASTING_MEMORY_S)
        lasting_m = self._offset_noise.ratio * self._bias_std_m
        return [(ROW_BIAS, factor, lasting_m**2 * (1.0 - factor * factor))]

    def _place(self, now: BatchMotion, then: BatchMotion) -> tuple[FloatArray, FloatArray]:
        x = self._ekf.x
        x_m, y_m = x[X] - (now.x_m - then.x_m), x[Y] - (now.y_m - then.y_m)
        return self._field.along_right_m(x_m, y_m)

    def _begin(self, seen: Mask) -> None:
        """Open a robot's bias state with its first line."""
        ekf = self._ekf
        new = seen & (ekf.cov[ROW_BIAS, ROW_BIAS] == 0.0)
        if new.any():
            ekf.inflate(ROW_BIAS, new * self._bias_std_m**2)

    def _offset(
        self, line: BatchLine, sign: FloatArray, now: BatchMotion, then: BatchMotion, seen: Mask
    ) -> Mask:
        ekf, field = self._ekf, self._field
        self._begin(seen)
        _, right_m = self._place(now, then)
        row: BatchRow = (*moved_row(field.right, now, then), (ROW_BIAS, -sign))
        across_m2 = ekf.project(row[:3])[1]
        known = seen & ~(across_m2 > (model.TELLS_APART_RATIO * field.pitch_m) ** 2)
        row_right_m = np.zeros_like(right_m)
        if self._last_row:
            index = np.rint((right_m + sign * line.offset_m) / field.pitch_m)
            row_right_m = clamp(index, 0.0, self._last_row) * field.pitch_m
        off_m = row_right_m - sign * line.offset_m - right_m
        noise = self._offset_noise
        noise.add(line.t_s, off_m, model.offset_variance(line.offset_std_m), seen)
        residual_m = off_m + sign * ekf.x[ROW_BIAS]
        variance = model.offset_variance(noise.ratio * line.offset_std_m)
        distance2 = residual_m**2 / (ekf.project(row)[1] + variance)
        fits, recovers = self._offset_gate.evaluate(distance2, known)
        if recovers.any():
            for state, part in ((X, field.right[0]), (Y, field.right[1])):
                ekf.inflate(state, _where(recovers, (part * model.RECOVERY_OFFSET_M) ** 2))
            ekf.inflate(YAW, _where(recovers, model.RECOVERY_YAW_RAD**2))
        ekf.update(row, residual_m, variance * model.tail_factor(ARRAYS, distance2), mask=fits)
        return fits

    def _turned_rad(
        self, line: BatchLine, sign: FloatArray, now: BatchMotion, then: BatchMotion
    ) -> FloatArray:
        row_yaw_rad = self._ekf.row_yaw_rad + np.where(sign > 0.0, 0.0, math.pi)
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        return ARRAYS.wrap(line.heading_rad + row_yaw_rad - yaw_rad)

    def _heading(
        self,
        line: BatchLine,
        sign: FloatArray,
        since_last_s: FloatArray,
        now: BatchMotion,
        then: BatchMotion,
        seen: Mask,
    ) -> None:
        ekf = self._ekf
        residual_rad = self._turned_rad(line, sign, now, then)
        std_rad = self._heading_noise.ratio * line.heading_std_rad
        variance = model.heading_variance(ARRAYS, std_rad, since_last_s)
        distance2 = residual_rad**2 / (ekf.cov[YAW, YAW] + variance)
        fits, recovers = self._heading_gate.evaluate(distance2, seen)
        if recovers.any():
            ekf.inflate(YAW, _where(recovers, model.RECOVERY_YAW_RAD**2))
        variance = variance * model.tail_factor(ARRAYS, distance2)
        ekf.update(((YAW, 1.0),), residual_rad, variance, mask=fits | recovers)

    def _range(
        self,
        along_then_m: FloatArray,
        std_m: float,
        now: BatchMotion,
        then: BatchMotion,
        seen: Mask,
    ) -> None:
        ekf, field, gate = self._ekf, self._field, self._range_gate
        along_m, _ = self._place(now, then)
        row = moved_row(field.forward, now, then)
        residual_m = along_then_m - along_m
        variance = std_m**2
        distance2 = ekf.update(row, residual_m, variance, gate.limit, seen)
        _, recovers = gate.evaluate(distance2, seen)
        if recovers.any():
            for state, part in ((X, field.forward[0]), (Y, field.forward[1])):
                ekf.inflate(state, _where(recovers, (part * model.RECOVERY_RANGE_M) ** 2))
            ekf.update(row, residual_m, variance, mask=recovers)


def moved_row(direction: tuple[float, float], now: BatchMotion, then: BatchMotion) -> BatchRow:
    dx, dy = direction
    moved_x, moved_y = now.x_m - then.x_m, now.y_m - then.y_m
    return ((X, dx), (Y, dy), (YAW, dx * moved_y - dy * moved_x))


def _where(mask: Mask, variance: float) -> FloatArray:
    return np.where(mask, variance, 0.0)
