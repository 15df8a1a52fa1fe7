"""Rows as a map draws them: any lines, each place measured against the one next to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.field_rows import FieldRows
from agribot.autonomy.estimate.sensors.mapped_rows import MappedRows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig

FIELD = FieldConfig(
    first_row_start_map_m=(3.0, -2.0), row_yaw_deg=37.0, row_length_m=12.0, row_count=4
)
FAN = (((0.0, 0.0), (10.0, 0.0)), ((0.0, 1.0), (10.0, 1.6)), ((1.0, 2.0), (9.0, 3.0)))


def test_the_rows_of_the_settings_are_the_same_when_a_map_draws_them() -> None:
    told = FieldRows(FIELD)
    drawn = MappedRows([(row.start_map_m, row.end_map_m) for row in lay_rows(FIELD)])
    rng = np.random.default_rng(1)
    for along_m, right_m in zip(rng.uniform(-1, 13, 60), rng.uniform(-1.4, 4.4, 60), strict=True):
        place = [
            FIELD.first_row_start_map_m[axis]
            + along_m * told.forward[axis]
            + right_m * told.right[axis]
            for axis in (0, 1)
        ]
        want, got = told.at(*place), drawn.at(*place)
        assert (got.row, got.length_m, got.pitch_m) == pytest.approx((want.row, 12.0, 1.0))
        assert (got.along_m, got.off_m) == pytest.approx((want.along_m, want.off_m))
        assert got.right == pytest.approx(want.right)
    assert drawn.yaw_rad == pytest.approx(told.yaw_rad)


@pytest.mark.parametrize("is_turned", [False, True])
def test_each_row_has_its_own_beginning_direction_and_distance_to_the_next(
    is_turned: bool,
) -> None:
    """A map may draw a row from either end: all are read as the first one is."""
    lines = (FAN[0], FAN[1][::-1] if is_turned else FAN[1], FAN[2])
    rows = MappedRows(lines)
    beside = rows.at(5.0, 1.3 + 0.1)
    yaw_rad = math.atan2(0.6, 10.0)
    assert (beside.row, beside.yaw_rad) == pytest.approx((1, yaw_rad))
    assert beside.off_m == pytest.approx(0.1 * math.cos(yaw_rad))
    assert beside.along_m == pytest.approx(math.hypot(5.0, 0.3), abs=0.02)
    assert rows.at(0.0, 0.1).pitch_m == pytest.approx(1.0, abs=0.01)
    assert rows.at(9.9, 0.1).pitch_m == pytest.approx(1.59, abs=0.02)


def test_beyond_its_ends_a_row_goes_straight_on() -> None:
    before, behind = MappedRows(FAN).at(-0.8, 0.2), MappedRows(FAN).at(10.7, -0.3)
    assert (before.row, before.along_m, before.off_m) == pytest.approx((0, -0.8, 0.2))
    assert (behind.row, behind.along_m, behind.off_m) == pytest.approx((0, 10.7, -0.3))


def test_a_bent_row_drawn_point_by_point_is_that_of_its_arc() -> None:
    """Radius 25 m, a point each half metre: 1.3 mm between arc and chord, 1.2 degrees a corner."""
    radius_m, turns = 25.0, np.linspace(0.0, 0.6, 31)
    arc = [(radius_m * math.sin(t), radius_m * (1.0 - math.cos(t))) for t in turns]
    rows = MappedRows([arc])
    for turned_rad in np.random.default_rng(2).uniform(0.02, 0.58, 40):
        inner_m = radius_m - 0.2
        at = rows.at(inner_m * math.sin(turned_rad), radius_m - inner_m * math.cos(turned_rad))
        assert at.along_m == pytest.approx(radius_m * turned_rad, abs=0.01)
        assert at.off_m == pytest.approx(0.2, abs=0.002)
        assert at.yaw_rad == pytest.approx(turned_rad, abs=0.003)


def test_a_corner_is_rounded_and_places_outside_it_belong_to_it() -> None:
    rows = MappedRows([((0.0, 0.0), (5.0, 0.0), (10.0, 1.0))])
    corner_rad = math.atan2(1.0, 5.0)
    assert rows.at(2.0, 0.1).yaw_rad == 0.0
    assert rows.at(5.0, 0.0).yaw_rad == pytest.approx(corner_rad / 2.0)
    outside = rows.at(5.02, -0.3)
    assert outside.along_m == pytest.approx(5.0)
    assert outside.off_m == pytest.approx(-math.hypot(0.02, 0.3))


@pytest.mark.parametrize("lines", [[], [((1.0, 1.0), (1.0, 1.0))]])
def test_a_field_without_rows_has_none_and_no_place_in_one(
    lines: list[tuple[tuple[float, float], ...]],
) -> None:
    rows = MappedRows(lines)
    assert not rows.has_rows
    nowhere = rows.at(3.0, 4.0)
    assert (nowhere.row, nowhere.length_m, nowhere.off_m) == (-1, 0.0, 0.0)
    assert nowhere.right == pytest.approx((0.0, -1.0))
