"""What the page's map gets about the ground."""

from __future__ import annotations

import math

import pytest

from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.ui.ground import field_of


def test_posts_are_rings_of_their_radius_and_holes_of_a_plan_are_kept() -> None:
    farm = config.load("farm", ["field.obstacles_map_m=[[3.0,-1.0,0.25]]"])
    hole = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))
    area = FieldArea(boundary=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)), holes=(hole,))
    told = field_of(farm, lay_rows(farm.field), area=area)
    kept, post = told.obstacles_map_m
    assert kept == list(hole)
    assert told.boundary_map_m == [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0)]
    for x_m, y_m in post:
        assert math.hypot(x_m - 3.0, y_m + 1.0) == pytest.approx(0.25)


def test_a_field_without_obstacles_has_none() -> None:
    assert field_of(config.load("beet"), ()).obstacles_map_m == []
