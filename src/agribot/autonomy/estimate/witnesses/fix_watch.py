"""Invalid fixes: a place that repeats while the robot drives, and a jump that it did not make."""

from __future__ import annotations

from agribot.core.facts import GnssJumped, GnssJumpedFar, GnssRepeats
from agribot.core.messages import GnssFix

# A receiver that repeats one place gives no information; with four decimals of a minute, the
# coarsest format in use, the place changes after 0.19 m.
REPEAT_M, NAMED_REPEAT_M = 0.05, 0.3
# Fixes that agreed with wheels and gyro in a row, before and after: those were in order.
AGREE_FIXES = 25
# A robot whose wheels moved it less while the fixes disagreed may have been carried.
CARRIED_M = 0.1
# Longest distance over which a person carries a robot that is switched on, m.
MAX_JUMP_M = 1000.0
# Share of the jump within which fixes count as those from before it.
BACK_RATIO = 0.5
# Longest gap of fixes. Receivers give one fix a second or more, with jitter, and a single one may
# be an outlier.
MAX_GAP_S = 3.0


class RepeatWatch:
    """Call `is_repeat` with every fix and the wheels' distance up to it."""

    def __init__(self) -> None:
        self._place: tuple[float, float] | None = None
        self._since_m = self._way_m = 0.0

    def is_repeat(self, fix: GnssFix, driven_m: float) -> bool:
        """Whether the fix repeats exactly the place from before the robot drove on."""
        place = (fix.lat_deg, fix.lon_deg)
        if place != self._place:
            self._place, self._since_m = place, driven_m
        self._way_m = driven_m - self._since_m
        return self._way_m >= REPEAT_M

    @property
    def fault(self) -> GnssRepeats | None:
        return GnssRepeats(self._way_m) if self._way_m >= NAMED_REPEAT_M else None


class JumpWatch:
    """Distinguishes a receiver that jumped from a robot that was carried.

    Wheels and gyro are good to centimetres over the seconds of a run of rejected fixes. If they
    agreed with the fixes before, and drove on meanwhile, the fixes jumped; so they did where the
    receiver's own velocities do not lead to them. Whether the fixes are
    right now, a person has to decide: the wheels of a lifted robot turn in the air, which looks
    the same.
    """

    def __init__(self) -> None:
        self.off_m = 0.0  # size of the fixes' jump; 0 while they are believed
        self._agreed = 0
        self._agreed_t_s, self._agreed_at_m = 0.0, 0.0

    def accept(self, t_s: float, moved_m: float) -> None:
        if t_s - self._agreed_t_s > MAX_GAP_S:
            self._agreed = 0
        self._agreed += 1
        self._agreed_t_s, self._agreed_at_m = t_s, moved_m
        if self._agreed >= AGREE_FIXES:
            self.off_m = 0.0

    def is_jump(
        self, off_m: float, moved_m: float, *, is_corrected: bool, is_disowned: bool = False
    ) -> bool:
        """Return whether rejected fixes, now `off_m` away, are a jump and not to be followed.

        `is_disowned`: the velocities of the receiver do not lead there.
        """
        drove_on = moved_m - self._agreed_at_m >= CARRIED_M
        has_left = is_corrected and self._agreed >= AGREE_FIXES and (drove_on or is_disowned)
        if self.off_m or has_left or off_m > MAX_JUMP_M:
            self.off_m = off_m
            self._agreed = 0
            return True
        return False

    def is_still_off(self, off_m: float) -> bool:
        """Whether a fix is still where the others jumped to, however little the filter knows."""
        return off_m > BACK_RATIO * self.off_m > 0.0

    @property
    def fault(self) -> GnssJumped | GnssJumpedFar | None:
        if self.off_m > MAX_JUMP_M:
            return GnssJumpedFar(self.off_m)
        return GnssJumped(self.off_m) if self.off_m else None

    def forget(self) -> None:
        """Believe the fixes again: a person has decided."""
        self.off_m, self._agreed = 0.0, 0
