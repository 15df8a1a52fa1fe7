"""Worlds as they are found: read with warnings, and a strict check that names every fault."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import WorldSpec
from agribot.description.terrain import encode_png, sample_height
from agribot.description.worlds_sdf import check_world, load_world

HEAD = """<?xml version="1.0"?>
<sdf version="{version}">
<world name="default">
<spherical_coordinates><latitude_deg>48</latitude_deg><longitude_deg>11</longitude_deg>
</spherical_coordinates>
"""
GROUND = """<model name="ground"><static>1</static><link name="l"><collision name="c">
<geometry><plane><normal>0 0 1</normal><size>30 30</size></plane></geometry>
</collision></link></model>
"""


def _file(folder: Path, body: str, *, version: str = "1.6", ground: str = GROUND) -> str:
    file = folder / "found.world"
    file.write_text(f"{HEAD.format(version=version)}{ground}{body}</world>\n</sdf>\n", "utf-8")
    return str(file)


def _line_of(file: str, text: str, nth: int = 1) -> int:
    lines = [n for n, line in enumerate(Path(file).read_text().splitlines(), 1) if text in line]
    return lines[nth - 1]


def _mesh_model(name: str, uri: str, scale: str = "1 1 1") -> str:
    return (
        f'<model name="{name}"><pose>4 5 0 0 0 0</pose><link name="l"><visual name="v">\n'
        f"<geometry><mesh><uri>{uri}</uri><scale>{scale}</scale></mesh></geometry>\n"
        "</visual></link></model>\n"
    )


@pytest.mark.parametrize("version", ["1.4", "1.5", "1.6", "1.7", "1.9", "1.11"])
def test_every_version_of_the_format_is_read(tmp_path: Path, version: str) -> None:
    world = load_world(_file(tmp_path, "", version=version))
    assert world.warnings == () and world.ground[0].x_max_m == 15.0


@pytest.mark.parametrize(
    "uri",
    ["model://barn/barn.dae", "package://farm/barn.stl", "file:///nowhere/barn.stl", "/x/b.obj"],
)
def test_a_named_box_stands_in_for_a_mesh_nobody_has(tmp_path: Path, uri: str) -> None:
    world = load_world(_file(tmp_path, _mesh_model("barn", uri, "2 1 3")))
    (barn,) = world.obstacles
    assert barn.name == "barn/visual" and barn.shapes[0].size_m == (2.0, 1.0, 3.0)
    assert barn.shapes[0].origin.xyz_m == (0.0, 0.0, 1.5)  # it stands on the ground
    assert any(uri in warning and "stands in" in warning for warning in world.warnings)


def _stl(low: tuple[float, float, float], high: tuple[float, float, float]) -> bytes:
    record = struct.pack("<12fH", 0, 0, 1, *low, *high, low[0], high[1], low[2], 0)
    return b"solid-free header".ljust(80) + struct.pack("<I", 1) + record


def test_a_mesh_that_is_there_gives_a_box_of_its_size(tmp_path: Path) -> None:
    meshes = tmp_path / "models" / "shed" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "shed.stl").write_bytes(_stl((0.0, 0.0, 0.0), (2.0, 4.0, 3.0)))
    uri = "model://shed/meshes/shed.stl"
    (shed,) = load_world(_file(tmp_path, _mesh_model("shed", uri, "0.5 0.5 0.5"))).obstacles
    assert shed.shapes[0].size_m == (1.0, 2.0, 1.5)
    assert shed.shapes[0].origin.xyz_m == (0.5, 1.0, 0.75)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.obj", "# made by hand\nv 0 0 0\nv 1 2 3\nvn 9 9 9\nf 1 2 1\n"),
        ("m.stl", "solid m\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 2 3\nvertex 1 0 0\n"),
        (
            "m.dae",
            '<COLLADA><asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset>'
            '<float_array id="m-positions-array" count="6">0 0 0 2 4 6</float_array></COLLADA>',
        ),
    ],
)
def test_meshes_of_every_common_format_are_measured(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    (thing,) = load_world(_file(tmp_path, _mesh_model("m", f"file://{name}"))).obstacles
    assert thing.shapes[0].size_m == pytest.approx((1.0, 2.0, 3.0))


def test_no_stand_in_is_put_on_the_robot(tmp_path: Path) -> None:
    barns = "".join(
        f"<include><uri>model://barn</uri><name>b{x}</name><pose>{x} 0 0 0 0 0</pose></include>"
        for x in (1, 3)
    )
    world = load_world(_file(tmp_path, barns))
    assert [o.name for o in world.obstacles] == ["b3"]
    assert any("'b1' would stand on the robot" in warning for warning in world.warnings)


def test_saved_states_of_repeated_models_go_by_their_order(tmp_path: Path) -> None:
    crop = '<model name="Crop_with_weed"><pose>9 9 0 0 0 0</pose></model>\n'
    state = (
        '<state world_name="default"><model name="Crop_with_weed"><pose>1 2 0 0 0 0</pose></model>'
        '<model name="Crop_with_weed"><pose>3 4 0 0 0 0</pose></model></state>'
    )
    world = load_world(_file(tmp_path, crop * 2 + state))
    crops = [(p.x_map_m, p.y_map_m) for p in world.plants if p.plant == PlantClass.CROP]
    assert crops == [(1.0, 2.0), (3.0, 4.0)]


def test_a_new_name_is_never_one_that_is_taken(tmp_path: Path) -> None:
    box = (
        '<model name="{}"><link name="l"><collision name="c"><geometry><box><size>1 1 1</size>'
        "</box></geometry></collision></link></model>"
    )
    world = load_world(
        _file(tmp_path, box.format("a_1") + box.format("a") + box.format("a") + box.format("a_1"))
    )
    names = [o.name for o in world.obstacles]
    assert len(set(names)) == 4 and names[:2] == ["a_1", "a"]


def test_poses_may_be_relative_to_other_models(tmp_path: Path) -> None:
    body = (
        '<frame name="yard"><pose>10 0 0 0 0 1.5707963267948966</pose></frame>'
        '<include><uri>model://oak</uri><pose relative_to="yard">2 0 0 0 0 0</pose></include>'
    )
    (oak,) = load_world(_file(tmp_path, body)).obstacles
    assert (oak.x_map_m, oak.y_map_m) == pytest.approx((10.0, 2.0))


def test_a_model_that_includes_itself_ends(tmp_path: Path) -> None:
    folder = tmp_path / "models" / "matryoshka"
    folder.mkdir(parents=True)
    (folder / "model.sdf").write_text(
        '<sdf version="1.9"><model name="matryoshka"><include><uri>model://matryoshka</uri>'
        '</include><link name="l"><collision name="c"><geometry><sphere><radius>1</radius>'
        "</sphere></geometry></collision></link></model></sdf>"
    )
    world = load_world(_file(tmp_path, "<include><uri>model://matryoshka</uri></include>"))
    assert len(world.obstacles) == 1


@pytest.mark.parametrize(
    "plugin",
    [
        '<plugin name="d" filename="libgazebo_ros_skid_steer_drive.so"/>',
        '<plugin name="d" filename="libgazebo_ros_diff_drive.so"/>',
        '<plugin name="gz::sim::systems::DiffDrive" filename="gz-sim-diff-drive-system"/>',
        '<plugin name="ignition::gazebo::systems::DiffDrive" filename="libignition-x.so"/>',
    ],
)
def test_a_robot_in_the_file_gives_the_place_to_start(tmp_path: Path, plugin: str) -> None:
    robot = f'<model name="rover"><pose>1 2 0.3 0 0 0.5</pose>{plugin}</model>'
    world = load_world(_file(tmp_path, robot))
    assert world.spawn_xy_map_m == (1.0, 2.0) and world.obstacles == ()
    assert world.spawn_yaw_map_rad == pytest.approx(0.5)
    assert world.warnings == (
        "the robot 'rover' of the world is left out; the one of --robot drives",
    )


@pytest.mark.parametrize("ratio", ["Inf", "inf", "+Infinity"])
def test_ground_of_infinite_friction_leaves_the_grip_to_the_tyre(
    tmp_path: Path, ratio: str
) -> None:
    ground = (
        '<model name="ground"><static>1</static><link name="l"><collision name="c"><geometry>'
        "<plane><size>100 100</size></plane></geometry><surface><friction><ode>"
        f"<mu>{ratio}</mu><mu2>{ratio}</mu2></ode></friction></surface></collision></link></model>"
    )
    world = load_world(_file(tmp_path, "", ground=ground))
    assert world.friction_ratio == 100.0


def test_names_that_gazebo_writes_with_two_colons_are_left_alone(tmp_path: Path) -> None:
    tags = (
        "<plugin name='p' filename='f'><gz::system_priority>-100</gz::system_priority>"
        "<ignition::gazebo::x gz::a='1'/></plugin>"
    )
    world = load_world(_file(tmp_path, tags))
    assert world.warnings == () and world.ground[0].x_max_m == 15.0


def _height_map(uri: str, size: str = "8 4 2", pos: str = "0 0 0") -> str:
    return (
        '<model name="land"><static>1</static><link name="l"><collision name="c"><geometry>'
        f"<heightmap><uri>{uri}</uri><size>{size}</size><pos>{pos}</pos></heightmap>"
        "</geometry></collision></link></model>\n"
    )


def _ramp() -> FloatArray:
    """Rises from West to East, and half as much from South to North."""
    east, north = np.meshgrid(np.linspace(0.0, 2.0, 9), np.linspace(0.0, 1.0, 5))
    return (east + north) / 3.0 * 2.0


def _terrain(folder: Path, body: str) -> WorldSpec:
    (folder / "ramp.png").write_bytes(encode_png(_ramp()))
    return load_world(_file(folder, body, ground=""))


def test_a_height_map_becomes_terrain_with_north_at_the_top(tmp_path: Path) -> None:
    world = _terrain(tmp_path, _height_map("file://ramp.png", pos="1 0 -0.5"))
    land = world.terrain
    assert land is not None and (land.x_min_m, land.y_min_m, land.resolution_m) == (-3.0, -2.0, 1.0)
    np.testing.assert_allclose(land.height_m, _ramp() - 0.5, atol=2.0 / 65535)
    assert sample_height(land, 5.0, 2.0) == pytest.approx(1.5, abs=1e-4)
    tile = world.ground[0]
    assert (tile.x_min_m, tile.y_min_m, tile.x_max_m, tile.y_max_m) == (-3.0, -2.0, 5.0, 2.0)


@pytest.mark.parametrize("heading_deg", [90.0, 180.0, -90.0, 33.0])
def test_terrain_turns_with_the_heading(tmp_path: Path, heading_deg: float) -> None:
    (tmp_path / "ramp.png").write_bytes(encode_png(_ramp()))
    file = Path(_file(tmp_path, _height_map("ramp.png"), ground=""))
    heading = f"<heading_deg>{heading_deg}</heading_deg></spherical_coordinates>"
    file.write_text(file.read_text().replace("</spherical_coordinates>", heading))
    land = load_world(str(file)).terrain
    assert land is not None
    turn = np.exp(1j * math.radians(heading_deg))
    for x_m, y_m in ((0.0, 0.0), (2.0, -1.0), (-3.0, 1.0)):
        at = (x_m + 1j * y_m) * turn
        expected_m = ((x_m + 4.0) / 4.0 + (y_m + 2.0) / 4.0) * 2.0 / 3.0
        assert sample_height(land, at.real, at.imag) == pytest.approx(expected_m, abs=0.02)


def test_a_volcano_stands_in_for_a_height_map_nobody_has(tmp_path: Path) -> None:
    body = _height_map("model://terrain/mtsthelens.dem", "150 150 50", "0 0 -685")
    world = load_world(_file(tmp_path, body, ground=""))
    assert world.terrain is not None
    assert (world.terrain.height_m.min(), world.terrain.height_m.max()) == (0.0, 50.0)
    assert any("mtsthelens.dem" in warning for warning in world.warnings)


FAULTY = """<model name="rock"><pose>1 2 3</pose></model>
<model name="rock"/>
<model name="rock"/>
<include><uri>model://barn</uri><pose>6 0 0 0 0 0</pose></include>
<model name="odd"><link name="l">
<collision name="c"><geometry><box><size>1 1</size></box></geometry></collision>
<visual name="v"><geometry/></visual>
</link></model>
<gravity>0 0 down</gravity>
"""


def test_a_strict_check_names_every_fault_with_its_line(tmp_path: Path) -> None:
    file = _file(tmp_path, FAULTY)
    found = {(f.line, f.text.partition(";")[0].partition(",")[0]) for f in check_world(file)}
    line = {word: _line_of(file, word) for word in ("1 2 3", "barn", "1 1<", "<geometry/>", "down")}
    assert found == {
        (line["1 2 3"], "model 'rock' <pose>: needs 6 numbers"),
        (_line_of(file, '"rock"/>'), "3 models are named 'rock'"),
        (_line_of(file, '"rock"/>', 2), "the name 'rock' is taken"),
        (line["barn"], "model 'model://barn' is in no model folder"),
        (line["1 1<"], "model 'odd' <box> <size>: needs 3 numbers"),
        (line["<geometry/>"], "model 'odd': <geometry> of 'v' is empty"),
        (line["down"], "<gravity>: '0 0 down' is not a list of numbers"),
    }


def test_a_strict_check_fails_and_a_lenient_one_warns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _file(tmp_path, "<include><uri>model://barn</uri><pose>6 0 0 0 0 0</pose></include>")
    assert main(["world", "check", file]) == 0
    assert "warning: model 'model://barn'" in capsys.readouterr().err
    assert main(["world", "check", file, "--strict"]) == 1
    assert f"found.world:{_line_of(file, 'barn')}: " in capsys.readouterr().out
    assert main(["world", "check", file, "--strict", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["ok"] and told["faults"][0]["line"] == _line_of(file, "barn")


def test_a_strict_check_of_broken_xml_names_the_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.world"
    file.write_text("<sdf>\n<world>\n</sdf>\n")
    assert main(["world", "check", str(file), "--strict"]) == 1
    assert "line 3" in capsys.readouterr().out
