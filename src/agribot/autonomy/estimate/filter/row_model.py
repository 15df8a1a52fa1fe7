"""What a line along the crop row says of the pose."""

from __future__ import annotations

import math

# A line that stays off by part of its noise for some seconds: leaves lean, light falls sideways.
LASTING_RATIO, LASTING_MEMORY_S = 0.75, 2.0
# Its direction stays off as well; that has no state and counts for all the frames it spoils.
HEADING_LASTING_RAD = math.radians(0.3)
OFFSET_FLOOR_M = 0.006
# Degrees of freedom of Student's t: what a gate lets in may still be an outlier.
TAIL_DEGREES = 4.0
# Largest 1 sigma of a pose that distinguishes rows, as a share of their distance.
DISTINCT_ROWS_RATIO = 0.25
# Probability from which a line is of the nearest row beyond that ratio.
SURE_RATIO = 0.93
# Lines that do not fit come in runs only when the pose is wrong.
GATE_SIGMA, RECOVER_AFTER = 3.5, 6
RECOVERY_OFFSET_M, RECOVERY_YAW_RAD = 0.15, math.radians(3.0)
RANGE_GATE_SIGMA, RANGE_RECOVER_AFTER = 3.0, 3
RECOVERY_RANGE_M = 0.5


def offset_variance(std_m: float) -> float:
    return std_m**2 + OFFSET_FLOOR_M**2


def heading_variance(std_rad: float, since_last_s: float) -> float:
    frames = max(1.0, LASTING_MEMORY_S / max(0.01, since_last_s))
    return std_rad**2 + HEADING_LASTING_RAD**2 * frames


def tail_factor(distance2: float) -> float:
    """Say by how much the variance grows for a residual that looks like an outlier."""
    return max(1.0, (TAIL_DEGREES + distance2) / (TAIL_DEGREES + 1.0))


def neighbour_shares(off_m: float, std_m: float, pitch_m: float) -> tuple[float, float]:
    """Say how likely a line is of the row to the left or to the right of the nearest one.

    The nearest row would put the robot `off_m` to the right of where it believes to be, known to
    `std_m` (1 sigma, normal), the others one row distance less or more.
    """
    left, own, right = (
        math.exp(((off_m**2 - (off_m + side * pitch_m) ** 2) / 2.0) / std_m**2)
        for side in (-1, 0, 1)
    )
    total = left + own + right
    return left / total, right / total
