"""Robots that drive otherwise than by skid steer on four wheels are refused by what they have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.description.loader import check_robot, load_robot
from agribot.description.package import ROOT
from agribot.description.turning import compute_yaw_multiplier

BASE = """<link name="base_link"><inertial><mass value="30"/>
  <inertia ixx="0.6" ixy="0" ixz="0" iyy="1.7" iyz="0" izz="2.0"/></inertial></link>"""
WHEEL = """<link name="{name}"><collision><origin rpy="1.5707963 0 0"/>
    <geometry><cylinder radius="0.16" length="0.1"/></geometry></collision></link>
<joint name="{name}_joint" type="continuous"><parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/></joint>
"""
MOUNT = """<link name="{name}"/><joint name="{name}_joint" type="{kind}">
  <parent link="base_link"/><child link="{name}"/><origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/>
  <limit lower="-0.5" upper="0.5" effort="5" velocity="1"/></joint>
"""
ROLLER = """<link name="{name}"/><joint name="{name}_joint" type="continuous">
  <parent link="{parent}"/><child link="{name}"/><axis xyz="1 1 0"/></joint>"""
PLUGIN = '<gazebo><plugin name="drive" filename="{file}">{inside}</plugin></gazebo>'
CONTROL = """<ros2_control name="{name}" type="system"><hardware><plugin>{plugin}</plugin>
  </hardware></ros2_control>"""
CORNERS = {"rear_right": (-0.25, -0.28), "rear_left": (-0.25, 0.28),
           "front_right": (0.25, -0.28), "front_left": (0.25, 0.28)}  # fmt: skip
ONLY = "only skid steer on four, six or eight driven wheels is simulated and controlled"


def wheel(name: str, x: float, y: float, parent: str = "base_link") -> str:
    return WHEEL.format(name=name, x=x, y=y, parent=parent)


def wheels(*places: str, name: str = "{}_wheel") -> str:
    return "".join(wheel(name.format(place), *CORNERS[place]) for place in places)


def on_mounts(kind: str, mount: str, name: str, *places: str) -> str:
    """Wheels on links that turn about the vertical."""
    parts = []
    for place in places:
        x, y = CORNERS[place]
        parts.append(MOUNT.format(name=mount.format(place), kind=kind, x=x, y=y))
        parts.append(wheel(name.format(place), 0.0, 0.0, mount.format(place)))
    return "".join(parts)


def file_of(folder: Path, inside: str) -> str:
    file = folder / "rover.urdf"
    file.write_text(f'<?xml version="1.0"?>\n<robot name="rover">{BASE}{inside}</robot>\n')
    return str(file)


REAR, FRONT, ALL = ("rear_right", "rear_left"), ("front_right", "front_left"), tuple(CORNERS)
FOUR = wheels(*ALL)
MIDDLE = wheel("middle_right_wheel", 0.0, -0.28) + wheel("middle_left_wheel", 0.0, 0.28)
OBLIQUE = '<gazebo reference="front_left_wheel"><fdir1>1 -1 0</fdir1></gazebo>'
CASTORS = "castors ('castor_front_right', 'castor_front_left')"
KINDS = {
    "car": (
        wheels(*REAR) + on_mounts("revolute", "steer_{}", "{}_wheel", *FRONT),
        "wheels: 'front_right_wheel', 'front_left_wheel' are steered, by "
        "'steer_front_right_joint', 'steer_front_left_joint'",
    ),
    "four steered wheels": (
        on_mounts("continuous", "steer_{}", "{}_wheel", *ALL),
        "are steered, by 'steer_rear_right_joint', 'steer_rear_left_joint'",
    ),
    "mower": (
        wheels(*REAR) + on_mounts("continuous", "{}_fork", "castor_{}", *FRONT),
        f"wheels: it drives on 'rear_right_wheel', 'rear_left_wheel' and rolls on {CASTORS}",
    ),
    "castors without forks": (
        wheels(*REAR) + wheels(*FRONT, name="castor_{}"),
        f"it drives on 'rear_right_wheel', 'rear_left_wheel' and rolls on {CASTORS}",
    ),
    "two wheels between four castors": (
        wheel("left_wheel", 0.0, 0.28) + wheel("right_wheel", 0.0, -0.28)
        + on_mounts("continuous", "{}_caster_fork", "{}_wheel", *ALL),
        "it drives on 'left_wheel', 'right_wheel' and rolls on castors ('rear_right_wheel', "
        "'rear_left_wheel', 'front_right_wheel', 'front_left_wheel')",
    ),
    "two wheels and a sphere": (
        wheels(*REAR) + '<link name="caster_ball"/><joint name="b" type="fixed">'
        '<parent link="base_link"/><child link="caster_ball"/></joint>',
        "four wheel joints at the corners are needed, of type continuous and with their axles "
        "along y of base_link; turning links: rear_right_wheel, rear_left_wheel; castors: "
        "caster_ball",
    ),
    "five wheels": (FOUR + wheel("nose_wheel", 0.4, 0.0), "wheels: it stands on 5 wheels ('rear"),
    "six wheels, two of them in line": (
        FOUR + wheel("rear_wheel", -0.4, 0.0) + wheel("nose_wheel", 0.4, 0.0),
        "wheels: 'rear_right_wheel', 'rear_wheel' are no pair, right and left",
    ),
    "ten wheels": (
        FOUR + "".join(wheel(f"w{k}_wheel", k / 90.0, (-1) ** k * 0.28) for k in range(6)),
        "wheels: it stands on 10 wheels",
    ),
    "two driven wheels between four that roll": (
        FOUR + MIDDLE + PLUGIN.format(
            file="gz-sim-diff-drive-system",
            inside="<left_joint>middle_left_wheel_joint</left_joint>"
            "<right_joint>middle_right_wheel_joint</right_joint>",
        ),
        "does not drive 'rear_right_wheel', 'rear_left_wheel', 'front_right_wheel', "
        "'front_left_wheel', which would roll along",
    ),
    "a small wheel between large ones": (
        FOUR + MIDDLE.replace('radius="0.16"', 'radius="0.12"'),
        "link 'middle_right_wheel': a wheel of 0.12 m radius between wheels of 0.16 m; all wheels "
        "of a skid steer",
    ),
    "mecanum by name": (
        wheels(*ALL, name="{}_mecanum_wheel"),
        "wheels: 'rear_right_mecanum_wheel', 'rear_left_mecanum_wheel', "
        "'front_right_mecanum_wheel', 'front_left_mecanum_wheel' have rollers (mecanum)",
    ),
    "mecanum by friction": (FOUR + OBLIQUE, "wheels: 'front_left_wheel' have rollers (mecanum)"),
    "mecanum by rollers": (
        FOUR + "".join(ROLLER.format(name=f"r{k}", parent="front_left_wheel") for k in range(8)),
        "wheels: 'front_left_wheel' have rollers (mecanum) and drive sideways",
    ),
    "mecanum by the file of a mesh": (
        FOUR.replace(
            "</collision>",
            '</collision><visual><geometry><mesh filename="package://rover/meshes/Mecanum_L.dae"/>'
            "</geometry></visual>",
        ),
        "'front_left_wheel' have rollers (mecanum) and drive sideways",
    ),
    "oblique axles": (
        FOUR.replace('<axis xyz="0 1 0"/>', '<axis xyz="0.5 0.8660254 0"/>'),
        "'rear_left_wheel', 'front_right_wheel', 'front_left_wheel' lie oblique (omni)",
    ),
    "mecanum by ros2_control": (
        FOUR + CONTROL.format(name="base", plugin="rover_hardware/MecanumSystem"),
        "ros2_control 'base': it drives sideways",
    ),
    "steering by ros2_control": (
        FOUR + CONTROL.format(name="ackermann_base", plugin="gz_ros2_control/GazeboSimSystem"),
        "ros2_control 'ackermann_base': it steers wheels",
    ),
    "planar plugin": (
        FOUR + PLUGIN.format(file="libgazebo_ros_planar_move.so", inside=""),
        "plugin 'libgazebo_ros_planar_move.so': it drives sideways",
    ),
    "steering plugin": (
        FOUR + PLUGIN.format(file="gz-sim-ackermann-steering-system", inside=""),
        "plugin 'gz-sim-ackermann-steering-system': it steers wheels",
    ),
    "tracks": (
        FOUR + PLUGIN.format(file="gz-sim-tracked-vehicle-system", inside=""),
        "plugin 'gz-sim-tracked-vehicle-system': it drives tracks",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_skid_steer_is_refused_by_its_parts(tmp_path: Path, kind: str) -> None:
    inside, words = KINDS[kind]
    with pytest.raises(DescriptionError) as refused:
        load_robot(file_of(tmp_path, inside))
    assert words in str(refused.value)
    said = (ONLY, "four wheel joints at the corners", "give them one radius")
    assert any(word in str(refused.value) for word in said)


def test_a_check_lists_it_as_a_fault_and_a_run_does_not_begin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = file_of(tmp_path, KINDS["car"][0])
    assert any(ONLY in finding.text and finding.is_fault for finding in check_robot(file))
    assert main(["describe", "--robot", file, "--check"]) == 1
    out = tmp_path / "run"
    assert main(["run", "farm", "--robot", file, "--headless", "--out", str(out)]) == 2
    assert "are steered, by 'steer_front_right_joint'" in capsys.readouterr().err
    assert not out.exists()


def test_wheels_between_the_corners_are_named_by_their_place_and_drive(tmp_path: Path) -> None:
    robot = load_robot(file_of(tmp_path, MIDDLE + FOUR))
    assert robot.middle_wheels == ("right_wheel_M", "left_wheel_M")
    places = [*CORNERS.values(), (0.0, -0.28), (0.0, 0.28)]
    assert robot.wheel_xy_body_m().tolist() == pytest.approx(np.array(places))
    four = load_robot(file_of(tmp_path, FOUR))
    assert four.middle_wheels == ()
    assert four.drive.yaw_multiplier == pytest.approx(1.0 + 0.25**2 / 0.28**2)
    assert 1.0 < robot.drive.yaw_multiplier < four.drive.yaw_multiplier


def test_the_multiplier_of_four_wheels_is_the_known_one_and_middle_wheels_lower_it() -> None:
    four = compute_yaw_multiplier([0.25, 0.25, -0.25, -0.25], 0.39)
    assert four == pytest.approx(1.0 + 0.25**2 / 0.39**2)
    six = compute_yaw_multiplier([0.25, 0.25, -0.25, -0.25, 0.0, 0.0], 0.39)
    assert 1.0 < six < four
    assert compute_yaw_multiplier([0.1, 0.1, -0.1, -0.1, 0.0, 0.0], 0.39) == pytest.approx(
        1.0, abs=1e-5
    )


def test_eight_wheels_are_two_pairs_between_the_corners(tmp_path: Path) -> None:
    pairs = [(x, y) for x in (0.1, -0.1) for y in (0.28, -0.28)]
    parts = "".join(wheel(f"w{k}_wheel", *place) for k, place in enumerate(pairs))
    robot = load_robot(file_of(tmp_path, FOUR + parts))
    at = {name: tuple(robot.base_from_link(name)[:2, 3]) for name in robot.middle_wheels}
    assert at == {
        "right_wheel_MR": (-0.1, -0.28), "left_wheel_MR": (-0.1, 0.28),
        "right_wheel_MF": (0.1, -0.28), "left_wheel_MF": (0.1, 0.28),
    }  # fmt: skip


def test_a_middle_pair_in_our_own_description_drives_though_its_plugin_names_four(
    tmp_path: Path,
) -> None:
    """Under the names that the packaged robot gives its wheels, as its xacro's macro makes them."""
    text = (ROOT / "urdf" / "agribot.urdf").read_text()
    middle = wheel("right_wheel_M", 0.0, -0.39) + wheel("left_wheel_M", 0.0, 0.39)
    file = tmp_path / "six.urdf"
    file.write_text(text.replace("</robot>", f"{middle}</robot>").replace("0.16", "0.09"))
    robot = load_robot(str(file))
    assert robot.middle_wheels == ("right_wheel_M", "left_wheel_M")
    said = " ".join(robot.warnings)
    assert "does not drive 'right_wheel_M', 'left_wheel_M'; here all six wheels drive" in said
    assert "<yaw_multiplier> is 1.415; from the places of all wheels it is 1.09;" in said


