"""What truly happened to each robot; it sees the truth, the robots do not."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import clamp
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import (
    CRUSH_M,
    DT_S,
    PITCH_M,
    PLANTS,
    ROW_LENGTH_M,
    ROW_LIMIT_M,
    ROWS,
    SPACING_M,
    TICK_STEPS,
    WHEELS_BODY_M,
)  # fmt: skip

BINS, BIN_M = 3000, 0.001  # histogram of the cross-track error, up to 3 m
NEES_PERIOD_S = 1.0


class LevelOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """The protection level against the truth, in the rows of one mission.

    `exceeded` counts how often the error grew beyond the level, `exceeded_m` is the way on which
    it was; `misled` counts how often it was also beyond the limit while the level allowed work,
    `available_m` is the way on which the level did.
    """

    row_m: float
    available_m: float
    exceeded: int
    exceeded_m: float
    misled: int


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """One mission. Cross-track errors are true ones against the row worked."""

    seed: int
    success: bool
    finished: bool
    rows_ok: int
    xte_rms_m: float
    xte_p95_m: float
    xte_max_m: float
    crushed: int
    time_s: float
    nees: float | None
    nees_pose: float | None
    paused_s: float
    level: LevelOutcome | None = None


class LevelJudge:
    """Holds levels of many robots against their true errors; rows run East."""

    def __init__(self, count: int, limit_m: float) -> None:
        self._limit_m = limit_m
        self._row_m, self._available_m, self._exceeded_m = np.zeros((3, count))
        self._exceeded, self._misled = np.zeros((2, count), dtype=int)
        self._was_beyond, self._was_misled = np.zeros((2, count), dtype=bool)

    def tick(
        self, plant: RoverFleet, y_m: FloatArray, level_m: FloatArray, row: np.ndarray
    ) -> None:
        """Add a tick: where the robots believe to be across the rows, and how far off at most."""
        way_m = (row >= 0) * abs(plant.v_mps) * (TICK_STEPS * DT_S)
        error_m, may_work = abs(y_m - plant.y_m), level_m <= self._limit_m
        beyond = (row >= 0) & (error_m > level_m)
        misled = (row >= 0) & may_work & (error_m > self._limit_m)
        self._row_m += way_m
        self._available_m += way_m * may_work
        self._exceeded_m += way_m * beyond
        self._exceeded += beyond & ~self._was_beyond
        self._misled += misled & ~self._was_misled
        self._was_beyond, self._was_misled = beyond, misled

    def outcomes(self) -> list[LevelOutcome]:
        columns = (self._row_m, self._available_m, self._exceeded, self._exceeded_m, self._misled)
        return [
            LevelOutcome(row_m=way, available_m=free, exceeded=count, exceeded_m=off, misled=bad)
            for way, free, count, off, bad in zip(*(c.tolist() for c in columns), strict=True)
        ]


class FleetJudge:
    def __init__(self, count: int) -> None:
        self._row_worst_m = np.zeros((ROWS, count))
        self._square, self._samples = np.zeros(count), np.zeros(count)
        self._bins = np.zeros((count, BINS), dtype=np.int32)
        self._covered = np.zeros((ROWS, PLANTS, count), dtype=bool)
        self._crushed = np.zeros((ROWS, PLANTS, count), dtype=bool)
        self._nees, self._nees_pose, self._nees_count = np.zeros((3, count))
        self.time_s = np.zeros(count)
        self._robots = np.arange(count)

    def tick(
        self, plant: RoverFleet, row: np.ndarray, tool_on: np.ndarray, is_done: np.ndarray
    ) -> None:
        """`row` counts from y = 0; a plant is covered where the tool works beside it."""
        active = ~is_done
        self.time_s += active * (TICK_STEPS * DT_S)
        works = active & (row >= 0) & (plant.x_m >= 0.0) & (plant.x_m <= ROW_LENGTH_M)
        robots = self._robots[works]
        rows = row[works]
        error_m = abs(plant.y_m[works] - rows * PITCH_M)
        self._row_worst_m[rows, robots] = np.maximum(self._row_worst_m[rows, robots], error_m)
        self._square[robots] += error_m**2
        self._samples[robots] += 1
        self._bins[robots, np.minimum((error_m / BIN_M).astype(np.int64), BINS - 1)] += 1
        self._cover(plant, active & tool_on)
        self._crush(plant, active)

    def _cover(self, plant: RoverFleet, works: np.ndarray) -> None:
        beside = clamp(np.rint(plant.y_m / PITCH_M), 0, ROWS - 1)
        near = abs(plant.y_m - beside * PITCH_M) < ROW_LIMIT_M
        near &= works & (plant.x_m >= 0.0) & (plant.x_m <= ROW_LENGTH_M)
        slot = np.rint(plant.x_m[near] / SPACING_M).astype(np.int64)
        self._covered[beside[near].astype(np.int64), slot, self._robots[near]] = True

    def _crush(self, plant: RoverFleet, active: np.ndarray) -> None:
        cos, sin = np.cos(plant.yaw_rad), np.sin(plant.yaw_rad)
        for ahead_m, left_m in WHEELS_BODY_M:
            x_m = plant.x_m + ahead_m * cos - left_m * sin
            y_m = plant.y_m + ahead_m * sin + left_m * cos
            row = clamp(np.rint(y_m / PITCH_M), 0, ROWS - 1)
            slot = clamp(np.rint(x_m / SPACING_M), 0, PLANTS - 1)
            square = (x_m - slot * SPACING_M) ** 2 + (y_m - row * PITCH_M) ** 2
            hit = active & (square < CRUSH_M**2)
            if hit.any():
                robots = self._robots[hit]
                self._crushed[row[hit].astype(int), slot[hit].astype(int), robots] = True

    def check_covariance(
        self, plant: RoverFleet, x_m: FloatArray, y_m: FloatArray, yaw_rad: FloatArray,
        cov: FloatArray, row: np.ndarray,
    ) -> None:  # fmt: skip
        """Squared errors over variances: lateral (expected 1) and of the whole pose (3)."""
        works = row >= 0
        error = np.stack([x_m - plant.x_m, y_m - plant.y_m, yaw_rad - plant.yaw_rad])
        error[2] -= 2.0 * np.pi * np.rint(error[2] / (2.0 * np.pi))
        self._nees += works * error[1] ** 2 / cov[1, 1]
        solved = np.linalg.solve(cov.transpose(2, 0, 1), error.T[:, :, None])[:, :, 0]
        self._nees_pose += works * (solved * error.T).sum(axis=1)
        self._nees_count += works

    def outcomes(
        self, seeds: list[int], is_done: np.ndarray, paused_s: FloatArray, *, has_filter: bool
    ) -> list[Outcome]:
        covered = self._covered.sum(axis=1) >= PLANTS - 1
        rows_ok = ((self._row_worst_m < ROW_LIMIT_M) & covered).sum(axis=0)
        crushed = self._crushed.sum(axis=(0, 1))
        few = crushed <= 0.01 * ROWS * PLANTS
        success = is_done & (rows_ok == ROWS) & few
        shares = self._bins.cumsum(axis=1) / np.maximum(self._samples, 1)[:, None]
        p95_m = (shares < 0.95).sum(axis=1) * BIN_M
        samples, checks = np.maximum(self._samples, 1), np.maximum(self._nees_count, 1)
        return [
            Outcome(
                seed=seed, success=bool(success[i]), finished=bool(is_done[i]),
                rows_ok=int(rows_ok[i]), xte_rms_m=float(np.sqrt(self._square[i] / samples[i])),
                xte_p95_m=float(p95_m[i]), xte_max_m=float(self._row_worst_m[:, i].max()),
                crushed=int(crushed[i]), time_s=float(self.time_s[i]),
                nees=float(self._nees[i] / checks[i]) if has_filter else None,
                nees_pose=float(self._nees_pose[i] / checks[i]) if has_filter else None,
                paused_s=float(paused_s[i]),
            )
            for i, seed in enumerate(seeds)
        ]  # fmt: skip
