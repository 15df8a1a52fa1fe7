"""Rows and world of a run are one: rows come with the world, or the run is refused."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pytest

from agribot.app.run_world import make_run_world
from agribot.app.simulated_run import simulate
from agribot.app.world_rows import check_rows, take_world_rows
from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.cli.main import main
from agribot.core.config import FieldConfig, RunConfig, load
from agribot.core.fact_text import render
from agribot.core.facts import CropOffRows, Fact, NoCropInRows
from agribot.core.geo import Datum
from agribot.core.own_world import OF_A_WORLD
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import FieldSettings, RowsSettings
from agribot.description.loader import load_robot
from agribot.description.package import ROOT
from agribot.description.row_table import fit_row_table
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import list_worlds, load_world
from tests import nightly
from tests.finding import refused

QUICK = ["perception.enabled=false", "record.enabled=false"]
PLACE = re.compile(r"<spherical_coordinates>.*?</spherical_coordinates>", re.DOTALL)
START = re.compile(r'<frame name="robot_spawn">.*?</frame>', re.DOTALL)


def field_of(world: str | Path, *settings: str, profile: str = "farm") -> FieldConfig:
    return take_world_rows(load(profile, [f'world="{world}"', *settings])).field


def describe(field: FieldConfig) -> tuple[float, ...]:
    """Rows, their length, distance and direction, and the first plant."""
    numbers = (field.row_length_m, field.row_pitch_m, field.row_yaw_deg)
    return (field.row_count, *numbers, *field.first_row_start_map_m)


# Rows, length, distance, direction and first plant; the start.
PACKAGED = {
    "Farm": ((6, 10.0, 1.0, 90.0, 1.0, 2.0), (-2.0, 0.0, 90.0)),
    "final": ((4, 8.0, 1.2, 90.0, 1.0, 2.0), (-2.0, 0.0, 90.0)),
    "world1": ((6, 10.0, 1.0, 90.0, 1.0, 2.0), (-2.0, 0.0, 90.0)),
    "volcano": ((4, 10.0, 1.0, -180.0, -3.0, -57.0), (0.0, -57.0, 180.0)),
    "hills": ((6, 10.0, 1.0, 90.0, 1.0, 2.0), (-2.0, 0.0, 90.0)),
    "beet": ((6, 12.0, 1.0, 90.0, 1.0, 2.0), (-2.0, 0.0, 90.0)),
    "rows-10x12": ((10, 12.0, 1.0, 0.0, 0.0, 0.0), (-0.963, -0.031, 1.6)),
    "empty": (None, (0.0, 0.0, 90.0)),  # no rows: those of the profile stay
}


@pytest.mark.parametrize("world", list_worlds())
def test_the_rows_of_every_packaged_world_come_with_it(world: str) -> None:
    """From another profile, whose own rows are others."""
    profile = "farm" if world == "rows-10x12" else "rows-10x12"
    field = field_of(world, profile=profile)
    rows, start = PACKAGED[world]
    own = load(profile).field
    assert describe(field) == pytest.approx(describe(own) if rows is None else rows, abs=1e-6)
    assert field.start_map_m is not None and field.start_yaw_deg is not None
    assert (*field.start_map_m, field.start_yaw_deg) == pytest.approx(start, abs=0.003)
    assert field.from_world == ()


@pytest.mark.parametrize("profile", ["farm", "beet", "hills", "rows-10x12"])
def test_a_profile_keeps_the_rows_that_it_states_for_its_own_world(profile: str) -> None:
    config = load(profile)
    assert config.field.from_world == ()
    assert take_world_rows(config) == config
    world = field_of(config.world, profile="farm" if profile == "rows-10x12" else "rows-10x12")
    assert describe(world) == pytest.approx(describe(config.field))
    assert world.row_curvature_radpm == config.field.row_curvature_radpm


def test_the_pole_of_a_world_and_its_bent_rows_come_too() -> None:
    assert field_of("final").obstacles_map_m == ((0.0, 0.0, 0.05), (0.0, 0.0, 0.035))
    assert field_of("world1").obstacles_map_m == ()
    assert field_of("hills").row_curvature_radpm == 0.03
    assert field_of("volcano").row_curvature_radpm == -0.0175


def test_rows_of_a_world_in_which_nothing_grows_are_bare_to_the_robot() -> None:
    assert not field_of("volcano").has_crop
    assert field_of("final").has_crop and field_of("hills").has_crop
    task = RowTask(load("farm", ["field.has_crop=false"]), load_robot())
    assert (task.has_crop, task.clearance_m) == (False, math.inf)


def test_what_the_settings_state_beside_a_world_stays() -> None:
    field = field_of("final", "field.row_count=2", "field.start_map_m=[-1,0]")
    assert (field.row_count, field.row_pitch_m, field.start_map_m) == (2, 1.2, (-1.0, 0.0))


def test_a_profile_that_names_a_world_and_no_rows_drives_those_of_the_world(
    tmp_path: Path,
) -> None:
    profile = tmp_path / "own.toml"
    profile.write_text('world = "final"\n[field]\nstart_std_m = 0.1\n')
    field = take_world_rows(load(str(profile))).field
    assert describe(field) == PACKAGED["final"][0]
    assert field.start_std_m == 0.1


def test_a_real_robot_takes_no_rows_of_a_simulated_world() -> None:
    settings = ['platform="hardware"', 'world="final"', "mission.waits_for_goals=true"]
    config = load("farm", settings)
    assert config.field.from_world == OF_A_WORLD
    assert describe(take_world_rows(config).field) == describe(load("farm").field)


def test_rows_that_are_not_those_of_the_world_are_refused_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    rows = ["--set", "field.row_count=6", "--set", "field.row_pitch_m=1"]
    words = ["run", "farm", "--world", "final", *rows, "--headless", "--out", str(out)]
    words += ["--set", "perception.enabled=false"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert render(CropOffRows("final", 18, 36, 0.25, has_rows=True)) in told
    assert not out.exists()


def check(config: RunConfig) -> None:
    config = take_world_rows(config)
    check_rows(make_run_world(config), config)


@pytest.mark.parametrize("preset", ["kind", "field", "hard"])
@pytest.mark.parametrize("profile", ["farm", "beet", "hills", "rows-10x12"])
def test_fields_as_they_are_drawn_fit_their_rows(profile: str, preset: str) -> None:
    for seed in range(3):
        check(load(profile, [f'sim.preset="{preset}"', f"seed={seed}"]))


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        (["field.first_row_start_map_m=[30,2]"], NoCropInRows(ANY, 36, has_rows=True)),
        (["field.row_yaw_deg=80"], CropOffRows),
        (["field.row_pitch_m=1.3"], CropOffRows),
    ],
)
def test_other_rows_than_the_crops_are_refused(settings: list[str], why: Fact | type[Fact]) -> None:
    with refused(why):
        check(load("farm", settings))


def test_rows_that_are_not_driven_need_not_fit() -> None:
    off = ["field.first_row_start_map_m=[30,2]"]
    check(load("farm", [*off, 'task="explore"']))
    check(load("farm", [*off, 'waypoints="places.csv"']))
    check(load("farm", [*off, 'plan="plan.geojson"']))
    check(load("farm", [*off, 'world="empty"']))  # no crop: bare rows


def test_a_world_without_a_place_lies_where_the_settings_say_and_its_compass_points_north(
    tmp_path: Path,
) -> None:
    """As Gazebo 7 and 9 wrote them; the original's file has x to the North."""
    path = tmp_path / "old.world"
    path.write_text(PLACE.sub("", (ROOT / "worlds" / "world1.world").read_text()))
    field, whole = field_of(path), field_of("world1")
    assert describe(field) == describe(whole) and field.start_map_m == whole.start_map_m
    assert field.datum == load("farm").field.datum
    world = make_run_world(take_world_rows(load("farm", [f'world="{path}"']))).world
    assert world.datum == field.datum
    assert world.field_enu_t == pytest.approx((0.0, 3.8e-5, -2.3e-5))
    assert world.warnings == (
        "no <spherical_coordinates>: the map lies at field.datum, and x points 90 degrees from "
        "East, as <magnetic_field> says; add the tag, with its <heading_deg>, to change this",
    )


