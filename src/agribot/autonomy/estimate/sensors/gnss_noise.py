"""What the filter believes of a fix: its white noise, and how its bias wanders."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from agribot.autonomy.estimate.filter.ekf import GNSS_BIAS_X, GNSS_BIAS_Y
from agribot.autonomy.estimate.filter.models import SURE_NOISE_RATIO, repeats
from agribot.core.facts import PositionsScatter, VelocityScatters
from agribot.core.messages import GnssFix, GnssQuality

CORRECTED = (GnssQuality.RTK_FIXED, GnssQuality.RTK_FLOAT)
MIN_POS_STD_M = 0.005
# Scatter of an uncorrected receiver around its own slow wander.
UNCORRECTED_WHITE_M = 0.12
# The wander: multipath and atmosphere over minutes; stays within the receiver's own sigma.
UNCORRECTED_WALK_M_PER_SQRT_S = 0.1
# With fixed ambiguities multipath on the carrier remains: about 1 cm over a minute.
CORRECTED_BIAS_M, CORRECTED_WALK_M_PER_SQRT_S = 0.01, 0.0018
# A float solution wanders this slowly, so its epochs are far from independent.
FLOAT_MEMORY_S = 15.0
FLOAT_STD_M = 0.3
# The median of the squared jumps of two axes, over their variance: 2 x 2 ln 2 for normal noise.
JUMP2_MEDIAN = 4.0 * math.log(2.0)
# The same of second differences, which have six times the variance of one place.
BEND2_MEDIAN = 12.0 * math.log(2.0)
# Jumps that give the receiver's noise to a third, and the fewest that are used.
MOST_JUMPS, LEAST_JUMPS = 21, 11
# Velocities in a row that have to show the same error before it is one of the pose.
STEADY_FIXES = 6
# Soil that shakes the antenna makes it twice as much as stated, no more.
NAMED_NOISE_RATIO, NAMED_NOISE_MPS = 3.0, 0.1
# Positions of honest receivers, tilting antennas included, scatter by less than what is stated.
NAMED_SCATTER_RATIO, NAMED_SCATTER_M = 2.0, 0.03
EVEN_STEP_RATIO = 0.3  # largest difference of two steps of time


class FixNoise(msgspec.Struct, frozen=True, kw_only=True):
    """The filter's model of a fix: white variance, and spread and walk of the bias."""

    variance_m2: float
    bias_std_m: float
    bias_walk_m_per_sqrt_s: float


def noise_model(
    pos_std_m: float, since_last_s: float, *, is_float: bool, is_corrected: bool
) -> FixNoise:
    std_m = max(MIN_POS_STD_M, pos_std_m)
    if not is_corrected:
        return FixNoise(
            variance_m2=UNCORRECTED_WHITE_M**2,
            bias_std_m=max(UNCORRECTED_WHITE_M, std_m),
            bias_walk_m_per_sqrt_s=UNCORRECTED_WALK_M_PER_SQRT_S,
        )
    # The stated sigma holds the slow part too, which the bias states carry.
    fixed_m2 = max(std_m**2 / 4.0, std_m**2 - CORRECTED_BIAS_M**2)
    float_m2 = max(FLOAT_STD_M, std_m) ** 2 * repeats(FLOAT_MEMORY_S, since_last_s)
    return FixNoise(
        variance_m2=float_m2 if is_float else fixed_m2,
        bias_std_m=CORRECTED_BIAS_M,
        bias_walk_m_per_sqrt_s=CORRECTED_WALK_M_PER_SQRT_S,
    )


def fix_noise(fix: GnssFix, since_last_s: float) -> FixNoise:
    is_float = fix.quality is GnssQuality.RTK_FLOAT
    is_corrected = fix.quality in CORRECTED
    return noise_model(fix.pos_std_m, since_last_s, is_float=is_float, is_corrected=is_corrected)


def bias_ageing(noise: FixNoise, dt_s: float) -> list[tuple[int, float, float]]:
    """Say how the two bias states age, as Ekf.relax takes it."""
    variance = noise.bias_std_m**2
    factor = math.exp(-(noise.bias_walk_m_per_sqrt_s**2) * dt_s / (2.0 * variance))
    growth = variance * (1.0 - factor * factor)
    return [(GNSS_BIAS_X, factor, growth), (GNSS_BIAS_Y, factor, growth)]


