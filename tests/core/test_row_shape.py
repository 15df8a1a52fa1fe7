"""Crop rows as lines and arcs: places beside them, lengths, directions, chords."""

from __future__ import annotations

import math
from itertools import pairwise
from unittest.mock import ANY

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.field_rows import FieldRows
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import RowsBent
from agribot.core.messages import Row
from agribot.core.row_shape import (
    end_yaw_rad,
    project_on_row,
    reverse_row,
    row_length_m,
    row_points_map_m,
    start_yaw_rad,
)
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)
from tests.finding import refused

QUARTER = Row(index=0, start_map_m=(10.0, 0.0), end_map_m=(0.0, 10.0), curvature_radpm=0.1)
BENDS = [0.0, 0.04, -0.04]


def _field(bend_radpm: float, yaw_deg: float = 37.0) -> FieldConfig:
    return FieldConfig(
        first_row_start_map_m=(3.0, -2.0),
        row_yaw_deg=yaw_deg,
        row_length_m=12.0,
        row_curvature_radpm=bend_radpm,
        row_count=5,
    )


def test_a_quarter_circle_about_the_origin_has_its_length_and_leads_north_then_west() -> None:
    assert row_length_m(QUARTER) == pytest.approx(5.0 * math.pi)
    assert start_yaw_rad(QUARTER) == pytest.approx(math.pi / 2.0)
    assert end_yaw_rad(QUARTER) == pytest.approx(math.pi)
    points = row_points_map_m(QUARTER)
    assert np.hypot(*points.T) == pytest.approx(np.full(len(points), 10.0))
    middles = (points[1:] + points[:-1]) / 2.0
    assert 10.0 - np.hypot(*middles.T).min() < 0.0011


def test_a_place_inside_the_circle_lies_left_of_a_row_that_bends_left() -> None:
    along_m, left_m, yaw_rad = project_on_row(QUARTER, 9.0 * math.cos(0.3), 9.0 * math.sin(0.3))
    assert along_m == pytest.approx(3.0)
    assert left_m == pytest.approx(1.0)
    assert yaw_rad == pytest.approx(math.pi / 2.0 + 0.3)


@pytest.mark.parametrize("bend", BENDS)
def test_from_its_other_end_a_row_is_the_same_line(bend: float) -> None:
    row = lay_rows(_field(bend))[2]
    back = reverse_row(row)
    there, here = project_on_row(row, 5.0, 1.0), project_on_row(back, 5.0, 1.0)
    assert here.along_m == pytest.approx(row_length_m(row) - there.along_m)
    assert here.left_m == pytest.approx(-there.left_m)
    assert math.cos(here.yaw_rad - there.yaw_rad) == pytest.approx(-1.0)


@pytest.mark.parametrize("bend", BENDS)
def test_rows_of_a_field_stay_one_pitch_apart_along_their_whole_length(bend: float) -> None:
    rows = lay_rows(_field(bend))
    for row, following in pairwise(rows):
        for x_m, y_m in row_points_map_m(following):
            assert project_on_row(row, x_m, y_m).left_m == pytest.approx(-1.0, abs=0.0015)


@pytest.mark.parametrize("bend", BENDS)
def test_the_rows_of_a_field_are_those_on_which_the_generator_puts_its_crop(bend: float) -> None:
    plan = FieldSettings(
        rows=RowsSettings(
            count=5, length_m=12.0, first_row_start_map_m=(3.0, -2.0), yaw_deg=37.0,
            curvature_radpm=bend,
        ),
        crop=CropSettings(spacing_m=0.25),
        weeds=WeedsSettings(density_per_m2=0.0),
    )  # fmt: skip
    rows = lay_rows(_field(bend))
    for plant in generate_field(plan, 1).plants:
        nearest = min(abs(project_on_row(row, plant.x_map_m, plant.y_map_m).left_m) for row in rows)
        assert nearest < 1e-5


@pytest.mark.parametrize("bend", BENDS)
@pytest.mark.parametrize("place", [(5.0, 1.0), (9.0, 3.5), (2.0, -4.0)])
def test_coordinates_of_the_rows_change_with_the_place_as_their_directions_say(
    bend: float, place: tuple[float, float]
) -> None:
    rows, step_m = FieldRows(_field(bend)), 1e-5
    at = rows.at(*place)
    scale = 1.0 + bend * at.right_m
    for direction, d_along, d_right in ((at.forward, 1.0 / scale, 0.0), (at.right, 0.0, 1.0)):
        moved = rows.at(place[0] + step_m * direction[0], place[1] + step_m * direction[1])
        assert (moved.along_m - at.along_m) / step_m == pytest.approx(d_along, abs=1e-4)
        assert (moved.right_m - at.right_m) / step_m == pytest.approx(d_right, abs=1e-4)
    for row in lay_rows(_field(bend)):
        end = rows.at(*row.end_map_m)
        assert (end.along_m, end.right_m) == pytest.approx((12.0, float(row.index)))
        assert end.stretch == pytest.approx(row_length_m(row) / 12.0)


def test_rows_that_would_run_into_each_other_are_refused() -> None:
    with refused(RowsBent(-0.2, ANY, ANY, ANY)):
        lay_rows(FieldConfig(row_curvature_radpm=-0.2, row_count=6))
