"""Ways to a place in a planned field: inside the boundary, around obstacles, off the crop."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from agribot.autonomy.plan.coverage.area import FieldArea, PlanRequest
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.ways.curves import Place
from agribot.core.errors import MissionError
from agribot.core.facts import Fact, NoRoomToFace, PlaceUnfit, ThereAlready
from tests.autonomy.plan.fields import REQUEST, ROW_REQUEST, ROWS, SHAPE, WITH_HOLE, certified

HALF_TURN_M = SHAPE.turn_radius_m
START = (3.0, 6.5)


def work(area: FieldArea, request: PlanRequest = REQUEST) -> FieldWork:
    plan, certificate = certified(area, request)
    assert certificate.ok
    return FieldWork(plan, area, SHAPE, request)


@pytest.fixture(scope="module")
def meadow() -> FieldWork:
    return work(WITH_HOLE)


@pytest.fixture(scope="module")
def crop() -> FieldWork:
    return work(ROWS, ROW_REQUEST)


def test_the_way_leads_around_the_obstacle_that_lies_between(meadow: FieldWork) -> None:
    path = meadow.plan_to(START, (16.0, 6.5, None))
    hole = shapely.Polygon(WITH_HOLE.holes[0])
    assert shapely.LineString([START, (16.0, 6.5)]).crosses(hole)
    assert shapely.LineString(path.xy_map_m).distance(hole) >= HALF_TURN_M
    assert path.xy_map_m[0] == pytest.approx(START)
    assert path.xy_map_m[-1] == pytest.approx((16.0, 6.5))
    assert set(path.row) == {-1}


@pytest.mark.parametrize("yaw_deg", [-120.0, 0.0, 77.0, 180.0])
def test_the_robot_ends_as_it_is_to_look(meadow: FieldWork, yaw_deg: float) -> None:
    yaw_rad = math.radians(yaw_deg)
    path = meadow.plan_to(START, (5.0, 11.0, yaw_rad))
    assert path.xy_map_m[-1] == pytest.approx((5.0, 11.0))
    assert math.cos(float(path.yaw_map_rad[-1]) - yaw_rad) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ((25.0, 6.5, None), PlaceUnfit(25.0, 6.5, "beyond")),
        ((10.0, 7.0, None), PlaceUnfit(10.0, 7.0, "obstacle")),
        ((0.3, 0.3, None), PlaceUnfit(0.3, 0.3, "edge")),
        ((0.75, 6.5, 0.0), NoRoomToFace(0.75, 6.5)),
        ((*START, None), ThereAlready()),
    ],
)
def test_a_place_that_cannot_be_driven_to_is_refused(
    meadow: FieldWork, goal: Place, why: Fact
) -> None:
    with pytest.raises(MissionError) as refused:
        meadow.plan_to(START, goal)
    assert refused.value.fact == why


def test_crop_is_no_place_and_no_way(crop: FieldWork) -> None:
    with pytest.raises(MissionError) as refused:
        crop.plan_to((-3.0, 5.0), (2.5, 5.0, None))
    assert refused.value.fact == PlaceUnfit(2.5, 5.0, "crop")
    path = crop.plan_to((-3.0, 5.0), (9.0, 5.0, None))
    rows = shapely.MultiLineString([list(row) for row in ROWS.rows])
    turning_m = SHAPE.wheel_turn_radius_m
    assert shapely.LineString(path.xy_map_m).distance(rows) >= turning_m
    assert float(np.max(path.s_m)) > 12.0, "around the rows, not through them"


def test_work_is_found_again_where_it_stopped(meadow: FieldWork) -> None:
    """On the headland, nearer to the edge than the robot can turn with room to spare."""
    planned = meadow.plan_from((*START, 0.0))
    place = planned.xy_map_m[len(planned.xy_map_m) // 2]
    path = meadow.plan_back(START, (float(place[0]), float(place[1]), 0.0))
    assert path.xy_map_m[-1] == pytest.approx(place, abs=1e-6)
