from __future__ import annotations

import math
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.certify import certify, find_closest_to_crop
from agribot.autonomy.plan.ways.curves import MIN_RADIUS_M
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.autonomy.plan.ways.speed import plan_speed_mps
from agribot.core.config import FieldConfig
from agribot.core.facts import NoClearWay, NoRows, OverCrop
from agribot.core.messages import Path, Row
from agribot.core.row_shape import project_on_row, row_length_m
from tests.autonomy.plan.planting import FARM, FARM_START, MISSION, from_field_frame, in_field_frame
from tests.finding import refused
from tests.robot_parts import HALF_TRACK_M, WHEEL_WIDTH_M, plain_rover


def planned(field: FieldConfig, start: tuple[float, float, float]) -> Path:
    return plan_rows(lay_rows(field), start, plain_rover(), MISSION)


def rows_in_order(path: Path) -> list[int]:
    worked = path.row[path.row >= 0]
    return [int(row) for row in worked[np.flatnonzero(np.diff(worked, prepend=-1))]]


def test_farm_rows_run_north_and_each_further_one_lies_to_the_east() -> None:
    rows = lay_rows(FARM)
    assert [row.start_map_m for row in rows] == [
        pytest.approx((1.0 + index, 2.0)) for index in range(6)
    ]
    assert all(row.end_map_m == pytest.approx((row.start_map_m[0], 12.0)) for row in rows)


def test_farm_mission_starts_at_the_robot_and_works_every_row_once() -> None:
    path = planned(FARM, FARM_START)
    assert path.xy_map_m[0] == pytest.approx(FARM_START[:2])
    assert path.yaw_map_rad[0] == pytest.approx(FARM_START[2])
    assert rows_in_order(path) == [0, 1, 2, 3, 4, 5]


def test_farm_wheels_keep_twenty_centimetres_off_every_row() -> None:
    path = planned(FARM, FARM_START)
    closest = find_closest_to_crop(path, plain_rover(), lay_rows(FARM))
    assert closest.clearance_m >= 0.2
    straddling_m = HALF_TRACK_M - WHEEL_WIDTH_M / 2
    assert closest.clearance_m == pytest.approx(straddling_m, abs=1e-6)


@pytest.mark.parametrize("yaw_deg", [0.0, 37.0, 90.0, 180.0, -120.0])
@pytest.mark.parametrize(("count", "pitch_m"), [(1, 1.0), (2, 1.0), (3, 0.58), (4, 0.75), (3, 2.5)])
def test_rows_of_any_direction_number_and_pitch_are_covered_clear_of_the_crop(
    yaw_deg: float, count: int, pitch_m: float
) -> None:
    field = FieldConfig(
        first_row_start_map_m=(-7.0, 3.0), row_yaw_deg=yaw_deg, row_count=count,
        row_pitch_m=pitch_m, row_length_m=6.0,
    )  # fmt: skip
    mission = msgspec.structs.replace(MISSION, plant_clearance_m=0.1)
    rows = lay_rows(field)
    path = plan_rows(rows, from_field_frame(field, -3.0, -2.0, 0.4), plain_rover(), mission)
    certify(path, rows, plain_rover(), 0.1)
    assert sorted(rows_in_order(path)) == list(range(count))
    local = in_field_frame(field, path.xy_map_m)
    for row in range(count):
        inside = local[path.row == row]
        assert np.abs(inside[:, 1] - row * pitch_m).max() < 1e-6
        assert inside[:, 0].min() == pytest.approx(0.0, abs=0.021)
        assert inside[:, 0].max() == pytest.approx(6.0, abs=0.021)


def test_thirty_rows_are_driven_in_alternating_direction() -> None:
    field = FieldConfig(row_count=30)
    path = planned(field, FARM_START)
    assert rows_in_order(path) == list(range(30))
    for row in range(30):
        north = np.sin(path.yaw_map_rad[path.row == row])
        assert north == pytest.approx(np.full_like(north, 1.0 if row % 2 == 0 else -1.0))


def test_turn_of_one_metre_pitch_is_a_semicircle_behind_a_straight_headland() -> None:
    path = planned(FARM, FARM_START)
    first = int(np.flatnonzero(path.row == 0)[-1])
    second = int(np.flatnonzero(path.row == 1)[0])
    between = slice(first, second)
    assert path.s_m[second] - path.s_m[first] == pytest.approx(2.0 + math.pi * 0.5, abs=0.03)
    assert path.xy_map_m[between, 1].max() == pytest.approx(13.5, abs=1e-3)
    assert set(np.round(path.curvature_radpm[between], 9)) == {0.0, -2.0}


def test_narrow_pitch_turns_in_a_bulb_no_tighter_than_the_robot_can() -> None:
    field = FieldConfig(row_pitch_m=0.58)
    path = planned(field, FARM_START)
    assert np.abs(path.curvature_radpm).max() <= 1.0 / MIN_RADIUS_M + 1e-9
    turn = path.curvature_radpm[path.s_m > path.s_m[path.row == 0][-1] + 1.0]
    assert {1.0, -1.0} <= set(np.sign(turn))


