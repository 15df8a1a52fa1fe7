"""Figures of one pass over a log: fixes against poses, outages, when the filter began."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.core.geo import MapFrame
from agribot.core.messages import Estimate, FloatArray, GnssFix, Vec3
from agribot.core.pose import Pose2
from agribot.record.localization.result import FIX_COLUMNS, OutageResult

AFTER_S = 60.0  # start of the log that is left out; until then a filter finds its heading
LAST_S = 3.0  # last part of an outage, in which its error is measured
LONGEST_GAP_S = 1.0  # largest gap over which an estimate is moved on to a fix
LIMIT_SIGMA2 = 9.0  # 3 sigma, squared


class ThinTable:
    """Rows of floats; every second one goes when there are too many, so that memory is bounded."""

    def __init__(self, columns: int, limit: int = 20_000) -> None:
        self._columns, self._limit = columns, limit
        self._rows: list[tuple[float, ...]] = []
        self._every = 1
        self._count = 0

    def append(self, row: tuple[float, ...]) -> None:
        if self._count % self._every == 0:
            self._rows.append(row)
        self._count += 1
        if len(self._rows) > self._limit:
            self._rows = self._rows[::2]
            self._every *= 2

    def to_array(self) -> FloatArray:
        """Copy the table, (rows, columns)."""
        return np.array(self._rows, dtype=float).reshape(-1, self._columns)


class FixOffset(NamedTuple):
    """Distance of a fix from a pose, m, and its square by both sigmas."""

    off_m: float
    nis: float


class FixFigures:
    """Compares fixes with poses; memory does not grow with their number."""

    def __init__(self, frame: MapFrame, antenna_body_m: Vec3) -> None:
        self._frame, self._antenna_body_m = frame, antenna_body_m
        self.table = ThinTable(len(FIX_COLUMNS))
        self.used = 0
        self._late_count, self._late_m2 = 0, 0.0
        self._judged = self._within = 0
        self._nis = 0.0

    def locate(self, fix: GnssFix) -> tuple[float, float]:
        """Find East and North of a fix in the map, m."""
        east_m, north_m, _ = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
        return east_m, north_m

    def judge(self, fix: GnssFix, before: Estimate | None) -> FixOffset | None:
        """Hold a fix that is given against the estimate before it."""
        if before is None or abs(fix.t_s - before.t_s) > LONGEST_GAP_S:
            return None
        offset = self.compare(fix, move_to(before, fix.t_s), before)
        self._judged += 1
        self._within += offset.nis <= LIMIT_SIGMA2
        self._nis += offset.nis
        return offset

    def add(
        self, fix: GnssFix, pose: Pose2 | None, judged: FixOffset | None, *, is_given: bool
    ) -> float | None:
        """Add a fix with the pose of its time that came of it; return how far it lies off, m."""
        x_m, y_m = self.locate(fix)
        off_m = None if pose is None else math.dist((x_m, y_m), self._find_antenna(pose))
        if off_m is not None and is_given and fix.t_s >= AFTER_S:
            self._late_count += 1
            self._late_m2 += off_m**2
        nis = math.nan if judged is None else judged.nis
        off = math.nan if off_m is None else off_m
        self.table.append((fix.t_s, x_m, y_m, fix.pos_std_m, off, nis, float(is_given)))
        return off_m

    def compare(self, fix: GnssFix, pose: Pose2, estimate: Estimate) -> FixOffset:
        x_m, y_m = self._find_antenna(pose)
        east_m, north_m = self.locate(fix)
        off = np.array([east_m - x_m, north_m - y_m])
        lever = (x_m - pose.x_m, y_m - pose.y_m)
        by_pose = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]]])
        cov = by_pose @ np.reshape(estimate.pose_cov, (3, 3)) @ by_pose.T
        cov += np.eye(2) * fix.pos_std_m**2
        return FixOffset(float(np.linalg.norm(off)), float(off @ np.linalg.solve(cov, off)))

    def _find_antenna(self, pose: Pose2) -> tuple[float, float]:
        ahead_m, left_m = pose.rotate(*self._antenna_body_m[:2])
        return pose.x_m + ahead_m, pose.y_m + left_m

    @property
    def rms_m(self) -> float | None:
        return math.sqrt(self._late_m2 / self._late_count) if self._late_count else None

    @property
    def within_ratio(self) -> float | None:
        return self._within / self._judged if self._judged else None

    @property
    def nis_mean(self) -> float | None:
        return self._nis / self._judged if self._judged else None


class OutageFigures:
    """Way and error of one outage."""

    def __init__(self, from_s: float, to_s: float) -> None:
        self.from_s, self.to_s = from_s, to_s
        self._errors_m: list[float] = []
        self._driven_m: list[float] = []
        self._sigma_m: float | None = None

    def has(self, t_s: float) -> bool:
        return self.from_s <= t_s < self.to_s

    def move(self, t_s: float, driven_m: float, estimate: Estimate | None) -> None:
        """Take the way by the wheels since the start, and the estimate, of a tick."""
        if not self.has(t_s):
            return
        self._driven_m = [*self._driven_m[:1], driven_m]
        self._sigma_m = None if estimate is None else estimate.pos_std_m

    def add(self, t_s: float, error_m: float | None) -> None:
        if error_m is not None and self.to_s - LAST_S <= t_s < self.to_s:
            self._errors_m.append(error_m)

    def result(self) -> OutageResult:
        errors, driven = self._errors_m, self._driven_m
        return OutageResult(
            from_s=self.from_s,
            to_s=self.to_s,
            driven_m=driven[-1] - driven[0] if driven else None,
            error_m=sum(errors) / len(errors) if errors else None,
            sigma_m=self._sigma_m,
        )


def move_to(estimate: Estimate, t_s: float) -> Pose2:
    """Move an estimate on to a time shortly after it, as it drives and turns."""
    dt_s = t_s - estimate.t_s
    yaw_rad = estimate.yaw_map_rad + estimate.yaw_rate_radps * dt_s
    course_rad = estimate.yaw_map_rad + estimate.slip_rad + estimate.yaw_rate_radps * dt_s / 2.0
    way_m = estimate.v_mps * dt_s
    return Pose2(
        estimate.x_map_m + way_m * math.cos(course_rad),
        estimate.y_map_m + way_m * math.sin(course_rad),
        yaw_rad,
    )
