"""Robots of other makers: loaded with usual values and warnings, and they drive."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import DescriptionError
from agribot.core.geo import transform
from agribot.core.messages import WHEEL_NAMES, DriveCommand, RobotCommand
from agribot.core.robot import RobotSpec
from agribot.description.loader import check_robot, export_urdf, load_robot, parse_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.physics import Physics
from agribot.sim.platform import SimPlatform
from agribot.sim.state import ANGULAR, EFFORT, WHEEL_SPEED

WHEEL = """
<link name="{name}">
  <inertial><mass value="2.6"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/>
  </inertial>
  <collision><origin rpy="1.5707963 0 0"/><geometry>{shape}</geometry></collision>
</link>
<joint name="{name}_joint" type="continuous">
  <parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{x} {y} 0.03" rpy="0 0 0"/><axis xyz="{axis}"/>
</joint>
"""
BODY = """
<link name="base_footprint"/>
<joint name="foot" type="fixed"><parent link="base_footprint"/><child link="base_link"/>
  <origin xyz="0 0 0.13"/></joint>
<link name="base_link">
  <inertial><mass value="33"/><inertia ixx="0.6" ixy="0" ixz="0" iyy="1.7" iyz="0" izz="2.0"/>
  </inertial>
  <collision><origin xyz="0 0 0.1"/><geometry><box size="0.9 0.5 0.2"/></geometry></collision>
</link>
"""
CYLINDER = '<cylinder radius="0.16" length="0.11"/>'
NAMES = ("rear_right", "rear_left", "front_right", "front_left")
PLACES = ((-0.25, -0.28), (-0.25, 0.28), (0.25, -0.28), (0.25, 0.28))


def _wheels(shape: str = CYLINDER, axis: str = "0 1 0", parent: str = "base_link") -> str:
    return "".join(
        WHEEL.format(name=f"{name}_wheel", shape=shape, axis=axis, parent=parent, x=x, y=y)
        for name, (x, y) in zip(NAMES, PLACES, strict=True)
    )


def _fixed(name: str, parent: str, child: str) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="fixed">{ends}</joint>'


def _file(folder: Path, inside: str, name: str = "rover.urdf") -> str:
    file = folder / name
    file.write_text(f'<?xml version="1.0"?>\n<robot name="rover">{inside}</robot>\n', "utf-8")
    return str(file)


def _drive(robot: RobotSpec, v_mps: float, yaw_rate_radps: float) -> tuple[float, float]:
    """True speed and yaw rate after 3 s of a command."""
    settings = config.load("farm", ["perception.enabled=false", 'sim.sensors="ideal"'])
    platform = SimPlatform(settings, robot, load_world("empty"))
    platform.read()
    for _ in range(150):
        command = DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)
        platform.write(RobotCommand(t_s=0.0, drive=command))
        platform.read()
    truth = platform.truth()
    platform.close()
    return truth.v_mps, truth.yaw_rate_radps


def test_wheels_are_known_by_their_place_and_the_robot_is_measured(tmp_path: Path) -> None:
    robot = load_robot(_file(tmp_path, BODY + _wheels()))
    np.testing.assert_allclose(robot.wheel_xy_body_m(), PLACES)
    drive = robot.drive
    assert (drive.wheel_radius_m, drive.wheel_width_m) == (0.16, 0.11)
    assert (drive.track_m, drive.wheelbase_m) == (0.56, 0.5)
    assert drive.yaw_multiplier == pytest.approx(1.0 + (0.25 / 0.28) ** 2)
    assert robot.base_height_m == pytest.approx(0.16 - 0.03)
    assert robot.mass_kg == pytest.approx(33 + 4 * 2.6)
    assert [j.name for j in robot.joints if j.child in WHEEL_NAMES] == [
        f"{name}_wheel_joint" for name in NAMES
    ]


def test_all_that_was_made_up_is_said(tmp_path: Path) -> None:
    told = " | ".join(load_robot(_file(tmp_path, BODY + _wheels())).warnings)
    for what in ("front_left_wheel", "drive plugin", "<drive>", "<tyre>", "IMU", "GNSS", "camera"):
        assert what in told
    assert load_robot().warnings == ()


@pytest.mark.parametrize("axis", ["0 1 0", "0 -1 0"])
@pytest.mark.parametrize("shape", [CYLINDER, '<sphere radius="0.16"/>'])
def test_any_four_wheels_drive_ahead_and_turn_left(tmp_path: Path, axis: str, shape: str) -> None:
    robot = load_robot(_file(tmp_path, BODY + _wheels(shape, axis)))
    v_mps, yaw_radps = _drive(robot, 0.5, 0.0)
    assert v_mps == pytest.approx(0.5, rel=0.03) and abs(yaw_radps) < 0.01
    v_mps, yaw_radps = _drive(robot, 0.0, 0.6)
    assert yaw_radps == pytest.approx(0.6, rel=0.1) and abs(v_mps) < 0.02


def test_wheels_turn_in_the_recording_as_they_roll(tmp_path: Path) -> None:
    """With a positive angle about the joint's axis the robot goes ahead, whatever its maker did."""
    for axis in ("0 1 0", "0 -1 0"):
        robot = load_robot(_file(tmp_path, BODY + _wheels(axis=axis)))
        for name in WHEEL_NAMES:
            joint = next(joint for joint in robot.joints if joint.child == name)
            assert (robot.base_from_link(name)[:3, :3] @ np.array(joint.axis))[1] > 0.99


