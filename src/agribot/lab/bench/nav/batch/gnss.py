"""As agribot.autonomy.estimate.gnss, for many robots whose receivers are of one kind."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.estimate.ekf import (
    GNSS_BIAS_X,
    GNSS_BIAS_Y,
    SLIP,
    WAY_X,
    WAY_Y,
    WHEEL_SCALE,
    YAW,
    X,
    Y,
)
from agribot.autonomy.estimate.gnss import FIRST_FIXES, UNKNOWN_M2
from agribot.autonomy.estimate.gnss_noise import (
    BEND2_MEDIAN,
    FLOAT_MEMORY_S,
    JUMP2_MEDIAN,
    LEAST_JUMPS,
    MOST_JUMPS,
    STEADY_FIXES,
    FixNoise,
    bias_ageing,
    is_even,
    is_steady,
    noise_model,
    widen,
)
from agribot.autonomy.estimate.lost_way import (
    LOST_MPS,
    LOST_S,
    STILL_SIGMA2,
    are_fixes_vague,
    can_be_of_wheels,
    have_lost_way,
)
from agribot.autonomy.estimate.models import antenna_velocity, velocity_variance
from agribot.autonomy.estimate.spin_watch import SpinWatch, ahead_and_aside, doubts
from agribot.autonomy.estimate.start import StartMark
from agribot.autonomy.estimate.velocity_way import MAX_GAP_S
from agribot.core.config import EstimateConfig
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import ARRAYS
from agribot.lab.bench.nav.batch.ekf import BatchEkf, BatchRow, Mask
from agribot.lab.bench.nav.batch.motion import BatchGate, BatchHistory, BatchMotion

Pair = tuple[FloatArray, FloatArray]
ComplexArray = npt.NDArray[np.complex128]


class BatchFix(NamedTuple):
    """One epoch of all receivers, at their antennas; arrays (N,), metres in the map."""

    t_s: float
    east_m: FloatArray
    north_m: FloatArray
    pos_std_m: FloatArray
    is_float: Mask
    east_mps: FloatArray
    north_mps: FloatArray
    velocity_std_mps: float


class BatchPositionNoise:
    """As autonomy.estimate.gnss_noise.PositionNoise."""

    def __init__(self, count: int) -> None:
        self._places: deque[tuple[float, FloatArray]] = deque(maxlen=2)
        self._bends2: deque[FloatArray] = deque(maxlen=MOST_JUMPS)
        self.std_m = np.zeros(count)

    def add(self, t_s: float, place_m: FloatArray) -> None:
        """Take places (2, N) less the way of the wheels."""
        if len(self._places) == 2:
            (first_s, first_m), (last_s, last_m) = self._places
            if is_even(last_s - first_s, t_s - last_s):
                self._bends2.append(np.sum((place_m - 2.0 * last_m + first_m) ** 2, axis=0))
        self._places.append((t_s, place_m))
        if len(self._bends2) >= LEAST_JUMPS:
            self.std_m = np.sqrt(np.median(self._bends2, axis=0) / BEND2_MEDIAN)


class BatchVelocityNoise:
    """As autonomy.estimate.gnss_noise.VelocityNoise."""

    def __init__(self, count: int) -> None:
        self._jumps2: deque[FloatArray] = deque(maxlen=MOST_JUMPS)
        self._recent: deque[Pair] = deque(maxlen=STEADY_FIXES)
        self.std_mps = np.zeros(count)

    @property
    def is_known(self) -> bool:
        return len(self._jumps2) >= LEAST_JUMPS

    def add(self, residuals: Pair) -> None:
        last = self._recent[-1] if self._recent else residuals
        self._recent.append(residuals)
        if len(self._recent) == 1:
            return
        self._jumps2.append((residuals[0] - last[0]) ** 2 + (residuals[1] - last[1]) ** 2)
        if self.is_known:
            self.std_mps = np.sqrt(np.median(self._jumps2, axis=0) / JUMP2_MEDIAN)

    @property
    def is_steady(self) -> Mask | bool:
        return len(self._recent) == STEADY_FIXES and is_steady(ARRAYS, self._recent)


class BatchGnss:
    """`is_corrected`: receivers with RTK corrections, with fixed or float ambiguities."""

    def __init__(
        self,
        ekf: BatchEkf,
        history: BatchHistory,
        config: EstimateConfig,
        antenna_body_m: tuple[float, float],
        start: StartMark,
        *,
        is_corrected: bool,
    ) -> None:
        count = ekf.x.shape[1]
        self.is_ready = False
        self._ekf, self._history, self._start = ekf, history, start
        self._lever_m = antenna_body_m
        self._is_corrected = is_corrected
        self._position_gate = BatchGate(count, config.gate_sigma, config.recover_after)
        self._spin_after = max(2, config.recover_after // 3)
        self._velocity_gate = BatchGate(count, config.gate_sigma, self._spin_after)
        self._spin_watch = SpinWatch(ARRAYS, self._spin_after)
        self._position_noise = BatchPositionNoise(count)
        self._velocity_noise = BatchVelocityNoise(count)
        self._first: list[Pair] = []
        self._noise: FixNoise[FloatArray] | None = None
        self._last_t_s = -math.inf
        self._receiver_m = np.zeros((2, count))
        self._lost_t_s = np.full(count, -math.inf)
        self._told: tuple[float, ComplexArray, ComplexArray] | None = None  # as lost_way.ToldWay

    def update(self, fix: BatchFix) -> None:
        now, then = self._history.newest, self._history.at(fix.t_s)
        if now is None or then is None:
            return
        since_last_s = min(fix.t_s - self._last_t_s, FLOAT_MEMORY_S)
        antenna_m, arm_m = self._find_antenna(fix, now, then)
        self._position_noise.add(fix.t_s, antenna_m - arm_m - np.stack((then.x_m, then.y_m)))
        stated = self._noise_of(fix, since_last_s)
        self._noise = widen(ARRAYS, stated, self._position_noise.std_m)
        self._last_t_s = fix.t_s
        if not self.is_ready:
            for state in (GNSS_BIAS_X, GNSS_BIAS_Y):
                self._ekf.reset(state, 0.0, self._noise.bias_std_m**2)
        self._position(fix, self._noise, (antenna_m, arm_m), now, then)
        if self.is_ready:
            self._velocity(fix, since_last_s, now, then)

    def _noise_of(self, fix: BatchFix, since_last_s: float) -> FixNoise[FloatArray]:
        return noise_model(
            ARRAYS, fix.pos_std_m, fix.is_float, since_last_s, is_corrected=self._is_corrected
        )

    def ageing(self, dt_s: float) -> Sequence[tuple[int, FloatArray | float, FloatArray | float]]:
        return [] if self._noise is None else bias_ageing(ARRAYS, self._noise, dt_s)

    def _find_antenna(
        self, fix: BatchFix, now: BatchMotion, then: BatchMotion
    ) -> tuple[FloatArray, FloatArray]:
        """Find antennas in the map, and from the robots' middles; (2, N)."""
        yaw_rad = self._ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        arm_x = cos * self._lever_m[0] - sin * self._lever_m[1]
        arm_y = sin * self._lever_m[0] + cos * self._lever_m[1]
        return np.stack((fix.east_m, fix.north_m)), np.stack((arm_x, arm_y))

    def _position(
        self,
        fix: BatchFix,
        noise: FixNoise[FloatArray],
        antenna: tuple[FloatArray, FloatArray],
        now: BatchMotion,
        then: BatchMotion,
    ) -> None:
        x, (antenna_m, arm_m) = self._ekf.x, antenna
        moved_m = np.stack((now.x_m - then.x_m, now.y_m - then.y_m))
        now_x, now_y = antenna_m - arm_m + moved_m - self._receiver_m
        if not self.is_ready:
            first_m2 = self._noise_of(fix, FLOAT_MEMORY_S).variance_m2
            self._begin(now_x, now_y, first_m2, fix.is_float, now)
            return
        rows: tuple[BatchRow, BatchRow] = (
            ((X, 1.0), (YAW, moved_m[1] - arm_m[1]), (GNSS_BIAS_X, 1.0)),
            ((Y, 1.0), (YAW, arm_m[0] - moved_m[0]), (GNSS_BIAS_Y, 1.0)),
        )
        residuals = (now_x - x[X] - x[GNSS_BIAS_X], now_y - x[Y] - x[GNSS_BIAS_Y])
        self._correct_position(rows, residuals, noise)

    def _begin(
        self,
        x_m: FloatArray,
        y_m: FloatArray,
        variance_m2: FloatArray | float,
        is_float: Mask,
        now: BatchMotion,
    ) -> None:
        self._first.append((x_m - now.x_m, y_m - now.y_m))
        if len(self._first) < FIRST_FIXES:
            return
        seen_m = [
            np.median([p[axis] for p in self._first], axis=0) + moved
            for axis, moved in enumerate((now.x_m, now.y_m))
        ]
        mark_m = self._start.xy_map_m
        uses_mark = np.full_like(x_m, mark_m is not None, dtype=bool)
        if self._is_corrected:
            uses_mark &= is_float
        at_m2 = np.where(uses_mark, self._start.std_m**2, UNKNOWN_M2)
        residuals = []
        for axis, state, moved in ((0, X, now.x_m), (1, Y, now.y_m)):
            marked_m = moved + (0.0 if mark_m is None else mark_m[axis])
            at_m = np.where(uses_mark, marked_m, seen_m[axis])
            self._ekf.reset(state, at_m, at_m2)
            residuals.append(seen_m[axis] - at_m)
        rows: tuple[BatchRow, BatchRow] = (
            ((X, 1.0), (GNSS_BIAS_X, 1.0)),
            ((Y, 1.0), (GNSS_BIAS_Y, 1.0)),
        )
        self._ekf.update_pair(rows, (residuals[0], residuals[1]), variance_m2)
        self.is_ready = True

    def _correct_position(
        self, rows: tuple[BatchRow, BatchRow], residuals: Pair, noise: FixNoise[FloatArray]
    ) -> None:
        gate, ekf = self._position_gate, self._ekf
        _, recovers = gate.evaluate(ekf.update_pair(rows, residuals, noise.variance_m2, gate.limit))
        if not recovers.any():
            return
        if not self._is_corrected:
            self._receiver_m += recovers * np.stack(residuals)
            ekf.inflate(GNSS_BIAS_X, np.where(recovers, noise.variance_m2, 0.0))
            ekf.inflate(GNSS_BIAS_Y, np.where(recovers, noise.variance_m2, 0.0))
            return
        for state, residual in zip((X, Y), residuals, strict=True):
            ekf.inflate(state, recovers * (residual**2 + noise.variance_m2))
        ekf.update_pair(rows, residuals, noise.variance_m2, mask=recovers)

    def _velocity(
        self, fix: BatchFix, since_last_s: float, now: BatchMotion, then: BatchMotion
    ) -> None:
        ekf, gate = self._ekf, self._velocity_gate
        yaw_rad = ekf.x[YAW] - (now.yaw_rad - then.yaw_rad)
        east_mps, north_mps, (east_row, north_row) = antenna_velocity(
            ARRAYS, yaw_rad, ekf.row_yaw_rad, ekf.x[WHEEL_SCALE], ekf.x[SLIP], then.wheel_mps,
            then.yaw_rate_radps, self._lever_m,
        )  # fmt: skip
        residuals = (fix.east_mps - east_mps, fix.north_mps - north_mps)
        self._velocity_noise.add(residuals)
        variance = velocity_variance(
            ARRAYS, fix.velocity_std_mps, self._velocity_noise.std_mps, then.yaw_rate_radps,
            since_last_s,
        )  # fmt: skip
        rows = (_velocity_row(east_row), _velocity_row(north_row))
        leads = self._lead(fix, rows, variance, then, yaw_rad)
        _, recovers = gate.evaluate(ekf.update_pair(rows, residuals, variance, gate.limit))
        claimed_mps, _ = ahead_and_aside(ARRAYS, (east_mps, north_mps), yaw_rad)
        missing_mps = ahead_and_aside(ARRAYS, residuals, yaw_rad)
        spins = self._spin_watch.is_spinning(claimed_mps, missing_mps, np.sqrt(variance))
        spins = np.asarray(spins) & self._velocity_noise.is_known & self._velocity_noise.is_steady
        recovers = (recovers | spins) & self._velocity_noise.is_steady
        if recovers.any():
            opened = doubts(
                ARRAYS, residuals, (east_mps, north_mps), yaw_rad, self._spin_watch.aside_mps,
                (then.wheel_mps, then.yaw_rate_radps), since_last_s * self._spin_after,
                is_corrected=self._is_corrected,
            )  # fmt: skip
            for state, doubt in opened:
                opens = recovers & ~(leads | spins) if state == YAW else recovers
                ekf.inflate(state, opens * doubt**2)
            ekf.update_pair(rows, residuals, variance, mask=recovers)

    def _lead(
        self,
        fix: BatchFix,
        rows: tuple[BatchRow, BatchRow],
        variance: FloatArray,
        then: BatchMotion,
        yaw_rad: FloatArray,
    ) -> Mask:
        """As GnssVelocity._lead, and the correction by it; whose velocities lead."""
        last, (ahead_m, left_m) = self._told, self._lever_m
        velocity_mps = fix.east_mps + 1j * fix.north_mps
        arm_m = np.exp(1j * yaw_rad) * complex(ahead_m, left_m)
        here = self._told = (fix.t_s, velocity_mps, then.x_m + 1j * then.y_m + arm_m)
        step_s = math.inf if last is None else here[0] - last[0]
        if last is None or step_s > MAX_GAP_S:
            return np.zeros_like(yaw_rad, dtype=bool)
        mean_mps = (last[1] + velocity_mps) / 2.0
        off_mps = mean_mps - (here[2] - last[2]) / step_s
        off_ahead_mps, _ = ahead_and_aside(ARRAYS, (off_mps.real, off_mps.imag), yaw_rad)
        shown_ahead, shown_aside = ahead_and_aside(ARRAYS, (mean_mps.real, mean_mps.imag), yaw_rad)
        rate_radps = then.yaw_rate_radps
        sure = velocity_variance(
            ARRAYS, fix.velocity_std_mps, self._velocity_noise.std_mps, 0.0 * rate_radps, step_s
        )
        is_lost = have_lost_way(off_ahead_mps, variance, self._velocity_noise.is_steady)
        self._lost_t_s = np.where(is_lost, fix.t_s, self._lost_t_s)
        shown_mps = (shown_ahead + rate_radps * left_m, shown_aside - rate_radps * ahead_m)
        is_vague = are_fixes_vague(
            rate_radps, is_corrected=self._is_corrected, is_float=fix.is_float
        )
        is_off = off_mps.real**2 + off_mps.imag**2 > STILL_SIGMA2 * sure
        leads = is_vague | ((fix.t_s - self._lost_t_s <= LOST_S) & is_off)
        leads &= can_be_of_wheels(ARRAYS, shown_mps, (then.wheel_mps, rate_radps), np.sqrt(sure))
        if leads.any():
            ekf, (east, north) = self._ekf, rows
            ekf.doubt_way(np.where(leads, (LOST_MPS * step_s) ** 2, 0.0))
            ways = ((*east, (WAY_X, 1.0 / step_s)), (*north, (WAY_Y, 1.0 / step_s)))
            ekf.update_pair(ways, (off_mps.real, off_mps.imag), sure, mask=leads)
            ekf.forget_way()
        return np.asarray(leads)


def _velocity_row(by: tuple[FloatArray, ...]) -> BatchRow:
    return (YAW, by[0]), (WHEEL_SCALE, by[1]), (SLIP, by[2])
