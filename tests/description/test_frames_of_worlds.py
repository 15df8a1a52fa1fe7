"""Where things stand whose pose is relative to a frame, link, joint or model."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.core.world import WorldSpec
from agribot.description.worlds_sdf import check_world, load_world

HEAD = """<?xml version="1.0"?>
<sdf version="1.9"><world name="w">
<model name="ground_plane"><static>true</static><link name="link"><collision name="c"><geometry>
<plane><normal>0 0 1</normal><size>60 60</size></plane></geometry></collision></link></model>
"""
BOX = '<collision name="c"><geometry><box><size>2 0.4 1</size></box></geometry></collision>'
TURN = "0 0 1.5707963267948966"
LINK_A = f'<link name="a"><pose>2 0 0.5 {TURN}</pose></link>'


def file_of(folder: Path, body: str) -> str:
    file = folder / "frames.world"
    file.write_text(f"{HEAD}{body}</world></sdf>\n")
    return str(file)


def model(inside: str, pose: str = "<pose>1 1 0 0 0 0</pose>") -> str:
    return f'<model name="m"><static>true</static>{pose}{inside}</model>'


def box_at(relative: str, kind: str = "link") -> str:
    """A link whose box lies 3 m ahead of a frame."""
    pose = f'<pose relative_to="{relative}">3 0 0 0 0 0</pose>'
    if kind == "link":
        return f'<link name="b">{pose}{BOX}</link>'
    return f'<link name="b">{BOX.replace("<geometry>", f"{pose}<geometry>")}</link>'


def find_box(world: WorldSpec) -> tuple[float, float, float, float]:
    """East, North, height and yaw of the one box."""
    (thing,) = world.obstacles
    (shape,) = thing.shapes
    x_m, y_m, z_m = shape.origin.xyz_m
    cos, sin = math.cos(thing.yaw_rad), math.sin(thing.yaw_rad)
    east_m, north_m = thing.x_map_m + cos * x_m - sin * y_m, thing.y_map_m + sin * x_m + cos * y_m
    return east_m, north_m, thing.z_map_m + z_m, thing.yaw_rad + shape.origin.rpy_rad[2]


FRAME = f'<frame name="f"><pose>2 0 0.5 {TURN}</pose></frame>'
JOINT = (
    f'<joint name="j" type="fixed"><parent>world</parent><child>a</child>'
    f"<pose>0 0 0 0 0 0</pose></joint>{LINK_A}"
)
ATTACHED = f'{LINK_A}<frame name="g" attached_to="a"/>'
NESTED = f'<model name="n"><pose>1 0 0 0 0 0</pose><link name="a"><pose>1 0 0.5 {TURN}</pose></link></model>'  # noqa: E501


@pytest.mark.parametrize("kind", ["link", "collision"])
@pytest.mark.parametrize(
    ("others", "relative"),
    [
        (LINK_A, "a"), (FRAME, "f"), (JOINT, "j"), (ATTACHED, "g"), (NESTED, "n::a"),
    ],
    ids=["link", "frame", "joint", "attached frame", "link of a nested model"],
)  # fmt: skip
def test_a_part_of_a_model_is_placed_in_the_frame_that_it_names(
    tmp_path: Path, others: str, relative: str, kind: str
) -> None:
    """The frame is at (2, 0, 0.5) of the model, turned to the left; the model at (1, 1, 0)."""
    world = load_world(file_of(tmp_path, model(others + box_at(relative, kind))))
    assert find_box(world) == pytest.approx((3.0, 4.0, 0.5, math.pi / 2.0))


def test_the_attribute_of_older_files_names_a_frame_too(tmp_path: Path) -> None:
    old = box_at("a").replace("relative_to", "frame")
    world = load_world(file_of(tmp_path, model(LINK_A + old)))
    assert find_box(world) == pytest.approx((3.0, 4.0, 0.5, math.pi / 2.0))
    world = load_world(file_of(tmp_path, model(LINK_A + old.replace('"a"', '"map"'))))
    assert find_box(world) == pytest.approx((4.0, 1.0, 0.0, 0.0))
    assert "model 'm': the pose of 'b' names 'map', which is no frame" in "".join(world.warnings)


def test_the_frame_of_the_model_may_be_named(tmp_path: Path) -> None:
    body = model(FRAME + box_at("__model__"))
    assert find_box(load_world(file_of(tmp_path, body))) == pytest.approx((4.0, 1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "pose",
    [
        '<pose relative_to="yard">2 0 0 0 0 0</pose>',
        '<pose relative_to="yard::a">0 0 -0.5 0 0 -1.5707963267948966</pose>',
    ],
)
def test_a_model_is_placed_in_a_frame_of_the_world_or_in_a_part_of_another(
    tmp_path: Path, pose: str
) -> None:
    yard = f'<model name="yard"><pose>10 0 0 0 0 0</pose>{LINK_A}</model>'
    box = find_box(
        load_world(file_of(tmp_path, yard + model(f'<link name="b">{BOX}</link>', pose)))
    )
    assert box == pytest.approx((12.0, 0.0, 0.0, 0.0))


def test_a_model_is_placed_by_the_frame_that_placement_frame_names(tmp_path: Path) -> None:
    body = model(f'<link name="b"><pose>0 0 0.5 0 0 0</pose>{BOX}</link>')
    body = body.replace('name="m"', 'name="m" placement_frame="b"')
    assert find_box(load_world(file_of(tmp_path, body))) == pytest.approx((1.0, 1.0, 0.0, 0.0))


def test_a_rotation_may_be_a_quaternion(tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    pose = f'<pose rotation_format="quat_xyzw">3 0 0.5 0 0 {half} {half}</pose>'
    world = load_world(file_of(tmp_path, model(f'<link name="b">{BOX}</link>', pose)))
    assert find_box(world) == pytest.approx((3.0, 0.0, 0.5, math.pi / 2.0))


CIRCLE = (
    '<frame name="a"><pose relative_to="b">1 0 0 0 0 0</pose></frame>'
    '<frame name="b"><pose relative_to="a">1 0 0 0 0 0</pose></frame>'
)
BAD = {
    "unknown in a model": (
        model(FRAME + box_at("ghost")),
        "model 'm': 'b' is placed relative to 'ghost', which is no frame; there are: f, b",
    ),
    "unknown in the world": (
        model("", '<pose relative_to="ghost">0 0 0 0 0 0</pose>'),
        "world 'w': 'm' is placed relative to 'ghost', which is no frame; there are: "
        "ground_plane, m",
    ),
    "circle": (
        CIRCLE + model("", '<pose relative_to="a">0 0 0 0 0 0</pose>'),
        "world 'w': 'a' is placed relative to itself",
    ),
    "no frame inside a frame": (model(FRAME + box_at("f::x")), "'f::x', which is no frame"),
    "quaternion of no length": (
        model("", '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose>'), "has no length",
    ),
    "another form": (
        model("", '<pose rotation_format="matrix">0</pose>'),
        "rotation_format 'matrix' is not read; use euler_rpy",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_frame_that_is_none_is_refused_and_a_check_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    body, words = BAD[case]
    file = file_of(tmp_path, body)
    with pytest.raises(DescriptionError) as refused:
        load_world(file)
    assert words in str(refused.value)
    assert any(words in finding.text and finding.is_fault for finding in check_world(file))
    assert main(["world", "check", file, "--strict"]) == 1
    assert words in capsys.readouterr().out


UNREAD = {
    "model 'm': sensor 'eye' of type 'camera' is not simulated": model(
        f'<link name="b">{BOX}<sensor name="eye" type="camera"/></link>'
    ),
    "model 'm' stands still; its joints are not simulated: 'hinge'": model(
        f'<link name="b">{BOX}</link><joint name="hinge" type="revolute"/>'
    ),
    "<wind> of 3 0 0 m/s is not simulated": "<wind><linear_velocity>3 0 0</linear_velocity></wind>",
}


@pytest.mark.parametrize("words", UNREAD)
def test_what_a_world_holds_and_is_not_simulated_is_named(tmp_path: Path, words: str) -> None:
    file = file_of(tmp_path, UNREAD[words])
    assert words in load_world(file).warnings
    assert any(finding.text == words and not finding.is_fault for finding in check_world(file))


def test_a_plugin_of_a_world_is_named_in_a_check_unless_its_work_is_done_here(
    tmp_path: Path,
) -> None:
    plugins = "".join(
        f'<plugin filename="gz-sim-{name}-system" name="x"/>' for name in ("physics", "buoyancy")
    )
    texts = [finding.text for finding in check_world(file_of(tmp_path, plugins))]
    assert [text for text in texts if "plugin" in text] == [
        "plugin 'gz-sim-buoyancy-system' is not read"
    ]