def test_wheels_on_rockers_and_in_turned_frames_are_put_on_the_base(tmp_path: Path) -> None:
    rocker = """<link name="rocker"/><joint name="pivot" type="revolute">
      <parent link="base_link"/><child link="rocker"/><origin xyz="0 0 0.05" rpy="0 0 3.14159265"/>
      <axis xyz="0 1 0"/></joint>"""
    robot = load_robot(_file(tmp_path, BODY + rocker + _wheels(parent="rocker")))
    at = {name: tuple(robot.base_from_link(name)[:2, 3].round(6)) for name in WHEEL_NAMES}
    assert at == dict(zip(WHEEL_NAMES, PLACES, strict=True))  # front and rear have changed places
    assert robot.base_from_link("left_wheel_F")[2, 3] == pytest.approx(0.08)
    assert any("hangs on 'rocker'" in warning for warning in robot.warnings)
    assert _drive(robot, 0.4, 0.0)[0] == pytest.approx(0.4, rel=0.03)


def test_a_robot_of_bare_links_drives_on_usual_values(tmp_path: Path) -> None:
    bare = '<link name="chassis"/>' + "".join(
        f'<link name="w{i}"/><joint name="j{i}" type="continuous"><parent link="chassis"/>'
        f'<child link="w{i}"/><origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/></joint>'
        for i, (x, y) in enumerate(PLACES)
    )
    robot = load_robot(_file(tmp_path, bare))
    told = " | ".join(robot.warnings)
    assert "'chassis' is taken" in told and "15 kg" in told and "a guess" in told
    assert _drive(robot, 0.3, 0.0)[0] == pytest.approx(0.3, rel=0.03)


def test_motors_that_nobody_told_fit_the_mass_and_the_wheels(tmp_path: Path) -> None:
    own, robot = load_robot(), load_robot(_file(tmp_path, BODY + _wheels()))
    mass = robot.mass_kg / own.mass_kg
    size = robot.drive.wheel_radius_m / own.drive.wheel_radius_m
    # The voltage at a speed over ground is the same, and currents grow with the mass.
    constants = [drive.torque_constant_nmpa for drive in (own.drive, robot.drive)]
    assert constants[1] == pytest.approx(size * constants[0], rel=1e-3)
    assert robot.drive.winding_ohm == pytest.approx(own.drive.winding_ohm / mass, rel=1e-3)
    assert robot.drive.gear_efficiency_ratio == own.drive.gear_efficiency_ratio
    assert robot.drive.wheel_torque_nm == robot.drive.torque_nm
    assert robot.drive.no_load_a == pytest.approx(own.drive.no_load_a * mass, rel=1e-3)


@pytest.mark.parametrize(
    "wheels",
    ["", _wheels(axis="1 0 0"), _wheels().replace("0.28", "0.0")],
    ids=["none", "sideways", "in line"],
)
def test_a_robot_without_four_wheels_at_the_corners_is_refused(tmp_path: Path, wheels: str) -> None:
    with pytest.raises(DescriptionError, match=r"rover\.urdf.*four wheel joints at the corners"):
        load_robot(_file(tmp_path, BODY + wheels))


def test_repeated_names_and_impossible_inertias_are_mended(tmp_path: Path) -> None:
    twice = '<link name="lamp"/><link name="lamp"/>'
    wrong = BODY.replace('izz="2.0"', 'izz="-2.0"')
    robot = load_robot(_file(tmp_path, wrong + twice + _wheels()))
    assert {"lamp", "lamp_1"} <= {link.name for link in robot.links}
    assert min(robot.link("base_link").inertia_kgm2[:3]) > 0.0
    assert any("no body has this inertia" in warning for warning in robot.warnings)


