"""Wheels that are to stand and turn: do people push the robot, or do its motors drive it?

People push slowly, all wheels roll together, and the motors brake. What differs from that was
driven. Wheels that were driven are judged once they have come to rest.
"""

from __future__ import annotations

from agribot.core.messages import Four
from agribot.core.robot import DriveSpec

PUSHED_MPS = 0.3  # fastest push, at the rims
TURNING_RADPS, STANDING_RADPS = 0.6, 0.2
WORKING_RATIO = 2e-3  # share of a wheel's full torque with which a motor counts as driving
FAST_LASTING_S = 0.1
# A speed controller that was pushed away springs back for a moment.
DRIVING_LASTING_S = 0.12
ALONE_LASTING_S = 0.4


class RestWatch:
    """One call a sample of the encoders, for as long as the wheels are to stand."""

    def __init__(self, drive: DriveSpec) -> None:
        self._fast_radps = PUSHED_MPS / drive.wheel_radius_m
        self._working_nm = 4.0 * WORKING_RATIO * drive.wheel_torque_nm
        self._fast_s = self._driving_s = self._alone_s = 0.0
        self._alone: tuple[int, bool] | None = None  # wheel that turns alone, and whether forwards
        self._has_rested = True

    def restart(self) -> None:
        """Wait until the wheels have come to rest: they may turn now."""
        self._fast_s = self._driving_s = self._alone_s = 0.0
        self._has_rested = False

    def is_driven(self, speeds_radps: Four, efforts_nm: Four | None, elapsed_s: float) -> bool:
        """Judge the mean speeds of the last moments; `efforts_nm` is None if not sent."""
        paces_radps = sorted(abs(speed) for speed in speeds_radps)
        is_turning = paces_radps[3] > TURNING_RADPS
        self._has_rested = self._has_rested or not is_turning
        if not self._has_rested:
            return False
        is_driving = is_turning and self._find_torque_nm(speeds_radps, efforts_nm) > 0.0
        is_fast = paces_radps[3] > self._fast_radps
        self._fast_s = self._fast_s + elapsed_s if is_fast else 0.0
        self._driving_s = self._driving_s + elapsed_s if is_driving else 0.0
        alone, before = _find_alone(speeds_radps), self._alone
        self._alone_s = self._alone_s + elapsed_s if alone and alone == before else 0.0
        self._alone = alone
        return (
            self._fast_s > FAST_LASTING_S
            or self._driving_s > DRIVING_LASTING_S
            or self._alone_s > ALONE_LASTING_S
        )

    def _find_torque_nm(self, speeds_radps: Four, efforts_nm: Four | None) -> float:
        """Return the torque that drives the wheels beyond what counts; below 0 where they brake."""
        if efforts_nm is None:
            return 0.0
        along_nm = sum(
            effort if speed > 0.0 else -effort
            for speed, effort in zip(speeds_radps, efforts_nm, strict=True)
        )
        return along_nm - self._working_nm


def _find_alone(speeds_radps: Four) -> tuple[int, bool] | None:
    """Find the one wheel that turns while the others stand, and whether it turns forwards.

    An encoder that rocks between two counts turns to and fro, and none of its ways lasts.
    """
    turning = [k for k, speed in enumerate(speeds_radps) if abs(speed) >= STANDING_RADPS]
    if len(turning) != 1 or abs(speeds_radps[turning[0]]) <= TURNING_RADPS:
        return None
    return turning[0], speeds_radps[turning[0]] > 0.0