def test_where_neither_place_nor_compass_is_stated_x_points_east(tmp_path: Path) -> None:
    path = tmp_path / "bare.world"
    text = PLACE.sub("", (ROOT / "worlds" / "world1.world").read_text())
    path.write_text(re.sub(r"<magnetic_field>.*?</magnetic_field>", "", text))
    field = field_of(path)
    assert describe(field) == (6, 10.0, 1.0, 0.0, 2.0, -1.0)
    assert (field.start_map_m, field.start_yaw_deg) == ((0.0, 2.0), 0.0)
    check(load("farm", [f'world="{path}"']))


CYLINDER = """<link name="l"><collision name="c"><geometry><cylinder><radius>.055</radius>
<length>.2</length></cylinder></geometry></collision></link></model>"""
GROUND = """<model name="ground_plane"><static>1</static><link name="l"><collision name="c">
<geometry><plane><normal>0 0 1</normal><size>50 50</size></plane></geometry></collision></link>
</model>"""
GPS = """<plugin name="gps" filename="libhector_gazebo_ros_gps.so"><referenceHeading>0
</referenceHeading><referenceLatitude>21.161289</referenceLatitude><referenceLongitude>72.787022
</referenceLongitude></plugin>"""
ROBOT = """<model name="agribot"><pose>2 0 0 0 0 0</pose><link name="base_link"/>
<plugin name="d" filename="libgazebo_ros_skid_steer_drive.so"/>{gps}</model><state
world_name="default"><model name="agribot"><pose>0 2 0.02 0 0 0</pose></model></state>"""