def test_the_exported_urdf_is_the_robot_as_it_is_driven(tmp_path: Path) -> None:
    """A recording carries this text: it must read back to the same robot, without a warning."""
    file = _file(tmp_path, BODY + _wheels(axis="0 -1 0"))
    again, first = parse_robot(export_urdf(file), "rover"), load_robot(file)
    assert again.warnings == ()
    assert again.drive == first.drive and again.tyre == first.tyre and again.imu == first.imu
    for link in first.links:
        np.testing.assert_allclose(
            again.base_from_link(link.name), first.base_from_link(link.name), atol=1e-9
        )


GZ_SIM = """
<gazebo><plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">
  <left_joint>front_left_wheel_joint</left_joint><wheel_separation>0.57</wheel_separation>
  <wheel_radius>0.17</wheel_radius></plugin>
  <plugin filename="gz-sim-imu-system" name="gz::sim::systems::Imu"/>
  <plugin filename="gz-sim-navsat-system" name="gz::sim::systems::NavSat"/>
  <plugin filename="gz-sim-magnetometer-system" name="gz::sim::systems::Magnetometer"/></gazebo>
<gazebo reference="base_link">
  <sensor name="i" type="imu"><update_rate>150</update_rate></sensor>
  <sensor name="n" type="navsat"><update_rate>4</update_rate></sensor>
  <sensor name="m" type="magnetometer"/></gazebo>
"""


def test_plugins_and_sensors_of_gz_sim_are_read(tmp_path: Path) -> None:
    robot = load_robot(_file(tmp_path, BODY + _wheels() + GZ_SIM))
    assert robot.mag is not None
    assert (robot.imu.rate_hz, robot.gnss.rate_hz, robot.mag.rate_hz) == (150.0, 4.0, 10.0)
    without = GZ_SIM.replace('  <sensor name="m" type="magnetometer"/>', "")
    assert load_robot(_file(tmp_path, BODY + _wheels() + without)).mag is None  # none made up
    assert (robot.drive.plugin_diameter_m, robot.drive.plugin_separation_m) == (0.34, 0.57)


OLD_XACRO = """<?xml version="1.0"?>
<robot name="old" xmlns:xacro="http://ros.org/wiki/xacro">
  <property name="half" value="0.2"/>
  <property name="colour" value="Grey"/>
  <include filename="$(find rover_parts)/urdf/wheel.xacro"/>
  <link name="base_link"/>
  <rover_wheel name="lf" x="${half}" y="${half}"/>
  <rover_wheel name="lr" x="${-half}" y="${half}"/>
  <rover_wheel name="rf" x="${half}" y="${-half}"/>
  <rover_wheel name="rr" x="${-half}" y="${-half}"/>
  <gazebo reference="base_link"><material>Gazebo/${colour}</material></gazebo>>
</robot>
"""
OLD_WHEEL = """<?xml version="1.0"?>
<robot>
  <macro name="rover_wheel" params="name x y">
    <link name="${name}"><collision><origin rpy="${pi/2} 0 0"/><geometry>
      <cylinder radius="0.1" length="0.04"/></geometry></collision></link>
    <joint name="${name}_joint" type="continuous"><parent link="base_link"/>
      <child link="${name}"/><origin xyz="${x} ${y} 0"/><axis xyz="0 1 0"/></joint>
  </macro>
</robot>
"""


@pytest.fixture
def old_xacro(tmp_path: Path) -> str:
    """Two packages side by side, in the spelling before ROS Jade."""
    top = tmp_path / "rover_description" / "urdf" / "rover.urdf.xacro"
    part = tmp_path / "rover_parts" / "urdf" / "wheel.xacro"
    for file, text in ((top, OLD_XACRO), (part, OLD_WHEEL)):
        file.parent.mkdir(parents=True)
        file.write_text(text)
    return str(top)


def test_xacro_without_prefixes_is_understood(old_xacro: str) -> None:
    robot = load_robot(old_xacro)
    assert robot.drive.track_m == robot.drive.wheelbase_m == 0.4
    assert sum("without the prefix xacro:" in warning for warning in robot.warnings) == 2
    assert _drive(robot, 0.4, 0.0)[0] == pytest.approx(0.4, rel=0.03)


def test_a_check_finds_the_lines_of_old_xacro(old_xacro: str) -> None:
    found = {(f.file, f.line): f.text for f in check_robot(old_xacro)}
    assert "'>' too many" in found["rover.urdf.xacro", 11]
    assert "<property>" in found["rover.urdf.xacro", 5]
    assert "<macro>" in found["wheel.xacro", 3]


