"""The other packaged worlds: the dense field, the bare one, hills and volcano."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.core.messages import DriveCommand, FloatArray, PlantClass, RobotCommand
from agribot.core.row_shape import project_on_row, row_points_map_m
from agribot.core.world import WorldSpec
from agribot.description.package import ROOT
from agribot.description.sdf_library import ModelLibrary
from agribot.description.terrain import (
    LANDSCAPES,
    find_landscape_file,
    load_heights,
    make_volcano,
    sample_height,
)
from agribot.description.worlds_sdf import check_world, list_worlds, load_world
from agribot.sim.platform import SimPlatform

Place = tuple[float, float]


def _crops(world: WorldSpec) -> set[Place]:
    return {
        (round(p.x_map_m, 6), round(p.y_map_m, 6))
        for p in world.plants
        if p.plant == PlantClass.CROP
    }


def _include_names(world: str) -> list[str]:
    root = ET.parse(ROOT / "worlds" / f"{world}.world").getroot()
    return [element.findtext("name", "") for element in root.iter("include")]


@pytest.mark.parametrize("name", list_worlds())
def test_a_strict_check_of_a_packaged_world_finds_nothing(name: str) -> None:
    assert check_world(name) == ()
    names = _include_names(name)
    assert len(set(names)) == len(names)


def test_final_world_is_the_farm_with_a_denser_field() -> None:
    final, farm = load_world("final"), load_world("Farm")
    expected = {(round(1 + 1.2 * row, 6), 2.0 + k) for row in range(4) for k in range(9)}
    assert _crops(final) == expected and len(expected) == 36
    others = {o.name for o in farm.obstacles} - {"Pole"}
    assert {o.name for o in final.obstacles} == others | {"entry_gate"}
    assert final.spawn_xy_map_m == farm.spawn_xy_map_m and final.ground == farm.ground


def test_world1_has_the_crops_of_the_farm_and_nothing_else() -> None:
    world = load_world("world1")
    assert _crops(world) == _crops(load_world("Farm"))
    assert world.obstacles == () and {tile.surface for tile in world.ground} == {"soil"}


def test_entry_gate_is_a_pole_with_its_own_receiver_on_top() -> None:
    gate = next(o for o in load_world("final").obstacles if o.name == "entry_gate")
    pole, antenna = gate.shapes
    assert pole.size_m[:2] == (0.05, 0.5) and antenna.size_m == (0.05, 0.05, 0.05)
    assert antenna.origin.xyz_m[2] == pytest.approx(0.525)
    urdf = ET.parse(ROOT / "urdf" / "entry_gate.urdf").getroot()
    cylinder = urdf.find("link[@name='gate_link']/collision/geometry/cylinder")
    assert cylinder is not None and (cylinder.get("radius"), cylinder.get("length")) == (
        "0.05", "0.5",
    )  # fmt: skip
    assert urdf.findtext("gazebo/plugin/bodyName") == "gps_pole_link"
    assert urdf.findtext("gazebo/plugin/robotNamespace") == "/Pole"


def test_farm_field_is_the_ground_of_the_farm() -> None:
    model = ModelLibrary(ROOT / "worlds" / "x.world").find("model://farm_field")
    assert model is not None
    sizes = [size.text for size in model.iter("size")]
    assert sizes == ["50 50", "50 50", "25 25", "25 5"]
    assert (model.findtext(".//mu"), model.findtext(".//mu2")) == ("100", "50")


def _slope_deg(world: WorldSpec) -> FloatArray:
    land = world.terrain
    assert land is not None
    north, east = np.gradient(land.height_m, land.resolution_m)
    return np.asarray(np.degrees(np.arctan(np.hypot(north, east))))


def test_volcano_is_150_m_wide_and_50_m_high_with_a_crater() -> None:
    land = load_world("volcano").terrain
    assert land is not None
    rows, columns = land.height_m.shape
    assert (rows - 1) * land.resolution_m == (columns - 1) * land.resolution_m == 150.0
    assert (land.height_m.min(), land.height_m.max()) == (0.0, 50.0)
    middle = sample_height(land, 0.0, 0.0)
    assert 25.0 < middle < 45.0  # lower than the rim around it
    edge = np.concatenate([land.height_m[0], land.height_m[-1]])
    assert edge.max() < 1.0


def test_volcano_has_wide_slopes_of_15_degrees_and_more() -> None:
    slope_deg = _slope_deg(load_world("volcano"))
    assert (slope_deg > 15.0).mean() > 0.3
    assert slope_deg.max() < 75.0


def test_another_seed_makes_another_volcano() -> None:
    assert np.array_equal(make_volcano(7, 65), make_volcano(7, 65))
    assert not np.allclose(make_volcano(7, 65), make_volcano(8, 65))


@pytest.mark.parametrize("name", LANDSCAPES)
def test_height_maps_are_current(name: str) -> None:
    made = LANDSCAPES[name]()
    kept = load_heights(find_landscape_file(name)) * made.max()
    np.testing.assert_allclose(
        kept, made, atol=made.max() / 60000, err_msg="run python -m agribot.description.terrain"
    )


def test_the_hill_falls_by_10_degrees_across_its_bent_rows_and_the_crop_stands_on_them() -> None:
    world, field = load_world("hills"), config.load("hills").field
    rows = lay_rows(field)
    assert world.terrain is not None
    for row in rows:
        places, around_m = row_points_map_m(row), 0.2
        along = np.gradient(places, axis=0)
        along /= np.hypot(along[:, 0], along[:, 1])[:, None]
        right = np.stack([along[:, 1], -along[:, 0]], axis=1)
        down_m = [
            sample_height(world.terrain, *(at - around_m * side))
            - sample_height(world.terrain, *(at + around_m * side))
            for at, side in zip(places, right, strict=True)
        ]
        slope_deg = np.degrees(np.arctan(np.array(down_m) / (2.0 * around_m)))
        assert np.mean(slope_deg) == pytest.approx(10.0, abs=0.8)
        assert slope_deg.min() > 8.5 and slope_deg.max() < 12.0
    assert all(abs(row.curvature_radpm) > 0.02 for row in rows)
    for x_m, y_m in _crops(world):
        nearest = min((project_on_row(row, x_m, y_m) for row in rows), key=lambda b: abs(b.left_m))
        assert abs(nearest.left_m) < 1e-4
        assert nearest.along_m / 2.0 == pytest.approx(round(nearest.along_m / 2.0), abs=1e-4)
    for oak in world.obstacles:
        ground_m = sample_height(world.terrain, oak.x_map_m, oak.y_map_m)
        assert oak.z_map_m == pytest.approx(ground_m, abs=0.001)


@pytest.mark.parametrize(("name", "tilt_deg"), [("volcano", (15.0, 26.0)), ("hills", (8.0, 12.0))])
def test_the_robot_stands_and_drives_on_the_slope_it_starts_on(
    name: str, tilt_deg: tuple[float, float]
) -> None:
    settings = config.load("farm", ["perception.enabled=false", 'sim.sensors="ideal"'])
    from agribot.description.loader import load_robot

    platform = SimPlatform(settings, load_robot(), load_world(name))
    platform.read()
    start = platform.truth()
    tilt = np.degrees(np.arccos(np.cos(start.roll_rad) * np.cos(start.pitch_rad)))
    assert tilt_deg[0] < tilt < tilt_deg[1]
    for _ in range(250):
        platform.write(RobotCommand(t_s=0.0, drive=DriveCommand(v_mps=0.4)))
        platform.read()
    end = platform.truth()
    moved_m = np.hypot(end.x_map_m - start.x_map_m, end.y_map_m - start.y_map_m)
    assert moved_m == pytest.approx(5 * 0.4, rel=0.15)
