from __future__ import annotations

from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.certify import certify, find_closest_to_crop, trace_wheels_map_m
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.facts import Fact, OverCrop, PathBroken, PathNotFinite, PathTight
from agribot.core.messages import FloatArray, Path
from tests.autonomy.plan.planting import FARM, FARM_START, MISSION
from tests.finding import refused
from tests.robot_parts import HALF_TRACK_M, WHEEL_WIDTH_M, plain_rover

ROWS = lay_rows(FARM)


@pytest.fixture(scope="module")
def farm_path() -> Path:
    return plan_rows(ROWS, FARM_START, plain_rover(), MISSION)


def farm_plants() -> FloatArray:
    return np.array([(1.0 + row, 2.0 + 2.0 * plant) for row in range(6) for plant in range(6)])


def test_the_planned_farm_path_passes(farm_path: Path) -> None:
    certify(farm_path, ROWS, plain_rover(), 0.2)
    certify(farm_path, ROWS, plain_rover(), 0.2, farm_plants())


def test_path_shifted_onto_the_plants_is_refused_with_the_place(farm_path: Path) -> None:
    shifted = msgspec.structs.replace(farm_path, xy_map_m=farm_path.xy_map_m + np.array([0.35, 0]))
    closest = find_closest_to_crop(shifted, plain_rover(), ROWS)
    left_m = HALF_TRACK_M - 0.35 - WHEEL_WIDTH_M / 2
    assert closest.clearance_m == pytest.approx(left_m, abs=1e-6)
    east_m, north_m = shifted.xy_map_m[closest.point].tolist()
    along_m, row = float(shifted.s_m[closest.point]), ROWS[closest.crop].index
    with refused(OverCrop(closest.wheel, "row", row, east_m, north_m, along_m, left_m, 0.15)):
        certify(shifted, ROWS, plain_rover(), MISSION.plant_clearance_m)
    assert "left" in closest.wheel or "right" in closest.wheel


def test_known_plants_are_named_instead_of_rows(farm_path: Path) -> None:
    plants = np.array([[20.0, 20.0], farm_path.xy_map_m[500] + np.array([0.0, 0.5])])
    beside = trace_wheels_map_m(farm_path, plain_rover())[1000, 2]
    plants[1] = beside
    with refused(OverCrop(ANY, "plant", 1, ANY, ANY, ANY, -WHEEL_WIDTH_M / 2, 0.15)):
        certify(farm_path, ROWS, plain_rover(), 0.15, plants)


def test_clearance_agrees_with_a_brute_force_search(farm_path: Path) -> None:
    rng = np.random.default_rng(3)
    plants = rng.uniform((-3.0, -1.0), (8.0, 15.0), (40, 2))
    tracks = trace_wheels_map_m(farm_path, plain_rover()).reshape(-1, 2)
    gaps = np.hypot(*(tracks[:, None, :] - plants[None]).T)
    expected_m = gaps.min() - WHEEL_WIDTH_M / 2
    closest = find_closest_to_crop(farm_path, plain_rover(), ROWS, plants)
    assert closest.clearance_m == pytest.approx(expected_m)
    assert closest.crop == int(np.argmin(gaps.min(axis=1)))


def test_a_field_too_narrow_for_the_wheels_is_refused() -> None:
    rows = lay_rows(FieldConfig(row_pitch_m=0.4, row_count=3))
    path = plan_rows(rows, (0.0, -3.0, 1.57), plain_rover(), MISSION)
    with refused(OverCrop(ANY, "row", ANY, ANY, ANY, ANY, ANY, ANY)):
        certify(path, rows, plain_rover(), 0.15)


def broken(path: Path, column: str, index: int, value: float) -> Path:
    array = getattr(path, column).copy()
    array[index] = value
    return msgspec.structs.replace(path, **{column: array})


@pytest.mark.parametrize(
    ("column", "index", "value", "why"),
    [
        ("xy_map_m", 300, np.nan, PathNotFinite(300)),
        ("xy_map_m", 300, 50.0, PathBroken("spacing", 0.05, ANY, ANY, ANY)),
        ("s_m", 300, 0.0, PathBroken("distance", 0.002, ANY, ANY, ANY)),
        ("yaw_map_rad", 900, 0.3, PathBroken("heading", 0.002, ANY, ANY, ANY)),
        ("curvature_radpm", 300, 5.0, PathTight(0.3, ANY, ANY, ANY)),
    ],
)
def test_every_broken_rule_has_its_own_fact(
    farm_path: Path, column: str, index: int, value: float, why: Fact
) -> None:
    with refused(why):
        certify(broken(farm_path, column, index, value), ROWS, plain_rover(), 0.15)


def test_a_kink_between_points_is_tighter_than_any_wheel_can_turn(farm_path: Path) -> None:
    kinked = farm_path.yaw_map_rad.copy()
    kinked[1500:] += 0.08
    turned = msgspec.structs.replace(farm_path, yaw_map_rad=kinked)
    with refused(PathTight(0.3, ANY, ANY, ANY)):
        certify(turned, ROWS, plain_rover(), 0.15)
