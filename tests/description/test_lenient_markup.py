"""Markup and forms of other people's files that Gazebo takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.core.world import WorldSpec
from agribot.description.loader import check_robot, load_robot
from agribot.description.package import ROOT
from agribot.description.worlds_sdf import load_world

HEAD = """<?xml version="1.0"?>
<sdf version="1.9"><world name="w">
<model name="ground_plane"><static>true</static><link name="link"><collision name="c"><geometry>
<plane><normal>0 0 1</normal><size>60 60</size></plane></geometry></collision></link></model>
"""
OWN = (ROOT / "urdf" / "agribot.urdf").read_text()


def world_of(folder: Path, body: str) -> WorldSpec:
    file = folder / "found.world"
    file.write_text(f"{HEAD}{body}</world></sdf>\n")
    return load_world(str(file))


def robot_file(folder: Path, old: str, new: str) -> str:
    file = folder / "rover.urdf"
    assert old in OWN
    file.write_text(OWN.replace(old, new, 1))
    return str(file)


def test_a_colour_of_three_numbers_is_opaque_and_noted(tmp_path: Path) -> None:
    file = robot_file(
        tmp_path, "<link ", '<material name="plain"><color rgba="0.9 0.5 0"/></material><link '
    )
    assert load_robot(file).warnings == ()
    assert [(f.text, f.is_fault) for f in check_robot(file)] == [
        ("<color> '0.9 0.5 0' has no alpha; it is opaque", False)
    ]


def test_a_colour_of_two_numbers_is_a_fault(tmp_path: Path) -> None:
    file = robot_file(tmp_path, "<link ", '<material name="x"><color rgba="1 0"/></material><link ')
    with pytest.raises(DescriptionError, match="<color>: needs 4 numbers, found 2"):
        load_robot(file)


@pytest.mark.parametrize("prefix", ["gz", "ignition", "drake"])
def test_names_with_a_prefix_that_is_not_declared_are_left_alone(
    tmp_path: Path, prefix: str
) -> None:
    robot = robot_file(tmp_path, "<link ", f'<{prefix}:thing {prefix}:of="x"/><link ')
    assert load_robot(robot) == load_robot()
    box = (
        f'<model name="b" {prefix}:kind="x"><{prefix}:policy/><link name="l"><collision name="c">'
        "<geometry><box><size>1 1 1</size></box></geometry></collision></link></model>"
    )
    assert [thing.name for thing in world_of(tmp_path, box).obstacles] == ["b"]


def test_a_line_behind_undeclared_prefixes_is_still_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.world"
    file.write_text(f"{HEAD}<gz:policy/>\n<broken\n</world></sdf>")
    assert main(["world", "check", str(file)]) == 2
    assert "bad.world: not well-formed XML: " in (told := capsys.readouterr().err)
    assert "line 6" in told or "line 7" in told


def solid(form: str) -> str:
    return (
        '<model name="thing"><pose>3 0 0.5 0 0 0</pose><link name="l"><collision name="c">'
        f"<geometry>{form}</geometry></collision></link></model>"
    )


FORMS = {
    "capsule": (
        "<capsule><radius>0.2</radius><length>0.6</length></capsule>",
        [("cylinder", (0.2, 0.6, 0.0), 0.0), ("sphere", (0.2, 0.0, 0.0), -0.3),
         ("sphere", (0.2, 0.0, 0.0), 0.3)],
    ),
    "cone": (
        "<cone><radius>0.4</radius><length>1</length></cone>", [("cylinder", (0.4, 1.0, 0.0), 0.0)]
    ),
    "ellipsoid": (
        "<ellipsoid><radii>0.5 0.3 0.2</radii></ellipsoid>", [("box", (1.0, 0.6, 0.4), 0.0)]
    ),
    "polyline": (
        "<polyline><point>-0.5 -0.5</point><point>0.5 -0.5</point><point>0 0.5</point>"
        "<height>2</height></polyline>",
        [("box", (1.0, 1.0, 2.0), 1.0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_form_without_a_like_is_there_as_others(tmp_path: Path, name: str) -> None:
    form, expected = FORMS[name]
    world = world_of(tmp_path, solid(form))
    (thing,) = world.obstacles
    found = [(shape.kind, shape.size_m, shape.origin.xyz_m[2]) for shape in thing.shapes]
    assert [one[:2] for one in found] == [one[:2] for one in expected]
    assert [one[2] for one in found] == pytest.approx([one[2] for one in expected])
    assert thing.collides
    assert any(f"model 'thing': <{name}> is taken as " in warning for warning in world.warnings)


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("<capsule><radius>0</radius><length>1</length></capsule>", "<radius>: a size of 0 m"),
        ("<ellipsoid><radii>1 -1 1</radii></ellipsoid>", "all must be above 0"),
        ("<polyline><point>0 0</point><height>1</height></polyline>", "span no area"),
        ("<cone><radius>1</radius></cone>", "<cone> <length>: needs 1 numbers, found 0"),
    ],
)
def test_a_form_of_no_size_is_refused(tmp_path: Path, form: str, words: str) -> None:
    with pytest.raises(DescriptionError, match=words):
        world_of(tmp_path, solid(form))
