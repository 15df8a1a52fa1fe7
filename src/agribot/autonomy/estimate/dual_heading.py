"""Heading of a second antenna as a correction of the filter."""

from __future__ import annotations

import math
from collections import Counter

from agribot.autonomy.estimate.ekf import YAW, Ekf
from agribot.autonomy.estimate.gate import Gate
from agribot.autonomy.estimate.history import MotionHistory
from agribot.core.config import EstimateConfig
from agribot.core.geo import wrap_rad
from agribot.core.messages import GnssHeading

# Multipath bends the baseline for some seconds; the receiver's sigma tells of single epochs.
STD_FACTOR = 1.1


class DualHeading:
    def __init__(
        self, ekf: Ekf, history: MotionHistory, config: EstimateConfig, rejected: Counter[str]
    ) -> None:
        self._ekf = ekf
        self._history = history
        self._gate = Gate(config.gate_sigma, config.recover_after)
        self._rejected = rejected
        self._last_t_s = -math.inf

    def update(self, heading: GnssHeading) -> None:
        now, then = self._history.newest, self._history.at(heading.t_s)
        if not (math.isfinite(heading.t_s + heading.yaw_map_rad) and heading.std_rad > 0.0):
            self._rejected["antenna heading not usable"] += 1
        elif heading.t_s <= self._last_t_s:
            self._rejected["antenna heading out of order"] += 1
        elif now is None or then is None:
            self._rejected["antenna heading without odometry"] += 1
        else:
            self._last_t_s = heading.t_s
            turned_rad = now.yaw_rad - then.yaw_rad
            ekf, gate = self._ekf, self._gate
            residual_rad = wrap_rad(heading.yaw_map_rad + turned_rad - ekf.x[YAW])
            variance = (STD_FACTOR * heading.std_rad) ** 2
            row = ((YAW, 1.0),)
            verdict = gate.judge(ekf.update(row, residual_rad, variance, gate.limit))
            if verdict == "reject":
                self._rejected["antenna heading outlier"] += 1
            elif verdict == "recover":
                ekf.inflate(YAW, residual_rad**2)
                ekf.update(row, residual_rad, variance)
