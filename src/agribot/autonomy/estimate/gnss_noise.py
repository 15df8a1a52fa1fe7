"""What the filter believes of a fix: its white noise, and how its bias wanders."""

from __future__ import annotations

from typing import Generic

import msgspec

from agribot.autonomy.estimate.ekf import GNSS_BIAS_X, GNSS_BIAS_Y
from agribot.autonomy.estimate.models import repeats
from agribot.core.arithmetic import FLOATS, Arithmetic, Condition, Number
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


class FixNoise(msgspec.Struct, Generic[Number], frozen=True, kw_only=True):
    """What the filter believes of a fix: white variance, and spread and walk of the bias."""

    variance_m2: Number | float
    bias_std_m: Number | float
    bias_walk_m_per_sqrt_s: float


def noise_model(
    m: Arithmetic[Number],
    pos_std_m: Number,
    is_float: Condition,
    since_last_s: float,
    *,
    is_corrected: bool,
) -> FixNoise[Number]:
    std_m = m.most(pos_std_m, MIN_POS_STD_M)
    if not is_corrected:
        return FixNoise(
            variance_m2=UNCORRECTED_WHITE_M**2,
            bias_std_m=m.most(std_m, UNCORRECTED_WHITE_M),
            bias_walk_m_per_sqrt_s=UNCORRECTED_WALK_M_PER_SQRT_S,
        )
    # The stated sigma holds the slow part too, which the bias states carry.
    fixed_m2 = m.most(std_m**2 - CORRECTED_BIAS_M**2, std_m**2 / 4.0)
    float_m2 = m.most(std_m, FLOAT_STD_M) ** 2 * repeats(FLOAT_MEMORY_S, since_last_s)
    return FixNoise(
        variance_m2=m.choose(is_float, float_m2, fixed_m2),
        bias_std_m=CORRECTED_BIAS_M,
        bias_walk_m_per_sqrt_s=CORRECTED_WALK_M_PER_SQRT_S,
    )


def fix_noise(fix: GnssFix, since_last_s: float) -> FixNoise[float]:
    is_float = fix.quality is GnssQuality.RTK_FLOAT
    is_corrected = fix.quality in CORRECTED
    return noise_model(FLOATS, fix.pos_std_m, is_float, since_last_s, is_corrected=is_corrected)


def bias_ageing(
    m: Arithmetic[Number], noise: FixNoise[Number], dt_s: float
) -> list[tuple[int, Number | float, Number | float]]:
    """Say how the two bias states age, as Ekf.relax takes it."""
    variance = noise.bias_std_m**2
    factor = m.exp(-(noise.bias_walk_m_per_sqrt_s**2) * dt_s / (2.0 * variance))
    growth = variance * (1.0 - factor * factor)
    return [(GNSS_BIAS_X, factor, growth), (GNSS_BIAS_Y, factor, growth)]
