"""Other people's world files: what is understood, and how a broken one is explained."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import PlantClass
from agribot.description.worlds_sdf import load_world

GROUND = """
<model name="ground"><static>true</static><link name="l">
  <collision name="c"><geometry><plane><size>20 10</size></plane></geometry></collision>
</link></model>"""
PLACE = """
<spherical_coordinates><latitude_deg>48</latitude_deg><longitude_deg>11</longitude_deg>
<elevation>500</elevation><heading_deg>{heading}</heading_deg></spherical_coordinates>"""


def _world(folder: Path, body: str, heading_deg: float = 0.0, *, ground: str = GROUND) -> str:
    file = folder / "test.world"
    file.write_text(
        '<sdf version="1.9" xmlns:agribot="urn:agribot:sdf"><world name="test">'
        f"{PLACE.format(heading=heading_deg)}{ground}{body}</world></sdf>",
        "utf-8",
    )
    return str(file)


def _box(name: str, pose: str, *, visual: str = "", inner: str = "0 0 0.5 0 0 0") -> str:
    return (
        f'<model name="{name}"><pose>{pose}</pose><link name="l"><collision name="c">'
        f"<pose>{inner}</pose><geometry><box><size>2 1 1</size></box></geometry></collision>"
        f"{visual}</link></model>"
    )


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -90.0, 180.0, 30.0, 123.4])
def test_everything_turns_with_the_heading(tmp_path: Path, heading_deg: float) -> None:
    body = (
        _box("thing", "3 1 0 0 0 0.2")
        + '<frame name="robot_spawn"><pose>2 0 0 0 0 0.1</pose></frame>'
        + "<magnetic_field>1 2 -3</magnetic_field>"
    )
    world = load_world(_world(tmp_path, body, heading_deg))
    turn = math.radians(heading_deg)
    thing = world.obstacles[0]
    assert complex(thing.x_map_m, thing.y_map_m) == pytest.approx((3 + 1j) * np.exp(1j * turn))
    assert complex(*world.spawn_xy_map_m) == pytest.approx(2 * np.exp(1j * turn))
    for yaw, expected in ((thing.yaw_rad, turn + 0.2), (world.spawn_yaw_map_rad, turn + 0.1)):
        assert math.remainder(yaw - expected, math.tau) == pytest.approx(0.0, abs=1e-12)
    assert complex(*world.field_enu_t[:2]) == pytest.approx((1 + 2j) * np.exp(1j * turn))
    assert world.field_enu_t[2] == -3.0


def test_ground_turns_with_the_heading(tmp_path: Path) -> None:
    tile = load_world(_world(tmp_path, "", 90.0)).ground[0]
    assert (tile.x_min_m, tile.x_max_m, tile.y_min_m, tile.y_max_m) == (-5.0, 5.0, -10.0, 10.0)


def test_ground_that_lies_askew_is_boxed_with_a_warning(tmp_path: Path) -> None:
    world = load_world(_world(tmp_path, "", 30.0))
    assert any("bounding box" in warning for warning in world.warnings)
    assert world.ground[0].x_max_m == pytest.approx(10 * np.cos(np.pi / 6) + 5 * 0.5)


def test_datum_is_that_of_the_file(tmp_path: Path) -> None:
    datum = load_world(_world(tmp_path, "")).datum
    assert (datum.lat_deg, datum.lon_deg, datum.alt_m) == (48.0, 11.0, 500.0)


def test_a_world_without_ground_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"test\.world: ground: the world has no ground"):
        load_world(_world(tmp_path, _box("thing", "0 0 0 0 0 0"), ground=""))


def test_unknown_world_names_the_known_ones() -> None:
    with pytest.raises(DescriptionError, match=r"unknown world 'Fram'; known: Farm, beet, empty"):
        load_world("Fram")


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"nowhere\.world does not exist"):
        load_world(str(tmp_path / "nowhere.world"))


def test_broken_xml_names_file_and_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.world"
    file.write_text("<sdf>\n<world>\n</sdf>\n", "utf-8")
    with pytest.raises(DescriptionError, match=r"bad\.world.*line 3"):
        load_world(str(file))


def test_a_model_file_is_no_world(tmp_path: Path) -> None:
    file = tmp_path / "model.sdf"
    file.write_text('<sdf version="1.9"><model name="m"/></sdf>', "utf-8")
    with pytest.raises(DescriptionError, match=r"no <world>; the file has <model>"):
        load_world(str(file))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<model name="m"><pose>1 2 3</pose></model>', "model 'm' <pose>: needs 6 numbers"),
        ("<gravity>0 0 down</gravity>", "<gravity>"),
        (
            '<light name="sun" type="directional"><direction>0 0 1</direction></light>',
            "shines upwards",
        ),
        ('<agribot:weeds density_per_m2="2"/>', "<agribot:weeds> x_min"),
    ],
)
def test_a_wrong_value_is_named_with_its_place(tmp_path: Path, body: str, words: str) -> None:
    with pytest.raises(DescriptionError) as raised:
        load_world(_world(tmp_path, body))
    assert words in str(raised.value) and "test.world" in str(raised.value)


def test_repeated_names_get_numbers_and_one_warning(tmp_path: Path) -> None:
    boxes = "".join(_box("rock", f"{i} 0 0 0 0 0") for i in range(3))
    world = load_world(_world(tmp_path, boxes))
    assert [o.name for o in world.obstacles] == ["rock", "rock_1", "rock_2"]
    assert [w for w in world.warnings if "rock" in w] == [
        "3 models are named 'rock'; all but the first got a number"
    ]


def test_a_box_stands_in_for_a_model_nobody_has(tmp_path: Path) -> None:
    include = "<include><uri>model://barn</uri><pose>3 0 0 0 0 0</pose></include>"
    world = load_world(_world(tmp_path, include * 2))
    assert [(o.name, o.shapes[0].kind, o.x_map_m) for o in world.obstacles] == [
        ("barn", "box", 3.0),
        ("barn_1", "box", 3.0),
    ]
    assert any("model://barn" in w and "(2 times)" in w for w in world.warnings)


def test_level_ground_stands_in_for_a_ground_nobody_has(tmp_path: Path) -> None:
    include = "<include><uri>model://my_grass_plane</uri></include>"
    world = load_world(_world(tmp_path, include, ground=""))
    assert [(t.surface, t.x_max_m) for t in world.ground] == [("grass", 50.0)]
    assert world.obstacles == () and len(world.warnings) == 1


def test_models_beside_the_world_come_before_the_packaged_ones(tmp_path: Path) -> None:
    folder = tmp_path / "models" / "oak"
    folder.mkdir(parents=True)
    folder.joinpath("model.sdf").write_text(
        f'<sdf version="1.9">{_box("oak", "0 0 0 0 0 0")}</sdf>', "utf-8"
    )
    include = "<include><uri>model://oak</uri><pose>1 2 0 0 0 0</pose></include>"
    oak = load_world(_world(tmp_path, include)).obstacles[0]
    assert [shape.kind for shape in oak.shapes] == ["box"]
    assert (oak.x_map_m, oak.y_map_m) == (1.0, 2.0)


def test_a_visual_on_its_own_collision_only_colours_it(tmp_path: Path) -> None:
    red = (
        '<visual name="v"><pose>0 0 0.5 0 0 0</pose><geometry><box><size>2 1 1</size></box>'
        "</geometry><material><diffuse>1 0 0 1</diffuse></material></visual>"
    )
    world = load_world(_world(tmp_path, _box("thing", "0 0 0 0 0 0", visual=red)))
    (thing,) = world.obstacles
    assert thing.collides and len(thing.shapes) == 1
    assert thing.shapes[0].rgba == (1.0, 0.0, 0.0, 1.0)


def test_what_is_only_to_be_seen_does_not_stand_in_the_way(tmp_path: Path) -> None:
    ball = '<visual name="v"><geometry><sphere><radius>1</radius></sphere></geometry></visual>'
    world = load_world(_world(tmp_path, _box("thing", "0 0 0 0 0 0", visual=ball)))
    assert [(o.name, o.collides, o.shapes[0].kind) for o in world.obstacles] == [
        ("thing", True, "box"),
        ("thing/visual", False, "sphere"),
    ]


def test_a_leaning_model_keeps_its_lean(tmp_path: Path) -> None:
    pose, inner = "1 2 3 0.3 -0.4 0.5", "0.1 0.2 0.3 0.2 0.1 -0.7"
    world = load_world(_world(tmp_path, _box("thing", pose, inner=inner), 30.0))
    (thing,) = world.obstacles
    from agribot.core.geo import transform

    expected = (
        transform((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(30.0)))
        @ transform((1.0, 2.0, 3.0), (0.3, -0.4, 0.5))
        @ transform((0.1, 0.2, 0.3), (0.2, 0.1, -0.7))
    )
    at = (thing.x_map_m, thing.y_map_m, thing.z_map_m)
    found = transform(at, (0.0, 0.0, thing.yaw_rad)) @ thing.shapes[0].origin.matrix()
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_part_that_cannot_be_read_is_left_out_with_a_warning(tmp_path: Path) -> None:
    mesh = '<visual name="v"><geometry><mesh><uri>model://x.dae</uri></mesh></geometry></visual>'
    world = load_world(_world(tmp_path, _box("thing", "0 0 0 0 0 0", visual=mesh)))
    assert [o.name for o in world.obstacles] == ["thing"]
    assert any("<mesh>" in warning for warning in world.warnings)


def test_the_tile_seen_wins_over_the_plane_felt(tmp_path: Path) -> None:
    tile = (
        '<model name="t"><link name="l"><visual name="tarmac"><geometry><plane><size>2 2</size>'
        "</plane></geometry></visual></link></model>"
    )
    world = load_world(_world(tmp_path, tile))
    assert [(t.surface, t.x_max_m) for t in world.ground] == [("pavement", 1.0)]


def test_a_saved_state_moves_a_model(tmp_path: Path) -> None:
    state = '<state world_name="test"><model name="thing"><pose>5 6 0 0 0 0</pose></model></state>'
    (thing,) = load_world(_world(tmp_path, _box("thing", "0 0 0 0 0 0") + state)).obstacles
    assert (thing.x_map_m, thing.y_map_m) == (5.0, 6.0)


OLD_ROBOT = """
<model name="agribot"><pose>2 0 0 0 0 0</pose>
  <plugin name="d" filename="libgazebo_ros_skid_steer_drive.so"/>
  <plugin name="g" filename="libhector_gazebo_ros_gps.so">
    <referenceLatitude>21.1</referenceLatitude><referenceLongitude>72.7</referenceLongitude>
  </plugin></model>
