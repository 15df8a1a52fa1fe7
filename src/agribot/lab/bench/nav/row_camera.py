"""A camera on the rows, as parameters: line, outliers, dropouts, ends."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import ARRAYS, clamp
from agribot.lab.bench.nav.batch.ekf import Mask
from agribot.lab.bench.nav.batch.row_lines import BatchLine
from agribot.lab.bench.nav.draws import Coins, Draws, wander
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import DT_S, PITCH_M, ROW_LENGTH_M, ROWS, Vision

PERIOD_STEPS = 7
MAX_HEADING_RAD, MAX_OFFSET_M = math.radians(25.0), 0.45
VIEW_M, MIN_ROW_IN_VIEW_M = (0.2, 1.2), 0.4
START_RANGE_M, END_RANGE_M = (0.3, 1.1), (0.2, 1.2)
START_RATIO, END_EVERY = 0.5, 3
WANDER_RATIO, WANDER_S = 0.8, 2.0


class RowCamera:
    def __init__(self, seeds: Sequence[int], vision: Vision) -> None:
        self._vision = vision
        self._draws, self._coins = Draws(seeds, 10, 8), Coins(seeds, 11, 4)
        self._offset_m, self._heading_rad, self._dark_s = np.zeros((3, len(seeds)))
        self._frames = 0

    def sample(self, t_s: float, plant: RoverFleet) -> BatchLine:
        vision, normal, coin = self._vision, self._draws.normals(), self._coins.uniforms()
        dt_s = PERIOD_STEPS * DT_S
        self._frames += 1
        lasting_m = WANDER_RATIO * vision.offset_std_m
        self._offset_m = wander(self._offset_m, lasting_m, WANDER_S, dt_s, normal[0])
        self._heading_rad = wander(
            self._heading_rad, vision.heading_wander_rad, WANDER_S, dt_s, normal[1]
        )
        dark = self._dark_s > 0.0
        goes_dark = ~dark & (coin[0] < dt_s / vision.dropout_every_s)
        lasts_s = vision.dropout_min_s + (vision.dropout_max_s - vision.dropout_min_s) * coin[1]
        self._dark_s = np.where(goes_dark, lasts_s, self._dark_s - dt_s * dark)
        sign = np.where(np.cos(plant.yaw_rad) > 0.0, 1.0, -1.0)
        row = np.rint(plant.y_m / PITCH_M)
        beside_m = plant.y_m - row * PITCH_M
        heading_rad = ARRAYS.wrap(plant.yaw_rad - np.where(sign > 0.0, 0.0, math.pi))
        near_m, far_m = plant.x_m + sign * VIEW_M[0], plant.x_m + sign * VIEW_M[1]
        first_m = clamp(np.minimum(near_m, far_m), 0.0, ROW_LENGTH_M)
        in_view_m = clamp(np.maximum(near_m, far_m), 0.0, ROW_LENGTH_M) - first_m
        looks = (
            (row >= 0.0) & (row < ROWS) & (abs(beside_m) < MAX_OFFSET_M)
            & (abs(heading_rad) < MAX_HEADING_RAD) & ~(self._dark_s > 0.0)
        )  # fmt: skip
        outlier = coin[2] < vision.outlier_ratio
        sees = looks & (in_view_m > MIN_ROW_IN_VIEW_M)
        seen_m = sign * beside_m + self._offset_m + vision.offset_std_m * normal[2]
        seen_m = seen_m + outlier * vision.outlier_m * normal[3]
        seen_rad = heading_rad + self._heading_rad + vision.heading_std_rad * normal[4]
        seen_rad = seen_rad + outlier * vision.outlier_rad * normal[5]
        start_m = (np.where(sign > 0.0, 0.0, ROW_LENGTH_M) - plant.x_m) * sign
        end_m = start_m + ROW_LENGTH_M
        sees_start = looks & _within(start_m, START_RANGE_M) & (coin[3] < START_RATIO)
        sees_end = sees & _within(end_m, END_RANGE_M) & (self._frames % END_EVERY == 0)
        return BatchLine(
            t_s=t_s,
            offset_m=np.where(sees, seen_m, math.nan),
            heading_rad=np.where(sees, seen_rad, math.nan),
            start_ahead_m=np.where(sees_start, start_m + vision.range_std_m * normal[6], math.nan),
            end_ahead_m=np.where(sees_end, end_m + vision.range_std_m * normal[7], math.nan),
            offset_std_m=vision.stated_ratio * vision.offset_std_m,
            heading_std_rad=vision.stated_ratio * vision.heading_std_rad,
            range_std_m=vision.range_std_m,
        )


def _within(value: FloatArray, limits: tuple[float, float]) -> Mask:
    inside: Mask = (value > limits[0]) & (value < limits[1])
    return inside
