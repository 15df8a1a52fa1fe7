"""How far a tool keeps off crop, as well as the map knows where that stands."""

from __future__ import annotations

from agribot.autonomy.implements.tool_frame import find_spread_m
from agribot.core.arithmetic import clamp
from agribot.core.config import TreatmentConfig
from agribot.core.implement.plants import KnownPlant
from agribot.core.messages import Estimate

CROP_STEM_M = 0.02  # radius of a young stem
# What works keeps off a stem by this, if its place is well known: all looks at it share an error of
# 20 mm, and over the way to the tool the pose goes 12 mm astray (1 sigma); twice both is 47 mm.
STEM_MARGIN_M = 0.05
LEAST_POSE_M = 0.01  # by which the place of leaves is always uncertain
SURE_SIGMA = 2.0


def find_keep_off_m(crop: KnownPlant, estimate: Estimate, config: TreatmentConfig) -> float:
    """How far from a crop's place to stay: by 7 cm, or as far as it is unsure, within the guard."""
    unsure_m = SURE_SIGMA * max(find_spread_m(crop.seen_std_m, estimate))
    return min(CROP_STEM_M + max(unsure_m, STEM_MARGIN_M), find_most_keep_off_m(config))


def find_most_keep_off_m(config: TreatmentConfig) -> float:
    """How far from a crop's place to stay where that is not well known."""
    return CROP_STEM_M + max(config.crop_guard_m, STEM_MARGIN_M)


def find_pose_margin_m(estimate: Estimate, config: TreatmentConfig) -> float:
    """How far leaves may lie beside where they were seen, for what the pose is off."""
    return clamp(find_spread_m(0.0, estimate)[1], LEAST_POSE_M, config.margin_m)
