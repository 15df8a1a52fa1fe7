"""The robot written as SDF: the same places, masses, joints and sensors."""

from __future__ import annotations

import math
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.messages import WHEEL_NAMES, FloatArray
from agribot.core.robot import RobotSpec
from agribot.description.elements import SourceFile
from agribot.description.loader import load_robot
from agribot.description.poses import read_pose
from agribot.description.robot_sdf import export_sdf
from tests import machine


@pytest.fixture(scope="module")
def robot() -> RobotSpec:
    return load_robot()


@pytest.fixture(scope="module")
def model(robot: RobotSpec) -> ET.Element:
    found = ET.fromstring(export_sdf(robot)).find("model")
    assert found is not None
    return found


def _poses(model: ET.Element) -> dict[str, FloatArray]:
    """Links and frames in the frame of the model."""
    source = SourceFile("robot.sdf")
    links = {e.get("name", ""): read_pose(e, source, "link") for e in model.findall("link")}
    frames = {
        e.get("name", ""): links[e.get("attached_to", "")] @ read_pose(e, source, "frame")
        for e in model.findall("frame")
    }
    return {**links, **frames}


def test_every_frame_stands_where_the_robot_has_it(robot: RobotSpec, model: ET.Element) -> None:
    poses = _poses(model)
    assert set(poses) == {link.name for link in robot.links}
    for name, pose in poses.items():
        np.testing.assert_allclose(pose, robot.body_from_link(name), atol=1e-9)


def test_only_bodies_with_a_mass_are_links(robot: RobotSpec, model: ET.Element) -> None:
    masses = [float(e.findtext("inertial/mass", "0")) for e in model.findall("link")]
    assert min(masses) > 0.0 and sum(masses) == pytest.approx(robot.mass_kg)


def test_wheels_turn_about_their_axles(robot: RobotSpec, model: ET.Element) -> None:
    poses = _poses(model)
    turning = [joint for joint in model.findall("joint") if joint.get("type") == "continuous"]
    assert {joint.findtext("child") for joint in turning} == set(WHEEL_NAMES)
    for joint in turning:
        axis = np.array([float(word) for word in joint.findtext("axis/xyz", "").split()])
        axle = poses[joint.findtext("child", "")][:3, :3] @ axis
        assert axle[1] == pytest.approx(1.0, abs=1e-5)


def test_sensors_and_drive_are_those_of_the_robot(robot: RobotSpec, model: ET.Element) -> None:
    rates = {s.get("type"): float(s.findtext("update_rate", "0")) for s in model.iter("sensor")}
    assert rates == {"imu": 200.0, "navsat": 5.0, "magnetometer": 5.0, "camera": 30.0}
    assert float(model.findtext(".//horizontal_fov", "0")) == pytest.approx(math.radians(80), 1e-6)
    plugin = model.find("plugin")
    assert plugin is not None and len(plugin.findall("left_joint")) == 2
    assert float(plugin.findtext("wheel_radius", "0")) == robot.drive.wheel_radius_m
    assert float(plugin.findtext("wheel_separation", "0")) == pytest.approx(
        robot.drive.effective_separation_m
    )


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str], robot: RobotSpec) -> None:
    assert main(["describe", "--sdf"]) == 0
    assert capsys.readouterr().out == export_sdf(robot)


def test_the_sdf_checker_accepts_it(tmp_path: Path, robot: RobotSpec) -> None:
    machine.require("ign")
    (tmp_path / "robot.sdf").write_text(export_sdf(robot))
    done = subprocess.run(
        ["ign", "sdf", "-k", str(tmp_path / "robot.sdf")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Valid." in done.stdout, done.stdout + done.stderr
