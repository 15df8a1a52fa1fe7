"""What was measured of a robot is kept, counts in the next run, and can be taken back."""

from __future__ import annotations

import argparse
import errno
import os
from pathlib import Path

import numpy as np
import pytest

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.app.calibration.robot_file import RobotFile
from agribot.cli.run.run_settings import add_setting_arguments, read_settings
from agribot.core import config
from agribot.core.config import CalibrationConfig
from agribot.core.errors import ConfigError, DescriptionError, RecordingError
from agribot.description.loader import load_robot


def test_every_change_can_be_undone_down_to_the_description(tmp_path: Path) -> None:
    file = RobotFile(tmp_path, "some/where/mine.urdf.xacro")
    assert file.path.name == "mine.toml" and file.settings() == ()
    file.add(["calibration.wheel_radius_m=0.089"])
    file.add(["calibration.yaw_multiplier=1.4", "estimate.mag_offset_t=[1e-6,-2e-6]"])
    assert config.load("farm", file.settings()).estimate.mag_offset_t == (1e-6, -2e-6)
    file.undo()
    assert file.settings() == ("calibration.wheel_radius_m=0.089",)
    file.undo()
    assert file.settings() == () and not file.can_undo and not file.path.exists()
    with pytest.raises(ConfigError, match="no earlier state"):
        file.undo()


def test_what_does_not_fit_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    file = RobotFile(tmp_path, "agribot")
    with pytest.raises(ConfigError, match="wheel_radius_m"):
        file.add(["calibration.wheel_radius_m=-1.0"])
    assert not file.path.exists()
    file.path.parent.mkdir(parents=True)
    file.path.write_text("calibration = [[[")
    with pytest.raises(ConfigError, match="delete it"):
        file.settings()


@pytest.mark.parametrize("fails", ["mine.bak0002", "mine.toml"])
def test_a_full_disk_changes_nothing_and_leaves_nothing_to_undo_that_never_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    file = RobotFile(tmp_path, "mine")
    file.add(["calibration.wheel_radius_m=0.089"])

    def write(path: Path, data: bytes) -> None:
        if path.name == fails:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        path.write_bytes(data)

    with monkeypatch.context() as full:
        full.setattr("agribot.app.calibration.robot_file.write_at_once", write)
        with pytest.raises(RecordingError, match="No space left on device; make room"):
            file.add(["calibration.wheel_radius_m=0.091"])
    assert file.settings() == ("calibration.wheel_radius_m=0.089",)
    file.undo()
    assert file.settings() == () and not file.can_undo


def test_no_change_is_forgotten_where_an_older_one_was_deleted(tmp_path: Path) -> None:
    file = RobotFile(tmp_path, "mine")
    for radius in ("0.088", "0.089", "0.091"):
        file.add([f"calibration.wheel_radius_m={radius}"])
    (file.path.parent / "mine.bak0001").unlink()
    file.add(["calibration.wheel_radius_m=0.092"])
    for radius in ("0.091", "0.089", "0.088"):
        file.undo()
        assert file.settings() == (f"calibration.wheel_radius_m={radius}",)


def test_a_run_believes_the_file_and_an_option_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    RobotFile(tmp_path, "agribot").add(["calibration.wheel_radius_m=0.089"])
    parser = argparse.ArgumentParser()
    add_setting_arguments(parser)
    assert read_settings(parser.parse_args(["farm"])).calibration.wheel_radius_m == 0.089
    assert "measured of this robot" in capsys.readouterr().err
    words = ["farm", "--set", "calibration.wheel_radius_m=0.088"]
    assert read_settings(parser.parse_args(words)).calibration.wheel_radius_m == 0.088
    other = read_settings(parser.parse_args(["farm", "--robot", "other"]))
    assert other.calibration.wheel_radius_m is None


@pytest.mark.parametrize(
    "measured",
    [
        CalibrationConfig(wheel_radius_m=9.8),
        CalibrationConfig(wheel_radius_m=0.001),
        CalibrationConfig(yaw_multiplier=20.0),
    ],
)
def test_wheels_that_cannot_be_those_of_the_robot_are_refused(measured: CalibrationConfig) -> None:
    """A radius in centimetres or inches would make the wheels turn many times too fast."""
    with pytest.raises(DescriptionError, match=r"by its description, and measured it can be"):
        apply_calibration(load_robot(), measured)


def test_the_antenna_moves_and_nothing_else() -> None:
    robot = load_robot()
    moved = apply_calibration(robot, CalibrationConfig(antenna_m=(0.31, -0.07)))
    before = robot.body_from_link(robot.gnss.link)[:3, 3]
    after = moved.body_from_link(moved.gnss.link)[:3, 3]
    assert after[:2] == pytest.approx([0.31, -0.07])
    assert after[2] == pytest.approx(before[2])
    assert robot.mag is not None
    for link in (robot.imu.link, robot.mag.link):
        assert np.array_equal(robot.body_from_link(link), moved.body_from_link(link))
    assert apply_calibration(robot, CalibrationConfig()) is robot
