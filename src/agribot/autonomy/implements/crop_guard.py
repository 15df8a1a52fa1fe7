"""How far a tool keeps off crop, as well as the map knows where that stands."""

from __future__ import annotations

import math

from agribot.autonomy.implements.tool_frame import find_spread_m
from agribot.core.arithmetic import clamp
from agribot.core.config import TreatmentConfig
from agribot.core.implement.plants import KnownPlant
from agribot.core.messages import Estimate

CROP_STEM_M = 0.02  # radius of a young stem
LEAST_POSE_M = 0.01  # least uncertainty of the place of leaves
SURE_SIGMA = 2.0


def find_keep_off_m(crop: KnownPlant, estimate: Estimate, config: TreatmentConfig) -> float:
    """Find how far from a crop's place to stay: off its stem by twice what the place is off by.

    That is what differs from look to look, what all looks share, and the way to the tool.
    """
    across_m = find_spread_m(crop.seen_std_m, estimate)[1]
    unsure_m = SURE_SIGMA * math.hypot(across_m, config.look_std_m, config.way_std_m)
    return min(CROP_STEM_M + unsure_m, find_most_keep_off_m(config))


def find_most_keep_off_m(config: TreatmentConfig) -> float:
    """Find how far from a crop's place to stay where that is not well known."""
    shared_m = SURE_SIGMA * math.hypot(config.look_std_m, config.way_std_m)
    return CROP_STEM_M + max(config.crop_guard_m, shared_m)


def find_pose_margin_m(estimate: Estimate, config: TreatmentConfig) -> float:
    """Return the offset of leaves from where they were seen, by the error of the pose."""
    return clamp(find_spread_m(0.0, estimate)[1], LEAST_POSE_M, config.margin_m)
