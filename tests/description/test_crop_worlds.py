"""Crop worlds as others publish them: plants and ground that are meshes, known by their names."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from agribot.app.world_rows import take_world_rows
from agribot.core.config import load
from agribot.core.errors import DescriptionError
from agribot.core.messages import PlantClass
from agribot.core.world import WorldSpec
from agribot.description.mesh_ground import make_height_field
from agribot.description.plant_names import NAMES, find_plant_name
from agribot.description.terrain import sample_height
from agribot.description.worlds_sdf import load_world
from agribot.sim.flora.species import SPECIES

PLANE = """<model name="ground_plane"><static>1</static><link name="l"><collision name="c">
<geometry>
<plane><normal>0 0 1</normal><size>60 60</size></plane></geometry></collision></link></model>"""


def read_world(folder: Path, body: str) -> WorldSpec:
    return load_world(file_of(folder, body))


def file_of(folder: Path, body: str) -> str:
    file = folder / "field.world"
    file.write_text(f'<?xml version="1.0"?><sdf version="1.9"><world name="w">{body}</world></sdf>')
    return str(file)


def mesh(name: str, uri: str, x_m: float, y_m: float, yaw_rad: float = 0.0) -> str:
    """A model whose visual and collision are one mesh."""
    parts = "".join(
        f'<{kind} name="{kind}"><geometry><mesh><uri>{uri}</uri></mesh></geometry></{kind}>'
        for kind in ("visual", "collision")
    )
    pose = f"<pose>{x_m} {y_m} 0 0 0 {yaw_rad}</pose>"
    return f'<model name="{name}">{pose}<link name="l">{parts}</link></model>'


def save_mesh(folder: Path, uri: str, corners_m: np.ndarray) -> None:
    path = folder / "models" / uri.removeprefix("model://")
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners_m.tolist()]
    path.write_text("\n".join(lines) + "\n")


def box(width_m: float, height_m: float) -> np.ndarray:
    half = width_m / 2.0
    return np.array(
        [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (0, height_m)]
    )


def hill(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return 0.5 * np.sin(x_m / 6.0) + 0.03 * y_m


@pytest.mark.parametrize("word", NAMES)
def test_every_name_draws_a_species_that_there_is(word: str) -> None:
    assert SPECIES[NAMES[word].species].plant is NAMES[word].plant


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("model://maize_01/meshes/maize.dae", "maize"), ("SugarBeet12", "beet"),
        ("Tomato_plant_big", "tomato"), ("weeds", "weed"), ("potatoes", "potato"),
        ("corner_post", None), ("seaweeder", None), ("house", None), ("power_plant", None),
    ],
)  # fmt: skip
def test_names_are_read_by_their_words(text: str, word: str | None) -> None:
    found = find_plant_name(text)
    assert (None if found is None else found.word) == word


def test_meshes_of_crop_and_weed_are_plants_of_their_height(tmp_path: Path) -> None:
    uri = "model://maize_01/maize.obj"
    save_mesh(tmp_path, uri, box(0.3, 0.4))
    rows = "".join(
        mesh(f"maize_{k}_{r}", uri, 0.5 * k, 0.75 * r) for k in range(8) for r in range(3)
    )
    thistle = mesh("thistle_1", "model://thistle/thistle.dae", 1.2, 0.3)  # whose file is missing
    world = read_world(tmp_path, PLANE + rows + thistle)
    assert Counter(p.plant for p in world.plants) == {PlantClass.CROP: 24, PlantClass.WEED: 1}
    crop = [p for p in world.plants if p.plant is PlantClass.CROP]
    assert {p.species for p in crop} == {"maize"}
    assert {round(p.size_m, 3) for p in crop} == {0.4}
    places = {(round(p.x_map_m, 3), round(p.y_map_m, 3)) for p in crop}
    assert places == {(0.5 * k, 0.75 * r) for k in range(8) for r in range(3)}
    (weed,) = [p for p in world.plants if p.plant is PlantClass.WEED]
    assert (weed.species, weed.x_map_m, weed.y_map_m) == ("thistle", 1.2, 0.3)
    assert world.obstacles == ()
    told = "models and meshes with 'maize' in their names are taken for crop plants, drawn as maize"
    assert f"{told} (24 times)" in world.warnings


def test_a_model_that_nobody_has_is_the_plant_that_its_name_speaks_of(tmp_path: Path) -> None:
    body = "<include><uri>model://tomato_plant</uri><pose>3 1 0 0 0 0</pose></include>"
    world = read_world(tmp_path, PLANE + body)
    (plant,) = world.plants
    assert (plant.plant, plant.x_map_m, plant.y_map_m) == (PlantClass.CROP, 3.0, 1.0)
    assert world.obstacles == ()


def test_the_rows_of_such_a_world_are_driven(tmp_path: Path) -> None:
    uri = "model://lettuce/lettuce.obj"
    save_mesh(tmp_path, uri, box(0.2, 0.2))
    crop = "".join(mesh(f"l_{k}_{r}", uri, 0.4 * k, -0.9 * r) for k in range(20) for r in range(4))
    file = file_of(tmp_path, PLANE + crop)
    field = take_world_rows(load("farm", [f'world="{file}"'])).field
    assert (field.row_count, field.row_pitch_m, field.row_yaw_deg) == (4, 0.9, 0.0)
    assert field.row_length_m == pytest.approx(7.6)
    assert field.first_row_start_map_m == pytest.approx((0.0, 0.0), abs=1e-3)


def test_what_is_wider_than_a_plant_is_none(tmp_path: Path) -> None:
    uri = "model://maize_row/row.obj"
    save_mesh(tmp_path, uri, box(6.0, 0.5))
    world = read_world(tmp_path, PLANE + mesh("maize_row", uri, 3.0, 0.0))
    assert world.plants == () and len(world.obstacles) == 1
    barn = '<model name="corn_crib"><link name="l"><collision name="c"><geometry><box>'
    barn += "<size>3 2 2</size></box></geometry></collision></link></model>"
    assert len(read_world(tmp_path, PLANE + barn).obstacles) == 1


def test_a_wide_mesh_is_the_ground_of_a_world_without_any(tmp_path: Path) -> None:
    x_m, y_m = np.meshgrid(np.linspace(-10.0, 10.0, 41), np.linspace(-5.0, 5.0, 21))
    corners_m = np.stack([x_m.ravel(), y_m.ravel(), hill(x_m, y_m).ravel()], axis=1)
    save_mesh(tmp_path, "model://land/land.obj", corners_m)
    save_mesh(tmp_path, "model://shed/shed.obj", box(5.0, 3.0))
    body = mesh("land", "model://land/land.obj", 2.0, 1.0, math.pi / 2.0)
    world = read_world(tmp_path, body + mesh("shed", "model://shed/shed.obj", 20.0, 0.0))
    assert world.terrain is not None
    for ahead_m, left_m in ((0.0, 0.0), (7.3, -3.1), (-9.6, 4.2)):
        there = sample_height(world.terrain, 2.0 - left_m, 1.0 + ahead_m)
        assert there == pytest.approx(float(hill(np.array(ahead_m), np.array(left_m))), abs=0.01)
    assert [thing.name for thing in world.obstacles] == ["shed"]
    assert "mesh of 'land' is the ground of this world, a grid of 0.5 m" in world.warnings


def test_ground_of_four_corners_is_a_plane(tmp_path: Path) -> None:
    corners_m = np.array([(0, 0, 0.0), (20, 0, 2.0), (0, 20, 0.0), (20, 20, 2.0)], dtype=np.float64)
    field = make_height_field(corners_m)
    assert sample_height(field, 5.0, 13.0) == pytest.approx(0.5)


def test_holes_of_a_mesh_are_filled_and_of_two_layers_the_upper_counts() -> None:
    x_m, y_m = (grid.ravel() for grid in np.meshgrid(np.arange(21.0), np.arange(21.0)))
    kept = np.hypot(x_m - 10.0, y_m - 10.0) > 3.0
    top = np.stack([x_m[kept], y_m[kept], np.full(kept.sum(), 1.0)], axis=1)
    field = make_height_field(np.concatenate([top, top - (0.0, 0.0, 5.0)]))
    assert field.height_m == pytest.approx(1.0)


def test_level_ground_stands_in_for_a_terrain_mesh_that_nobody_has(tmp_path: Path) -> None:
    world = read_world(tmp_path, mesh("terrain", "model://farm_terrain/t.dae", 0.0, 0.0))
    assert world.terrain is None and len(world.ground) == 1
    assert world.obstacles == ()
    assert "mesh of 'terrain' is the ground of this world, level" in world.warnings


def test_a_world_without_any_ground_is_still_refused(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="the world has no ground"):
        read_world(tmp_path, mesh("statue", "model://statue/s.dae", 0.0, 0.0))
