"""Farm.world: where everything stands, and that the robot can reach its rows."""

from __future__ import annotations

import math
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from agribot.core.config import load
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import Shape
from agribot.core.world import Obstacle, Plant, WorldSpec
from agribot.description.loader import load_robot
from agribot.description.package import ROOT
from agribot.description.worlds_sdf import list_worlds, load_world
from tests import machine

HEADLAND_M = 1.8
CLEAR_M = 1.5


@pytest.fixture(scope="module")
def farm() -> WorldSpec:
    return load_world("Farm", seed=1)


def _of_class(world: WorldSpec, plant: PlantClass) -> list[Plant]:
    return [p for p in world.plants if p.plant == plant]


def _xy(plants: list[Plant]) -> FloatArray:
    return np.array([(p.x_map_m, p.y_map_m) for p in plants])


def _radius_m(obstacle: Obstacle) -> float:
    """Of a circle, about the obstacle's own origin, that holds it all."""
    return max(
        math.hypot(*shape.origin.xyz_m[:2])
        + (math.hypot(*shape.size_m) / 2 if shape.kind == "box" else max(shape.size_m))
        for shape in obstacle.shapes
    )


def test_farm_is_read_without_a_warning(farm: WorldSpec) -> None:
    assert farm.warnings == () and farm.name == "Farm"


def test_map_lies_at_the_datum_of_the_field(farm: WorldSpec) -> None:
    assert farm.datum == load("farm").field.datum
    assert (farm.datum.lat_deg, farm.datum.lon_deg) == (21.161289, 72.787022)


def test_36_crops_stand_in_six_rows_to_the_north(farm: WorldSpec) -> None:
    # In the file x is North and y is West: x in 2..12, y in -1..-6.
    expected = {(float(-y), float(x)) for x in range(2, 13, 2) for y in range(-6, 0)}
    crops = [(p.x_map_m, p.y_map_m) for p in _of_class(farm, PlantClass.CROP)]
    assert len(crops) == 36 and set(crops) == expected


def test_crops_stand_on_the_rows_that_the_profile_drives(farm: WorldSpec) -> None:
    field = load("farm").field
    yaw = math.radians(field.row_yaw_deg)
    along, right = np.array([np.cos(yaw), np.sin(yaw)]), np.array([np.sin(yaw), -np.cos(yaw)])
    offset = _xy(_of_class(farm, PlantClass.CROP)) - np.array(field.first_row_start_map_m)
    row = offset @ right / field.row_pitch_m
    np.testing.assert_allclose(row, np.round(row), atol=1e-9)
    assert set(np.round(row).astype(int)) == set(range(field.row_count))
    assert (offset @ along).min() == pytest.approx(0.0, abs=1e-9)
    assert (offset @ along).max() == pytest.approx(field.row_length_m)


def test_crops_are_of_one_kind_and_about_20_cm_tall(farm: WorldSpec) -> None:
    crops = _of_class(farm, PlantClass.CROP)
    assert {(p.species, p.stem_radius_m) for p in crops} == {("sugar_beet", 0.055)}
    sizes = [p.size_m for p in crops]
    assert 0.18 <= min(sizes) < max(sizes) <= 0.22
    assert len({p.seed for p in crops}) == 36 and len({p.yaw_rad for p in crops}) == 36


def test_robot_starts_west_of_the_pole_looking_north(farm: WorldSpec) -> None:
    assert farm.spawn_xy_map_m == pytest.approx((-1.99996, 0.0017), abs=1e-12)
    assert farm.spawn_yaw_map_rad == pytest.approx(math.pi / 2)


def test_compass_points_north_and_down(farm: WorldSpec) -> None:
    assert farm.field_enu_t == pytest.approx((0.0, 3.8e-5, -2.3e-5))


def test_gravity_friction_and_sun_are_those_of_the_file(farm: WorldSpec) -> None:
    assert farm.gravity_mps2 == 9.8
    assert farm.friction_ratio == 50.0  # the smaller of 100 and 50; the tyre's 1.0 decides
    assert np.linalg.norm(farm.light.to_sun) == pytest.approx(1.0)
    # The light falls along (-0.5, 0.1, -0.9) in North, West, Up.
    np.testing.assert_allclose(
        farm.light.to_sun, np.array([0.1, 0.5, 0.9]) / math.sqrt(1.07), atol=1e-9
    )
    assert (farm.light.diffuse, farm.light.ambient) == (0.8, 0.4)


