"""What a seed draws from a preset, and the worlds that come of it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.run_setup import prepare_run
from agribot.app.run_world import make_run_world, settle_origin
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig, load
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum
from agribot.core.messages import PlantClass
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import WorldSpec
from agribot.description.altered_world import alter_world
from agribot.description.conditions import (
    Preset,
    draw_conditions,
    list_condition_presets,
    load_condition_preset,
)
from agribot.description.loader import load_robot
from agribot.description.package import find_packaged_or_file, list_world_files
from agribot.description.worlds_sdf import load_run_world

ROWS = lay_rows(load("rows-10x12").field)


def _make(preset: str, seed: int, profile: str = "rows-10x12") -> WorldSpec:
    return make_run_world(load(profile, [f"seed={seed}", f"sim.preset={preset}"])).world


def _crops(world: WorldSpec) -> np.ndarray:
    return np.array([(p.x_map_m, p.y_map_m) for p in world.plants if p.plant == PlantClass.CROP])


@pytest.mark.parametrize("profile", ["farm", "rows-10x12", "hills", "beet"])
def test_the_kind_preset_leaves_every_world_as_its_file_says(profile: str) -> None:
    config = load(profile, ["seed=7"])
    made, plain = make_run_world(config), load_run_world(config)
    assert made.conditions is None
    for name in WorldSpec.__struct_fields__:
        if name not in ("terrain", "datum"):
            assert getattr(made.world, name) == getattr(plain, name)
    robot = load_robot("agribot")
    assert made.alter_robot(robot) is robot


def test_the_same_seed_draws_the_same_world_and_another_seed_another_one() -> None:
    first, again, other = _make("field", 1), _make("field", 1), _make("field", 2)
    assert first.plants == again.plants and first.relief == again.relief
    assert first.light != other.light
    assert first.spawn_xy_map_m != other.spawn_xy_map_m
    assert not set(_crops(first)[:, 0]) & set(_crops(other)[:, 0])


@pytest.mark.parametrize("preset", ["kind", "field"])
def test_a_gap_leaves_so_many_metres_of_every_row_bare_and_all_else_as_it_was(preset: str) -> None:
    words = ["seed=3", f"sim.preset={preset}"]
    whole = make_run_world(load("rows-10x12", words)).world
    config = load("rows-10x12", [*words, 'faults=["crop.gap=5@0"]'])
    gapped = make_run_world(config).world
    assert set(gapped.plants) < set(whole.plants)
    lost = set(whole.plants) - set(gapped.plants)
    assert {plant.plant for plant in lost} == {PlantClass.CROP}
    for row in ROWS:
        mine = [p for p in lost if abs(project_on_row(row, p.x_map_m, p.y_map_m).left_m) < 0.3]
        along_m = [float(project_on_row(row, p.x_map_m, p.y_map_m).along_m) for p in mine]
        assert 3.5 < max(along_m) - min(along_m) < 5.1
        assert min(along_m) > 0.5 and max(along_m) < row_length_m(row) - 0.5
    assert make_run_world(config).world.plants == gapped.plants


def test_over_many_seeds_what_is_drawn_spreads_as_the_preset_says() -> None:
    preset = load_condition_preset("field")
    drawn = [draw_conditions(preset, seed, ROWS) for seed in range(400)]
    for name, std in (
        ("start_offset_m", preset.start_std_m),
        ("map_offset_m", preset.map_offset_std_m),
        ("row_offsets_m", preset.row_offset_std_m),
        ("camera_angles_deg", preset.camera_angle_std_deg),
        ("map_turn_deg", preset.map_turn_std_deg),
    ):
        values = np.array([getattr(one, name) for one in drawn])
        assert values.std() == pytest.approx(std, rel=0.12)
        assert abs(values).max() <= 3.0 * std + 1e-12
        assert abs(values.mean()) < 0.15 * std
    moisture = [one.moisture_ratio for one in drawn]
    assert preset.moisture_ratio[0] <= min(moisture) < 0.12 and 0.48 < max(moisture) <= 0.5
    assert {one.soil_class for one in drawn} == {"firm", "tilled"}


def test_plants_stand_about_the_true_row_as_far_as_the_planter_errs() -> None:
    across = []
    for seed in range(6):
        made = make_run_world(load("rows-10x12", [f"seed={seed}", "sim.preset=field"]))
        rows = [made.find_true_row(row) for row in ROWS]
        for x, y in _crops(made.world):
            across.append(min((float(project_on_row(r, x, y).left_m) for r in rows), key=abs))
    std = load_condition_preset("field").sowing_across_std_m
    assert np.std(across) == pytest.approx(std, rel=0.06)
    assert abs(np.mean(across)) < 0.05 * std


def test_the_map_is_off_by_the_offset_turn_and_stretch_that_were_drawn() -> None:
    preset = Preset(
        about="", map_offset_std_m=0.1, map_turn_std_deg=1.0, map_stretch_std_ratio=0.02
    )
    drawn = draw_conditions(preset, 3, ROWS)
    true = [drawn.find_true_row(row) for row in ROWS]
    for row, there in zip(ROWS, true, strict=True):
        assert row_length_m(there) == pytest.approx(
            row_length_m(row) * (1.0 + drawn.map_stretch_ratio)
        )
        (x0, y0), (x1, y1) = there.start_map_m, there.end_map_m
        assert math.degrees(math.atan2(y1 - y0, x1 - x0)) == pytest.approx(drawn.map_turn_deg)
    middle = np.mean([end for row in true for end in (row.start_map_m, row.end_map_m)], axis=0)
    offset = middle - np.array(drawn.centre_map_m)
    assert offset == pytest.approx(drawn.map_offset_m)


def _count_crops(**spread: object) -> int:
    """Count the crops of rows-10x12 where only this differs from its map."""
    preset = msgspec.convert({"about": "", **spread}, Preset)
    drawn = draw_conditions(preset, 5, ROWS)
    return len(_crops(alter_world(load_run_world(load("rows-10x12")), ROWS, preset, drawn, 5)))


def test_gaps_missing_rows_and_doubles_change_the_stand_of_the_crop() -> None:
    assert _count_crops() == 490
    assert 370 < _count_crops(missing_ratio=0.2) < 415
    assert 490 + 70 < _count_crops(double_ratio=0.2) < 490 + 130
    assert _count_crops(gaps_per_row=2.0, gap_length_m=(1.0, 1.0)) < 450
    left = _count_crops(missing_row_ratio=0.5)
    assert left % 49 == 0 and 49 <= left <= 441


def test_weeds_stand_elsewhere_in_every_seed_as_many_as_before_and_off_the_stems() -> None:
    plain, first, other = _make("kind", 1), _make("field", 1), _make("field", 2)
    weeds = [
        np.array([(p.x_map_m, p.y_map_m) for p in world.plants if p.plant == PlantClass.WEED])
        for world in (plain, first, other)
    ]
    assert len(weeds[0]) == len(weeds[1]) == len(weeds[2]) > 50
    for a, b in ((0, 1), (1, 2)):
        assert np.median(np.hypot(*(weeds[a] - weeds[b]).T)) > 0.3
    gaps = np.hypot(*(weeds[1][:, None] - _crops(first)[None]).transpose(2, 0, 1))
    assert gaps.min() >= 0.04


def test_the_robot_in_the_field_has_a_worn_wheel_and_a_turned_camera_that_nobody_told_it() -> None:
    robot = load_robot("agribot")
    made = make_run_world(load("farm", ["seed=4", "sim.preset=hard"]))
    assert made.conditions is not None and robot.camera is not None
    true = made.alter_robot(robot)
    assert true.drive.wheel_radius_m == pytest.approx(
        robot.drive.wheel_radius_m * (1.0 - made.conditions.wheel_wear_ratio)
    )
    link = robot.camera.link
    turn = true.base_from_link(link)[:3, :3] @ robot.base_from_link(link)[:3, :3].T
    angle_deg = math.degrees(math.acos((np.trace(turn) - 1.0) / 2.0))
    assert angle_deg == pytest.approx(math.hypot(*made.conditions.camera_angles_deg), rel=0.05)


def test_every_packaged_preset_says_what_it_is_and_field_lies_between_kind_and_hard() -> None:
    assert list_condition_presets() == ["field", "hard", "kind"]
    kind, field, hard = (load_condition_preset(name) for name in ("kind", "field", "hard"))
    assert kind.is_exact and not field.is_exact
    for name in Preset.__struct_fields__:
        if name.endswith(("_std_m", "_std_deg", "_std_ratio")):
            assert 0.0 == getattr(kind, name) < getattr(field, name) < getattr(hard, name)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('about = "x"\nsoil_classes = ["bog"]', "bog"),
        ('about = "x"\nclod_heights_m = 3', "clod_heights_m"),
        ('about = "x"\nmoisture_ratio = [0.5, 0.1]', "write the smaller first"),
        ('about = "x"\nmissing_ratio = 1.5', "missing_ratio"),
        ('about = "x"\nsoil_classes = []', "name at least one"),
        ("about = ", "preset"),
    ],
)
def test_a_preset_file_that_cannot_be_is_refused_with_its_reason(
    tmp_path: Path, text: str, says: str
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=says):
        load_condition_preset(str(path))


def test_an_unknown_preset_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ConfigError, match=r"unknown preset .feild.*field"):
        load_condition_preset("feild")
    with pytest.raises(ConfigError, match=r"cannot read nowhere\.toml"):
        load_condition_preset("nowhere.toml")


def write_world(folder: Path, lat_deg: str, lon_deg: str) -> Path:
    """The Farm world at another place; at none with empty numbers."""
    text = find_packaged_or_file(
        "world", "Farm", list_world_files(), (".world", ".sdf")
    ).read_text()
    text = re.sub("(<latitude_deg>)[^<]*", rf"\g<1>{lat_deg}", text)
    text = re.sub("(<longitude_deg>)[^<]*", rf"\g<1>{lon_deg}", text)
    if not lat_deg:
        text = re.sub("(?s)<spherical_coordinates>.*</spherical_coordinates>", "", text)
    path = folder / "far.world"
    path.write_text(text)
    return path


def settle(world: Path | str, folder: Path, *settings: str) -> FieldConfig:
    config = load("farm", [f'world="{world}"', *settings])
    return prepare_run(config, folder / "run").config.field


def test_a_run_in_a_world_far_from_its_settings_has_its_map_in_that_world(tmp_path: Path) -> None:
    """It waited for ever for a receiver within 10 km of the map."""
    field = settle(write_world(tmp_path, "52.1", "11.6"), tmp_path)
    assert (field.datum.lat_deg, field.datum.lon_deg) == (52.1, 11.6)


def test_a_run_in_the_world_of_its_profile_keeps_the_settings(tmp_path: Path) -> None:
    assert settle("Farm", tmp_path) == load("farm").field


def test_settings_that_lie_too_far_from_their_world_are_moved_there() -> None:
    far = msgspec.structs.replace(load("farm").field, datum=Datum(lat_deg=52.1, lon_deg=11.6))
    config = msgspec.structs.replace(load("farm"), field=far)
    field = settle_origin(config).field
    assert field.datum == load_run_world(load("farm")).datum
    assert "world Farm, too far from that of the settings" in field.datum_source


def test_a_world_that_states_no_place_lies_at_the_datum_of_the_settings(tmp_path: Path) -> None:
    path = write_world(tmp_path, "", "")
    field = settle(path, tmp_path)
    assert field.datum == load("farm").field.datum
    assert "states none" in field.datum_source
    config = load("farm", [f'world="{path}"'])
    moved = msgspec.structs.replace(config, field=field)
    assert load_run_world(moved).datum == field.datum