def is_steady(residuals: Sequence[tuple[float, float]]) -> bool:
    """Return whether residuals, east and north, show a lasting error and not only noise.

    Of noise alone the mean of six is as large as the scatter from one to the next in one case of
    several hundred; a wrong heading or spinning wheels leave the same residual every time.
    """
    east = sum(pair[0] for pair in residuals) / len(residuals)
    north = sum(pair[1] for pair in residuals) / len(residuals)
    jumps2 = sum(
        (after[0] - before[0]) ** 2 + (after[1] - before[1]) ** 2
        for before, after in pairwise(residuals)
    )
    return east**2 + north**2 > jumps2 / (2.0 * (len(residuals) - 1))


def widen(noise: FixNoise, learnt_m: float) -> FixNoise:
    """Believe what was learnt of the white noise where it is surely more than what is stated."""
    learnt_m2 = learnt_m * learnt_m
    is_more = learnt_m2 > SURE_NOISE_RATIO**2 * noise.variance_m2
    return msgspec.structs.replace(noise, variance_m2=learnt_m2 if is_more else noise.variance_m2)


def is_even(before_s: float, step_s: float) -> bool:
    """Return whether two time steps are similar enough for second differences."""
    return abs(step_s - before_s) <= EVEN_STEP_RATIO * before_s


class PositionNoise:
    """White noise of a receiver's positions, from how far each lies off the line of its neighbours.

    They are seen from where the wheels led, so that the filter has no part in it. A second
    difference cancels what is steady, wheels that slip or a wrong heading.
    """

    def __init__(self) -> None:
        self._places: deque[tuple[float, complex]] = deque(maxlen=2)
        self._bends2: deque[float] = deque(maxlen=MOST_JUMPS)
        self._stated_m = self.std_m = 0.0

    def add(self, t_s: float, place_m: complex, stated_m: float) -> None:
        """Take the place of a fix less the way of the wheels, and its stated 1 sigma."""
        self._stated_m = stated_m
        places = self._places
        if len(places) == 2:
            (first_s, first_m), (last_s, last_m) = places
            if is_even(last_s - first_s, t_s - last_s):
                self._bends2.append(abs(place_m - 2.0 * last_m + first_m) ** 2)
        places.append((t_s, place_m))
        if len(self._bends2) >= LEAST_JUMPS:
            self.std_m = math.sqrt(statistics.median(self._bends2) / BEND2_MEDIAN)

    @property
    def fault(self) -> PositionsScatter | None:
        if self.std_m < max(NAMED_SCATTER_RATIO * self._stated_m, NAMED_SCATTER_M):
            return None
        return PositionsScatter(self.std_m, self._stated_m)


class VelocityNoise:
    """White noise of a receiver's velocity from the jumps between neighbouring residuals.

    A jump cancels what lasts, a wrong heading or wheels that spin, and has twice the variance of
    the noise; the median of the last ones does not hear single outliers. It does not depend on
    what receiver and filter say of themselves.
    """

    def __init__(self) -> None:
        self._jumps2: deque[float] = deque(maxlen=MOST_JUMPS)
        self._recent: deque[tuple[float, float]] = deque(maxlen=STEADY_FIXES)
        self._stated_mps = self.std_mps = 0.0

    def add(self, residuals: tuple[float, float], stated_mps: float) -> None:
        """Take a velocity less what was expected, east and north, m/s, and its stated 1 sigma."""
        self._stated_mps = stated_mps
        last = self._recent[-1] if self._recent else residuals
        self._recent.append(residuals)
        if len(self._recent) == 1:
            return
        self._jumps2.append((residuals[0] - last[0]) ** 2 + (residuals[1] - last[1]) ** 2)
        if self.is_known:
            self.std_mps = math.sqrt(statistics.median(self._jumps2) / JUMP2_MEDIAN)

    @property
    def is_known(self) -> bool:
        return len(self._jumps2) >= LEAST_JUMPS

    @property
    def is_steady(self) -> bool:
        """Whether the last velocities were all off in the same way, as an error of the pose is."""
        is_full = len(self._recent) == STEADY_FIXES
        return is_full and is_steady(self._recent)

    @property
    def sure_mps(self) -> float:
        """As stated, unless more than that is certain: what is learnt scatters by a third."""
        is_more = self.std_mps > SURE_NOISE_RATIO * self._stated_mps
        return self.std_mps if is_more else self._stated_mps

    @property
    def fault(self) -> VelocityScatters | None:
        if self.std_mps < max(NAMED_NOISE_RATIO * self._stated_mps, NAMED_NOISE_MPS):
            return None
        return VelocityScatters(self.std_mps, self._stated_mps)