<model name="Crop_with_weed"><pose>4 -1 0 0 0 0</pose></model>
<model name="Crop_with_weed"><pose>6 -1 0 0 0 0</pose></model>
<include><uri>model://CropWithWeed</uri><pose>8 -2 0 0 0 0</pose></include>
<include><uri>model://sun</uri></include>"""


def test_an_old_world_with_its_robot_inside_is_understood(tmp_path: Path) -> None:
    """The robot gives spawn pose, datum and orientation; repeated crops grow as plants."""
    file = tmp_path / "old.world"
    file.write_text(
        f'<sdf version="1.6"><world name="default">{OLD_ROBOT}{GROUND}</world></sdf>', "utf-8"
    )
    world = load_world(str(file))
    assert (world.datum.lat_deg, world.datum.lon_deg) == (21.1, 72.7)
    assert world.spawn_xy_map_m == (0.0, 2.0)
    assert world.spawn_yaw_map_rad == pytest.approx(math.pi / 2)
    crops = [p for p in world.plants if p.plant == PlantClass.CROP]
    assert [(p.x_map_m, p.y_map_m) for p in crops] == [(1.0, 4.0), (1.0, 6.0), (2.0, 8.0)]
    assert world.obstacles == ()
    assert world.warnings == (
        "2 models are named 'Crop_with_weed'; all but the first got a number",
        "the robot 'agribot' of the world is left out; the one of --robot drives",
    )


def test_a_field_too_full_of_crops_for_weeds_says_so(tmp_path: Path) -> None:
    crop = "<include><uri>model://crop_with_weed</uri><name>c</name></include>"
    weeds = (
        '<agribot:weeds density_per_m2="500" x_min="-0.1" x_max="0.1" y_min="-0.1" y_max="0.1" '
        'crop_distance_m="0.5" species="grass" height_min_m="0.04" height_max_m="0.1"/>'
    )
    with pytest.raises(DescriptionError, match=r"no place for a weed 0\.5 m from every crop"):
        load_world(_world(tmp_path, crop + weeds))
