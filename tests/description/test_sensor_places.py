"""Sensors of other people's robots: where they are, and those that are not read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.core.robot import RobotSpec
from agribot.description.loader import check_robot, export_urdf, load_robot, parse_robot
from agribot.description.robot_sdf import export_sdf

BASE = """<link name="base_link"><inertial><mass value="20"/>
  <inertia ixx="0.6" ixy="0" ixz="0" iyy="1.7" iyz="0" izz="2.0"/></inertial></link>"""
WHEEL = """<link name="{name}"><collision><origin rpy="1.5707963 0 0"/>
    <geometry><cylinder radius="0.12" length="0.06"/></geometry></collision></link>
<joint name="{name}_joint" type="continuous"><parent link="base_link"/><child link="{name}"/>
  <origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/></joint>
"""
WHEELS = "".join(
    WHEEL.format(name=f"wheel_{k}", x=x, y=y)
    for k, (x, y) in enumerate(((-0.3, -0.3), (-0.3, 0.3), (0.3, -0.3), (0.3, 0.3)))
)
CAMERA = "<camera><horizontal_fov>1.2</horizontal_fov>{inside}</camera>"


def sensor(kind: str, pose: str = "", name: str = "s", inside: str = "") -> str:
    return (
        f'<gazebo reference="base_link"><sensor type="{kind}" name="{name}">{pose}'
        f"<update_rate>10</update_rate>{inside}</sensor></gazebo>"
    )


def file_of(folder: Path, inside: str) -> str:
    file = folder / "rover.urdf"
    file.write_text(f'<?xml version="1.0"?>\n<robot name="rover">{BASE}{WHEELS}{inside}</robot>\n')
    return str(file)


def look_of(robot: RobotSpec) -> tuple[float, ...]:
    """Where the camera is in the body, and how far it looks down."""
    pose = robot.body_from_camera()
    return (*pose[:3, 3].tolist(), float(np.arcsin(-pose[2, 2])))


@pytest.mark.parametrize(
    ("outer", "inner"),
    [
        ("<pose>0.4 0 0.5 0 0.6 0</pose>", ""),
        ('<pose relative_to="base_link">0.4 0 0.5 0 0.6 0</pose>', ""),
        ("<pose>0.4 0 0.5 0 0 0</pose>", "<pose>0 0 0 0 0.6 0</pose>"),
    ],
    ids=["of the sensor", "of the sensor in its link", "of sensor and camera"],
)
def test_a_camera_is_where_its_pose_puts_it(tmp_path: Path, outer: str, inner: str) -> None:
    file = file_of(tmp_path, sensor("camera", outer, inside=CAMERA.format(inside=inner)))
    robot = load_robot(file)
    assert look_of(robot) == pytest.approx((0.4, 0.0, 0.5 + 0.12, 0.6))
    assert look_of(parse_robot(export_urdf(file), "again")) == pytest.approx(look_of(robot))
    assert "<pose>0.4 0 0.5 0 0.6 0</pose>" in export_sdf(robot)


@pytest.mark.parametrize("kind", ["imu", "gps", "navsat", "magnetometer"])
def test_every_sensor_is_where_its_pose_puts_it(tmp_path: Path, kind: str) -> None:
    robot = load_robot(file_of(tmp_path, sensor(kind, "<pose>-0.2 0 0.9 0 0 0</pose>")))
    mount = {"imu": robot.imu, "magnetometer": robot.mag}.get(kind, robot.gnss)
    assert mount is not None
    assert robot.base_from_link(mount.link)[:3, 3] == pytest.approx((-0.2, 0.0, 0.9))
    assert mount.rate_hz == 10.0


def test_a_pose_in_another_frame_is_refused(tmp_path: Path) -> None:
    file = file_of(tmp_path, sensor("imu", '<pose relative_to="mast">0 0 1 0 0 0</pose>'))
    words = r"sensor 's': its <pose> is relative to 'mast', which is not read here; state it in"
    with pytest.raises(DescriptionError, match=words):
        load_robot(file)
    assert any("relative to 'mast'" in f.text and f.is_fault for f in check_robot(file))


PLUGIN = '<gazebo><plugin name="x" filename="{file}">{inside}</plugin></gazebo>'
UNREAD = {
    "sensor 'scan' of type 'sonar' is not simulated": sensor("sonar", name="scan"),
    "camera 'rear' is not simulated; 'front' is the robot's": sensor(
        "camera", name="front", inside=CAMERA.format(inside="")
    ) + sensor("camera", name="rear", inside=CAMERA.format(inside="")),
    "IMU: link 'base_link_s' is turned by 90 degrees; its readings are simulated and taken along "
    "the axes of the body": sensor("imu", "<pose>0 0 0 1.5708 0 0</pose>"),
    "plugin 'libimu_sensor.so': <xyzOffset> 0 0 0.1 is not read": PLUGIN.format(
        file="libimu_sensor.so", inside="<xyzOffset>0 0 0.1</xyzOffset>"
    ),
}  # fmt: skip


@pytest.mark.parametrize("words", UNREAD)
def test_what_is_not_read_is_named_at_the_start_and_in_a_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str
) -> None:
    file = file_of(tmp_path, UNREAD[words])
    assert words in load_robot(file).warnings
    assert main(["describe", "--robot", file, "--check"]) == 0  # a note, no fault
    assert words in capsys.readouterr().out


def test_an_unknown_plugin_is_named_in_a_check(tmp_path: Path) -> None:
    file = file_of(tmp_path, PLUGIN.format(file="libgazebo_ros_gripper.so", inside=""))
    texts = [finding.text for finding in check_robot(file)]
    assert "plugin 'libgazebo_ros_gripper.so' is not read" in texts
    assert not any("gripper" in warning for warning in load_robot(file).warnings)