FAULTY = """
<link name="lamp"><visual><geometry/></visual></link>
<joint name="loose" type="fixed"><parent link="base_link"/><child link="nothing"/></joint>
<link name="heavy"><inertial><mass value="much"/><inertia ixx="1"/></inertial></link>
"""


def test_a_check_names_every_fault_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _file(
        tmp_path,
        FAULTY + export_urdf().partition("?>")[2].split(">", 1)[1].rpartition("</robot>")[0],
    )
    lines = Path(file).read_text().splitlines()
    assert main(["describe", "--robot", file, "--check", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)["faults"]
    places = {(fault["line"], fault["text"].partition(":")[0]) for fault in told}
    for word, what in (
        ("lamp", "link 'lamp'"),
        ("loose", "joint 'loose'"),
        ("heavy", "link 'heavy' <mass>"),
    ):
        line = 1 + next(i for i, text in enumerate(lines) if f'"{word}"' in text)
        assert (line, what) in places


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("</robot>", _fixed("back", "lamp", "base_footprint") + "</robot>",
         "joint 'back': link 'lamp' would hang on itself"),
        ("</robot>", _fixed("self", "lamp", "lamp") + "</robot>",
         "joint 'self': link 'lamp' hangs on joint 'lamp_joint' already"),
        ("</robot>", '<link name="knot"/>' + _fixed("self", "knot", "knot") + "</robot>",
         "joint 'self': link 'knot' would hang on itself"),
        ('<box size="0.9 0.5 0.2"/>', '<box size="-0.9 0.5 0.2"/>',
         "link 'base_link' <box>: a size of -0.9 x 0.5 x 0.2 m"),
        ('<cylinder radius="0.16"', '<cylinder radius="-0.16"',
         "link 'rear_right_wheel' <cylinder>: a size of -0.16 x 0.11 m"),
        ('<cylinder radius="0.16"', '<cylinder radius="0"', "a size of 0 x 0.11 m"),
        ('<cylinder radius="0.16"', '<cylinder radius="160"', "a wheel of 160 m radius > 3 m"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_and_named_by_a_check(
    tmp_path: Path, before: str, after: str, words: str
) -> None:
    lamp = '<link name="lamp"/>' + _fixed("lamp_joint", "base_link", "lamp")
    file = Path(_file(tmp_path, BODY + lamp + _wheels()))
    file.write_text(file.read_text().replace(before, after, 4))
    with pytest.raises(DescriptionError) as raised:
        load_robot(str(file))
    assert words in str(raised.value)
    assert any(words in finding.text for finding in check_robot(str(file)))


def test_a_link_that_nothing_holds_is_named(tmp_path: Path) -> None:
    robot = load_robot(_file(tmp_path, BODY + '<link name="lamp"/>' + _wheels()))
    assert "link 'lamp' hangs on no joint; it is held where 'base_footprint' is" in robot.warnings


def test_a_check_passes_what_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["describe", "--check"]) == 0
    assert capsys.readouterr().out == "0 faults, 0 notes\n"


def test_describing_a_robot_of_others_warns_and_succeeds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["describe", "--robot", _file(tmp_path, BODY + _wheels())]) == 0
    printed = capsys.readouterr()
    assert "warning: no IMU" in printed.err and "it can be driven" in printed.out


def test_the_default_camera_looks_down_at_the_ground_ahead(tmp_path: Path) -> None:
    robot = load_robot(_file(tmp_path, BODY + _wheels()))
    assert robot.camera is not None
    pose = robot.body_from_link(robot.camera.link)
    np.testing.assert_allclose(
        pose, transform((0.25, 0.0, 0.9), (0.0, math.radians(50.0), 0.0)), atol=1e-9
    )


@pytest.mark.parametrize("is_effort", [False, True])
def test_motors_that_were_made_up_run_calmly_in_short_and_long_steps(
    tmp_path: Path, is_effort: bool
) -> None:
    robot = load_robot(_file(tmp_path, BODY + _wheels()))
    for step_ns in (500_000, 5_000_000):
        physics = Physics(robot, load_world("empty"), step_ns, is_effort=is_effort)
        for _ in range(100):
            physics.command(DriveCommand(v_mps=0.5, yaw_rate_radps=0.3))
            rows = physics.advance(20_000_000 // step_ns)
        assert np.ptp(rows[:, WHEEL_SPEED], axis=0).max() < 0.01
        assert rows[-1, ANGULAR][2] == pytest.approx(0.3, rel=0.03)
        assert (rows[-1, EFFORT] * rows[-1, WHEEL_SPEED]).sum() > 0.0
