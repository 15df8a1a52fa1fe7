"""Worlds as Gazebo saves them: its default magnetic field, and models without their meshes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from agribot.core.messages import DriveCommand
from agribot.core.world import WorldSpec, is_person
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.physics import Physics
from agribot.sim.state import POSITION

GROUND = """<model name="ground"><static>1</static><link name="l"><collision name="c"><geometry>
<plane><normal>0 0 1</normal><size>60 60</size></plane></geometry></collision></link></model>"""
# What hector's GPS plugin says of a world whose x axis points North.
HECTOR = """<model name="rover"><link name="l"/>
<plugin name="drive" filename="libgazebo_ros_skid_steer_drive.so"/>
<plugin name="gps" filename="libhector_gazebo_ros_gps.so">
<referenceLatitude>21.161289</referenceLatitude><referenceLongitude>72.787022</referenceLongitude>
</plugin></model>"""
PLATE = """<collision name="bottom"><pose>0 0 0.01 0 0 0</pose><geometry><box>
<size>0.35 0.75 0.02</size></box></geometry></collision>"""
MESH = '<{part} name="{part}"><geometry><mesh><uri>{uri}</uri></mesh></geometry></{part}>'


def _world(folder: Path, body: str) -> WorldSpec:
    file = folder / "saved.world"
    file.write_text(f'<sdf version="1.6"><world name="default">{GROUND}{body}</world></sdf>')
    return load_world(str(file))


def _model(uri: str, x_m: float = 9.0, extra: str = "") -> str:
    parts = "".join(MESH.format(part=part, uri=uri) for part in ("collision", "visual"))
    return (
        f'<model name="thing"><link name="link">{extra}{parts}</link>'
        f"<pose frame=''>{x_m} 0 0 0 -0 0</pose></model>"
    )


@pytest.mark.parametrize(
    "written", ["5.5645e-06 2.28758e-05 -4.23884e-05", "6e-06 2.3e-05 -4.2e-05"]
)
@pytest.mark.parametrize("frame", ["", HECTOR])
def test_the_default_magnetic_field_points_to_true_north(
    tmp_path: Path, written: str, frame: str
) -> None:
    world = _world(tmp_path, f"{frame}<magnetic_field>{written}</magnetic_field>")
    east_t, north_t, up_t = world.field_enu_t
    assert east_t == 0.0 and north_t > 2e-5
    assert math.degrees(math.atan2(-up_t, north_t)) == pytest.approx(61.0, abs=0.5)
    assert sum("magnetic_field" in warning for warning in world.warnings) == 1


def test_a_world_without_a_magnetic_field_has_the_default_without_a_word(tmp_path: Path) -> None:
    world = _world(tmp_path, HECTOR)
    assert world.field_enu_t[0] == 0.0
    assert not any("magnetic" in warning for warning in world.warnings)


def test_any_other_magnetic_field_is_taken_as_written(tmp_path: Path) -> None:
    world = _world(tmp_path, f"{HECTOR}<magnetic_field>1e-05 2e-05 -4e-05</magnetic_field>")
    np.testing.assert_allclose(world.field_enu_t, (-2e-05, 1e-05, -4e-05), atol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "packaged"),
    [
        ("person_walking/meshes/walking.dae", "person_walking"),
        ("person_standing/meshes/standing.dae", "person_standing"),
        ("house_1/meshes/house_1.dae", "house"),
        ("house_2/meshes/house_2.dae", "house"),
        ("house_3/meshes/house_3.dae", "house"),
        ("oak_tree/meshes/oak_tree.dae", "oak"),
        ("pine_tree/meshes/pine_tree.dae", "pine"),
        ("lamp_post/meshes/lamp_post.dae", "lamp_post"),
        ("table/meshes/table.dae", "table"),
        ("stop_sign/meshes/stop_sign.dae", "speed_limit_sign"),
        ("speed_limit_sign/meshes/speed_limit_sign.dae", "speed_limit_sign"),
        ("telephone_pole/meshes/telephone_pole.dae", "telephone_pole"),
    ],
)
def test_a_packaged_model_stands_in_for_meshes_that_are_not_here(
    tmp_path: Path, mesh: str, packaged: str
) -> None:
    saved = _world(tmp_path, _model(f"model://{mesh}", extra=PLATE))
    uri = f"<include><uri>model://{packaged}</uri><pose>9 0 0 0 0 0</pose></include>"
    (thing,), (ours,) = saved.obstacles, _world(tmp_path, uri).obstacles
    plate, *stand_in = thing.shapes
    assert (tuple(stand_in), thing.collides) == (ours.shapes, True)
    assert plate.size_m == (0.35, 0.75, 0.02)
    assert (thing.x_map_m, thing.y_map_m) == (9.0, 0.0)
    (told,) = [warning for warning in saved.warnings if "meshes" in warning]
    assert f"model://{mesh.partition('/')[0]}'" in told and f"'{packaged}'" in told


WALL = """<link name="wall"><collision name="wall"><geometry><box><size>0.2 10 2</size></box>
</geometry></collision></link>"""


def test_a_stand_in_stands_where_its_mesh_would_and_leaves_other_links_alone(
    tmp_path: Path,
) -> None:
    parts = "".join(
        MESH.format(part=part, uri="model://table/meshes/table.dae").replace(
            "<geometry>", "<pose>0 0 0.5 0 0 0</pose><geometry>"
        )
        for part in ("collision", "visual")
    )
    link = f'<link name="table"><pose>5 3 0 0 0 {math.pi / 2}</pose>{parts}</link>'
    world = _world(tmp_path, f'<model name="yard">{WALL}{link}<pose>9 0 0 0 0 0</pose></model>')
    table = _world(tmp_path, "<include><uri>model://table</uri></include>").obstacles[0]
    (yard,) = world.obstacles
    wall, *stand_in = yard.shapes
    assert (wall.size_m, wall.origin.xyz_m) == ((0.2, 10.0, 2.0), (0.0, 0.0, 0.0))
    assert [shape.size_m for shape in stand_in] == [shape.size_m for shape in table.shapes]
    for shape, ours in zip(stand_in, table.shapes, strict=True):
        x_m, y_m, z_m = ours.origin.xyz_m
        np.testing.assert_allclose(shape.origin.xyz_m, (5.0 - y_m, 3.0 + x_m, 0.5 + z_m))
        assert shape.origin.rpy_rad[2] == pytest.approx(math.pi / 2)
        assert shape.rgba == ours.rgba


def test_two_meshes_of_one_kind_stand_at_two_places(tmp_path: Path) -> None:
    parts = "".join(
        MESH.format(part=part, uri="model://table/meshes/table.dae")
        for part in ("collision", "visual")
    )
    links = "".join(f'<link name="{x}"><pose>{x} 0 0 0 0 0</pose>{parts}</link>' for x in (-4, 4))
    world = _world(tmp_path, f'<model name="yard">{links}</model>')
    (yard,) = world.obstacles
    table = _world(tmp_path, "<include><uri>model://table</uri></include>").obstacles[0]
    assert len(yard.shapes) == 2 * len(table.shapes)
    assert {round(shape.origin.xyz_m[0] / 4.0) for shape in yard.shapes} == {-1, 1}
    assert sum("meshes" in warning for warning in world.warnings) == 1


def test_several_visuals_of_one_mesh_stand_once(tmp_path: Path) -> None:
    uri = "model://oak_tree/meshes/oak_tree.dae"
    again = MESH.format(part="visual", uri=uri)
    (tree,) = _world(tmp_path, _model(uri, extra=again)).obstacles
    (ours,) = _world(tmp_path, "<include><uri>model://oak</uri></include>").obstacles
    assert tree.shapes == ours.shapes


def test_a_mesh_that_is_only_seen_is_not_hit_instead_of_the_solid_parts(tmp_path: Path) -> None:
    visual = MESH.format(part="visual", uri="model://cafe_table/meshes/cafe_table.dae")
    model = f'<model name="cafe"><link name="l">{PLATE}{visual}</link></model>'
    solid, seen = _world(tmp_path, model).obstacles
    assert [shape.size_m for shape in solid.shapes] == [(0.35, 0.75, 0.02)]
    assert (solid.collides, seen.collides) == (True, False)


def test_a_damaged_mesh_is_as_good_as_none(tmp_path: Path) -> None:
    meshes = tmp_path / "models" / "person_walking" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "walking.dae").write_text("<COLLADA>")
    world = _world(tmp_path, _model("model://person_walking/meshes/walking.dae", extra=PLATE))
    assert len(world.obstacles[0].shapes) > 5


def test_a_mesh_of_a_ros_package_is_found_on_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    meshes = tmp_path / "ws" / "src" / "farm_gazebo" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "barn.obj").write_text("v 0 0 0\nv 1 2 3\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws" / "src"))
    (barn, *_) = _world(tmp_path, _model("package://farm_gazebo/meshes/barn.obj")).obstacles
    assert barn.shapes[0].size_m == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("variable", ["GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH"])
def test_models_and_meshes_of_gazebos_paths_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    models = tmp_path / "elsewhere" / "models"
    for name in ("person_walking/meshes", "shed"):
        (models / name).mkdir(parents=True)
    (models / "person_walking" / "meshes" / "walking.obj").write_text("v 0 0 0\nv 1 2 3\n")
    (models / "shed" / "model.sdf").write_text(
        '<sdf version="1.6"><model name="shed"><link name="l"><collision name="c"><geometry>'
        "<box><size>4 5 6</size></box></geometry></collision></link></model></sdf>"
    )
    monkeypatch.setenv(variable, f"/nowhere:{models}")
    shed = "<include><uri>model://shed</uri><pose>-9 0 0 0 0 0</pose></include>"
    world = _world(tmp_path, _model("model://person_walking/meshes/walking.obj") + shed)
    sizes = {o.name: o.shapes[0].size_m for o in world.obstacles}
    assert sizes == {"thing": (1.0, 2.0, 3.0), "shed": (4.0, 5.0, 6.0)}


def test_a_saved_person_stops_the_robot_and_is_felt(tmp_path: Path) -> None:
    uri = "model://person_walking/meshes/walking.dae"
    physics = Physics(load_robot(), _world(tmp_path, _model(uri, 1.5, PLATE)), 2_000_000)
    touched = False
    for _ in range(40):
        physics.command(DriveCommand(v_mps=0.5))
        physics.advance(50)
        touched = touched or physics.find_contact_body_m() is not None
    assert touched and physics.history[-1, POSITION][0] < 1.5


@pytest.mark.parametrize(
    ("uri", "kind"),
    [
        ("model://male_visitor_2", "person_standing"),
        ("https://fuel.gazebosim.org/1.0/OpenRobotics/models/Casual female", "person_standing"),
        ("https://fuel.gazebosim.org/1.0/x/models/WalkingPerson", "person_walking"),
        ("model://old_farmhouse", "house"),
        ("model://apple_tree", "oak"),
        ("model://brown_cow", "dog"),
    ],
)
def test_the_words_of_an_absent_model_choose_what_stands_in(
    tmp_path: Path, uri: str, kind: str
) -> None:
    file = tmp_path / "w.world"
    ground = "<include><uri>model://ground_plane</uri></include>"
    one = f"<include><uri>{uri}</uri><pose>5 1 0 0 0 0</pose></include>"
    file.write_text(f"<sdf version='1.9'><world name='w'>{ground}{one}</world></sdf>")
    world = load_world(str(file))
    (thing,) = (obstacle for obstacle in world.obstacles if obstacle.collides)
    assert thing.name == uri.rpartition("/")[2]
    assert thing.kind == kind and is_person(thing.kind) == kind.startswith("person")
    highest_m = max(shape.origin.xyz_m[2] for shape in thing.shapes)
    assert highest_m > (0.4 if kind == "dog" else 1.4)
    assert any(f"the packaged '{kind}' stands in" in warning for warning in world.warnings)


def test_an_absent_model_of_no_known_kind_is_still_a_box(tmp_path: Path) -> None:
    file = tmp_path / "w.world"
    includes = "<include><uri>model://{}</uri><pose>5 {} 0 0 0 0</pose></include>"
    two = includes.format("vegetable_crate", 1) + includes.format("ground_plane", 0)
    file.write_text(f"<sdf version='1.9'><world name='w'>{two}</world></sdf>")
    (crate,) = load_world(str(file)).obstacles
    assert [shape.kind for shape in crate.shapes] == ["box"]
