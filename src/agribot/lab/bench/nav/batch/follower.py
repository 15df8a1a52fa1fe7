"""As agribot.autonomy.control.follower, for many robots that drive the same path."""

from __future__ import annotations

import numpy as np

from agribot.autonomy.control import law
from agribot.autonomy.control.follower import (
    NOMINAL_DT_S,
    PIVOT_ENTER_RAD,
    PIVOT_GAIN_PER_S,
    PIVOT_LEAVE_RAD,
)
from agribot.autonomy.control.yaw_gain import (
    HIGHEST_RATIO,
    LOWEST_RATIO,
    MEMORY_S,
    MIN_MOVING_RATIO,
    MIN_RATE_RADPS,
    PRIOR_RAD2PS,
)
from agribot.core.config import ControlConfig
from agribot.core.messages import FloatArray, Path
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.arrays import ARRAYS, clamp

BatchPose = tuple[FloatArray, FloatArray, FloatArray]


class BatchYawGain:
    def __init__(self, count: int, lag_s: float) -> None:
        self._lag_s = lag_s
        self._expected_radps = np.zeros(count)
        self._together = np.full(count, PRIOR_RAD2PS)
        self._power = np.full(count, PRIOR_RAD2PS)

    @property
    def ratio(self) -> FloatArray:
        ratio: FloatArray = clamp(self._together / self._power, LOWEST_RATIO, HIGHEST_RATIO)
        return ratio

    def learn(
        self,
        sent_v_mps: FloatArray,
        sent_radps: FloatArray,
        v_mps: FloatArray,
        yaw_rate_radps: FloatArray,
        dt_s: float,
    ) -> None:
        self._expected_radps += (sent_radps - self._expected_radps) * dt_s / (self._lag_s + dt_s)
        expected_radps = self._expected_radps
        asked_mps = MIN_MOVING_RATIO * sent_v_mps
        learns = (v_mps > asked_mps) & (asked_mps > 0.0) & (abs(expected_radps) >= MIN_RATE_RADPS)
        kept = 1.0 - dt_s / MEMORY_S
        together = kept * self._together + expected_radps * yaw_rate_radps * dt_s
        power = kept * self._power + expected_radps * expected_radps * dt_s
        self._together = np.where(learns, together, self._together)
        self._power = np.where(learns, power, self._power)


class BatchFollower:
    """Commands of N robots, each at its own place on one path."""

    def __init__(self, count: int, config: ControlConfig, robot: RobotSpec, path: Path) -> None:
        self._config, self._drive, self._path = config, robot.drive, path
        self._max_yaw_rate_radps = min(config.max_yaw_rate_radps, robot.drive.max_yaw_rate_radps)
        self.v_mps, self.yaw_rate_radps = np.zeros(count), np.zeros(count)
        self._is_pivoting = np.zeros(count, dtype=bool)
        self._yaw_gain = BatchYawGain(count, max(config.delay_s, NOMINAL_DT_S))

    def step(
        self,
        pose: BatchPose,
        v_mps: FloatArray,
        yaw_rate_radps: FloatArray,
        slip_rad: FloatArray,
        s_m: FloatArray,
        max_speed_mps: FloatArray,
        dt_s: float,
    ) -> None:
        """Set `v_mps` and `yaw_rate_radps`; where `max_speed_mps` is 0 the robot halts."""
        self._yaw_gain.learn(self.v_mps, self.yaw_rate_radps, v_mps, yaw_rate_radps, dt_s)
        there = law.ahead(ARRAYS, pose, v_mps, yaw_rate_radps, slip_rad, self._config.delay_s)
        errors = self.errors(s_m, *there)
        goes = max_speed_mps > 0.0
        limit_rad = np.where(self._is_pivoting, PIVOT_LEAVE_RAD, PIVOT_ENTER_RAD)
        self._is_pivoting = np.where(goes, abs(errors[1]) > limit_rad, self._is_pivoting)
        wanted_v, wanted_rate = law.steer(
            ARRAYS, errors, slip_rad, np.where(goes, max_speed_mps, 1.0), self._yaw_gain.ratio,
            self._config.length_m, self._max_yaw_rate_radps,
        )  # fmt: skip
        pivot_rate = law.clamp(ARRAYS, -PIVOT_GAIN_PER_S * errors[1], self._max_yaw_rate_radps)
        wanted_v = np.where(goes & ~self._is_pivoting, wanted_v, 0.0)
        wanted_rate = np.where(goes, np.where(self._is_pivoting, pivot_rate, wanted_rate), 0.0)
        drive = self._drive
        self.v_mps = law.ramp(ARRAYS, wanted_v, self.v_mps, drive.max_accel_mps2 * dt_s)
        self.yaw_rate_radps = law.ramp(
            ARRAYS, wanted_rate, self.yaw_rate_radps, drive.max_yaw_accel_radps2 * dt_s
        )

    def errors(
        self, s_m: FloatArray, x_m: FloatArray, y_m: FloatArray, yaw_rad: FloatArray
    ) -> BatchPose:
        """Cross-track, heading error and curvature at the points of the path beside the poses."""
        path = self._path
        index = self._index(s_m)
        for _ in range(2):
            along_m, left_m = self._offset(index, x_m, y_m)
            curvature = path.curvature_radpm[index]
            bent = np.where(curvature == 0.0, 1.0, curvature)
            arc_m = np.arctan2(bent * along_m, 1.0 - bent * left_m) / bent
            index = self._index(path.s_m[index] + np.where(curvature == 0.0, along_m, arc_m))
        _, left_m = self._offset(index, x_m, y_m)
        heading_rad = ARRAYS.wrap(yaw_rad - path.yaw_map_rad[index])
        return left_m, heading_rad, path.curvature_radpm[index]

    def _index(self, s_m: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        index = np.searchsorted(self._path.s_m, s_m, side="right") - 1
        return np.minimum(np.maximum(index, 0), len(self._path.s_m) - 1)

    def _offset(
        self,
        index: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
        x_m: FloatArray,
        y_m: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        xy_m = self._path.xy_map_m[index]
        yaw_rad = self._path.yaw_map_rad[index]
        return law.offset(ARRAYS, x_m - xy_m[:, 0], y_m - xy_m[:, 1], yaw_rad)