def test_soil_lies_on_grass_and_a_road_runs_along_the_east_side(farm: WorldSpec) -> None:
    tiles = [(t.surface, t.x_min_m, t.y_min_m, t.x_max_m, t.y_max_m) for t in farm.ground]
    assert tiles == [
        ("grass", -24.0, -25.0, 26.0, 25.0),
        ("soil", -11.5, -12.5, 13.5, 12.5),
        ("pavement", 13.5, -12.5, 18.5, 12.5),
    ]


def test_all_things_of_the_farm_are_there_under_their_own_names(farm: WorldSpec) -> None:
    assert len({o.name for o in farm.obstacles}) == len(farm.obstacles)
    assert Counter(o.kind for o in farm.obstacles) == {
        "base_station": 1, "house": 1, "pine": 10, "oak": 12, "lamp_post": 3,
        "person_walking": 3, "person_standing": 1, "table": 1, "telephone_pole": 1,
        "speed_limit_sign": 1,
    }  # fmt: skip
    assert all(o.collides and o.shapes for o in farm.obstacles)


def test_known_places_are_kept(farm: WorldSpec) -> None:
    at = {o.name: (o.x_map_m, o.y_map_m) for o in farm.obstacles}
    assert at["Pole"] == (0.0, 0.0)
    assert at["house"] == pytest.approx((-15.4, 15.4))
    assert at["table"] == pytest.approx((-12.1, 3.0))
    assert at["telephone_pole"] == pytest.approx((18.5, 14.7))
    assert at["speed_limit_sign"] == pytest.approx((18.4, -6.6))
    assert {at[f"pine_{i}"][0] for i in range(1, 11)} == {13.3}


def _lowest_m(shape: Shape) -> float:
    """Lowest point of a shape above the origin of its obstacle."""
    pose = shape.origin.matrix()
    if shape.kind == "sphere":
        return float(pose[2, 3]) - shape.size_m[0]
    if shape.kind == "box":
        return float(pose[2, 3] - np.abs(pose[2, :3]) @ shape.size_m / 2)
    upright = abs(float(pose[2, 2]))
    rim_m = shape.size_m[0] * math.sqrt(max(0.0, 1.0 - upright**2))
    return float(pose[2, 3]) - upright * shape.size_m[1] / 2 - rim_m


def test_things_stand_on_the_ground(farm: WorldSpec) -> None:
    for obstacle in farm.obstacles:
        lowest_m = obstacle.z_map_m + min(_lowest_m(shape) for shape in obstacle.shapes)
        assert lowest_m == pytest.approx(0.0, abs=0.02), obstacle.name


def test_base_station_is_a_pole_with_its_antenna_on_top(farm: WorldSpec) -> None:
    base = next(o for o in farm.obstacles if o.name == "Pole")
    assert base.shapes[0].size_m[:2] == (0.05, 0.5)
    assert base.shapes[1].size_m == (0.05, 0.05, 0.05)


def _distance_to_box(x_m: float, y_m: float, box: tuple[float, float, float, float]) -> float:
    x_min, y_min, x_max, y_max = box
    return math.hypot(max(x_min - x_m, 0.0, x_m - x_max), max(y_min - y_m, 0.0, y_m - y_max))


def test_rows_and_headlands_are_clear(farm: WorldSpec) -> None:
    crops = _xy(_of_class(farm, PlantClass.CROP))
    low, high = crops.min(axis=0), crops.max(axis=0)
    worked = (low[0], low[1] - HEADLAND_M, high[0], high[1] + HEADLAND_M)
    for obstacle in farm.obstacles:
        gap_m = _distance_to_box(obstacle.x_map_m, obstacle.y_map_m, worked) - _radius_m(obstacle)
        # The base station is the origin of the map, 1.02 m from the corner of the headland.
        least_m = 0.4 if obstacle.name == "Pole" else CLEAR_M
        assert gap_m > least_m, obstacle.name


