"""Looks after a drive along a route: has it strayed, does it get on, how near are plants."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.plan.mission.caution import CropGuard, LostRow, across_std_m, caution_ratio
from agribot.autonomy.plan.mission.route import Route
from agribot.core.config import MissionConfig
from agribot.core.facts import (
    EstimateNotReady,
    Fact,
    MayBeOffRow,
    NoHeadway,
    NoPositionFor,
    OffPath,
    RowLost,
    StartUnsure,
)
from agribot.core.messages import Estimate, Path, Row
from agribot.core.row_shape import project_on_row, row_length_m

# Wheels of a robot this near to a row, or past its ends, may reach its plants.
BESIDE_CROP_M, PAST_CROP_M = 0.6, 0.4
# Distance from the path that an error of the pose explains, in sigmas of the pose.
OFF_PATH_SIGMA = 3.0
HEADWAY_M = 0.05  # least progress along the path that counts


class StallWatch:
    """Call it while the mission runs; `restart` when it starts or goes on after a pause."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._best_m = -math.inf
        self._since_s = math.nan

    def restart(self) -> None:
        self._best_m, self._since_s = -math.inf, math.nan

    def is_stalled(self, s_m: float, t_s: float) -> bool:
        """Say whether `s_m` along the path has not grown by HEADWAY_M for too long."""
        if s_m >= self._best_m + HEADWAY_M:
            self._best_m, self._since_s = s_m, t_s
        return t_s - self._since_s > self._limit_s


class Watch:
    """Each method finds what is wrong, None where all is well."""

    def __init__(self, config: MissionConfig) -> None:
        self._stall = StallWatch(config.stall_timeout_s)
        self._limit_s = config.stall_timeout_s
        self.caution = 1.0  # share of its speed at which the robot drives here
        self._guard, self._lost = CropGuard(), LostRow()
        self._in_crop: tuple[Path, Sequence[Row], list[bool]] | None = None

    def restart(self) -> None:
        """Forget what was: the robot sets off anew, as somebody asked."""
        self._stall.restart()
        self._guard.restart()
        self._lost = LostRow()

    def restart_headway(self) -> None:
        """Go over to another route: what was made on the last one does not count."""
        self._stall.restart()

    @property
    def may_work(self) -> bool:
        """Whether the tool may work where the robot is, if it is where it believes."""
        return self._guard.may_work

    @property
    def is_row_lost(self) -> bool:
        """Whether the robot does not know well enough where its row is."""
        return self._lost.is_lost

    @property
    def is_guarding(self) -> bool:
        """Whether the robot stands because it may be off its row."""
        return self._guard.ratio == 0.0

    def check_start(
        self, rows: Sequence[Row], estimate: Estimate, config: MissionConfig
    ) -> StartUnsure | None:
        """Find why the robot must not set off: neither its pose nor a camera knows the rows."""
        std_m, limit_m = estimate.pos_std_m, config.max_row_std_m
        if not rows or estimate.row_seen is not None or std_m <= limit_m:
            return None
        return StartUnsure(std_m, limit_m)

    def check_path(self, route: Route, estimate: Estimate, limit_m: float) -> OffPath | None:
        """Find that the robot has left its path: it is farther off than its pose may be wrong."""
        x_map_m, y_map_m = estimate.x_map_m, estimate.y_map_m
        limit_m = max(limit_m, OFF_PATH_SIGMA * across_std_m(estimate, route.yaw_map_rad))
        if route.progress.off_path_m <= limit_m:
            return None
        off_m = route.progress.off_driven_path_m(x_map_m, y_map_m)
        return OffPath(off_m, limit_m, x_map_m, y_map_m) if off_m > limit_m else None

    def check_row(self, route: Route, estimate: Estimate, config: MissionConfig) -> RowLost | None:
        """Slow down in and next to the rows where the robot knows less well where they are."""
        std_m = across_std_m(estimate, route.yaw_map_rad)
        self.caution = caution_ratio(std_m, config)
        if self.caution > 0.0:
            self._lost.find()
            return None
        self.caution = self._lost.creep(estimate)
        return RowLost(std_m, config.max_row_std_m)

    def check_crop(
        self, route: Route, estimate: Estimate, rows: Sequence[Row], limit_m: float
    ) -> MayBeOffRow | None:
        """Slow down in crop where the robot may drive over it, and stop it there.

        A robot one of whose sensors fails may be farther on than it believes: it stands before its
        way leads into crop, on the headland, and waits there.
        """
        ahead_m = 0.0 if estimate.fact is None else estimate.protection_m
        if not self._crosses_crop(route, rows, ahead_m):
            self._guard.leave()
            return None
        reason = self._guard.judge(estimate, limit_m)
        self.caution = min(self.caution, self._guard.ratio)
        return reason

    def _crosses_crop(self, route: Route, rows: Sequence[Row], ahead_m: float) -> bool:
        """Whether the path has crop beside it where the robot is, or within `ahead_m`."""
        known = self._in_crop
        if known is None or known[0] is not route.path or known[1] is not rows:
            self._in_crop = known = route.path, rows, _find_crop(route.path, rows)
        first, s_m = route.progress.index, route.path.s_m
        last = int(np.searchsorted(s_m, s_m[first] + ahead_m)) if ahead_m else first
        return any(known[2][first : last + 1])

    def check_headway(self, route: Route, t_s: float, cause: Fact | None) -> NoHeadway | None:
        progress = route.progress
        if not self._stall.is_stalled(progress.s_m, t_s):
            return None
        return NoHeadway(self._limit_s, progress.s_m, progress.length_m, cause)

    def check_position(self, t_s: float, cause: Fact | None) -> NoPositionFor | None:
        """Find that the robot has waited too long for its position."""
        if not self._stall.is_stalled(0.0, t_s):
            return None
        return NoPositionFor(self._limit_s, cause or EstimateNotReady())


def _find_crop(path: Path, rows: Sequence[Row]) -> list[bool]:
    """Return for each point of a path whether it runs in or next to a row."""
    found = np.zeros(len(path.s_m), dtype=bool)
    for row in rows:
        along_m, left_m, _ = project_on_row(row, path.xy_map_m[:, 0], path.xy_map_m[:, 1])
        is_along = (along_m >= -PAST_CROP_M) & (along_m <= row_length_m(row) + PAST_CROP_M)
        found |= is_along & (np.abs(left_m) <= BESIDE_CROP_M)
    return list(map(bool, found))