def test_wide_pitch_crosses_the_headland_straight() -> None:
    field = FieldConfig(row_pitch_m=3.0, row_count=2)
    path = planned(field, FARM_START)
    crossing = np.abs(np.cos(path.yaw_map_rad)) > 1.0 - 1e-9
    on_headland = crossing & (path.xy_map_m[:, 1] > 13.0)
    assert np.ptp(path.xy_map_m[on_headland, 0]) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ("start", "first_row", "north_m"),
    [
        ((-2.0, 0.0, 90.0), 0, 2.0),
        ((8.0, 0.0, 90.0), 5, 2.0),
        ((-2.0, 14.0, 0.0), 0, 12.0),
        ((8.0, 15.0, 180.0), 5, 12.0),
    ],
)
def test_work_begins_at_the_nearest_corner(
    start: tuple[float, float, float], first_row: int, north_m: float
) -> None:
    path = planned(FARM, (start[0], start[1], math.radians(start[2])))
    assert rows_in_order(path)[0] == first_row
    first = int(np.flatnonzero(path.row >= 0)[0])
    assert path.xy_map_m[first, 1] == pytest.approx(north_m, abs=0.01)


@pytest.mark.parametrize("too_near_m", [-0.1, 0.0, 0.05, 0.1, 0.2])
@pytest.mark.parametrize(("left_m", "turned_deg"), [(0.0, 0.0), (0.05, 3.0), (-0.08, -4.0)])
def test_a_robot_that_stands_a_little_too_near_drives_into_its_first_row_at_once(
    too_near_m: float, left_m: float, turned_deg: float
) -> None:
    """It drove the first row with the tool off to turn behind it, or a circle in front of it."""
    north_m = 2.0 - MISSION.headland_m + too_near_m
    path = planned(FARM, (1.0 - left_m, north_m, math.radians(90.0 + turned_deg)))
    certify(path, lay_rows(FARM), plain_rover(), MISSION.plant_clearance_m)
    first = int(np.flatnonzero(path.row >= 0)[0])
    assert rows_in_order(path)[0] == 0
    assert path.s_m[first] == pytest.approx(2.0 - north_m, abs=0.05)
    run_in = path.curvature_radpm[(path.s_m > path.s_m[first] - 0.3) & (path.s_m < path.s_m[first])]
    assert np.all(run_in == 0.0)


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0, -90.0])
@pytest.mark.parametrize("place", [(-2.0, 7.0), (8.5, 7.0), (3.5, -2.0), (3.5, 16.0)])
def test_the_way_in_goes_around_the_crop_from_every_side(
    place: tuple[float, float], yaw_deg: float
) -> None:
    path = planned(FARM, (*place, math.radians(yaw_deg)))
    certify(path, lay_rows(FARM), plain_rover(), MISSION.plant_clearance_m)


@pytest.mark.parametrize("yaw_deg", [90.0, -90.0])
def test_a_robot_left_in_the_middle_of_a_row_leaves_along_it(yaw_deg: float) -> None:
    path = planned(FARM, (3.0, 7.0, math.radians(yaw_deg)))
    certify(path, lay_rows(FARM), plain_rover(), MISSION.plant_clearance_m)
    assert sorted(rows_in_order(path)) == [0, 1, 2, 3, 4, 5]


def test_a_robot_across_a_row_is_told_to_move() -> None:
    with refused(NoClearWay(3.0, 7.0, ANY)):
        planned(FARM, (3.0, 7.0, 0.0))


def test_uneven_row_ends_are_cleared_before_the_turn() -> None:
    rows = (
        Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(0.0, 8.0)),
        Row(index=1, start_map_m=(1.0, 2.0), end_map_m=(1.0, 11.0)),
        Row(index=2, start_map_m=(2.0, -3.0), end_map_m=(2.0, 9.0)),
    )
    path = plan_rows(rows, (0.0, -2.0, math.pi / 2), plain_rover(), MISSION)
    certify(path, rows, plain_rover(), 0.2)
    assert rows_in_order(path) == [0, 1, 2]


def test_field_without_rows_is_refused() -> None:
    with refused(NoRows):
        plan_rows((), FARM_START, plain_rover(), MISSION)


def test_plan_is_the_same_every_time() -> None:
    first, second = planned(FARM, FARM_START), planned(FARM, FARM_START)
    assert np.array_equal(first.xy_map_m, second.xy_map_m)


@pytest.mark.parametrize("bend_radpm", [0.03, -0.03, 0.1])
def test_bent_rows_are_driven_along_their_arcs_with_the_wheels_off_the_crop(
    bend_radpm: float,
) -> None:
    field = msgspec.structs.replace(FARM, row_curvature_radpm=bend_radpm)
    rows = lay_rows(field)
    path = planned(field, FARM_START)
    certify(path, rows, plain_rover(), MISSION.plant_clearance_m)
    assert rows_in_order(path) == [0, 1, 2, 3, 4, 5]
    for row in rows:
        on_row = path.row == row.index
        along_m, left_m, _ = project_on_row(row, *path.xy_map_m[on_row].T)
        assert np.abs(left_m).max() < 1e-6
        assert along_m.min() < 0.03 and along_m.max() > row_length_m(row) - 0.03
    speed_mps = np.array(plan_speed_mps(path, MISSION))
    middle = (path.row == 2) & (np.abs(path.s_m - path.s_m[path.row == 2].mean()) < 2.0)
    assert speed_mps[middle] == pytest.approx(MISSION.speed_mps)


def test_a_straight_path_over_a_bent_row_is_refused_where_a_wheel_meets_the_crop() -> None:
    straight = planned(FARM, FARM_START)
    bent = lay_rows(msgspec.structs.replace(FARM, row_curvature_radpm=0.03))
    with refused(OverCrop(ANY, "row", ANY, ANY, ANY, ANY, ANY, ANY)):
        certify(straight, bent, plain_rover(), MISSION.plant_clearance_m)
