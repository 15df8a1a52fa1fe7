"""Robots as their makers publish them: attribute values, and parts in missing packages."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import RobotSpec
from agribot.description.loader import check_robot, export_urdf, load_robot, parse_robot

MACRO = """<?xml version="1.0"?>
<robot xmlns:xacro="http://ros.org/wiki/xacro">
  <xacro:macro name="rover_wheel" params="prefix parent *place">
    <link name="${prefix}_wheel_link">
      <inertial><mass value="2.6"/>
        <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.02"/></inertial>
      <collision><origin rpy="${pi/2} 0 0"/>
        <geometry><cylinder radius="0.16" length="0.11"/></geometry></collision>
    </link>
    <gazebo reference="${prefix}_wheel_link">FRICTION</gazebo>
    <joint name="${prefix}_wheel" type="continuous">
      <parent link="${parent}"/><child link="${prefix}_wheel_link"/>
      <xacro:insert_block name="place"/><axis xyz="0 1 0" rpy="0 0 0"/>
    </joint>
  </xacro:macro>
</robot>
"""
TOP = """<?xml version="1.0"?>
<robot name="rover" xmlns:xacro="http://ros.org/wiki/xacro">
  <xacro:arg name="laser_enabled" default="$(optenv ROVER_LASER 1)"/>
  <xacro:arg name="extras" default="$(optenv ROVER_EXTRAS empty.urdf)"/>
  <xacro:include filename="$(find rover_description)/urdf/wheel.urdf.xacro"/>
  BEFORE
  <link name="base_link">
    <inertial><mass value="33"/>
      <inertia ixx="0.6" ixy="0" ixz="0" iyy="1.7" iyz="0" izz="2.0"/></inertial>
  </link>
  BODY
  <xacro:rover_wheel prefix="fl" parent="LEFT"><origin xyz="0.25 0.28 0"/></xacro:rover_wheel>
  <xacro:rover_wheel prefix="fr" parent="RIGHT"><origin xyz="0.25 -0.28 0"/></xacro:rover_wheel>
  <xacro:rover_wheel prefix="rl" parent="LEFT"><origin xyz="-0.25 0.28 0"/></xacro:rover_wheel>
  <xacro:rover_wheel prefix="rr" parent="RIGHT"><origin xyz="-0.25 -0.28 0"/></xacro:rover_wheel>
  <xacro:include filename="$(arg extras)"/>
</robot>
"""
BY_ATTRIBUTE = """<mu1 value="0.9"/><mu2 value="0.5"/><kp value="10000000.0" /><kd value="1.0" />
  <fdir1 value="1 0 0"/><selfCollide value="false"/><material>Gazebo/Grey</material>"""
BY_TEXT = """<mu1>0.9</mu1><mu2>0.5</mu2><kp>1e7</kp><kd>1</kd><fdir1>1 0 0</fdir1>"""
LASER = """<xacro:if value="$(arg laser_enabled)">
    <link name="laser_mount"/>
    <joint name="laser_mount_joint" type="fixed">
      <parent link="base_link"/><child link="laser_mount"/></joint>
    <xacro:sick_tim frame="laser" topic="scan"/>
    <joint name="laser_joint" type="fixed">
      <parent link="laser_mount"/><child link="laser"/></joint>
    <joint name="cap_joint" type="fixed"><parent link="laser"/><child link="cap"/></joint>
    <link name="cap"/>
    <gazebo reference="laser"><material>Gazebo/Black</material></gazebo>
  </xacro:if>"""
SICK = '<xacro:include filename="$(find sick_tim)/urdf/sick_tim.urdf.xacro"/>'
CONTROL = '<xacro:arg name="controllers" default="$(find rover_control)/config/control.yaml"/>'
ROCKERS = """<link name="left_rocker"/><link name="right_rocker"/>
  <joint name="left_pivot" type="revolute"><parent link="base_link"/><child link="left_rocker"/>
    <limit upper="0.15" lower="-0.15" effort="100000" velocity="1"/><axis xyz="0 1 0"/></joint>
  <joint name="right_pivot" type="revolute"><parent link="base_link"/><child link="right_rocker"/>
    <limit upper="0.15" lower="-0.15" effort="100000" velocity="1"/><axis xyz="0 1 0"/></joint>
  <gazebo><plugin name="imu_controller" filename="libhector_gazebo_ros_imu.so">
    <updateRate>50.0</updateRate><bodyName>imu_link</bodyName></plugin></gazebo>"""
FOUND = """<robot xmlns:xacro="http://ros.org/wiki/xacro">
  <xacro:macro name="sick_tim" params="frame topic"><link name="${frame}"/></xacro:macro></robot>