@pytest.mark.parametrize("has_gps", [True, False])
def test_a_world_as_the_original_saved_it_is_driven_along_its_rows(
    tmp_path: Path, has_gps: bool
) -> None:
    """Crops of one name, the robot and its state in the world, x to the North, or to nowhere."""
    crop = "".join(
        f'<model name="Crop_with_weed"><pose>{x} {y} 0.1 0 0 0</pose>{CYLINDER}'
        for x in range(2, 13, 2)
        for y in range(-6, 0)
    )
    path = tmp_path / "old.world"
    robot = ROBOT.format(gps=GPS if has_gps else "")
    path.write_text(
        '<?xml version="1.0"?><sdf version="1.6"><world name="default"><magnetic_field>6e-06 '
        f"2.3e-05 -4.2e-05</magnetic_field>{GROUND}{crop}{robot}</world></sdf>"
    )
    field = field_of(path)
    if has_gps:
        assert describe(field) == PACKAGED["Farm"][0]
        assert field.start_map_m == pytest.approx((-2.0, 0.0))
    else:  # Gazebo's default magnetic field is that of no place
        assert describe(field) == (6, 10.0, 1.0, 0.0, 2.0, -1.0)
        assert field.start_map_m == pytest.approx((0.0, 2.0))
    check(load("farm", [f'world="{path}"']))


def test_a_robot_that_a_world_puts_nowhere_starts_before_the_first_row(tmp_path: Path) -> None:
    path = tmp_path / "no-robot.world"
    path.write_text(START.sub("", (ROOT / "worlds" / "world1.world").read_text()))
    world = load_world(str(path))
    assert world.spawn_xy_map_m == pytest.approx((1.0, -1.0))
    assert field_of(path).start_map_m == (1.0, -1.0)


def test_a_world_of_another_place_brings_its_place(tmp_path: Path) -> None:
    path = tmp_path / "far.world"
    text = (ROOT / "worlds" / "final.world").read_text()
    path.write_text(text.replace("21.161289", "48.5"))
    assert field_of(path).datum == Datum(lat_deg=48.5, lon_deg=72.787022)


@pytest.mark.parametrize("yaw_deg", [0.0, 17.3, 90.0, -140.0])
def test_rows_are_found_from_plants_with_gaps_and_jitter_in_any_direction(yaw_deg: float) -> None:
    rng, yaw_rad = np.random.default_rng(3), np.radians(yaw_deg)
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad)])
    crop = np.array([(k * 0.25, r * 0.75) for r in range(8) for k in range(80)])
    crop = (crop + rng.uniform(-0.02, 0.02, crop.shape))[rng.uniform(size=len(crop)) > 0.2]
    table = fit_row_table(crop[:, :1] * ahead + crop[:, 1:] * right + (5.0, 3.0), (5.0, 3.0))
    assert table is not None
    assert table.row_count == 8
    assert table.row_length_m == pytest.approx(19.75, abs=0.5)
    assert table.row_pitch_m == pytest.approx(0.75, abs=0.005)
    turn_deg = (table.row_yaw_deg - yaw_deg + 180.0) % 360.0 - 180.0
    assert turn_deg == pytest.approx(0.0, abs=0.1)
    assert table.first_row_start_map_m == pytest.approx((5.0, 3.0), abs=0.5)


def test_no_rows_are_found_where_crop_stands_anywhere_or_in_one_place() -> None:
    rng = np.random.default_rng(0)
    assert fit_row_table(rng.uniform(0.0, 15.0, (400, 2)), (0.0, 0.0)) is None
    assert fit_row_table(np.full((36, 2), 3.0), (0.0, 0.0)) is None
    assert fit_row_table(np.zeros((0, 2)), (0.0, 0.0)) is None


def test_crop_in_no_straight_rows_asks_for_its_rows(tmp_path: Path) -> None:
    path = tmp_path / "tramlines.world"
    rows = RowsSettings(count=9, tramline_every=3, tramline_m=0.6, pitch_m=0.5)
    write_world(generate_field(FieldSettings(rows=rows), 0), path)
    with refused(CropOffRows(ANY, ANY, ANY, ANY, has_rows=False)):
        check(load("farm", [f'world="{path}"']))


def test_a_check_of_a_world_says_where_its_rows_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "check", "final"]) == 0
    told = "rows: 4 of 8 m, 1.2 m apart, the first from East 1 m, North 2 m towards 90 degrees\n"
    assert told in capsys.readouterr().out
    assert main(["world", "check", "empty", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] is None


@pytest.mark.slow
@nightly.by_day("test_the_rows_of_every_packaged_world_come_with_it")
@pytest.mark.parametrize(("world", "rows"), [("final", 4), ("world1", 6), ("volcano", 4)])
def test_a_mission_over_the_rows_of_another_world_crushes_nothing(
    tmp_path: Path, world: str, rows: int
) -> None:
    config = load("farm", [*QUICK, f'world="{world}"', 'sim.sensors="rtk"'])
    with simulate(config, tmp_path / "run") as run:
        for _ in run.ticks():
            pass
        report = run.finish()
    assert report.ok and report.mission.rows_done == rows
    assert report.tracking.plants_crushed == 0
