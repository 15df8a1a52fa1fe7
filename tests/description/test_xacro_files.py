"""Files of xacro by what they hold, with their arguments, and bounds for the YAML they load."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.app.calibration.robot_file import RobotFile
from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.description.loader import export_urdf, load_robot
from agribot.description.package import split_arguments
from agribot.ui.robot_side.about_run import urdf_for_page

DECLARED = '<robot name="rover" xmlns:xacro="http://www.ros.org/wiki/xacro">'
PLAIN = export_urdf().partition("?>")[2].partition(">")[2]  # after <robot ...>
ARGUMENTS = '<xacro:arg name="side" default="left"/><link name="$(arg side)_lamp"/>'


def write(folder: Path, name: str, text: str) -> str:
    file = folder / name
    file.write_text(text, "utf-8")
    return str(file)


@pytest.fixture
def rover(tmp_path: Path) -> str:
    """A xacro with an argument, under the name of a plain file."""
    return write(tmp_path, "rover.urdf", DECLARED + ARGUMENTS + PLAIN)


def names(robot: str) -> set[str]:
    return {link.name for link in load_robot(robot).links}


@pytest.mark.parametrize("name", ["rover.urdf", "rover.urdf.xml", "rover.model", "rover"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_xacro_is_expanded_whatever_its_file_is_called_and_however_it_is_saved(
    rover: str, name: str, encoding: str
) -> None:
    file = Path(rover).with_name(name)
    file.write_text(Path(rover).read_text("utf-8"), encoding)
    assert "left_lamp" in names(str(file))


def test_a_plain_file_that_declares_the_names_of_xacro_stays_as_it_is(tmp_path: Path) -> None:
    file = write(tmp_path, "rover.urdf", DECLARED + PLAIN)
    assert load_robot(file).drive == load_robot().drive


def test_arguments_follow_the_file_as_in_ros(
    rover: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "right_lamp" in names(f"{rover} side:=right")
    assert main(["describe", "--robot", f"{rover} side:=right", "--urdf"]) == 0
    assert '<link name="right_lamp"' in capsys.readouterr().out
    assert urdf_for_page("<robot/>", f"{rover} side:=a/b") == ("<robot/>", {})
    assert RobotFile(Path("/home"), f"{rover} side:=a/b").path.name == "rover.toml"


def test_arguments_are_told_apart_from_a_path_with_blanks() -> None:
    written = "my robots/x.xacro  side:=far left ns:=/"
    assert split_arguments(written) == ("my robots/x.xacro", {"side": "far left", "ns": "/"})
    assert split_arguments("agribot") == ("agribot", {})


def test_an_argument_that_the_file_has_not_is_refused_with_those_it_has(rover: str) -> None:
    with pytest.raises(DescriptionError, match="no argument 'wheels'; it has: side"):
        load_robot(f"{rover} wheels:=4")


TEN = "[" + ", ".join(["*{0}"] * 10) + "]"
LEVELS = "\n".join(f"a{k + 1}: &a{k + 1} {TEN.format(f'a{k}')}" for k in range(9))
MERGED = "\n".join(f"a{k + 1}: &a{k + 1}\n  k{k}: 1\n  <<: {TEN.format(f'a{k}')}" for k in range(9))


@pytest.mark.parametrize(
    "text",
    [f"a0: &a0 [x]\n{LEVELS}", f"a0: &a0 {{x: 1}}\n{MERGED}", "a: &a [*a]"],
    ids=["lists", "merged", "itself"],
)
def test_yaml_that_expands_without_end_is_refused(tmp_path: Path, text: str) -> None:
    write(tmp_path, "b.yaml", text)
    use = "<xacro:property name='p' value=\"${xacro.load_yaml('b.yaml')}\"/><link name='${p}'/>"
    file = write(tmp_path, "rover.xacro", DECLARED + use + PLAIN)
    with pytest.raises(DescriptionError, match=r"b\.yaml: .* more than 100000 values"):
        load_robot(file)


def test_yaml_with_aliases_and_units_is_loaded(tmp_path: Path) -> None:
    write(tmp_path, "b.yaml", "near: &near lamp\nlinks: [*near, *near]\nturn: !degrees 180")
    use = (
        "<xacro:property name='p' value=\"${xacro.load_yaml('b.yaml')}\"/>"
        '<link name="${p.links[1]}_${round(p.turn)}"/>'
    )
    file = write(tmp_path, "rover.xacro", DECLARED + use + PLAIN)
    assert "lamp_3" in names(file)


def test_a_check_passes_a_robot_that_drives_with_assumed_numbers_and_notes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = export_urdf()
    begin, end = text.index("<yaw_multiplier>"), text.index("</yaw_multiplier>")
    file = write(tmp_path, "rover.urdf", text[:begin] + text[end + len("</yaw_multiplier>") :])
    assert main(["describe", "--robot", file, "--check", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] and told["faults"] == []
    assert "<yaw_multiplier> is missing" in told["notes"][0]["text"]
    assert main(["describe", "--robot", file, "--check"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "0 faults, 1 notes"
