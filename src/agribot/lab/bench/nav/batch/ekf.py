"""As agribot.autonomy.estimate.ekf, for many robots: they are the last axis of every array."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from agribot.autonomy.estimate.ekf import (
    GYRO_BIAS,
    GYRO_SCALE,
    SLIP,
    STATES,
    WHEEL_SCALE,
    YAW,
    FilterStates,
    MotionNoise,
    X,
    Y,
)
from agribot.autonomy.estimate.models import motion, pair_distance2, walk_across
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import ARRAYS

Mask = npt.NDArray[np.bool_]
# As ekf.Row, but a coefficient may also be an array with one element per robot.
BatchRow = tuple[tuple[int, float | FloatArray], ...]


class BatchEkf(FilterStates[FloatArray]):
    """States `x` (STATES, N) and covariance `cov` (STATES, STATES, N) of N robots."""

    def __init__(self, count: int, std: Sequence[float], row_yaw_rad: float) -> None:
        self.x: FloatArray = np.zeros((STATES, count))
        self.cov = np.zeros((STATES, STATES, count))
        for state, value in enumerate(std):
            self.cov[state, state] = value**2
        self.row_yaw_rad = row_yaw_rad
        self._outer = np.empty_like(self.cov)

    def slip_ratio(self, yaw_map_rad: FloatArray) -> FloatArray:
        ratio: FloatArray = np.cos(yaw_map_rad - self.row_yaw_rad)
        return ratio

    def predict(
        self, distance_m: FloatArray, turn_rad: FloatArray, dt_s: float, noise: MotionNoise
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, cov = self.x, self.cov
        told_rad, turn_s = turn_rad - x[GYRO_BIAS] * dt_s, (1.0 - x[GYRO_SCALE]) * dt_s
        turned_rad = told_rad - x[GYRO_SCALE] * told_rad
        dx_m, dy_m, (x_row, y_row) = motion(
            ARRAYS, x[YAW] + turned_rad / 2.0, self.row_yaw_rad, x[WHEEL_SCALE], x[SLIP],
            distance_m, told_rad, turn_s,
        )  # fmt: skip
        x[X] += dx_m
        x[Y] += dy_m
        x[YAW] = ARRAYS.wrap(x[YAW] + turned_rad)
        top = np.empty((3, *cov.shape[1:]))
        for state, row in enumerate((x_row, y_row)):
            top[state] = row[0] * cov[YAW]
            for offset in (1, 2, 3, 4):
                top[state] += row[offset] * cov[YAW + offset]
        top[YAW] = -turn_s * cov[GYRO_BIAS] - told_rad * cov[GYRO_SCALE]
        cov[:3] += top
        corner = np.empty((3, 3, cov.shape[2]))
        for state, row in enumerate((x_row, y_row)):
            corner[:, state] = row[0] * cov[:3, YAW]
            for offset in (1, 2, 3, 4):
                corner[:, state] += row[offset] * cov[:3, YAW + offset]
        corner[:, YAW] = -turn_s * cov[:3, GYRO_BIAS] - told_rad * cov[:3, GYRO_SCALE]
        cov[:3, :3] += corner
        cov[3:, :3] = cov[:3, 3:].transpose(1, 0, 2)
        xx_m2, yy_m2, xy_m2 = walk_across(
            dx_m, dy_m, distance_m, noise.across_m2_per_m - noise.along_m2_per_m
        )
        position_m2 = noise.along_m2_per_m * abs(distance_m)
        position_m2 += noise.position_m2_per_rad * abs(turned_rad)
        self.inflate(X, position_m2 + xx_m2)
        self.inflate(Y, position_m2 + yy_m2)
        cov[X, Y] += xy_m2
        cov[Y, X] += xy_m2
        self.inflate(YAW, noise.yaw_rad2_per_s * dt_s)
        return dx_m, dy_m, turned_rad

    def project(self, row: BatchRow) -> tuple[FloatArray, FloatArray]:
        """P H^T (STATES, N) and H P H^T (N,)."""
        state, weight = row[0]
        projected = self.cov[state] * weight
        for state, weight in row[1:]:
            projected += self.cov[state] * weight
        variance = np.zeros(self.cov.shape[2])
        for state, weight in row:
            variance += weight * projected[state]
        return projected, variance

    def update(
        self,
        row: BatchRow,
        residual: FloatArray,
        variance: float | FloatArray,
        gate: float = math.inf,
        mask: Mask | None = None,
    ) -> FloatArray:
        """As Ekf.update; robots outside `mask` keep their state."""
        projected, prior = self.project(row)
        total = prior + variance
        distance2: FloatArray = residual * residual / total
        self._apply(projected, residual, total, _both(distance2 <= gate, mask))
        return distance2

    def update_pair(
        self,
        rows: tuple[BatchRow, BatchRow],
        residuals: tuple[FloatArray, FloatArray],
        variance: float | FloatArray,
        gate: float = math.inf,
        mask: Mask | None = None,
    ) -> FloatArray:
        first, prior_0 = self.project(rows[0])
        _, prior_1 = self.project(rows[1])
        cross = np.zeros_like(prior_0)
        for state, weight in rows[1]:
            cross += weight * first[state]
        total_0, total_1 = prior_0 + variance, prior_1 + variance
        r0, r1 = residuals
        distance2: FloatArray = pair_distance2(r0, r1, total_0, total_1, cross)
        inside = _both(distance2 <= gate, mask)
        self._apply(first, r0, total_0, inside)
        self.update(rows[1], r1 - cross / total_0 * r0, variance, mask=inside)
        return distance2

    def _apply(
        self, projected: FloatArray, residual: FloatArray, total: FloatArray, mask: Mask
    ) -> None:
        projected *= mask  # a robot outside it gets neither gain nor knowledge
        self.x += projected * (residual / total)
        self.x[YAW] = ARRAYS.wrap(self.x[YAW])
        projected /= np.sqrt(total)
        np.multiply(projected[:, None], projected, out=self._outer)
        self.cov -= self._outer


def _both(inside: Mask, mask: Mask | None) -> Mask:
    return inside if mask is None else inside & mask