"""


def _package(folder: Path, *, friction: str = BY_ATTRIBUTE, before: str = "", body: str = "",
             parents: tuple[str, str] = ("base_link", "base_link")) -> str:  # fmt: skip
    urdf = folder / "rover_description" / "urdf"
    urdf.mkdir(parents=True)
    top = TOP.replace("BEFORE", before).replace("BODY", body)
    top = top.replace("LEFT", parents[0]).replace("RIGHT", parents[1])
    (urdf / "wheel.urdf.xacro").write_text(MACRO.replace("FRICTION", friction))
    (urdf / "empty.urdf").write_text("<robot/>")
    (urdf / "rover.urdf.xacro").write_text(top)
    return str(urdf / "rover.urdf.xacro")


def _names(robot: RobotSpec) -> set[str]:
    return {link.name for link in robot.links}


def test_a_value_attribute_says_the_same_as_text(tmp_path: Path) -> None:
    by_attribute, by_text = (
        load_robot(_package(tmp_path / name, friction=friction))
        for name, friction in (("a", BY_ATTRIBUTE), ("t", BY_TEXT))
    )
    assert by_attribute.tyre == by_text.tyre
    assert by_attribute.tyre.friction_longitudinal_ratio == 0.9
    assert by_attribute.tyre.friction_lateral_ratio == 0.5


def test_a_first_direction_given_as_an_attribute_turns_the_friction(tmp_path: Path) -> None:
    along_axle = BY_ATTRIBUTE.replace('fdir1 value="1 0 0"', 'fdir1 value="0 1 0"')
    tyre = load_robot(_package(tmp_path, friction=along_axle)).tyre
    assert (tyre.friction_longitudinal_ratio, tyre.friction_lateral_ratio) == (0.5, 0.9)


def test_a_part_in_an_absent_package_is_left_out_and_named_once(tmp_path: Path) -> None:
    file = _package(tmp_path, before=SICK, body=LASER)
    robot = load_robot(file)
    (told,) = [warning for warning in robot.warnings if "sick_tim'" in warning]
    assert "urdf/sick_tim.urdf.xacro" in told and "left out" in told
    assert sum("<xacro:sick_tim>" in warning for warning in robot.warnings) == 1
    assert "laser_mount" in _names(robot) and _names(robot).isdisjoint({"laser", "cap"})
    assert {joint.name for joint in robot.joints}.isdisjoint({"laser_joint", "cap_joint"})
    assert robot.drive.track_m == 0.56
    assert any("sick_tim" in finding.text for finding in check_robot(file))


def test_the_robot_without_the_absent_part_reads_back_as_it_is(tmp_path: Path) -> None:
    file = _package(tmp_path, before=SICK, body=LASER)
    again, first = parse_robot(export_urdf(file), "rover"), load_robot(file)
    assert again.warnings == () and _names(again) == _names(first)


def test_an_absent_package_in_an_argument_does_not_end_the_reading(tmp_path: Path) -> None:
    with_argument = load_robot(_package(tmp_path / "with", before=CONTROL))
    assert with_argument == load_robot(_package(tmp_path / "without"))


def test_an_unknown_macro_is_an_error_where_nothing_was_left_out(tmp_path: Path) -> None:
    file = _package(tmp_path, body=LASER)
    with pytest.raises(DescriptionError, match=r"unknown macro name: xacro:sick_tim"):
        load_robot(file)


def test_a_missing_file_of_a_package_that_is_here_is_an_error(tmp_path: Path) -> None:
    file = _package(tmp_path)
    (Path(file).parent / "wheel.urdf.xacro").unlink()
    with pytest.raises(DescriptionError, match=r"wheel\.urdf\.xacro"):
        load_robot(file)


@pytest.mark.parametrize(
    ("variable", "told", "package"),
    [
        ("ROS_PACKAGE_PATH", "src", "src/sick_drivers/sick_tim"),
        ("ROS_PACKAGE_PATH", "src/sick_tim", "src/sick_tim"),
        ("AMENT_PREFIX_PATH", "install", "install/share/sick_tim"),
        ("GZ_SIM_RESOURCE_PATH", "models", "models/sick_tim"),
        ("GAZEBO_MODEL_PATH", "models", "models/sick_tim"),
    ],
)
def test_packages_are_found_where_the_environment_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, told: str, package: str
) -> None:
    elsewhere = tmp_path / "elsewhere" / package / "urdf"
    elsewhere.mkdir(parents=True)
    (elsewhere / "sick_tim.urdf.xacro").write_text(FOUND)
    monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'elsewhere' / told}")
    robot = load_robot(_package(tmp_path / "home" / "robots" / "ws", before=SICK, body=LASER))
    assert {"laser", "cap"} <= _names(robot)
    assert not any("sick_tim" in warning for warning in robot.warnings)


def test_wheels_on_rockers_with_a_sensor_on_no_link_are_adopted(tmp_path: Path) -> None:
    file = _package(tmp_path, body=ROCKERS, parents=("left_rocker", "right_rocker"))
    robot = load_robot(file)
    assert {joint.parent for joint in robot.joints if joint.child in WHEEL_NAMES} == {"base_link"}
    assert (robot.imu.link, robot.imu.rate_hz) == ("base_link", 50.0)
    assert any("no link 'imu_link'" in warning for warning in robot.warnings)
