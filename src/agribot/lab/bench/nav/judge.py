"""What truly happened to the robot; it sees the truth, the robot does not."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.geo import wrap_rad
from agribot.core.messages import Estimate
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.scenario import (
    CRUSH_M,
    PITCH_M,
    PLANTS,
    ROW_LENGTH_M,
    ROW_LIMIT_M,
    SPACING_M,
    TICK_S,
    WHEELS_BODY_M,
)

NEES_PERIOD_S = 1.0
MISSED_PLANTS = 1  # missed plants of a row that counts as worked all the same
MAX_CRUSHED_RATIO = 0.01


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
    """One mission. Cross-track errors are true ones against the row worked.

    `reason` is what the robot says at the end of a mission that it did not finish, `cpu_s` is the
    CPU time of the mission: plant, sensors, robot and judge.
    """

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
    reason: str = ""
    cpu_s: float = 0.0


class LevelJudge:
    """Holds the level of a robot against its true error; rows run East."""

    def __init__(self, limit_m: float) -> None:
        self._limit_m = limit_m
        self._row_m = self._available_m = self._exceeded_m = 0.0
        self._exceeded = self._misled = 0
        self._was_beyond = self._was_misled = False

    def tick(self, rover: SoilRover, y_m: float, level_m: float, row: int) -> None:
        """Add a tick: where the robot believes to be across the rows, and how far off at most."""
        is_in_row, way_m = row >= 0, abs(rover.v_mps) * TICK_S
        error_m, may_work = abs(y_m - rover.y_m), level_m <= self._limit_m
        is_beyond = is_in_row and error_m > level_m
        is_misled = is_in_row and may_work and error_m > self._limit_m
        self._row_m += way_m * is_in_row
        self._available_m += way_m * (is_in_row and may_work)
        self._exceeded_m += way_m * is_beyond
        self._exceeded += is_beyond and not self._was_beyond
        self._misled += is_misled and not self._was_misled
        self._was_beyond, self._was_misled = is_beyond, is_misled

    def outcome(self) -> LevelOutcome:
        return LevelOutcome(
            row_m=self._row_m, available_m=self._available_m, exceeded=self._exceeded,
            exceeded_m=self._exceeded_m, misled=self._misled,
        )  # fmt: skip


class Consistency:
    """Squared errors of a pose over its variances: lateral (expected 1) and of all of it (3)."""

    def __init__(self) -> None:
        self._lateral = self._pose = 0.0
        self._count = 0

    def add(self, rover: SoilRover, estimate: Estimate) -> None:
        error = np.array([
            estimate.x_map_m - rover.x_m, estimate.y_map_m - rover.y_m,
            wrap_rad(estimate.yaw_map_rad - rover.yaw_rad),
        ])  # fmt: skip
        cov = np.array(estimate.pose_cov).reshape(3, 3)
        self._lateral += float(error[1] ** 2 / cov[1, 1])
        self._pose += float(error @ np.linalg.solve(cov, error))
        self._count += 1

    def means(self) -> tuple[float, float] | tuple[None, None]:
        """Return lateral and pose; None where there was no pose in a row."""
        if not self._count:
            return None, None
        return self._lateral / self._count, self._pose / self._count


class MissionJudge:
    """Measures one mission in a field of `rows` rows, whose first one lies at y = 0."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._errors_m: list[float] = []
        self._worst_m = [0.0] * rows
        self._covered: list[set[int]] = [set() for _ in range(rows)]
        self._crushed: set[tuple[int, int]] = set()
        self._ticks = 0

    def tick(self, rover: SoilRover, row: int, *, tool_on: bool) -> None:
        """Add a tick; a plant is covered where the tool works beside it.

        `row` is the one that the robot works, counted from y = 0; -1 between the rows.
        """
        self._ticks += 1
        is_beside_plants = 0.0 <= rover.x_m <= ROW_LENGTH_M
        if row >= 0 and is_beside_plants:
            error_m = abs(rover.y_m - row * PITCH_M)
            self._errors_m.append(error_m)
            self._worst_m[row] = max(self._worst_m[row], error_m)
        beside = self._row_near(rover.y_m)
        if tool_on and is_beside_plants and abs(rover.y_m - beside * PITCH_M) < ROW_LIMIT_M:
            self._covered[beside].add(round(rover.x_m / SPACING_M))
        self._crush(rover)

    def _row_near(self, y_m: float) -> int:
        return clamp(round(y_m / PITCH_M), 0, self._rows - 1)

    def _crush(self, rover: SoilRover) -> None:
        cos, sin = math.cos(rover.yaw_rad), math.sin(rover.yaw_rad)
        for ahead_m, left_m in WHEELS_BODY_M:
            x_m = rover.x_m + ahead_m * cos - left_m * sin
            y_m = rover.y_m + ahead_m * sin + left_m * cos
            row, slot = self._row_near(y_m), clamp(round(x_m / SPACING_M), 0, PLANTS - 1)
            if (x_m - slot * SPACING_M) ** 2 + (y_m - row * PITCH_M) ** 2 < CRUSH_M**2:
                self._crushed.add((row, slot))

    def outcome(self, seed: int, *, is_done: bool) -> Outcome:
        errors_m = np.array(self._errors_m or [0.0])
        rows_ok = sum(
            worst_m < ROW_LIMIT_M and len(covered) >= PLANTS - MISSED_PLANTS
            for worst_m, covered in zip(self._worst_m, self._covered, strict=True)
        )
        few = len(self._crushed) <= MAX_CRUSHED_RATIO * self._rows * PLANTS
        return Outcome(
            seed=seed, success=is_done and rows_ok == self._rows and few, finished=is_done,
            rows_ok=rows_ok, xte_rms_m=float(np.sqrt(np.mean(errors_m**2))),
            xte_p95_m=float(np.quantile(errors_m, 0.95)), xte_max_m=max(self._worst_m),
            crushed=len(self._crushed), time_s=self._ticks * TICK_S, nees=None, nees_pose=None,
            paused_s=0.0,
        )  # fmt: skip
