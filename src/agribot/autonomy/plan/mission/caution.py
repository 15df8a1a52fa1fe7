"""Slower where the robot knows less well where the crop row is, and off the crop where it may err.

The protection level bounds how far the robot may be off its row although it believes to be on it,
also when the GNSS lies. While that is less than from the wheels to the crop, nothing happens.
"""

from __future__ import annotations

import math

from agribot.core.config import MissionConfig
from agribot.core.facts import MayBeOffRow
from agribot.core.geo import std_along_m
from agribot.core.messages import Estimate, GnssQuality
from agribot.core.robot import DriveSpec

# Share of the speed just before the robot must stop: it sees more plants only by moving.
CREEP_RATIO = 0.25
# A robot that knows where it is stays this near to its path.
TRACKING_M = 0.06
# Dead reckoning, which checks the GNSS, bounds the error of the best receiver no closer than this.
LEAST_LIMIT_M = 0.2
# Time of creeping beyond the limit to get row or fix back, s, and the most of the limit. Without a
# fault but unsure, as after a turn on a slope, it creeps for longer, a plant's distance or two:
# camera or corrections show its row only on the move.
PATIENCE_S, MAX_RATIO = 10.0, 1.5
# Time for which a robot without a camera stands first, s: ambiguities are fixed again by waiting,
# and plants that it creeps past with the tool off stay unworked.
WAIT_S = 50.0
BACK_S = 2.0  # time for which a reason to stand is still stated once the level is back
# Two solutions that agree are less than 2 sigma apart, and the level holds about 4: then at least
# two thirds of it is mere ignorance.
UNSURE_PATIENCE_S, UNSURE_RATIO = 40.0, 0.66


def across_std_m(estimate: Estimate, yaw_map_rad: float) -> float:
    """Return 1 sigma of the position across a direction of the map, metres."""
    xx, xy, _, _, yy, *_ = estimate.pose_cov
    return std_along_m((xx, xy, yy), (-math.sin(yaw_map_rad), math.cos(yaw_map_rad)))


def caution_ratio(std_m: float, config: MissionConfig) -> float:
    """Return the part of the speed that an uncertainty across the row allows; 0 beyond limits."""
    if not std_m <= config.max_row_std_m:
        return 0.0
    if std_m <= config.full_speed_std_m:
        return 1.0
    part = (std_m - config.full_speed_std_m) / (config.max_row_std_m - config.full_speed_std_m)
    return 1.0 - part * (1.0 - CREEP_RATIO)


def protection_limit_m(drive: DriveSpec, pitch_m: float = math.inf) -> float:
    """Return how far a robot astride a row may be off before a wheel reaches crop, either side."""
    inside_m = (drive.track_m - drive.wheel_width_m) / 2.0
    outside_m = pitch_m - (drive.track_m + drive.wheel_width_m) / 2.0
    return max(min(inside_m, outside_m) - TRACKING_M, LEAST_LIMIT_M)


class CropGuard:
    """Watches the protection level across the row while there is crop beside the wheels.

    Above the limit the tool is off and the robot creeps; it stands where the level stays there or
    rises on, and goes on by itself once the level is back. Without a camera it stands first: a fix
    comes back by waiting. `restart` when a person resumes it: it then creeps once more, whatever
    the level. A level that rides up and down at its limit is one warning.
    """

    def __init__(self) -> None:
        self.ratio = 1.0  # share of its speed at which the robot may drive
        self._since_s: float | None = None
        self._stood: tuple[float, MayBeOffRow] | None = None  # when it last had to, and why
        self._is_granted = False

    @property
    def may_work(self) -> bool:
        return self.ratio == 1.0

    def restart(self) -> None:
        self.leave()
        self._is_granted = True

    def leave(self) -> None:
        """Forget what was: there is no crop beside the wheels."""
        self._since_s, self._stood, self._is_granted, self.ratio = None, None, False, 1.0

    def judge(self, estimate: Estimate, limit_m: float) -> MayBeOffRow | None:
        """Find why the robot must stand, or had to a moment ago; `ratio` is what it may do."""
        level_m, stood = estimate.across_protection_m, self._stood
        if level_m <= limit_m:
            self.leave()
            is_fresh = stood is not None and estimate.t_s - stood[0] < BACK_S
            self._stood = stood if is_fresh else None
            return self._stood and self._stood[1]
        reason = self._judge_excess(estimate, limit_m)
        self._stood = None if reason is None else (estimate.t_s, reason)
        return reason

    def _judge_excess(self, estimate: Estimate, limit_m: float) -> MayBeOffRow | None:
        level_m = estimate.across_protection_m
        self._since_s = estimate.t_s if self._since_s is None else self._since_s
        lasts_s = estimate.t_s - self._since_s
        if estimate.row_seen is None and not self._is_granted:
            lasts_s -= WAIT_S
        if lasts_s < 0.0:
            self.ratio = 0.0
            return MayBeOffRow(level_m, limit_m)
        is_unsure = estimate.across_unknown_m >= UNSURE_RATIO * level_m
        is_unsure = is_unsure and lasts_s < UNSURE_PATIENCE_S
        is_unsure = is_unsure and estimate.fact is None  # no sensor is known to fail
        is_near = self._is_granted or level_m <= MAX_RATIO * limit_m
        may_creep = self._is_granted or _finds_row(estimate)
        if may_creep and (is_unsure or (is_near and lasts_s < PATIENCE_S)):
            self.ratio = CREEP_RATIO
            return None
        self.ratio = 0.0
        return MayBeOffRow(level_m, limit_m)


def _finds_row(estimate: Estimate) -> bool:
    """Whether row or fix may come back on the move: not without a camera and corrections."""
    is_at_its_best = estimate.quality in (GnssQuality.SINGLE, GnssQuality.DGNSS)
    return estimate.row_seen is not None or not is_at_its_best


class LostRow:
    """Driving of a robot that is unsure of its row: a camera finds it only on the move."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    @property
    def is_lost(self) -> bool:
        return self._since_s is not None

    def find(self) -> None:
        """Forget what was: the row is known again."""
        self._since_s = None

    def creep(self, estimate: Estimate) -> float:
        """Return the share of its speed at which it may go on and look; 0 where it must stand."""
        self._since_s = estimate.t_s if self._since_s is None else self._since_s
        looks = estimate.row_seen is not None and estimate.fact is None
        return CREEP_RATIO if looks and estimate.t_s - self._since_s < PATIENCE_S else 0.0
