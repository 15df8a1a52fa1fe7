"""Slower where the row is known less well, and not at all where it is lost."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.config import MissionConfig
from agribot.messages import Estimate, GnssQuality
from agribot.plan.caution import CREEP_RATIO, across_std_m, caution_ratio

CONFIG = MissionConfig()


def known(east_std_m: float, north_std_m: float) -> Estimate:
    return Estimate(
        t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
        slip_rad=0.0, pose_cov=(east_std_m**2, 0, 0, 0, north_std_m**2, 0, 0, 0, 0.01),
        pos_std_m=max(east_std_m, north_std_m), yaw_std_rad=0.1, quality=GnssQuality.SINGLE,
        ok=True,
    )  # fmt: skip


def test_only_the_part_across_the_row_counts() -> None:
    estimate = known(0.05, 2.0)
    assert across_std_m(estimate, math.pi / 2) == pytest.approx(0.05)
    assert across_std_m(estimate, 0.0) == pytest.approx(2.0)
    turned = msgspec.structs.replace(known(0.0, 0.0), pose_cov=(1, -1, 0, -1, 1, 0, 0, 0, 0.01))
    assert across_std_m(turned, math.pi / 4) == pytest.approx(math.sqrt(2.0))
    assert across_std_m(turned, -math.pi / 4) == pytest.approx(0.0)


def test_speed_falls_to_a_creep_and_then_to_nothing() -> None:
    assert caution_ratio(CONFIG.full_speed_std_m, CONFIG) == 1.0
    assert caution_ratio(CONFIG.max_row_std_m, CONFIG) == pytest.approx(CREEP_RATIO)
    assert caution_ratio(CONFIG.max_row_std_m + 0.01, CONFIG) == 0.0
    assert caution_ratio(math.nan, CONFIG) == 0.0
    steps = [caution_ratio(0.01 * step, CONFIG) for step in range(26)]
    assert steps == sorted(steps, reverse=True)
