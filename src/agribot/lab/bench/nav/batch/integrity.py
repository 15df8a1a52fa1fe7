"""The level of `autonomy.estimate.integrity` across the rows, for many robots on level ground.

As there, but for what a robot remembers of faults: rejected fixes, and a split that lasts; and in
turns it follows the wheels with corrections, too, so that the level behind a turn is the wider one.
"""

from __future__ import annotations

from collections import deque
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate.ekf import SLIP, WHEEL_SCALE, YAW, Y
from agribot.autonomy.estimate.integrity import (
    ANCHOR_AGE_S,
    ANCHOR_PERIOD_S,
    FAULT_RATIO,
    MAX_LOST_RATIO,
    TURN_LOSS_STD_RATIO,
    TURN_RADIUS_M,
)
from agribot.core.config import EstimateConfig
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import clamp
from agribot.lab.bench.nav.batch.ekf import BatchEkf, Mask


class _Anchor(NamedTuple):
    """Arrays (N,): the filter's place across the rows less the dead-reckoned one, and the ways."""

    t_s: float
    off_m: FloatArray
    variance_m2: FloatArray
    course_rad2: FloatArray
    slip: FloatArray
    driven_m: FloatArray
    aside_m: FloatArray
    turning_m: FloatArray


class BatchIntegrity:
    """Call `move` with every step of wheels and gyro, `bound` for the levels now; rows run East."""

    def __init__(self, ekf: BatchEkf, config: EstimateConfig) -> None:
        count = ekf.x.shape[1]
        self._ekf = ekf
        risk = config.protection_risk
        self._gain, self._fault_gain = _normal(risk), _normal(risk / FAULT_RATIO)
        self._walk2_m = config.position_walk_m_per_sqrt_m**2
        self._y_m, self._driven_m, self._aside_m, self._turning_m = np.zeros((4, count))
        self._anchors: deque[_Anchor] = deque()

    def move(self, distance_m: FloatArray, turn_rad: FloatArray) -> None:
        x = self._ekf.x
        way_m = distance_m * (1.0 - clamp(x[WHEEL_SCALE], -MAX_LOST_RATIO, MAX_LOST_RATIO))
        self._y_m = self._y_m + way_m * np.sin(x[YAW])
        self._driven_m = self._driven_m + abs(way_m)
        turning_m = np.minimum(abs(way_m), TURN_RADIUS_M * abs(turn_rad))
        self._turning_m = self._turning_m + turning_m
        self._aside_m = self._aside_m + abs(way_m) * np.cos(x[YAW]) ** 2

    def bound(self, t_s: float, is_held: Mask) -> FloatArray:
        """Give the level of each robot across the rows, m (N,); the camera holds some of them."""
        here = self._here(t_s)
        anchors = self._anchors
        if not anchors or t_s - anchors[-1].t_s >= ANCHOR_PERIOD_S:
            anchors.append(here)
        while t_s - anchors[0].t_s > ANCHOR_AGE_S and len(anchors) > 1:
            anchors.popleft()
        then = anchors[0]
        apart_m = here.off_m - then.off_m - then.slip * (here.aside_m - then.aside_m)
        way_m = here.driven_m - then.driven_m
        lost_m = TURN_LOSS_STD_RATIO * (here.turning_m - then.turning_m)
        alone_m2 = then.variance_m2 + self._walk2_m * way_m + then.course_rad2 * way_m**2
        split_m = abs(apart_m) + self._fault_gain * np.sqrt(alone_m2 + lost_m**2)
        plain_m = self._gain * np.sqrt(here.variance_m2)
        return np.where(is_held, plain_m, np.maximum(plain_m, split_m))

    def _here(self, t_s: float) -> _Anchor:
        x, cov = self._ekf.x, self._ekf.cov
        return _Anchor(
            t_s=t_s, off_m=x[Y] - self._y_m, variance_m2=cov[Y, Y].copy(),
            course_rad2=cov[YAW, YAW] + cov[SLIP, SLIP], slip=x[SLIP].copy(),
            driven_m=self._driven_m, aside_m=self._aside_m, turning_m=self._turning_m,
        )  # fmt: skip


def _normal(risk_ratio: float) -> float:
    return NormalDist().inv_cdf(1.0 - risk_ratio / 2.0)
