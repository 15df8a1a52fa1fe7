"""Row lines against poses: what stands aside or turned is found, facing either way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.app.calibration.row_view import Glance, fit_row_view
from agribot.core.config import FieldConfig
from agribot.core.facts import NoRowLine
from agribot.core.messages import RowLine
from tests.finding import refused

FIELD = FieldConfig(
    first_row_start_map_m=(0.0, 0.0), row_yaw_deg=0.0, row_length_m=10.0, row_pitch_m=1.0,
    row_count=2,
)  # fmt: skip
BIAS_M, BIAS_RAD = 0.05, math.radians(2.0)


def glances(bias_m: float, bias_rad: float, ways: Sequence[float] = (0.0, math.pi)) -> list[Glance]:
    """A robot 3 cm left of its line and turned by a degree sees row 0 (y = 0) from a metre on."""
    rng = np.random.default_rng(1)
    found = []
    for yaw_rad in ways:
        left_m, turned_rad, sign = 0.03, math.radians(1.0), 1.0 if yaw_rad == 0.0 else -1.0
        for along_m in np.arange(0.5, 9.5, 0.05).tolist():
            ahead_left_m = left_m + math.sin(turned_rad)
            line = RowLine(
                t_s=0.0,
                offset_m=ahead_left_m + bias_m + 0.01 * rng.standard_normal(),
                heading_rad=turned_rad + bias_rad + 0.01 * rng.standard_normal(),
                offset_std_m=0.01, heading_std_rad=0.01, at_ahead_m=1.0, start_ahead_m=None,
                end_ahead_m=None, range_std_m=0.1,
            )  # fmt: skip
            found.append(Glance((along_m, sign * left_m, yaw_rad + turned_rad), line, 0.01, 0.003))
    return found


@pytest.mark.parametrize("ways", [(0.0,), (math.pi,), (0.0, math.pi)])
def test_a_camera_that_looks_aside_is_found_whichever_way_the_robot_drives(
    ways: Sequence[float],
) -> None:
    fit = fit_row_view(glances(BIAS_M, BIAS_RAD, ways), FIELD)
    assert fit.offset_bias_m == pytest.approx(BIAS_M, abs=0.005)
    assert fit.heading_bias_rad == pytest.approx(BIAS_RAD, abs=0.005)
    assert fit.offset_scatter_m == pytest.approx(0.01, rel=0.3)
    told = " ".join(fit.complaints())
    assert "seen +5" in told or "seen +4" in told
    assert "turned by +2" in told or "turned by +1.9" in told


def test_rows_that_are_seen_where_they_stand_are_good() -> None:
    assert not fit_row_view(glances(0.0, 0.0), FIELD).complaints()


def test_a_coarse_pose_or_pictures_without_rows_are_not_enough() -> None:
    coarse = [glance._replace(pos_std_m=1.2) for glance in glances(0.0, 0.0)]
    assert "receiver with corrections" in fit_row_view(coarse, FIELD).complaints()[0]
    blind = [glance._replace(line=None) for glance in coarse]
    with refused(NoRowLine):
        fit_row_view(blind, FIELD)
    mostly = fit_row_view(glances(0.0, 0.0)[:60] + blind, FIELD)
    assert "at least 50%" in mostly.complaints()[0]
    beside = [msgspec.structs.replace(FIELD, first_row_start_map_m=(0.0, 20.0))]
    with refused(NoRowLine(0, 360)):
        fit_row_view(glances(0.0, 0.0), beside[0])