def test_the_way_to_the_first_row_is_wide_enough_for_the_robot(farm: WorldSpec) -> None:
    start, end = np.array(farm.spawn_xy_map_m), np.array([1.0, 2.0])
    steps = start + np.linspace(0.0, 1.0, 101)[:, None] * (end - start)
    robot = load_robot().drive
    half_diagonal_m = (
        math.hypot(
            robot.track_m + robot.wheel_width_m, robot.wheelbase_m + 2 * robot.wheel_radius_m
        )
        / 2
    )
    for obstacle in farm.obstacles:
        to_way_m = np.hypot(*(steps - (obstacle.x_map_m, obstacle.y_map_m)).T).min()
        least_m = half_diagonal_m if obstacle.name == "Pole" else CLEAR_M
        solid_m = 0.05 if obstacle.name == "Pole" else _radius_m(obstacle)
        assert to_way_m - solid_m > least_m, obstacle.name


def test_weeds_stand_in_their_area_and_away_from_crops(farm: WorldSpec) -> None:
    weeds, crops = (_of_class(farm, kind) for kind in (PlantClass.WEED, PlantClass.CROP))
    gaps = np.linalg.norm(_xy(weeds)[:, None] - _xy(crops)[None], axis=2)
    assert gaps.min() >= 0.15 - 1e-9
    near_crop = gaps.min(axis=1) <= 0.35
    x, y = _xy(weeds).T
    in_area = (x >= 0.5) & (x <= 6.5) & (y >= 1.0) & (y <= 13.0)
    assert (in_area | near_crop).all()


def test_weeds_differ_in_kind_size_and_shape(farm: WorldSpec) -> None:
    weeds = _of_class(farm, PlantClass.WEED)
    assert {w.species for w in weeds} == {"grass", "goosefoot", "thistle", "amaranth"}
    sizes = [w.size_m for w in weeds]
    assert 0.04 <= min(sizes) < 0.06 and 0.13 < max(sizes) <= 0.15
    assert len({w.seed for w in weeds}) == len(weeds)


def test_packaged_worlds_are_listed_and_all_load() -> None:
    assert list_worlds() == [
        "Farm", "beet", "empty", "final", "hills", "rows-10x12", "volcano", "world1",
    ]  # fmt: skip
    for name in list_worlds():
        assert load_world(name).warnings == ()


def test_empty_world_is_bare_soil_with_the_robot_at_the_origin() -> None:
    empty = load_world("empty")
    assert empty.plants == () and empty.obstacles == ()
    assert [t.surface for t in empty.ground] == ["soil"]
    assert empty.spawn_xy_map_m == (0.0, 0.0)
    assert empty.spawn_yaw_map_rad == pytest.approx(math.pi / 2)


def test_package_knows_no_other_machine() -> None:
    for file in [*(ROOT / "worlds").iterdir(), *(ROOT / "models").rglob("*.*")]:
        assert str(ROOT).encode() not in file.read_bytes() and " " not in file.name


FILES = (
    ROOT / "worlds" / "empty.world",
    ROOT / "urdf" / "entry_gate.urdf",
    *sorted((ROOT / "models").glob("*/model.sdf")),
    *sorted(set((ROOT / "worlds").glob("*.world")) - {ROOT / "worlds" / "empty.world"}),
)


@pytest.mark.parametrize(
    "file",
    [*FILES[:3], *(pytest.param(file, marks=pytest.mark.nightly) for file in FILES[3:])],
    ids=lambda file: f"{file.parent.name}-{file.stem}",
)
def test_files_pass_the_sdf_checker(file: Path) -> None:
    machine.require("ign")
    done = subprocess.run(
        ["ign", "sdf", "-k", str(file)],
        capture_output=True, text=True, check=False,
        env={"SDF_PATH": str(ROOT / "models"), "PATH": "/usr/bin:/bin", "HOME": "/tmp"},
    )  # fmt: skip
    assert "Valid." in done.stdout, done.stdout + done.stderr
    assert "Error" not in done.stdout + done.stderr.replace("Library error", "")
