"""The marked place on which the robot is put down before a run."""

from __future__ import annotations

import math

import msgspec

from agribot.core.config import FieldConfig
from agribot.core.facts import StartTurned

# Largest distance to the mark, in joint sigmas; without fixed ambiguities at least in metres, too.
MISPLACED_SIGMA = 4.0
MISPLACED_M = 1.0
# Lower limit of that distance, m. Above it, and up to the limit, half the row distance counts: a
# robot astride the next row is misplaced.
LEAST_MISPLACED_M = 0.3


class StartMark(msgspec.Struct, frozen=True, kw_only=True):
    """Position and yaw in the map, each None where the field does not state it."""

    xy_map_m: tuple[float, float] | None
    yaw_map_rad: float | None
    std_m: float
    yaw_std_rad: float
    misplaced_m: float = MISPLACED_M

    @classmethod
    def of(cls, field: FieldConfig) -> StartMark:
        yaw_deg = field.start_yaw_deg
        return cls(
            xy_map_m=field.start_map_m,
            yaw_map_rad=None if yaw_deg is None else math.radians(yaw_deg),
            std_m=field.start_std_m,
            yaw_std_rad=math.radians(field.start_yaw_std_deg),
            misplaced_m=_find_misplaced_m(field),
        )

    def heading_fault(
        self, off_rad: float, std_rad: float, source: str = "compass"
    ) -> StartTurned | None:
        """Find that by a source the robot looks elsewhere; None when it may well not."""
        limit_rad = MISPLACED_SIGMA * math.hypot(self.yaw_std_rad, std_rad)
        return StartTurned(source, abs(off_rad), limit_rad) if abs(off_rad) > limit_rad else None


def _find_misplaced_m(field: FieldConfig) -> float:
    half_pitch_m = field.row_pitch_m / 2.0 if field.row_count > 1 else MISPLACED_M
    return min(max(half_pitch_m, LEAST_MISPLACED_M), MISPLACED_M)
