"""The marked place on which the robot is put down before a run."""

from __future__ import annotations

import math

import msgspec

from agribot.core.config import FieldConfig

# Farther off the mark than so many sigma, and than this, somebody put the robot elsewhere.
MISPLACED_SIGMA = 4.0
MISPLACED_M = 1.0
# Where rows stand closer than twice that, half their distance: a robot astride the next one does.
# Nearer than this to its mark a robot always begins.
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
            misplaced_m=_tell_rows_apart_m(field),
        )

    def position_fault(self, off_m: float, gnss_std_m: float) -> str:
        """Why GNSS says that the robot is not at the mark; empty when it may well be."""
        limit_m = max(self.misplaced_m, MISPLACED_SIGMA * math.hypot(self.std_m, gnss_std_m))
        if off_m <= limit_m:
            return ""
        return (
            f"the robot does not stand at the marked start: GNSS is {off_m:.2f} m > "
            f"{limit_m:.2f} m away from it; put it there, or correct field.start_map_m"
        )

    def heading_fault(self, off_rad: float, compass_std_rad: float) -> str:
        """Why the compass says that the robot looks elsewhere; empty when it may well not."""
        limit_rad = MISPLACED_SIGMA * math.hypot(self.yaw_std_rad, compass_std_rad)
        if abs(off_rad) <= limit_rad:
            return ""
        return (
            f"the robot does not face as marked at the start: the compass is "
            f"{math.degrees(abs(off_rad)):.0f} deg > {math.degrees(limit_rad):.0f} deg off; "
            "turn it, or correct field.start_yaw_deg"
        )


def _tell_rows_apart_m(field: FieldConfig) -> float:
    half_pitch_m = field.row_pitch_m / 2.0 if field.row_count > 1 else MISPLACED_M
    return min(max(half_pitch_m, LEAST_MISPLACED_M), MISPLACED_M)
