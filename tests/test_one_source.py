"""The xacro files are the robot: one number changed there changes everything that depends on it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from agribot import description
from agribot.autonomy.estimate.localizer import Localizer
from agribot.core import config
from agribot.core.messages import DriveCommand, RobotCommand
from agribot.core.robot import RobotSpec
from agribot.description.loader import export_urdf, load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.platform import SimPlatform

OLD = '<xacro:property name="wheel_radius" value="0.09"/>'
NEW = '<xacro:property name="wheel_radius" value="0.12"/>'


@pytest.fixture
def bigger_wheels(tmp_path: Path) -> str:
    """A copy of the description in which one number differs; returns its top file."""
    folder = tmp_path / "urdf"
    shutil.copytree(Path(description.__file__).parent / "urdf", folder)
    body = folder / "agribot_body.urdf.xacro"
    text = body.read_text()
    assert text.count(OLD) == 1
    body.write_text(text.replace(OLD, NEW))
    return str(folder / "agribot_sensors.urdf.xacro")


def drive_ahead(robot: RobotSpec) -> tuple[float, float, float]:
    """Drive 4 s at 0.4 m/s: true and estimated distance in m, and wheel speed in rad/s."""
    settings = config.load("farm", ["perception.enabled=false", 'sim.sensors="ideal"'])
    platform = SimPlatform(settings, robot, load_world("empty"))
    localizer = Localizer(settings.estimate, settings.field, robot)
    true_m = believed_m = wheel_radps = 0.0
    for tick in range(400):
        batch = platform.read()
        estimate = localizer.update(batch)
        speed_mps = 0.4 if tick >= 200 else 0.0
        drive = DriveCommand(v_mps=speed_mps)
        platform.write(RobotCommand(t_s=batch.t_s, drive=drive))
        true_m += platform.truth().v_mps * 0.02
        believed_m += estimate.v_mps * 0.02
        wheel_radps = sum(batch.wheels[-1].speed_radps) / 4
    platform.close()
    return true_m, believed_m, wheel_radps


def test_a_changed_wheel_radius_reaches_physics_odometry_and_exported_urdf(
    bigger_wheels: str,
) -> None:
    usual, bigger = load_robot(), load_robot(bigger_wheels)
    assert bigger.drive.wheel_radius_m == 0.12
    assert bigger.base_height_m == pytest.approx(usual.base_height_m + 0.03)

    usual_true_m, usual_believed_m, usual_radps = drive_ahead(usual)
    true_m, believed_m, radps = drive_ahead(bigger)
    assert radps == pytest.approx(usual_radps * 0.09 / 0.12, rel=0.02)
    assert true_m == pytest.approx(usual_true_m, rel=0.02)
    assert believed_m == pytest.approx(true_m, rel=0.02)
    assert usual_believed_m == pytest.approx(usual_true_m, rel=0.02)

    assert 'radius="0.12"' in export_urdf(bigger_wheels)
    assert 'radius="0.09"' in export_urdf()


def test_physics_that_disagrees_with_odometry_is_seen_as_wrong_distance(
    bigger_wheels: str,
) -> None:
    settings = config.load("farm", ["perception.enabled=false", 'sim.sensors="ideal"'])
    platform = SimPlatform(settings, load_robot(bigger_wheels), load_world("empty"))
    platform.read()
    for _ in range(150):
        platform.write(RobotCommand(t_s=0.0, drive=DriveCommand(v_mps=0.4)))
        batch = platform.read()
    by_usual_radius_mps = 0.09 * sum(batch.wheels[-1].speed_radps) / 4
    assert platform.truth().v_mps == pytest.approx(by_usual_radius_mps * 0.12 / 0.09, rel=0.03)
