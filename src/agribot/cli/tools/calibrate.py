"""`agribot calibrate`: measure wheels, compass, antenna and camera on a drive."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app.calibration.figure import FIGURE
from agribot.app.calibration.wheels import WheelsResult, assess_wheels, format_wheels
from agribot.cli.ranges import seed
from agribot.cli.tools import calibration_motors, calibration_rows
from agribot.cli.tools.calibration_camera import format_toml, observe_drive
from agribot.core import config as settings
from agribot.core.errors import ConfigError
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.sim.random_streams import make_stream

if TYPE_CHECKING:
    from agribot.app.calibration.camera import CameraDrive, CameraResult, RowViewResult
    from agribot.app.calibration.figure import DriveSamples, FigureMotion
    from agribot.app.calibration.row_mount import RowMountResult
    from agribot.app.calibration.sensors import AntennaResult, MagResult
    from agribot.cli.tools.calibration_motors import MotorsResult

    Result = (
        WheelsResult | MagResult | AntennaResult | CameraResult | RowMountResult | RowViewResult
        | MotorsResult
    )  # fmt: skip
    Outcome = tuple[Result, str]

# name -> (one line of help, an example)
SUBJECTS = {
    "drive": ("wheel radius and effective separation", "drive --sensors rtk --json"),
    "magnetometer": (
        "the robot's own iron, hard and soft",
        "magnetometer --recording runs/first/run.mcap",
    ),
    "antenna": ("where the GNSS antenna sits", "antenna --sensors rtk"),
    "camera": ("pitch, yaw, roll and height of its mount", "camera --profile farm"),
    "row-view": ("whether rows are seen where they stand", "row-view --profile rows-10x12"),
    "motors": (
        "keep what the motors of a real robot are; nothing is driven",
        "motors --counts-per-turn 2048 --full-speed-rpm 80",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    subjects = parser.add_subparsers(dest="subject", metavar="WHAT", required=True)
    for name, (help_line, example) in SUBJECTS.items():
        subjects.add_parser(name, help=help_line, epilog=f"example: agribot calibrate {example}")
    for name in ("drive", "magnetometer", "antenna"):
        _add_common(subjects.choices[name])
    for name, profile in (("camera", "farm"), ("row-view", "rows-10x12")):
        parser_of = subjects.choices[name]
        _add_robot(parser_of)
        parser_of.add_argument(
            "--profile", default=profile, metavar="NAME|FILE",
            help="whose mission is driven for a while (default: %(default)s)",
        )  # fmt: skip
    calibration_motors.add_arguments(subjects.choices["motors"])
    calibration_rows.add_arguments(subjects.choices["camera"])
    for name in ("magnetometer", "camera", "row-view"):
        subjects.choices[name].add_argument(
            "--recording", metavar="FILE", help="of a mission that turned, instead of a drive"
        )
    subjects.choices["drive"].add_argument(
        "--tape",
        action="store_true",
        help="measure the legs by tape (simulated: to 1 cm), where GNSS is too coarse",
    )


def _add_common(drive: argparse.ArgumentParser) -> None:
    drive.add_argument("--world", default="empty", metavar="NAME|FILE", help="needs 8 m x 8 m")
    _add_robot(drive)


def _add_robot(drive: argparse.ArgumentParser) -> None:
    drive.add_argument("--robot", default="agribot", metavar="NAME|FILE", help="to be calibrated")
    drive.add_argument(
        "--machine",
        metavar="NAME|FILE",
        help="build the simulated machine from this description instead, to see an error found",
    )
    drive.add_argument("--sensors", default="rtk", metavar="PRESET", help="default: rtk")
    drive.add_argument("--seed", type=seed, default=0, metavar="N", help="of all randomness")
    drive.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    from agribot.description.loader import load_robot

    if getattr(options, "recording", None) == "":
        raise ConfigError("--recording: empty; give the run.mcap of a run, or leave it out")
    if options.subject == "motors":
        return _report(options, calibration_motors.keep_motors(options))
    robot = load_robot(options.robot)
    machine = load_robot(options.machine) if options.machine else robot
    runners: dict[str, Callable[[argparse.Namespace, RobotSpec, RobotSpec], Outcome]] = {
        "drive": _calibrate_wheels, "magnetometer": _calibrate_magnetometer,
        "antenna": _calibrate_antenna,
        "camera": _calibrate_camera, "row-view": _assess_row_view,
    }  # fmt: skip
    return _report(options, runners[options.subject](options, robot, machine))


def _report(options: argparse.Namespace, outcome: Outcome) -> int:
    result, text = outcome
    sys.stderr.write(text)
    if options.json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    return 0 if result.ok else 1


def _calibrate_wheels(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    from agribot.app.calibration.drive_fit import fit_drive
    from agribot.app.calibration.figure import measure_gain

    described = _drive(options, machine, robot.drive)
    original = _drive(options, machine, robot.drive.with_plugin_geometry())
    fit = fit_drive(described.batches, described.stretches)
    result = assess_wheels(
        robot.drive, fit, measure_gain(described, fit), measure_gain(original, fit)
    )
    return result, format_wheels(robot.drive, result)


def _calibrate_magnetometer(
    options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec
) -> Outcome:
    from agribot.app.calibration.figure import TURNS
    from agribot.app.calibration.sensors import (
        calibrate_magnetometer,
        calibrate_recorded_magnetometer,
        format_magnetometer,
    )
    from agribot.record.replay import read_config

    if options.recording:
        path = Path(options.recording)
        result = calibrate_recorded_magnetometer(path)
        declination_deg = read_config(path).field.declination_deg or 0.0
        sys.stderr.write(f"declination: {declination_deg:g} deg, as the recording's settings say\n")
    elif robot.mag is None:
        raise ConfigError(
            f"{options.robot}: its description has no magnetometer, so that there is nothing to "
            "calibrate; its heading follows from the first metres driven"
        )
    else:
        result = calibrate_magnetometer(_drive(options, machine, robot.drive, TURNS), 0.0)
    return result, format_magnetometer(result)


def _calibrate_antenna(
    options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec
) -> Outcome:
    from agribot.app.calibration.figure import TURNS
    from agribot.app.calibration.sensors import calibrate_antenna, format_antenna

    result = calibrate_antenna(_drive(options, machine, robot.drive, TURNS), robot)
    return result, format_antenna(result)


def _calibrate_camera(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    from agribot.app.calibration.camera import calibrate_camera, format_camera

    calibration_rows.check_options(options)
    if options.rows:
        return calibration_rows.calibrate_by_rows(options)
    result = calibrate_camera(_observe(options, robot, machine))
    return result, format_camera(result)


def _assess_row_view(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> Outcome:
    from agribot.app.calibration.camera import assess_row_view, format_row_view

    result = assess_row_view(_observe(options, robot, machine))
    return result, format_row_view(result)


def _observe(options: argparse.Namespace, robot: RobotSpec, machine: RobotSpec) -> CameraDrive:
    from agribot.app.calibration.camera import observe_recording

    if options.recording:
        return observe_recording(Path(options.recording))
    return observe_drive(robot, machine, options.profile, options.sensors, options.seed)


def _drive(
    options: argparse.Namespace,
    machine: RobotSpec,
    board: DriveSpec,
    figure: Sequence[FigureMotion] = FIGURE,
) -> DriveSamples:
    """Drive the figure with a machine whose motor board assumes the geometry `board`."""
    from agribot.app.calibration.drive_fit import TAPE_STD_M
    from agribot.app.calibration.figure import drive_figure
    from agribot.description.worlds_sdf import load_world
    from agribot.sim.platform import SimPlatform

    config = settings.load(
        "farm",
        [
            "perception.enabled=false",
            f"sim.sensors={format_toml(options.sensors)}",
            f"seed={format_toml(options.seed)}",
        ],
    )
    platform = SimPlatform(config, machine, load_world(options.world), board=board)
    rng = make_stream(options.seed, "tape")

    def tape() -> tuple[float, float]:
        truth = platform.truth()
        x_error_m, y_error_m = (TAPE_STD_M / math.sqrt(2.0) * rng.standard_normal(2)).tolist()
        return truth.x_map_m + x_error_m, truth.y_map_m + y_error_m

    try:
        uses_tape = options.subject == "drive" and options.tape
        return drive_figure(platform, board, tape if uses_tape else None, figure)
    finally:
        platform.close()