def test_suspensions_and_reels_are_no_steering_and_no_wheels(tmp_path: Path) -> None:
    rocker = """<link name="rocker"/><joint name="pivot" type="revolute"><parent link="base_link"/>
      <child link="rocker"/><axis xyz="0 1 0"/></joint>
      <link name="strut"/><joint name="spring" type="prismatic"><parent link="rocker"/>
      <child link="strut"/><axis xyz="0 0 1"/></joint>"""
    parts = "".join(wheel(f"{name}_wheel", *CORNERS[name], "strut") for name in ALL)
    robot = load_robot(file_of(tmp_path, rocker + parts + wheel("reel", 0.4, 0.0)))
    assert robot.drive.track_m == pytest.approx(0.56)
    assert "link 'reel' turns as a wheel does; it does not drive" in robot.warnings


def test_castors_beside_four_driven_wheels_are_named(tmp_path: Path) -> None:
    castor = MOUNT.format(name="fork", kind="continuous", x=0.5, y=0.0)
    robot = load_robot(file_of(tmp_path, FOUR + castor + wheel("caster_wheel", 0, 0, "fork")))
    assert robot.drive.wheelbase_m == 0.5
    assert "castor 'caster_wheel' is not simulated; four wheels carry the robot" in robot.warnings


def test_wheels_that_the_robots_own_plugin_leaves_to_roll_are_named(tmp_path: Path) -> None:
    two = "<left_joint>rear_left_wheel_joint</left_joint>"
    two += "<right_joint>rear_right_wheel_joint</right_joint>"
    plugin = PLUGIN.format(file="gz-sim-diff-drive-system", inside=two)
    told = load_robot(file_of(tmp_path, FOUR + plugin)).warnings
    assert (
        "plugin 'gz-sim-diff-drive-system' does not drive 'front_right_wheel', "
        "'front_left_wheel'; here all four wheels drive"
    ) in told


def test_wheels_without_a_transmission_and_without_a_command_are_named(tmp_path: Path) -> None:
    rear = [f"{place}_wheel_joint" for place in REAR]
    transmissions = "".join(
        f'<transmission name="of_{joint}"><joint name="{joint}"/></transmission>' for joint in rear
    )
    commands = "".join(
        f'<joint name="{joint}"><command_interface name="velocity"/></joint>' for joint in rear
    )
    control = f'<ros2_control name="base" type="system">{commands}</ros2_control>'
    told = load_robot(file_of(tmp_path, FOUR + transmissions + control)).warnings
    rolling = "does not drive 'front_right_wheel', 'front_left_wheel'; here all four wheels drive"
    assert f"<transmission> {rolling}" in told
    assert f"ros2_control 'base' {rolling}" in told
