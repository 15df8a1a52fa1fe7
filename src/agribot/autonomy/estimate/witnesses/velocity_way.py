"""Where the velocities of a receiver lead: a second dead reckoning, which wheels cannot spoil.

They come from the carrier's Doppler shift and know nothing of wrong ambiguities; they lose no way
on soft ground, but a few millimetres a second for as long as they are summed up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

MAX_GAP_S = 1.5
# Lasting error of a Doppler velocity, 1 sigma.
VELOCITY_BIAS_MPS = 0.005


def summed_variance_m2(noise_mps: float, gaps2_s2: float, lasted_s: float) -> float:
    """Variance of the way that velocities have led in `lasted_s`, given their gaps squared."""
    return noise_mps**2 * gaps2_s2 + (VELOCITY_BIAS_MPS * lasted_s) ** 2


class VelocityMark(NamedTuple):
    """Mark at a fix: the filter's antenna less the place by the velocities until then.

    Vectors of the map are complex, East + i North. Marks of another `part` cannot be compared: the
    receiver was silent in between. `gaps2_s2` sums the squares of the gaps between fixes.
    """

    part: int
    t_s: float
    off_m: complex
    gaps2_s2: float


class VelocityWay:
    """Call `add` with every velocity; only marks that are at most MAX_GAP_S old are used."""

    def __init__(self) -> None:
        self._last: VelocityMark | None = None
        self._velocity_mps = self._way_m = 0j
        self._noise_mps = 0.0

    def add(self, t_s: float, velocity_mps: complex, antenna_m: complex, noise_mps: float) -> None:
        """Take a velocity with its 1 sigma, and where the filter has the antenna at that time."""
        last, before_mps = self._last, self._velocity_mps
        self._velocity_mps, self._noise_mps = velocity_mps, noise_mps
        gap_s = math.inf if last is None else t_s - last.t_s
        part, gaps2_s2 = (0, 0.0) if last is None else (last.part, last.gaps2_s2)
        if gap_s > MAX_GAP_S:
            part, gap_s = part + 1, 0.0
        self._way_m += gap_s / 2.0 * (before_mps + velocity_mps)
        self._last = VelocityMark(part, t_s, antenna_m - self._way_m, gaps2_s2 + gap_s * gap_s)

    def find_mark(self, t_s: float) -> VelocityMark | None:
        """Find the mark of the last velocity; None where the receiver has been silent since."""
        last = self._last
        return last if last is not None and t_s - last.t_s <= MAX_GAP_S else None

    def compare(
        self, then: VelocityMark | None, here: VelocityMark | None
    ) -> tuple[complex, float] | None:
        """Measure the distance of filter and velocities between two marks, and 1 sigma of these."""
        if then is None or here is None or then.part != here.part:
            return None
        gaps2_s2, lasted_s = here.gaps2_s2 - then.gaps2_s2, here.t_s - then.t_s
        variance_m2 = summed_variance_m2(self._noise_mps, gaps2_s2, lasted_s)
        return here.off_m - then.off_m, math.sqrt(variance_m2)
